#pragma once
// What the uses of libcurl here share: the head of an answer, how requests are set up, and one request after the other
// for those that may wait. Private to client/native.
#include <curl/curl.h>

#include <atomic>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.h"

namespace client {

/// Status and headers of an answer, as lines come; of several answers (redirects) the last counts. Bounded.
struct HttpHead {
  int status = 0;
  bool ended = false;
  std::map<std::string, std::string> headers;  ///< names in lower case

  /// One line as it came; false when there are too many.
  bool add(std::string_view line);
  std::string header(const std::string& lower_case_name) const;

 private:
  std::size_t bytes_ = 0;
};

/// http and https alone, a few redirects, no signals; everything else as libcurl has it.
void setUpRequest(CURL* handle, const std::string& url);
void startCurlOnce();

struct HttpRequest {
  std::string url;
  std::string method = "GET";
  std::string range;                 ///< "0-15"; empty: all
  std::vector<std::string> headers;  ///< "Name: value"
  std::size_t max_bytes = 0;         ///< of the body: a longer one is broken off as soon as that is known
  double seconds = 10.0;             ///< from connecting to the last byte
};

struct HttpResponse {
  HttpHead head;  ///< status 0: nobody answered
  base::Bytes body;
  bool too_long = false;  ///< broken off
  std::string problem;    ///< why the answer is not whole; else empty
};

/// Asks and waits, on kept connections. One thread asks; any may stop.
class HttpClient {
 public:
  HttpClient();
  ~HttpClient();
  HttpClient(const HttpClient&) = delete;
  HttpClient& operator=(const HttpClient&) = delete;
  HttpResponse send(const HttpRequest& request);
  /// What is under way ends now, and so does all that is asked later.
  void stop();

 private:
  CURLcode perform(CURL* handle);
  CURLM* multi_ = nullptr;
  std::atomic<bool> stopped_{false};
};

}  // namespace client
