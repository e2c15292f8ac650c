#pragma once
// A WebSocket client that can do wrong: it has a socket and writes any frames, and checks those of the server against
// RFC 6455. Every call ends within ten seconds.
#include <arpa/inet.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

#include "base/bytes.h"

namespace server {

/// Opcodes (RFC 6455, section 5.2).
enum class Op : std::uint8_t { kContinuation = 0, kText = 1, kBinary = 2, kClose = 8, kPing = 9, kPong = 10 };

struct RawFrame {
  Op op = Op::kBinary;
  base::Bytes payload = {};
  bool fin = true;
  bool masked = true;
  std::uint8_t reserved = 0;                  ///< RSV1..RSV3 as the bits 4, 2 and 1
  std::optional<std::uint64_t> length = {};   ///< that the header claims; nothing: the payload's
  std::optional<unsigned> length_bytes = {};  ///< that the length takes after the first 7 bits: 0, 2, 8; the shortest
};

inline base::Bytes bytesOf(const std::string& text) {
  return {text.begin(), text.end()};
}

/// A close frame's payload (section 5.5.1).
inline base::Bytes closePayload(std::uint16_t code, const std::string& reason = "") {
  base::Bytes payload{static_cast<std::uint8_t>(code >> 8U), static_cast<std::uint8_t>(code & 0xFFU)};
  payload.insert(payload.end(), reason.begin(), reason.end());
  return payload;
}

inline base::Bytes encode(const RawFrame& frame) {
  const std::uint64_t length = frame.length.value_or(frame.payload.size());
  const unsigned shortest = length < 126 ? 0 : length < 65536 ? 2 : 8;
  const unsigned length_bytes = frame.length_bytes.value_or(shortest);
  base::Bytes out;
  out.push_back(static_cast<std::uint8_t>((frame.fin ? 0x80U : 0U) | unsigned{frame.reserved} << 4U |
                                          static_cast<unsigned>(frame.op)));
  const std::uint64_t short_length = length_bytes == 0 ? length : length_bytes == 2 ? 126 : 127;
  out.push_back(static_cast<std::uint8_t>((frame.masked ? 0x80U : 0U) | short_length));
  for (unsigned i = length_bytes; i-- > 0;) out.push_back(static_cast<std::uint8_t>(length >> 8U * i & 0xFFU));
  constexpr std::uint8_t kMask[4] = {0x37, 0xFA, 0x21, 0x3D};
  if (frame.masked) out.insert(out.end(), std::begin(kMask), std::end(kMask));
  for (std::size_t i = 0; i < frame.payload.size(); ++i)
    out.push_back(static_cast<std::uint8_t>(frame.payload[i] ^ (frame.masked ? kMask[i % 4] : 0)));
  return out;
}

/// A frame as the server sent it.
struct ReceivedFrame {
  Op op = Op::kBinary;
  bool fin = true;
  base::Bytes payload;
  /// The code of a close frame; 1005 where it has none (section 7.1.5).
  int closeCode() const { return payload.size() < 2 ? 1005 : payload[0] << 8 | payload[1]; }
};

class RawWebSocket {
 public:
  explicit RawWebSocket(std::uint16_t port) : socket_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const int now = 1;
    ::setsockopt(socket_, IPPROTO_TCP, TCP_NODELAY, &now, sizeof(now));
    connected_ = ::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)) == 0;
  }
  ~RawWebSocket() { ::close(socket_); }
  RawWebSocket(const RawWebSocket&) = delete;
  RawWebSocket& operator=(const RawWebSocket&) = delete;

  bool connected() const { return connected_; }
  /// False where the server has gone.
  bool write(const base::Bytes& bytes) {
    for (std::size_t sent = 0; sent < bytes.size();) {
      const ssize_t count = ::send(socket_, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
      if (count <= 0) return false;
      sent += static_cast<std::size_t>(count);
    }
    return true;
  }
  bool write(const std::string& text) { return write(bytesOf(text)); }
  bool write(const RawFrame& frame) { return write(encode(frame)); }

  /// The head of the answer to a request, with its empty line; empty where none came.
  std::string readHead() {
    while (received_.find("\r\n\r\n") == std::string::npos)
      if (!more()) return {};
    const std::size_t end = received_.find("\r\n\r\n") + 4;
    const std::string head = received_.substr(0, end);
    received_.erase(0, end);
    return head;
  }
  /// Shakes hands with the key of the RFC's section 1.3; false where the server refused.
  bool shakeHands() { return write(request("GET / HTTP/1.1", "13")) && readHead().rfind("HTTP/1.1 101", 0) == 0; }
  static std::string request(const std::string& line, const std::string& version,
                             const std::string& key = "dGhlIHNhbXBsZSBub25jZQ==") {
    return line + "\r\nHost: 127.0.0.1\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n" +
           (version.empty() ? "" : "Sec-WebSocket-Version: " + version + "\r\n") +
           (key.empty() ? "" : "Sec-WebSocket-Key: " + key + "\r\n") + "\r\n";
  }

  /// The next frame; nothing where the server closed the connection or sent one that a server must not send.
  std::optional<ReceivedFrame> readFrame() {
    while (received_.size() < 2)
      if (!more()) return std::nullopt;
    const auto byte = [&](std::size_t i) { return static_cast<std::uint8_t>(received_[i]); };
    const bool masked = (byte(1) & 0x80U) != 0;
    const unsigned reserved = byte(0) & 0x70U;
    if (masked || reserved != 0) return fail("a frame is masked or has reserved bits");
    const unsigned short_length = byte(1) & 0x7FU;
    const std::size_t length_bytes = short_length == 126 ? 2 : short_length == 127 ? 8 : 0;
    while (received_.size() < 2 + length_bytes)
      if (!more()) return std::nullopt;
    std::uint64_t length = length_bytes == 0 ? short_length : 0;
    for (std::size_t i = 0; i < length_bytes; ++i) length = length << 8U | byte(2 + i);
    if ((length_bytes == 2 && length < 126) || (length_bytes == 8 && length < 65536)) return fail("a length is padded");
    while (received_.size() < 2 + length_bytes + length)
      if (!more()) return std::nullopt;
    ReceivedFrame frame{static_cast<Op>(byte(0) & 0x0FU), (byte(0) & 0x80U) != 0, {}};
    const auto begin = received_.begin() + static_cast<std::ptrdiff_t>(2 + length_bytes);
    frame.payload.assign(begin, begin + static_cast<std::ptrdiff_t>(length));
    received_.erase(0, static_cast<std::size_t>(2 + length_bytes + length));
    return frame;
  }
  /// Reads past all frames of other kinds.
  std::optional<ReceivedFrame> readUntil(Op op) {
    while (auto frame = readFrame())
      if (frame->op == op) return frame;
    return std::nullopt;
  }
  /// Whether the server ends the connection without sending anything but what was under way.
  bool isClosed() {
    while (more()) {
    }
    return ended_;
  }
  /// Says how the server broke the protocol; empty where it did not.
  const std::string& fault() const { return fault_; }

 private:
  std::nullopt_t fail(const std::string& fault) {
    fault_ = fault;
    return std::nullopt;
  }
  bool more() {
    pollfd waits{socket_, POLLIN, 0};
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until_ - std::chrono::steady_clock::now());
    if (::poll(&waits, 1, std::max(0, static_cast<int>(left.count()))) <= 0) return false;
    char buffer[65536];
    const ssize_t count = ::recv(socket_, buffer, sizeof(buffer), 0);
    ended_ = count <= 0;
    if (count > 0) received_.append(buffer, static_cast<std::size_t>(count));
    return count > 0;
  }

  int socket_;
  bool connected_ = false, ended_ = false;
  std::string received_, fault_;
  const std::chrono::steady_clock::time_point until_ = std::chrono::steady_clock::now() + std::chrono::seconds(10);
};

}  // namespace server
