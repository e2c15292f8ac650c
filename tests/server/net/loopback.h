#pragma once
// LoopbackClient speaks raw WebSocket and HTTP to 127.0.0.1 in tests. Every call ends within ten seconds.
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "protocol/message.h"

namespace server {

struct HttpAnswer {
  int status = 0;                              ///< 0: no answer
  std::map<std::string, std::string> headers;  ///< names in lower case
  std::string body;
};

HttpAnswer httpRequest(std::uint16_t port, const std::string& target,
                       const std::map<std::string, std::string>& headers = {}, const std::string& method = "GET");

/// Sends the request and closes without waiting for the answer; no status.
HttpAnswer askAndLeave(std::uint16_t port, const std::string& target);

/// Connects, writes these bytes, reads until the peer closes.
std::string rawExchange(std::uint16_t port, const std::string& bytes);

class LoopbackClient {
 public:
  /// Null when the handshake fails. `receive_buffer`: bytes of the socket's, 0 = the system's choice.
  static std::unique_ptr<LoopbackClient> connect(std::uint16_t port, const std::string& path = "/",
                                                 int receive_buffer = 0);
  ~LoopbackClient();

  bool send(const protocol::ClientMessage& message) { return sendBytes(protocol::encode(message)); }
  bool sendBytes(const base::Bytes& bytes, bool binary = true);
  /// Returns the next message, or nullopt when the server closed.
  std::optional<protocol::ServerMessage> receive();
  /// The code of the server's close frame; 0 when there was none.
  int closeCode() const;
  std::string closeReason() const;
  /// Closes the handshake's way.
  void close();

 private:
  LoopbackClient() = default;
  struct State;
  std::unique_ptr<State> state_;
};

/// A bare Beast server for benchmarks: a client's messages are answered with these lists of messages in turn, none of
/// which is empty.
class PlainSender {
 public:
  explicit PlainSender(std::vector<std::vector<base::Bytes>> answers);
  ~PlainSender();
  PlainSender(const PlainSender&) = delete;
  PlainSender& operator=(const PlainSender&) = delete;
  std::uint16_t port() const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace server
