#pragma once
// Shared by all users of libcurl in client/native: the set-up of requests, and a client that sends one request after
// the other and waits. Private to client/native.
#include <array>
#include <atomic>
#include <string>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "base/http/http.h"
#include "client/native/host_access.h"

namespace client {

/// Gets a line about what went wrong from libcurl; it outlives the request.
using CurlProblem = std::array<char, CURL_ERROR_SIZE>;
/// The line, or the code's own words where there is none.
std::string problemOf(CURLcode code, const CurlProblem& problem);

/// Sets up a request: only http and https, verified TLS, a few redirects, no signals, libcurl's defaults for everything
/// else. The token is not sent on to another host by a redirect.
void setUpRequest(CURL* handle, const std::string& url, const HostAccess& access, CurlProblem& problem);

struct HttpRequest {
  std::string url;
  std::string method = "GET";
  std::string range;                 ///< "0-15"; empty: all
  std::vector<std::string> headers;  ///< "Name: value"
  std::size_t max_bytes = 0;         ///< limit of the body; a longer one is aborted as soon as its length is known
  double seconds = 10.0;             ///< from connecting to the last byte
};

struct HttpResponse {
  base::HttpHead head;  ///< status 0: nobody answered
  base::Bytes body;
  bool too_long = false;  ///< the body exceeded max_bytes, and was aborted
  std::string problem;    ///< the reason when the answer is not whole, else empty
};

/// Sends requests on kept connections and waits for the answers. One thread sends; any may stop.
class HttpClient {
 public:
  explicit HttpClient(HostAccess access = {}) : access_(std::move(access)) {}
  HttpResponse send(const HttpRequest& request);
  /// Ends the request under way, and all that are sent later.
  void stop();

 private:
  CURLcode perform(CURL* handle);
  const HostAccess access_;
  base::CurlMulti multi_ = base::makeCurlMulti();
  std::atomic<bool> stopped_{false};
};

}  // namespace client
