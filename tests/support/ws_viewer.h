#pragma once
// A viewer for load tests: a WebSocket over a raw, non-blocking socket that counts what it receives and throws it away,
// so that hundreds of them cost one core less than a server. It trusts the server.
#include <arpa/inet.h>
#include <fcntl.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cerrno>
#include <cstdint>
#include <cstring>
#include <functional>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/file.h"

namespace support {

/// Connects to a port of this machine, from 127.0.0.`last_byte` so that servers take viewers for different machines.
inline base::FileDescriptor connectTo(std::uint16_t port, std::uint8_t last_byte = 1) {
  base::FileDescriptor socket(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_in from{}, to{};
  from.sin_family = to.sin_family = AF_INET;
  from.sin_addr.s_addr = htonl(0x7F000000U | last_byte);
  to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  to.sin_port = htons(port);
  ::bind(socket.get(), reinterpret_cast<const sockaddr*>(&from), sizeof from);
  if (::connect(socket.get(), reinterpret_cast<const sockaddr*>(&to), sizeof to) != 0) return base::FileDescriptor();
  const int on = 1;
  ::setsockopt(socket.get(), IPPROTO_TCP, TCP_NODELAY, &on, sizeof on);
  return socket;
}

class WsViewer {
 public:
  /// Gets the first bytes of each message, at least 16 of them where it has as many, and its size.
  using OnMessage = std::function<void(base::ByteView front, std::size_t size)>;

  explicit WsViewer(OnMessage on_message) : on_message_(std::move(on_message)) {}

  /// Opens the connection; waits for the answer to the upgrade. False: refused.
  bool open(std::uint16_t port, std::uint8_t last_byte = 1, const std::string& path = "/") {
    socket_ = connectTo(port, last_byte);
    if (!socket_) return false;
    const std::string request = "GET " + path + " HTTP/1.1\r\nHost: 127.0.0.1:" + std::to_string(port) +
                                "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\nSec-WebSocket-Key: "
                                "dGhlIHNhbXBsZSBub25jZQ==\r\nSec-WebSocket-Version: 13\r\n\r\n";
    if (::send(socket_.get(), request.data(), request.size(), MSG_NOSIGNAL) < 0) return false;
    std::string answer;
    for (char c = 0; answer.find("\r\n\r\n") == std::string::npos && ::recv(socket_.get(), &c, 1, 0) == 1;) answer += c;
    ::fcntl(socket_.get(), F_SETFL, O_NONBLOCK);
    return answer.starts_with("HTTP/1.1 101");
  }

  /// Sends a binary message of at most 64 KB.
  bool send(const base::Bytes& message) {
    base::Bytes frame{0x82};
    if (message.size() < 126) {
      frame.push_back(static_cast<std::uint8_t>(0x80U | message.size()));
    } else {
      frame.push_back(0x80U | 126U);
      frame.push_back(static_cast<std::uint8_t>(message.size() >> 8U));
      frame.push_back(static_cast<std::uint8_t>(message.size() & 0xFFU));
    }
    frame.insert(frame.end(), 4, 0);  // a mask of zeros
    frame.insert(frame.end(), message.begin(), message.end());
    return ::send(socket_.get(), frame.data(), frame.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(frame.size());
  }

  /// Reads all that is there. False: the connection ended.
  bool read() {
    thread_local std::vector<std::uint8_t> buffer(std::size_t{1} << 20);
    for (;;) {
      const ssize_t got = ::recv(socket_.get(), buffer.data(), buffer.size(), 0);
      if (got == 0) return false;
      if (got < 0) return errno == EAGAIN || errno == EINTR;
      bytes_ += static_cast<std::uint64_t>(got);
      accept({buffer.data(), static_cast<std::size_t>(got)});
      if (static_cast<std::size_t>(got) < buffer.size()) return true;
    }
  }

  int handle() const { return socket_.get(); }
  std::uint64_t bytes() const { return bytes_; }
  void close() { socket_ = base::FileDescriptor(); }

 private:
  void accept(base::ByteView bytes) {
    while (!bytes.empty()) {
      if (left_ == 0 && !readHeader(bytes)) return;
      const std::size_t part = std::min<std::size_t>(left_, bytes.size());
      if (front_.size() < kFront)
        front_.insert(front_.end(), bytes.begin(),
                      bytes.begin() + static_cast<std::ptrdiff_t>(std::min(part, kFront - front_.size())));
      left_ -= part;
      bytes = bytes.subspan(part);
      if (left_ == 0) finish();
    }
  }

  bool readHeader(base::ByteView& bytes) {
    while (!bytes.empty()) {
      header_.push_back(bytes.front());
      bytes = bytes.subspan(1);
      if (header_.size() < 2) continue;
      const std::size_t length = header_[1] & 0x7FU;
      const std::size_t wide = length == 126 ? 2 : length == 127 ? 8 : 0;
      if (header_.size() < 2 + wide) continue;
      left_ = wide == 0 ? length : 0;
      for (std::size_t i = 0; i < wide; ++i) left_ = left_ << 8U | header_[2 + i];
      size_ = left_;
      opcode_ = header_[0] & 0x0FU;
      header_.clear();
      front_.clear();
      if (left_ == 0) finish();
      if (left_ != 0) return true;
    }
    return false;
  }

  void finish() {
    if (opcode_ == 2) on_message_(front_, size_);
    if (opcode_ == 9) {
      const base::Bytes pong{0x8A, 0x80, 0, 0, 0, 0};
      ::send(socket_.get(), pong.data(), pong.size(), MSG_NOSIGNAL);
    }
  }

  static constexpr std::size_t kFront = 64;
  OnMessage on_message_;
  base::FileDescriptor socket_;
  base::Bytes header_, front_;
  std::size_t left_ = 0, size_ = 0;
  unsigned opcode_ = 0;
  std::uint64_t bytes_ = 0;
};

}  // namespace support
