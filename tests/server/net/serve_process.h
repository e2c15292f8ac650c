#pragma once
// `lumigrid serve` as a process of tests.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tests/programs/run_program.h"
#include "tests/support/temporary_directory.h"

namespace server {

/// The server runs as long as the object lives.
class ServeProcess {
 public:
  /// `standard_error`: a descriptor; it is closed here, so that the process is the only one that has it. -1: a file.
  /// `max_files`: descriptors that it may have; 0: as many as the test.
  explicit ServeProcess(const std::vector<std::string>& arguments, int standard_error = -1, rlim_t max_files = 0) {
    if (standard_error < 0) standard_error = ::open(logPath().c_str(), O_WRONLY | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
    const std::string out = directory_ / "out";
    std::vector<std::string> words{
        std::string(LUMIGRID_BIN_DIR) + "/lumigrid", "serve", "--json", "--port", "0", "--no-frames"};
    words.insert(words.end(), arguments.begin(), arguments.end());
    pid_ = ::fork();
    if (pid_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGKILL);
      ::dup2(::open(out.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0644), STDOUT_FILENO);
      ::dup2(standard_error, STDERR_FILENO);
      const rlimit files{max_files, max_files};
      if (max_files != 0) ::setrlimit(RLIMIT_NOFILE, &files);
      std::vector<char*> argv;
      for (std::string& word : words) argv.push_back(word.data());
      argv.push_back(nullptr);
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    ::close(standard_error);
    for (int i = 0; i < 2000 && port_ == 0 && isRunning(); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      const auto said = nlohmann::json::parse(programs::readText(out), nullptr, false);
      if (said.is_object()) port_ = said["port"];
    }
    EXPECT_NE(port_, 0) << "the server does not start";
  }
  ~ServeProcess() {
    if (isRunning()) ::kill(pid_, SIGKILL);
    wait();
  }

  std::uint16_t port() const { return port_; }
  pid_t pid() const { return pid_; }
  std::string log() const { return programs::readText(logPath()); }
  void send(int signal) const { ::kill(pid_, signal); }
  bool isRunning() {
    if (ended_) return false;
    int status = 0;
    if (::waitpid(pid_, &status, WNOHANG) == pid_) end(status);
    return !ended_;
  }
  /// The exit status; 128 + n where signal n ended it.
  int wait() {
    int status = 0;
    if (!ended_ && ::waitpid(pid_, &status, 0) == pid_) end(status);
    return status_;
  }

 private:
  std::string logPath() const { return directory_ / "err"; }
  void end(int status) {
    ended_ = true;
    status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }
  const support::TemporaryDirectory directory_;
  pid_t pid_ = -1;
  std::uint16_t port_ = 0;
  bool ended_ = false;
  int status_ = 0;
};

/// Waits for up to twenty seconds.
template <class Condition>
bool waitFor(const Condition& condition) {
  for (int i = 0; i < 2000; ++i) {
    if (condition()) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  return false;
}

}  // namespace server
