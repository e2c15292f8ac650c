#include "repository/objects/http_client.h"

#include <curl/curl.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdlib>
#include <mutex>
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

// Real servers send less than 8 KiB of headers, and an error's page is read for its message only.
constexpr std::size_t kMaxHeaderBytes = std::size_t{64} << 10;
constexpr std::size_t kMaxErrorBytes = std::size_t{64} << 10;
constexpr std::size_t kFirstReserve = std::size_t{1} << 20;  // reserved with the first bytes of a body
constexpr long kStallBytesPerSecond = 1024;                  // the "1 KiB/s" of HttpOptions::stall_timeout

struct CloseHandle {
  void operator()(CURL* handle) const { curl_easy_cleanup(handle); }
};
using Handle = std::unique_ptr<CURL, CloseHandle>;
struct FreeList {
  void operator()(curl_slist* list) const { curl_slist_free_all(list); }
};
using HeaderList = std::unique_ptr<curl_slist, FreeList>;

std::string lowerCase(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

// --- Receiving

// The part of an answer that has arrived so far. Nothing in it grows beyond its bound, whatever the server sends.
struct ReceivedResponse {
  HttpResponse response;
  std::uint64_t max_body_bytes = 0;
  std::size_t header_bytes = 0;
  bool headers_too_long = false;
  bool headers_complete = false;

  bool isSuccess() const { return response.status < 300; }
  bool startResponse(const std::string& status_line);
  bool addHeader(const std::string& line);
  bool addBody(base::ByteView bytes);

 private:
  bool announcesTooMuch() const {
    return isSuccess() && std::strtoull(response.header("content-length").c_str(), nullptr, 10) > max_body_bytes;
  }
};

// Reads a line such as "HTTP/1.1 206 Partial Content". A redirect or a 100 Continue sends a status line of its own
// before; the last one counts.
bool ReceivedResponse::startResponse(const std::string& status_line) {
  response = {};
  headers_complete = false;
  const auto space = status_line.find(' ');
  if (space != std::string::npos) response.status = std::atoi(status_line.c_str() + space);
  return true;
}

bool ReceivedResponse::addHeader(const std::string& line) {
  header_bytes += line.size();
  headers_too_long = header_bytes > kMaxHeaderBytes;
  if (headers_too_long) return false;
  if (line.rfind("HTTP/", 0) == 0) return startResponse(line);
  if (line == "\r\n" || line == "\n") headers_complete = true;
  if (const auto colon = line.find(':'); colon != std::string::npos)
    response.headers[lowerCase(line.substr(0, colon))] = trimmed(line.substr(colon + 1));
  return true;
}

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

extern "C" std::size_t receiveHeader(char* data, std::size_t size, std::size_t count, void* received) {
  return static_cast<ReceivedResponse*>(received)->addHeader({data, size * count}) ? size * count : 0;
}

extern "C" std::size_t receiveBody(char* data, std::size_t size, std::size_t count, void* received) {
  const base::ByteView bytes(reinterpret_cast<const std::uint8_t*>(data), size * count);
  return static_cast<ReceivedResponse*>(received)->addBody(bytes) ? bytes.size() : 0;
}

// --- One attempt

template <class Value>
void setOption(const Handle& handle, CURLoption option, Value value) {
  LUMIGRID_CHECK(curl_easy_setopt(handle.get(), option, value) == CURLE_OK);
}

void setLimits(const Handle& handle, const HttpOptions& options) {
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

void setRedirects(const Handle& handle, const HttpRequest& request, const HttpOptions& options) {
  const bool secure = request.url.rfind("https:", 0) == 0;
  setOption(handle, CURLOPT_PROTOCOLS_STR, secure ? "https" : "http");
  setOption(handle, CURLOPT_REDIR_PROTOCOLS_STR, secure ? "https" : "http,https");
  setOption(handle, CURLOPT_FOLLOWLOCATION, request.follow_redirects ? 1L : 0L);
  setOption(handle, CURLOPT_MAXREDIRS, static_cast<long>(options.redirects));
}

void setMethod(const Handle& handle, const HttpRequest& request) {
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

HeaderList headerList(const HttpRequest& request) {
  HeaderList list;
  // An empty "Expect:" keeps libcurl from waiting for "100 Continue", which takes a second with servers that send none.
  for (const char* line : {"Expect:", "Accept-Encoding: identity", "User-Agent: lumigrid"})
    list.reset(curl_slist_append(list.release(), line));
  if (request.headers)
    for (const std::string& line : request.headers()) list.reset(curl_slist_append(list.release(), line.c_str()));
  return list;
}

struct Attempt {
  CURLcode code = CURLE_OK;
  ReceivedResponse received;
  std::string detail;           // libcurl's description of `code`
  milliseconds retry_after{0};  // the pause that the server asks for
};

Attempt attemptRequest(const Handle& handle, const HttpRequest& request, const HttpOptions& options) {
  Attempt result;
  result.received.max_body_bytes = request.max_body_bytes;
  std::array<char, CURL_ERROR_SIZE> words{};
  curl_easy_reset(handle.get());
  setLimits(handle, options);
  setRedirects(handle, request, options);
  setMethod(handle, request);
  const HeaderList headers = headerList(request);
  setOption(handle, CURLOPT_URL, request.url.c_str());
  setOption(handle, CURLOPT_PATH_AS_IS, 1L);  // a changed path would no longer fit its signature
  setOption(handle, CURLOPT_HTTPHEADER, headers.get());
  setOption(handle, CURLOPT_ERRORBUFFER, words.data());
  setOption(handle, CURLOPT_HEADERFUNCTION, &receiveHeader);
  setOption(handle, CURLOPT_HEADERDATA, &result.received);
  setOption(handle, CURLOPT_WRITEFUNCTION, &receiveBody);
  setOption(handle, CURLOPT_WRITEDATA, &result.received);

  result.code = curl_easy_perform(handle.get());
  result.detail = words[0] != '\0' ? words.data() : curl_easy_strerror(result.code);
  curl_off_t seconds = 0;
  if (curl_easy_getinfo(handle.get(), CURLINFO_RETRY_AFTER, &seconds) == CURLE_OK && seconds > 0)
    result.retry_after = milliseconds(std::min<curl_off_t>(seconds, 1000000) * 1000);
  // A write error means that addBody stopped the transfer: the bytes so far are the answer.
  if (result.code == CURLE_WRITE_ERROR && !result.received.headers_too_long) result.code = CURLE_OK;
  // libcurl takes a connection that ends among the headers for an answer without a body.
  if (result.code == CURLE_OK && !result.received.headers_complete) result.code = CURLE_PARTIAL_FILE;
  return result;
}

// --- Retries

bool isTransient(const Attempt& attempt) {
  switch (attempt.code) {
    case CURLE_OK: {
      const int status = attempt.received.response.status;
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
  const auto say = [&](const std::string& what, ErrorCode code = ErrorCode::kNetwork) { return Error{code, what}; };
  const std::string detail = " (" + printable(attempt.detail) + ")";
  if (attempt.received.headers_too_long) return say("the server sends endless headers; it is no object server");
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

// Idle libcurl handles, each with its open connections. A request borrows one of them.
class HttpClient::HandlePool {
 public:
  explicit HandlePool(std::size_t max_idle) : max_idle_(max_idle) {
    static const CURLcode started = curl_global_init(CURL_GLOBAL_DEFAULT);  // once a process
    LUMIGRID_CHECK(started == CURLE_OK);
  }
  Handle borrowHandle() {
    const std::lock_guard lock(mutex_);
    if (idle_.empty()) {
      Handle handle(curl_easy_init());
      LUMIGRID_CHECK(handle != nullptr);  // it fails only without memory
      return handle;
    }
    Handle handle = std::move(idle_.back());
    idle_.pop_back();
    return handle;
  }
  void returnHandle(Handle handle) {
    const std::lock_guard lock(mutex_);
    if (idle_.size() < max_idle_) idle_.push_back(std::move(handle));
  }

 private:
  std::size_t max_idle_;
  std::mutex mutex_;
  std::vector<Handle> idle_;
};

HttpClient::HttpClient(const HttpOptions& options)
    : options_(options), pool_(std::make_unique<HandlePool>(options.kept_connections)) {}

HttpClient::~HttpClient() = default;

Result<HttpResponse> HttpClient::send(const HttpRequest& request) const {
  const auto begin = std::chrono::steady_clock::now();
  Handle handle = pool_->borrowHandle();
  Attempt attempt = attemptRequest(handle, request, options_);
  for (int retry = 1; retry <= options_.retries && isTransient(attempt); ++retry) {
    if (attempt.retry_after > options_.longest_pause) break;
    const milliseconds pause = std::max(pauseBefore(retry, options_), attempt.retry_after);
    if (std::chrono::steady_clock::now() + pause > begin + options_.patience) break;
    std::this_thread::sleep_for(pause);
    attempt = attemptRequest(handle, request, options_);
  }
  pool_->returnHandle(std::move(handle));
  if (attempt.code != CURLE_OK) return transportError(attempt, options_);
  return std::move(attempt.received.response);
}

std::string HttpResponse::header(const std::string& lower_case_name) const {
  const auto it = headers.find(lower_case_name);
  return it == headers.end() ? "" : it->second;
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

std::string trimmed(const std::string& text) {
  const auto begin = text.find_first_not_of(" \t\r\n");
  if (begin == std::string::npos) return "";
  return text.substr(begin, text.find_last_not_of(" \t\r\n") - begin + 1);
}

std::string printable(const std::string& text) {
  std::string clean = text.substr(0, 200);
  std::replace_if(
      clean.begin(), clean.end(), [](char c) { return c < 0x20 || c > 0x7e; }, ' ');
  return clean;
}

}  // namespace repository
