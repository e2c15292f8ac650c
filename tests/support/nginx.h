#pragma once
// Debian's nginx (nginx-light) on ports of 127.0.0.1 that nobody else has, for as long as the object lives.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "tests/support/temporary_directory.h"

namespace support {

/// The path of nginx; empty when it is not installed.
inline std::string nginxProgram() {
  for (const char* path : {"/usr/sbin/nginx", "/usr/bin/nginx", "/usr/local/sbin/nginx"})
    if (::access(path, X_OK) == 0) return path;
  return "";
}

/// Skips the test when nginx is not installed; for a test's first line, or SetUp.
#define LUMIGRID_SKIP_WITHOUT_NGINX() \
  if (support::nginxProgram().empty()) GTEST_SKIP() << "nginx is not installed (Debian: nginx-light)"

inline void replaceAll(std::string& text, const std::string& what, const std::string& by) {
  for (std::size_t at = 0; (at = text.find(what, at)) != std::string::npos; at += by.size())
    text.replace(at, what.size(), by);
}

/// A port at which nobody listens at present.
inline std::uint16_t freePort() {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof(address);
  EXPECT_EQ(::bind(fd, reinterpret_cast<sockaddr*>(&address), size), 0);
  EXPECT_EQ(::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size), 0);
  ::close(fd);
  return ntohs(address.sin_port);
}

class Nginx {
 public:
  /// `lines`: its http block with the servers; $PORT0, $PORT1 … stand for ports.
  struct Configuration {
    std::string http;
    std::size_t ports = 1;
  };

  /// Serves the files under `root` at url(). `lines` go into the server block: "location /secret/ { deny all; }", or
  /// "include /etc/nginx/mime.types;" for a browser.
  explicit Nginx(const std::string& root, const std::string& lines = "")
      : Nginx(Configuration{"server {\nlisten 127.0.0.1:$PORT0;\nroot " + root + ";\n" + lines + "\n}\n"}) {}
  /// The test fails when nginx does not start.
  explicit Nginx(const Configuration& configuration) {
    ::setenv("no_proxy", "127.0.0.1,localhost", 1);
    // Another process may take a port between the search and the start of nginx.
    for (int attempt = 0; attempt < 5 && !running(); ++attempt) start(configuration);
    EXPECT_TRUE(running()) << "nginx does not start: " << textOf("error.log");
  }
  ~Nginx() { stop(); }
  Nginx(const Nginx&) = delete;
  Nginx& operator=(const Nginx&) = delete;

  bool running() const { return pid_ > 0; }
  std::uint16_t port(std::size_t i = 0) const { return ports_[i]; }
  /// The address, without a slash at the end.
  std::string url() const { return "http://127.0.0.1:" + std::to_string(port()); }
  /// Returns one line per answered request, in nginx's "combined" format. A request is logged after its answer, so the
  /// last line may appear a moment after the answer.
  std::string accessLog() const { return textOf("access.log"); }
  void stop() {
    if (!running()) return;
    ::kill(pid_, SIGTERM);
    ::waitpid(pid_, nullptr, 0);
    pid_ = -1;
  }

 private:
  void start(const Configuration& configuration) {
    ports_.clear();
    while (ports_.size() < configuration.ports) ports_.push_back(freePort());
    writeConfiguration(configuration.http);
    std::vector<std::string> words{
        nginxProgram(), "-p", directory_.path(), "-c", directory_ / "nginx.conf", "-e", directory_ / "error.log"};
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    pid_ = ::fork();
    if (pid_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGTERM);  // a test that crashes leaves no server behind
      ::close_range(3, ~0U, 0);            // ports of the test's own servers would stay open in nginx
      ::execv(argv[0], argv.data());
      ::_exit(127);
    }
    // nginx writes its pid file when it listens at all ports. An answer at one port might be another process's.
    while (running() && !std::filesystem::exists(directory_ / "nginx.pid")) {
      if (::waitpid(pid_, nullptr, WNOHANG) == pid_) pid_ = -1;
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
    }
  }

  void writeConfiguration(std::string http) const {
    for (std::size_t i = 0; i < ports_.size(); ++i)
      replaceAll(http, "$PORT" + std::to_string(i), std::to_string(ports_[i]));
    std::ofstream out(directory_ / "nginx.conf");
    out << "daemon off;\nmaster_process off;\npid nginx.pid;\nevents {}\nhttp {\naccess_log access.log;\n";
    for (const char* kind : {"client_body", "proxy", "fastcgi", "uwsgi", "scgi"})
      out << kind << "_temp_path " << kind << ";\n";
    out << http << "}\n";
  }

  std::string textOf(const std::string& file) const {
    std::ifstream in(directory_ / file);
    std::ostringstream text;
    text << in.rdbuf();
    return text.str();
  }

  const TemporaryDirectory directory_;
  pid_t pid_ = -1;
  std::vector<std::uint16_t> ports_;
};

}  // namespace support
