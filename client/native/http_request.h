#pragma once
// Shared by all users of libcurl in client/native: the head of an answer, the set-up of requests, and a client that
// sends one request after the other and waits. Private to client/native.
#include <curl/curl.h>

#include <atomic>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.h"

namespace client {

/// Collects status and headers of an answer line by line. After redirects the last answer counts. Bounded.
struct HttpHead {
  int status = 0;
  bool ended = false;
  std::map<std::string, std::string> headers;  ///< names in lower case

  /// Adds one line; returns false when there are too many.
  bool add(std::string_view line);
  std::string header(const std::string& lower_case_name) const;

 private:
  std::size_t bytes_ = 0;
};

/// Sets up a request: only http and https, a few redirects, no signals, libcurl's defaults for everything else.
void setUpRequest(CURL* handle, const std::string& url);
void startCurlOnce();

struct HttpRequest {
  std::string url;
  std::string method = "GET";
  std::string range;                 ///< "0-15"; empty: all
  std::vector<std::string> headers;  ///< "Name: value"
  std::size_t max_bytes = 0;         ///< limit of the body; a longer one is aborted as soon as its length is known
  double seconds = 10.0;             ///< from connecting to the last byte
};

struct HttpResponse {
  HttpHead head;  ///< status 0: nobody answered
  base::Bytes body;
  bool too_long = false;  ///< the body exceeded max_bytes, and was aborted
  std::string problem;    ///< the reason when the answer is not whole, else empty
};

/// Sends requests on kept connections and waits for the answers. One thread sends; any may stop.
class HttpClient {
 public:
  HttpClient();
  ~HttpClient();
  HttpClient(const HttpClient&) = delete;
  HttpClient& operator=(const HttpClient&) = delete;
  HttpResponse send(const HttpRequest& request);
  /// Ends the request under way, and all that are sent later.
  void stop();

 private:
  CURLcode perform(CURL* handle);
  CURLM* multi_ = nullptr;
  std::atomic<bool> stopped_{false};
};

}  // namespace client
