#pragma once
// An HTTP client over libcurl for objects behind web servers and in buckets. It keeps connections open, verifies TLS,
// bounds the size of answers and repeats requests after transient errors.
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <mutex>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/http/http.h"

namespace repository {

struct HttpOptions {
  /// Attempts after the first one. They follow transient errors: no connection, a connection that broke or stalled, a
  /// body cut short, and status 429, 500, 502, 503 or 504.
  int retries = 4;
  /// The pause before the first retry. Each next pause is twice as long, and a random share of it between a half and
  /// the whole is waited, so that many readers do not come back at once.
  std::chrono::milliseconds first_pause{100};
  /// No pause is longer. A server that asks for a longer one (Retry-After) is not asked again.
  std::chrono::milliseconds longest_pause{5000};
  std::chrono::milliseconds connect_timeout{10000};
  /// A transfer below 1 KiB/s for this long is given up.
  std::chrono::seconds stall_timeout{20};
  /// No attempt begins later than this after the first, so that a hanging server delays a reader by less than a minute.
  std::chrono::seconds patience{30};
  int redirects = 4;                  ///< followed at most; never from https to http
  std::size_t kept_connections = 16;  ///< idle ones that stay open
  /// A file of certificates (PEM) against which servers are verified; "": the system's.
  std::string ca_file;
};

/// The defaults, with ca_file from the environment variable SSL_CERT_FILE.
HttpOptions httpOptionsFromEnvironment();

struct HttpRequest {
  std::string method;  ///< GET, HEAD, PUT, POST, DELETE
  std::string url;
  /// Returns "Name: value" lines. It is called before each attempt, since a signature holds the time.
  std::function<std::vector<std::string>()> headers;
  base::ByteView body;               ///< must live until send returns
  std::uint64_t max_body_bytes = 0;  ///< a successful answer's body is received up to here
  bool follow_redirects = false;     ///< otherwise a 3xx is an answer like any other
};

struct HttpResponse {
  base::HttpHead head;
  base::Bytes body;       ///< at most max_body_bytes; for status 300 and up the first 64 KiB
  bool too_long = false;  ///< a successful answer has more than max_body_bytes: `body` is its start, or empty
};

/// Safe from any thread.
class HttpClient {
 public:
  explicit HttpClient(const HttpOptions& options) : options_(options) {}

  /// Returns the server's answer, whatever its status, or an error (kNetwork) when there is none. The message does not
  /// name the object; callers add its name.
  base::Result<HttpResponse> send(const HttpRequest& request) const;

 private:
  base::CurlHandle borrowHandle() const;
  void returnHandle(base::CurlHandle handle) const;

  HttpOptions options_;
  mutable std::mutex mutex_;
  mutable std::vector<base::CurlHandle> idle_;  // each with its open connections; a request borrows one
};

/// Percent-encodes a text for a URL: letters, digits and -._~ stay (RFC 3986, 2.3), and so does "/" if `keep_slash`.
std::string percentEncoded(const std::string& text, bool keep_slash);

/// Makes a server's text fit for a one-line message: printable ASCII, at most 200 characters.
std::string printable(const std::string& text);

}  // namespace repository
