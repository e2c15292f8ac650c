#include "client/native/http_request.h"

#include <utility>

#include "base/number.h"

namespace client {
namespace {

constexpr long kRedirects = 4;  // a choice; the limit stops hosts that redirect in circles

/// A response of which a part has arrived.
struct PartialResponse {
  HttpResponse reply;
  std::size_t max_body_bytes = 0;

  bool addHeader(std::string_view line) { return reply.head.addLine(line); }
  bool addBody(base::ByteView bytes) {
    const auto length = base::parseDecimal(reply.head.header("content-length"));
    reply.too_long = (length && *length > max_body_bytes) || bytes.size() > max_body_bytes - reply.body.size();
    if (!reply.too_long) reply.body.insert(reply.body.end(), bytes.begin(), bytes.end());
    return !reply.too_long;
  }
};

}  // namespace

std::string problemOf(CURLcode code, const CurlProblem& problem) {
  return problem[0] != '\0' ? problem.data() : curl_easy_strerror(code);
}

void setUpRequest(CURL* handle, const std::string& url, const HostAccess& access, CurlProblem& problem) {
  problem[0] = '\0';
  curl_easy_setopt(handle, CURLOPT_ERRORBUFFER, problem.data());
  curl_easy_setopt(handle, CURLOPT_URL, url.c_str());
  curl_easy_setopt(handle, CURLOPT_PROTOCOLS_STR, "http,https");
  curl_easy_setopt(handle, CURLOPT_REDIR_PROTOCOLS_STR, url.rfind("https:", 0) == 0 ? "https" : "http,https");
  curl_easy_setopt(handle, CURLOPT_FOLLOWLOCATION, 1L);
  curl_easy_setopt(handle, CURLOPT_MAXREDIRS, kRedirects);
  curl_easy_setopt(handle, CURLOPT_NOSIGNAL, 1L);
  curl_easy_setopt(handle, CURLOPT_USERAGENT, "lumigrid-view");
  curl_easy_setopt(handle, CURLOPT_SSLVERSION, CURL_SSLVERSION_TLSv1_2);
  // Replaces the system's file of authorities, but not its folder, which has the same.
  if (!access.ca_file.empty()) curl_easy_setopt(handle, CURLOPT_CAINFO, access.ca_file.c_str());
  if (!access.token.empty()) {
    curl_easy_setopt(handle, CURLOPT_HTTPAUTH, CURLAUTH_BEARER);
    curl_easy_setopt(handle, CURLOPT_XOAUTH2_BEARER, access.token.c_str());
  }
}

void HttpClient::stop() {
  stopped_ = true;
  curl_multi_wakeup(multi_.get());
}

CURLcode HttpClient::perform(CURL* handle) {
  CURLcode result = CURLE_ABORTED_BY_CALLBACK;
  curl_multi_add_handle(multi_.get(), handle);
  for (int running = 1; running > 0 && !stopped_;) {
    curl_multi_perform(multi_.get(), &running);
    constexpr int kMilliseconds = 1000;
    if (running > 0) curl_multi_poll(multi_.get(), nullptr, 0, kMilliseconds, nullptr);
  }
  int left = 0;
  while (const CURLMsg* message = curl_multi_info_read(multi_.get(), &left))
    if (message->msg == CURLMSG_DONE) result = message->data.result;
  curl_multi_remove_handle(multi_.get(), handle);
  return result;
}

HttpResponse HttpClient::send(const HttpRequest& request) {
  PartialResponse incoming;
  incoming.max_body_bytes = request.max_bytes;
  CurlProblem problem{};  // before the handle, which may write to it until its end
  const base::CurlHandle handle = base::makeCurlHandle();
  setUpRequest(handle.get(), request.url, access_, problem);
  if (request.method != "GET") curl_easy_setopt(handle.get(), CURLOPT_CUSTOMREQUEST, request.method.c_str());
  curl_easy_setopt(handle.get(), CURLOPT_TIMEOUT_MS, static_cast<long>(1e3 * request.seconds));
  base::receiveInto(incoming, handle.get());
  if (!request.range.empty()) curl_easy_setopt(handle.get(), CURLOPT_RANGE, request.range.c_str());
  base::CurlHeaders headers;
  for (const std::string& header : request.headers) base::appendHeader(headers, header);
  curl_easy_setopt(handle.get(), CURLOPT_HTTPHEADER, headers.get());
  const CURLcode code = perform(handle.get());
  if (incoming.reply.too_long)
    incoming.reply.problem = "the answer is too large";
  else if (code != CURLE_OK)
    incoming.reply.problem = problemOf(code, problem);
  return std::move(incoming.reply);
}

}  // namespace client
