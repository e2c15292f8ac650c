#pragma once
// What the uses of libcurl here share: the head of an answer, and how requests are set up. Private to client/native.
#include <curl/curl.h>

#include <map>
#include <string>
#include <string_view>

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

}  // namespace client
