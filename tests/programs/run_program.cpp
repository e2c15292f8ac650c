#include "tests/programs/run_program.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <sstream>

namespace programs {

std::string readText(const std::string& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

void writeText(const std::string& path, const std::string& text) {
  std::ofstream(path, std::ios::binary) << text;
}

pid_t start(const std::string& program, const std::vector<std::string>& arguments, const std::string& log) {
  const std::string binary = std::string(LUMIGRID_BIN_DIR) + "/" + program;
  const pid_t pid = ::fork();
  if (pid != 0) return pid;
  for (auto [suffix, target] : {std::pair{".out", STDOUT_FILENO}, std::pair{".err", STDERR_FILENO}})
    ::dup2(::open((log + suffix).c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644), target);
  std::vector<std::string> words{binary};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> argv;
  for (std::string& word : words) argv.push_back(word.data());
  argv.push_back(nullptr);
  ::execv(binary.c_str(), argv.data());
  ::_exit(127);
}

int wait(pid_t pid, std::uint64_t* peak_memory_bytes) {
  int status = 0;
  rusage usage{};
  ::wait4(pid, &status, 0, &usage);
  if (peak_memory_bytes != nullptr) *peak_memory_bytes = static_cast<std::uint64_t>(usage.ru_maxrss) * 1024;
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

Outcome run(const std::string& program, const std::vector<std::string>& arguments) {
  static int runs = 0;
  const std::string log = (std::filesystem::temp_directory_path() /
                           ("lumigrid_run_" + std::to_string(::getpid()) + "_" + std::to_string(runs++)))
                              .string();
  Outcome outcome;
  outcome.status = wait(start(program, arguments, log), &outcome.peak_memory_bytes);
  outcome.out = readText(log + ".out");
  outcome.err = readText(log + ".err");
  std::filesystem::remove(log + ".out");
  std::filesystem::remove(log + ".err");
  return outcome;
}

void ProgramTest::SetUp() {
  const auto* info = ::testing::UnitTest::GetInstance()->current_test_info();
  directory_ = std::filesystem::temp_directory_path() /
               (std::string("lumigrid_") + info->name() + "_" + std::to_string(::getpid()));
  std::filesystem::create_directories(directory_);
}

std::string ProgramTest::smallMesh() {
  const std::string mesh = path("small.ply");
  if (!std::filesystem::exists(mesh)) {
    const Outcome made = run("lumigrid", {"sample", "--triangles", "10000", "-o", mesh});
    EXPECT_EQ(made.status, 0) << made.err;
  }
  return mesh;
}

std::string ProgramTest::smallScene() {
  const std::string scene = path("scene");
  const Outcome built = run("lumigrid", {"build", smallMesh(), "-o", scene, "--grid", "3", "--face", "64", "--quiet"});
  EXPECT_EQ(built.status, 0) << built.err;
  return scene;
}

void expectOneLineError(const Outcome& outcome, int status, const std::vector<std::string>& pieces) {
  EXPECT_EQ(outcome.status, status) << outcome.err;
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
  for (const std::string& piece : pieces)
    EXPECT_NE(outcome.err.find(piece), std::string::npos) << "no '" << piece << "' in: " << outcome.err;
}

}  // namespace programs
