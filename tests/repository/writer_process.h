#pragma once
// Runs a store_writer as a child process.
#include <fcntl.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <optional>
#include <string>
#include <vector>

namespace repository::test {

class WriterProcess {
 public:
  explicit WriterProcess(std::vector<std::string> arguments) {
    arguments.insert(arguments.begin(), LUMIGRID_STORE_WRITER);
    std::vector<char*> argv;
    for (std::string& argument : arguments) argv.push_back(argument.data());
    argv.push_back(nullptr);

    int ends[2] = {-1, -1};
    if (::pipe2(ends, O_CLOEXEC) != 0) return;
    posix_spawn_file_actions_t actions;
    posix_spawn_file_actions_init(&actions);
    posix_spawn_file_actions_adddup2(&actions, ends[1], STDOUT_FILENO);
    if (::posix_spawn(&pid_, argv[0], &actions, nullptr, argv.data(), environ) != 0) pid_ = -1;
    posix_spawn_file_actions_destroy(&actions);
    ::close(ends[1]);
    read_fd_ = ends[0];
  }
  ~WriterProcess() {
    kill();
    ::close(read_fd_);
  }
  WriterProcess(const WriterProcess&) = delete;
  WriterProcess& operator=(const WriterProcess&) = delete;

  /// The number of the next batch that it reports as committed; nothing when it has ended.
  std::optional<std::uint32_t> nextCommitted() {
    std::string line;
    for (char c = 0; ::read(read_fd_, &c, 1) == 1 && c != '\n';) line += c;
    if (line.empty()) return std::nullopt;
    return static_cast<std::uint32_t>(std::stoul(line));
  }
  /// Sends SIGKILL. Earlier reports can still be read.
  void kill() {
    if (pid_ <= 0) return;
    ::kill(pid_, SIGKILL);
    wait();
  }
  /// The exit status, or −1 when it was killed.
  int wait() {
    int status = 0;
    if (pid_ <= 0 || ::waitpid(pid_, &status, 0) < 0) return -1;
    pid_ = -1;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }

 private:
  pid_t pid_ = -1;
  int read_fd_ = -1;
};

}  // namespace repository::test
