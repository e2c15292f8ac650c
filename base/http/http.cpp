#include "base/http/http.h"

#include <algorithm>
#include <cctype>
#include <cstdlib>

#include "base/check.h"
#include "base/text.h"

namespace base {
namespace {

constexpr std::size_t kMaxHeadBytes = std::size_t{64} << 10;  // real servers send less than 8 KiB

void startCurlOnce() {
  static const CURLcode started = curl_global_init(CURL_GLOBAL_DEFAULT);
  LUMIGRID_CHECK(started == CURLE_OK);
}

}  // namespace

CurlHandle makeCurlHandle() {
  startCurlOnce();
  CurlHandle handle(curl_easy_init());
  LUMIGRID_CHECK(handle != nullptr);
  return handle;
}

CurlMulti makeCurlMulti() {
  startCurlOnce();
  CurlMulti multi(curl_multi_init());
  LUMIGRID_CHECK(multi != nullptr);
  return multi;
}

void appendHeader(CurlHeaders& headers, const std::string& line) {
  headers.reset(curl_slist_append(headers.release(), line.c_str()));
}

bool HttpHead::addLine(std::string_view line) {
  bytes_ += line.size();
  too_long = bytes_ > kMaxHeadBytes;
  if (too_long) return false;
  // A status line such as "HTTP/1.1 206 Partial Content".
  if (line.starts_with("HTTP/")) {
    headers.clear();
    complete = false;
    const auto space = line.find(' ');
    status = space == std::string_view::npos ? 0 : std::atoi(std::string(line.substr(space)).c_str());
    return true;
  }
  if (line == "\r\n" || line == "\n") complete = true;
  const auto colon = line.find(':');
  if (colon == std::string_view::npos) return true;
  std::string name(line.substr(0, colon));
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
  headers[name] = trimmed(line.substr(colon + 1));
  return true;
}

std::string HttpHead::header(const std::string& lower_case_name) const {
  const auto it = headers.find(lower_case_name);
  return it == headers.end() ? "" : it->second;
}

}  // namespace base
