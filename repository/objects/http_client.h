#pragma once
// HTTP over libcurl, for objects behind web servers and in buckets: kept connections, verified TLS, bounded answers,
// and a few tries more where an error may pass.
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"

namespace repository {

struct HttpOptions {
  /// Tries after the first, for what may pass: no connection, a connection that broke or stood still, a body cut short,
  /// status 429, 500, 502, 503 and 504.
  int retries = 4;
  /// Before the first of them; each next one is twice as long, and between half of that and all of it is waited, so
  /// that many readers do not come back at once.
  std::chrono::milliseconds first_pause{100};
  /// No pause is longer. A server that asks for more (Retry-After) is not asked again.
  std::chrono::milliseconds longest_pause{5000};
  std::chrono::milliseconds connect_timeout{10000};
  /// An answer that brings less than 1 KiB/s for so long is given up.
  std::chrono::seconds stall_timeout{20};
  /// No try begins later than this after the first, so that a server that hangs costs no minutes.
  std::chrono::seconds patience{30};
  /// How many redirects are followed; never from https to http.
  int redirects = 4;
  /// Idle connections that are kept open.
  std::size_t kept_connections = 16;
  /// A file of certificates (PEM) that servers are verified against; "": the system's.
  std::string ca_file;
};

/// The defaults, with ca_file from the environment (SSL_CERT_FILE).
HttpOptions httpOptionsFromEnvironment();

struct HttpRequest {
  std::string method;  ///< GET, HEAD, PUT, POST, DELETE
  std::string url;
  /// "Name: value" lines, asked for anew before each try: a signature holds the time.
  std::function<std::vector<std::string>()> headers;
  base::ByteView body;            ///< must live until send returns
  std::uint64_t most_bytes = 0;   ///< a good answer's body beyond this is not received
  bool follow_redirects = false;  ///< otherwise a 3xx is an answer like any other
};

struct HttpResponse {
  int status = 0;
  std::map<std::string, std::string> headers;  ///< names in lower case
  base::Bytes body;                            ///< at most most_bytes; of an error (300 and up) the first 64 KiB
  bool too_long = false;  ///< the good answer has more than most_bytes: `body` is only its start, or empty

  /// "" when absent.
  std::string header(const std::string& lower_case_name) const;
};

/// From any thread.
class HttpClient {
 public:
  explicit HttpClient(const HttpOptions& options);
  ~HttpClient();
  HttpClient(const HttpClient&) = delete;
  HttpClient& operator=(const HttpClient&) = delete;

  /// The server's answer, whatever its status. An error (kNetwork) when there is none; its message does not name the
  /// object, the caller does.
  base::Result<HttpResponse> send(const HttpRequest& request) const;

 private:
  class Pool;
  HttpOptions options_;
  std::unique_ptr<Pool> pool_;
};

/// Percent-encoded for a URL: letters, digits and -._~ stay (RFC 3986, 2.3), and "/" where `keep_slash`.
std::string percentEncoded(const std::string& text, bool keep_slash);

/// Without the spaces, tabs and ends of lines around it.
std::string trimmed(const std::string& text);

/// What a server wrote, fit for a one-line message: printable ASCII, at most 200 characters.
std::string printable(const std::string& text);

}  // namespace repository
