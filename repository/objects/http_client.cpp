#include "repository/objects/http_client.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <random>
#include <thread>
#include <utility>

#include "base/check.h"

namespace repository {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;
using std::chrono::milliseconds;

constexpr std::size_t kMaxErrorBytes = std::size_t{64} << 10;  // an error's page is read for its message only
constexpr std::size_t kFirstReserve = std::size_t{1} << 20;    // reserved with the first bytes of a body
constexpr long kStallBytesPerSecond = 1024;                    // the "1 KiB/s" of HttpOptions::stall_timeout

// --- Receiving

// The part of an answer that has arrived so far. Nothing in it grows beyond its bound, whatever the server sends.
struct ReceivedResponse {
  HttpResponse response;
  std::uint64_t max_body_bytes = 0;

  bool isSuccess() const { return response.head.status < 300; }
  bool addHeader(std::string_view line) { return response.head.addLine(line); }
  bool addBody(base::ByteView bytes);

 private:
  bool announcesTooMuch() const {
    return isSuccess() && std::strtoull(response.head.header("content-length").c_str(), nullptr, 10) > max_body_bytes;
  }
};

// Returns false to stop the transfer.
bool ReceivedResponse::addBody(base::ByteView bytes) {
  base::Bytes& body = response.body;
  const std::uint64_t limit = isSuccess() ? max_body_bytes : kMaxErrorBytes;
  if (bytes.size() > limit - body.size() || (body.empty() && announcesTooMuch())) {
    if (isSuccess()) {
      response.too_long = true;
    } else {
      body.insert(body.end(), bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(limit - body.size()));
    }
    return false;
  }
  const std::size_t needed = body.size() + bytes.size();
  if (needed > body.capacity())
    body.reserve(std::min<std::uint64_t>(limit, std::max({needed, 2 * body.capacity(), kFirstReserve})));
  body.insert(body.end(), bytes.begin(), bytes.end());
  return true;
}

// --- One attempt

template <class Value>
void setOption(const base::CurlHandle& handle, CURLoption option, Value value) {
  LUMIGRID_CHECK(curl_easy_setopt(handle.get(), option, value) == CURLE_OK);
}

void setLimits(const base::CurlHandle& handle, const HttpOptions& options) {
  setOption(handle, CURLOPT_NOSIGNAL, 1L);
  setOption(handle, CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(options.connect_timeout.count()));
  setOption(handle, CURLOPT_LOW_SPEED_LIMIT, kStallBytesPerSecond);
  setOption(handle, CURLOPT_LOW_SPEED_TIME, static_cast<long>(options.stall_timeout.count()));
  setOption(handle, CURLOPT_MAXCONNECTS, 2L);
  setOption(handle, CURLOPT_TCP_KEEPALIVE, 1L);
  setOption(handle, CURLOPT_NETRC,
            static_cast<long>(CURL_NETRC_OPTIONAL));  // passwords come from ~/.netrc, not addresses
  if (!options.ca_file.empty()) setOption(handle, CURLOPT_CAINFO, options.ca_file.c_str());
}

void setRedirects(const base::CurlHandle& handle, const HttpRequest& request, const HttpOptions& options) {
  const bool secure = request.url.rfind("https:", 0) == 0;
  setOption(handle, CURLOPT_PROTOCOLS_STR, secure ? "https" : "http");
  setOption(handle, CURLOPT_REDIR_PROTOCOLS_STR, secure ? "https" : "http,https");
  setOption(handle, CURLOPT_FOLLOWLOCATION, request.follow_redirects ? 1L : 0L);
  setOption(handle, CURLOPT_MAXREDIRS, static_cast<long>(options.redirects));
}

void setMethod(const base::CurlHandle& handle, const HttpRequest& request) {
  if (request.method == "HEAD") {
    setOption(handle, CURLOPT_NOBODY, 1L);
  } else if (request.method == "PUT" || request.method == "POST") {
    setOption(handle, CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(request.body.size()));
    setOption(handle, CURLOPT_POSTFIELDS,
              request.body.empty() ? "" : reinterpret_cast<const char*>(request.body.data()));
    setOption(handle, CURLOPT_CUSTOMREQUEST, request.method.c_str());
  } else if (request.method != "GET") {
    setOption(handle, CURLOPT_CUSTOMREQUEST, request.method.c_str());
  }
}

base::CurlHeaders headerList(const HttpRequest& request) {
  base::CurlHeaders list;
  // An empty "Expect:" keeps libcurl from waiting for "100 Continue", which takes a second with servers that send none.
  for (const char* line : {"Expect:", "Accept-Encoding: identity", "User-Agent: lumigrid"})
    base::appendHeader(list, line);
  if (request.headers)
    for (const std::string& line : request.headers()) base::appendHeader(list, line);
  return list;
}

struct Attempt {
  CURLcode code = CURLE_OK;
  ReceivedResponse received;
  std::string detail;           // libcurl's description of `code`
  milliseconds retry_after{0};  // the pause that the server asks for
};

Attempt attemptRequest(const base::CurlHandle& handle, const HttpRequest& request, const HttpOptions& options) {
  Attempt result;
  result.received.max_body_bytes = request.max_body_bytes;
  std::array<char, CURL_ERROR_SIZE> words{};
  curl_easy_reset(handle.get());
  setLimits(handle, options);
  setRedirects(handle, request, options);
  setMethod(handle, request);
  const base::CurlHeaders headers = headerList(request);
  setOption(handle, CURLOPT_URL, request.url.c_str());
  setOption(handle, CURLOPT_PATH_AS_IS, 1L);  // a changed path would no longer fit its signature
  setOption(handle, CURLOPT_HTTPHEADER, headers.get());
  setOption(handle, CURLOPT_ERRORBUFFER, words.data());
  base::receiveInto(result.received, handle.get());

  result.code = curl_easy_perform(handle.get());
  result.detail = words[0] != '\0' ? words.data() : curl_easy_strerror(result.code);
  curl_off_t seconds = 0;
  if (curl_easy_getinfo(handle.get(), CURLINFO_RETRY_AFTER, &seconds) == CURLE_OK && seconds > 0)
    result.retry_after = milliseconds(std::min<curl_off_t>(seconds, 1000000) * 1000);
  // A write error means that addBody stopped the transfer: the bytes so far are the answer.
  if (result.code == CURLE_WRITE_ERROR && !result.received.response.head.too_long) result.code = CURLE_OK;
  // libcurl takes a connection that ends among the headers for an answer without a body.
  if (result.code == CURLE_OK && !result.received.response.head.complete) result.code = CURLE_PARTIAL_FILE;
  return result;
}

// --- Retries

bool isTransient(const Attempt& attempt) {
  switch (attempt.code) {
    case CURLE_OK: {
      const int status = attempt.received.response.head.status;
      return status == 429 || status == 500 || status == 502 || status == 503 || status == 504;
    }
    case CURLE_COULDNT_CONNECT:
    case CURLE_COULDNT_RESOLVE_HOST:
    case CURLE_OPERATION_TIMEDOUT:
    case CURLE_GOT_NOTHING:
    case CURLE_PARTIAL_FILE:
    case CURLE_RECV_ERROR:
    case CURLE_SEND_ERROR:
    case CURLE_SSL_CONNECT_ERROR:
    case CURLE_HTTP2:
    case CURLE_HTTP2_STREAM:
      return true;
    default:
      return false;
  }
}

// Exponential backoff with jitter, between half of the pause and all of it.
milliseconds pauseBefore(int retry, const HttpOptions& options) {
  thread_local std::minstd_rand random(std::random_device{}());
  milliseconds whole = options.first_pause;
  for (int i = 1; i < retry && whole < options.longest_pause; ++i) whole *= 2;
  whole = std::min(whole, options.longest_pause);
  return milliseconds(std::uniform_int_distribution<milliseconds::rep>(whole.count() / 2, whole.count())(random));
}

Error transportError(const Attempt& attempt, const HttpOptions& options) {
  const auto say = [&](const std::string& problem, ErrorCode code = ErrorCode::kNetwork) {
    return Error{code, problem};
  };
  const std::string detail = " (" + printable(attempt.detail) + ")";
  if (attempt.received.response.head.too_long) return say("the server sends endless headers; it is no object server");
  switch (attempt.code) {
    case CURLE_COULDNT_RESOLVE_HOST:
    case CURLE_COULDNT_RESOLVE_PROXY:
      return say("no such host" + detail + "; look at the address and the name server");
    case CURLE_COULDNT_CONNECT:
      return say("no connection" + detail + "; is the server running, and is this its port?");
    case CURLE_OPERATION_TIMEDOUT:
      return say("the server is too slow" + detail + "; look at the network, or try again later");
    case CURLE_PARTIAL_FILE:
      return say("the answer is truncated" + detail + "; the server or a proxy cuts connections, try again later");
    case CURLE_TOO_MANY_REDIRECTS:
      return say("redirected more than " + std::to_string(options.redirects) +
                 " times; give the address that the server redirects to");
    case CURLE_UNSUPPORTED_PROTOCOL:
      return say(
          "redirected from https to another protocol, which is not followed; give an address that stays at https");
    case CURLE_PEER_FAILED_VERIFICATION:
      return say("the server's certificate is not trusted" + detail +
                 "; name its authority's certificate with SSL_CERT_FILE");
    case CURLE_SSL_CACERT_BADFILE:
      return say("the certificates cannot be read" + detail + "; look at SSL_CERT_FILE", ErrorCode::kInvalidInput);
    case CURLE_SSL_CONNECT_ERROR:
      return say("no TLS with this server" + detail + "; is it https that it speaks at this port?");
    case CURLE_URL_MALFORMAT:
      return say("no usable address" + detail, ErrorCode::kInvalidInput);
    default:
      return say("the connection broke" + detail + "; look at the network, or try again later");
  }
}

}  // namespace

