#pragma once
// Debian's nginx (nginx-light) on 127.0.0.1, with a directory and ports of its own, for as long as the object lives.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <fstream>
#include <string>
#include <thread>
#include <vector>

namespace repository::test {

/// "" when it is not installed.
inline std::string nginxProgram() {
  for (const char* path : {"/usr/sbin/nginx", "/usr/bin/nginx", "/usr/local/sbin/nginx"})
    if (::access(path, X_OK) == 0) return path;
  return "";
}

class Nginx {
 public:
  /// `servers`: server blocks in which $PORT0, $PORT1 … and $DIR stand for ports and the directory. Not running() when
  /// it does not start.
  Nginx(const std::string& directory, const std::string& servers, std::size_t ports) : directory_(directory) {
    ::setenv("no_proxy", "127.0.0.1,localhost", 1);
    // Somebody may take a port between our look and its start.
    for (int attempt = 0; attempt < 5 && !running(); ++attempt) start(servers, ports);
  }
  ~Nginx() { stop(); }
  Nginx(const Nginx&) = delete;
  Nginx& operator=(const Nginx&) = delete;

  bool running() const { return pid_ > 0; }
  int port(std::size_t i) const { return ports_[i]; }
  void stop() {
    if (pid_ <= 0) return;
    ::kill(pid_, SIGTERM);
    ::waitpid(pid_, nullptr, 0);
    pid_ = -1;
  }

 private:
  void start(const std::string& servers, std::size_t ports) {
    ports_.clear();
    while (ports_.size() < ports) ports_.push_back(freePort());
    writeConfiguration(servers);
    const std::string configuration = directory_ + "/nginx.conf";
    const std::string log = directory_ + "/error.log";
    std::vector<std::string> words{nginxProgram(), "-p", directory_, "-c", configuration, "-e", log};
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    pid_ = ::fork();
    if (pid_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGTERM);  // a test that crashes leaves no server behind
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    while (pid_ > 0 && !answers(ports_.back())) {
      if (::waitpid(pid_, nullptr, WNOHANG) == pid_) pid_ = -1;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }

  void writeConfiguration(std::string servers) const {
    replaceAll(servers, "$DIR", directory_);
    for (std::size_t i = 0; i < ports_.size(); ++i)
      replaceAll(servers, "$PORT" + std::to_string(i), std::to_string(ports_[i]));
    std::ofstream out(directory_ + "/nginx.conf");
    out << "daemon off;\nmaster_process off;\npid " << directory_
        << "/nginx.pid;\nevents {}\nhttp {\n  access_log off;\n";
    for (const char* kind : {"client_body", "proxy", "fastcgi", "uwsgi", "scgi"})
      out << "  " << kind << "_temp_path " << directory_ << "/" << kind << ";\n";
    out << servers << "}\n";
  }

  static void replaceAll(std::string& text, const std::string& what, const std::string& by) {
    for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size())
      text.replace(at, what.size(), by);
  }
  static sockaddr_in loopback(int port) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    address.sin_port = htons(static_cast<std::uint16_t>(port));
    return address;
  }
  static int freePort() {
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address = loopback(0);
    socklen_t size = sizeof(address);
    const bool bound = ::bind(fd, reinterpret_cast<sockaddr*>(&address), size) == 0 &&
                       ::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) == 0;
    ::close(fd);
    return bound ? ntohs(address.sin_port) : 0;
  }
  static bool answers(int port) {
    const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    const sockaddr_in address = loopback(port);
    const bool connected = ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0;
    ::close(fd);
    return connected;
  }

  std::string directory_;
  pid_t pid_ = -1;
  std::vector<int> ports_;
};

}  // namespace repository::test
