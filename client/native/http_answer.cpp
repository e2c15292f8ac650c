#include "client/native/http_answer.h"

#include <algorithm>
#include <cctype>
#include <cstdlib>

namespace client {
namespace {

constexpr std::size_t kMostHeadBytes = 64 * 1024;
constexpr long kRedirects = 4;

std::string trimmed(std::string_view text) {
  const auto begin = text.find_first_not_of(" \t\r\n");
  if (begin == std::string_view::npos) return "";
  return std::string(text.substr(begin, text.find_last_not_of(" \t\r\n") - begin + 1));
}

}  // namespace

bool HttpHead::add(std::string_view line) {
  bytes_ += line.size();
  if (bytes_ > kMostHeadBytes) return false;
  if (line.substr(0, 5) == "HTTP/") {
    headers.clear();
    ended = false;
    const auto space = line.find(' ');
    status = space == std::string_view::npos ? 0 : std::atoi(std::string(line.substr(space, 5)).c_str());
    return true;
  }
  if (line == "\r\n" || line == "\n") ended = true;
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

void setUpRequest(CURL* handle, const std::string& url) {
  curl_easy_setopt(handle, CURLOPT_URL, url.c_str());
  curl_easy_setopt(handle, CURLOPT_PROTOCOLS_STR, "http,https");
  curl_easy_setopt(handle, CURLOPT_REDIR_PROTOCOLS_STR, url.rfind("https:", 0) == 0 ? "https" : "http,https");
  curl_easy_setopt(handle, CURLOPT_FOLLOWLOCATION, 1L);
  curl_easy_setopt(handle, CURLOPT_MAXREDIRS, kRedirects);
  curl_easy_setopt(handle, CURLOPT_NOSIGNAL, 1L);
  curl_easy_setopt(handle, CURLOPT_USERAGENT, "lumigrid-view");
}

void startCurlOnce() {
  static const CURLcode started = curl_global_init(CURL_GLOBAL_DEFAULT);
  static_cast<void>(started);
}

}  // namespace client
