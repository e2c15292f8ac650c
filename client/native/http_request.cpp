#include "client/native/http_request.h"

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <memory>

#include "base/byte_range.h"

namespace client {
namespace {

constexpr std::size_t kMaxHeadBytes = 64 * 1024;
constexpr long kRedirects = 4;

std::string trimmed(std::string_view text) {
  const auto begin = text.find_first_not_of(" \t\r\n");
  if (begin == std::string_view::npos) return "";
  return std::string(text.substr(begin, text.find_last_not_of(" \t\r\n") - begin + 1));
}

struct CloseHandle {
  void operator()(CURL* handle) const { curl_easy_cleanup(handle); }
};
struct FreeList {
  void operator()(curl_slist* list) const { curl_slist_free_all(list); }
};

/// A response on its way.
struct Incoming {
  HttpResponse reply;
  std::size_t most = 0;

  bool add(base::ByteView bytes) {
    const auto length = base::parseDecimal(reply.head.header("content-length"));
    reply.too_long = (length && *length > most) || bytes.size() > most - reply.body.size();
    if (!reply.too_long) reply.body.insert(reply.body.end(), bytes.begin(), bytes.end());
    return !reply.too_long;
  }
};

extern "C" std::size_t incomingHeader(char* data, std::size_t size, std::size_t count, void* incoming) {
  return static_cast<Incoming*>(incoming)->reply.head.add({data, size * count}) ? size * count : 0;
}
extern "C" std::size_t incomingBody(char* data, std::size_t size, std::size_t count, void* incoming) {
  const base::ByteView bytes(reinterpret_cast<const std::uint8_t*>(data), size * count);
  return static_cast<Incoming*>(incoming)->add(bytes) ? bytes.size() : 0;
}

}  // namespace

bool HttpHead::add(std::string_view line) {
  bytes_ += line.size();
  if (bytes_ > kMaxHeadBytes) return false;
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

HttpClient::HttpClient() {
  startCurlOnce();
  multi_ = curl_multi_init();
}
HttpClient::~HttpClient() {
  curl_multi_cleanup(multi_);
}

void HttpClient::stop() {
  stopped_ = true;
  curl_multi_wakeup(multi_);
}

CURLcode HttpClient::perform(CURL* handle) {
  CURLcode result = CURLE_ABORTED_BY_CALLBACK;
  curl_multi_add_handle(multi_, handle);
  for (int running = 1; running > 0 && !stopped_;) {
    curl_multi_perform(multi_, &running);
    constexpr int kMilliseconds = 1000;
    if (running > 0) curl_multi_poll(multi_, nullptr, 0, kMilliseconds, nullptr);
  }
  int left = 0;
  while (const CURLMsg* message = curl_multi_info_read(multi_, &left))
    if (message->msg == CURLMSG_DONE) result = message->data.result;
  curl_multi_remove_handle(multi_, handle);
  return result;
}

HttpResponse HttpClient::send(const HttpRequest& request) {
  Incoming incoming;
  incoming.most = request.max_bytes;
  const std::unique_ptr<CURL, CloseHandle> handle(curl_easy_init());
  setUpRequest(handle.get(), request.url);
  if (request.method != "GET") curl_easy_setopt(handle.get(), CURLOPT_CUSTOMREQUEST, request.method.c_str());
  curl_easy_setopt(handle.get(), CURLOPT_TIMEOUT_MS, static_cast<long>(1e3 * request.seconds));
  curl_easy_setopt(handle.get(), CURLOPT_HEADERFUNCTION, incomingHeader);
  curl_easy_setopt(handle.get(), CURLOPT_HEADERDATA, &incoming);
  curl_easy_setopt(handle.get(), CURLOPT_WRITEFUNCTION, incomingBody);
  curl_easy_setopt(handle.get(), CURLOPT_WRITEDATA, &incoming);
  if (!request.range.empty()) curl_easy_setopt(handle.get(), CURLOPT_RANGE, request.range.c_str());
  std::unique_ptr<curl_slist, FreeList> headers;
  for (const std::string& header : request.headers) headers.reset(curl_slist_append(headers.release(), header.c_str()));
  curl_easy_setopt(handle.get(), CURLOPT_HTTPHEADER, headers.get());
  const CURLcode code = perform(handle.get());
  if (incoming.reply.too_long)
    incoming.reply.problem = "the answer is too large";
  else if (code != CURLE_OK)
    incoming.reply.problem = curl_easy_strerror(code);
  return std::move(incoming.reply);
}

}  // namespace client
