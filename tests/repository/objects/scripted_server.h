#pragma once
// An HTTP server on 127.0.0.1 that answers as its test scripts it, right or wrong.
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cstdlib>
#include <functional>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

namespace repository::test {

struct Answer {
  std::string bytes;         ///< status line, headers and body, as they go out
  bool close = false;        ///< afterwards; otherwise the connection stays
  bool stand_still = false;  ///< afterwards, until the server is destroyed
};

/// Returns "HTTP/1.1 206 Partial Content" and so on with a Content-Length of the body.
inline Answer answer(const std::string& status, const std::string& headers, const std::string& body) {
  return {"HTTP/1.1 " + status + "\r\n" + headers + "Content-Length: " + std::to_string(body.size()) + "\r\n\r\n" +
          body};
}

/// The answer of a correct server to a request for bytes `first` … `last` of `object`.
inline Answer part(const std::string& object, std::size_t first, std::size_t last, const std::string& headers = "") {
  return answer("206 Partial Content",
                headers + "Content-Range: bytes " + std::to_string(first) + "-" + std::to_string(last) + "/" +
                    std::to_string(object.size()) + "\r\n",
                object.substr(first, last - first + 1));
}

/// The value of a request's header; "" when it is absent.
inline std::string headerOf(const std::string& request, const std::string& name) {
  const auto at = request.find("\r\n" + name + ": ");
  if (at == std::string::npos) return "";
  const auto begin = at + name.size() + 4;
  return request.substr(begin, request.find("\r\n", begin) - begin);
}

class ScriptedServer {
 public:
  /// `number` counts the requests from 0. Several threads may call it at once.
  using Script = std::function<Answer(const std::string& request, int number)>;

  explicit ScriptedServer(Script script) : script_(std::move(script)) {
    // libcurl would ask a proxy named by the environment even for this machine.
    ::setenv("no_proxy", "127.0.0.1,localhost", 1);
    listener_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    auto* const any = reinterpret_cast<sockaddr*>(&address);
    if (::bind(listener_, any, size) != 0 || ::listen(listener_, 64) != 0 || ::getsockname(listener_, any, &size) != 0)
      std::abort();
    port_ = ntohs(address.sin_port);
    acceptor_ = std::thread([this] { acceptAll(); });
  }
  ~ScriptedServer() { stop(); }
  ScriptedServer(const ScriptedServer&) = delete;
  ScriptedServer& operator=(const ScriptedServer&) = delete;

  /// Stops listening at this port.
  void stop() {
    if (stopping_.exchange(true)) return;
    ::shutdown(listener_, SHUT_RDWR);
    acceptor_.join();
    ::close(listener_);
    {
      const std::lock_guard lock(mutex_);
      for (const int fd : connections_) ::shutdown(fd, SHUT_RDWR);
    }
    for (std::thread& thread : threads_) thread.join();
    for (const int fd : connections_) ::close(fd);
  }

  std::string url(const std::string& folder = "/scene") const {
    return "http://127.0.0.1:" + std::to_string(port_) + folder;
  }
  int port() const { return port_; }
  std::vector<std::string> requests() const {
    const std::lock_guard lock(mutex_);
    return requests_;
  }
  std::size_t connections() const {
    const std::lock_guard lock(mutex_);
    return connections_.size();
  }

 private:
  void acceptAll() {
    for (;;) {
      const int fd = ::accept4(listener_, nullptr, nullptr, SOCK_CLOEXEC);
      if (fd < 0) return;
      const std::lock_guard lock(mutex_);
      connections_.push_back(fd);
      threads_.emplace_back([this, fd] { serve(fd); });
    }
  }

  void serve(int fd) {
    std::string pending;
    for (std::string request; receive(fd, pending, request);) {
      int number = 0;
      {
        const std::lock_guard lock(mutex_);
        number = static_cast<int>(requests_.size());
        requests_.push_back(request);
      }
      const Answer said = script_(request, number);
      for (std::size_t sent = 0; sent < said.bytes.size();) {
        const ssize_t n = ::send(fd, said.bytes.data() + sent, said.bytes.size() - sent, MSG_NOSIGNAL);
        if (n <= 0) break;
        sent += static_cast<std::size_t>(n);
      }
      if (said.close) break;
      char ignored = 0;
      if (said.stand_still) {
        while (::recv(fd, &ignored, 1, 0) > 0) continue;
      }
    }
    ::shutdown(fd, SHUT_RDWR);
  }

  // Reads the next request with headers and body.
  static bool receive(int fd, std::string& pending, std::string& request) {
    for (;;) {
      if (const auto end = pending.find("\r\n\r\n"); end != std::string::npos) {
        const std::string length = headerOf(pending.substr(0, end + 2), "Content-Length");
        const std::size_t whole = end + 4 + (length.empty() ? 0 : std::stoul(length));
        if (pending.size() >= whole) {
          request = pending.substr(0, whole);
          pending.erase(0, whole);
          return true;
        }
      }
      char buffer[4096];
      const ssize_t n = ::recv(fd, buffer, sizeof(buffer), 0);
      if (n <= 0) return false;
      pending.append(buffer, static_cast<std::size_t>(n));
    }
  }

  Script script_;
  int listener_ = -1;
  int port_ = 0;
  std::atomic<bool> stopping_{false};
  std::thread acceptor_;
  mutable std::mutex mutex_;
  std::vector<int> connections_;
  std::vector<std::thread> threads_;
  std::vector<std::string> requests_;
};

}  // namespace repository::test