// --- The client

base::CurlHandle HttpClient::borrowHandle() const {
  const std::lock_guard lock(mutex_);
  if (idle_.empty()) return base::makeCurlHandle();
  base::CurlHandle handle = std::move(idle_.back());
  idle_.pop_back();
  return handle;
}

void HttpClient::returnHandle(base::CurlHandle handle) const {
  const std::lock_guard lock(mutex_);
  if (idle_.size() < options_.kept_connections) idle_.push_back(std::move(handle));
}

Result<HttpResponse> HttpClient::send(const HttpRequest& request) const {
  const auto begin = std::chrono::steady_clock::now();
  base::CurlHandle handle = borrowHandle();
  Attempt attempt = attemptRequest(handle, request, options_);
  for (int retry = 1; retry <= options_.retries && isTransient(attempt); ++retry) {
    if (attempt.retry_after > options_.longest_pause) break;
    const milliseconds pause = std::max(pauseBefore(retry, options_), attempt.retry_after);
    if (std::chrono::steady_clock::now() + pause > begin + options_.patience) break;
    std::this_thread::sleep_for(pause);
    attempt = attemptRequest(handle, request, options_);
  }
  returnHandle(std::move(handle));
  if (attempt.code != CURLE_OK) return transportError(attempt, options_);
  return std::move(attempt.received.response);
}

HttpOptions httpOptionsFromEnvironment() {
  HttpOptions options;
  if (const char* file = std::getenv("SSL_CERT_FILE"); file != nullptr) options.ca_file = file;
  return options;
}

std::string percentEncoded(const std::string& text, bool keep_slash) {
  constexpr const char* kDigits = "0123456789ABCDEF";
  const std::string kept = keep_slash ? "-._~/" : "-._~";
  std::string encoded;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    const bool letter = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9');
    if (letter || kept.find(c) != std::string::npos) {
      encoded += c;
    } else {
      encoded += '%';
      encoded += kDigits[byte >> 4];
      encoded += kDigits[byte & 15];
    }
  }
  return encoded;
}

std::string printable(const std::string& text) {
  std::string clean = text.substr(0, 200);
  std::replace_if(
      clean.begin(), clean.end(), [](char c) { return c < 0x20 || c > 0x7e; }, ' ');
  return clean;
}

}  // namespace repository
