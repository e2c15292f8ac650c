#pragma once
// TLS on a connected socket that does not block: each call does as much as it can without waiting, and says what the
// socket must be ready for before it can go on. Knows no event loop; any_stream.h makes a stream of it.
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>

#include "base/bytes.h"
#include "base/tls/tls_context.h"

struct ssl_st;  // OpenSSL's SSL

namespace base {

class TlsEngine {
 public:
  enum class Step { kDone, kWantsToRead, kWantsToWrite, kClosed, kFailed };
  struct Outcome {
    Step step = Step::kFailed;
    std::size_t bytes = 0;  ///< read or written; with kDone alone
  };

  /// The server's side of a socket, which stays the caller's and must not be closed before the last call.
  static TlsEngine forServer(const TlsContext& context, int socket);
  /// The client's side. The certificate must be for `host`, a name or an IP address, and from a trusted authority.
  static TlsEngine forClient(const TlsContext& context, int socket, const std::string& host);

  Outcome handshake();
  /// Reads at least a byte; `out` is not empty. kClosed at the end of the peer's stream.
  Outcome read(std::span<std::uint8_t> out);
  /// Writes one record, at most 16 KiB; `bytes` is not empty. After kWantsToWrite, the next call begins with the same
  /// bytes, and has as many or more.
  Outcome write(ByteView bytes);
  /// Tells the peer that nothing follows, as far as that needs no waiting.
  void sendClose();
  /// Whether the peer has closed, found out without waiting and without losing what it sent.
  bool isPeerGone();

  /// After kFailed: the reason for people, such as "certificate has expired".
  const std::string& problem() const { return problem_; }
  /// After kFailed: the system's error number where the socket failed, 0 where TLS did.
  int systemError() const { return system_error_; }
  /// After a failed handshake: whether the peer sent an HTTP request in the clear.
  bool metPlainHttp() const { return met_plain_http_; }

 private:
  TlsEngine(const TlsContext& context, int socket);
  Outcome outcomeOf(int returned);
  void explainFailure();

  struct FreeSsl {
    void operator()(ssl_st* ssl) const;
  };
  std::unique_ptr<ssl_st, FreeSsl> ssl_;
  std::string problem_;
  int system_error_ = 0;
  bool met_plain_http_ = false;
  bool broken_ = false;  // after an error of the connection nothing may be sent any more
};

}  // namespace base
