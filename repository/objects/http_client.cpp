#include "repository/objects/http_client.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdlib>
#include <mutex>
#include <random>
#include <thread>
#include <utility>

#include "base/check.h"
#include "repository/objects/curl_library.h"

namespace repository {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;
using std::chrono::milliseconds;

constexpr std::size_t kMaxHeaderBytes = std::size_t{64} << 10;
constexpr std::size_t kMaxErrorBytes = std::size_t{64} << 10;
constexpr std::size_t kFirstReserve = std::size_t{1} << 20;  // taken at once; the rest as it comes
constexpr long kStallBytesPerSecond = 1024;

// What has a handle has the library.
const CurlLibrary& curl() {
  return *curlLibrary();
}

struct CloseHandle {
  void operator()(CURL* handle) const { curl().easy_cleanup(handle); }
};
using Handle = std::unique_ptr<CURL, CloseHandle>;
struct FreeList {
  void operator()(curl_slist* list) const { curl().slist_free_all(list); }
};
using HeaderList = std::unique_ptr<curl_slist, FreeList>;

std::string lowerCase(std::string text) {
  std::transform(text.begin(), text.end(), text.begin(), [](unsigned char c) { return std::tolower(c); });
  return text;
}

// --- Receiving

// What one try has received so far. Nothing in it grows beyond its bound, whatever the server sends.
struct Receipt {
  HttpResponse response;
  std::uint64_t most_bytes = 0;
  std::size_t header_bytes = 0;
  bool headers_too_long = false;
  bool headers_whole = false;

  bool isGood() const { return response.status < 300; }
  bool startAnswer(const std::string& status_line);
  bool addHeader(const std::string& line);
  bool addBody(base::ByteView bytes);

 private:
  bool announcesTooMuch() const {
    return isGood() && std::strtoull(response.header("content-length").c_str(), nullptr, 10) > most_bytes;
  }
};

// "HTTP/1.1 206 Partial Content". A redirect or a 100 Continue has one of its own before: the last one counts.
bool Receipt::startAnswer(const std::string& status_line) {
  response = {};
  headers_whole = false;
  const auto space = status_line.find(' ');
  if (space != std::string::npos) response.status = std::atoi(status_line.c_str() + space);
  return true;
}

bool Receipt::addHeader(const std::string& line) {
  header_bytes += line.size();
  headers_too_long = header_bytes > kMaxHeaderBytes;
  if (headers_too_long) return false;
  if (line.rfind("HTTP/", 0) == 0) return startAnswer(line);
  if (line == "\r\n" || line == "\n") headers_whole = true;
  if (const auto colon = line.find(':'); colon != std::string::npos)
    response.headers[lowerCase(line.substr(0, colon))] = trimmed(line.substr(colon + 1));
  return true;
}

// False stops the transfer.
bool Receipt::addBody(base::ByteView bytes) {
  base::Bytes& body = response.body;
  const std::uint64_t limit = isGood() ? most_bytes : kMaxErrorBytes;
  if (bytes.size() > limit - body.size() || (body.empty() && announcesTooMuch())) {
    if (isGood()) {
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

extern "C" std::size_t receiveHeader(char* data, std::size_t size, std::size_t count, void* receipt) {
  return static_cast<Receipt*>(receipt)->addHeader({data, size * count}) ? size * count : 0;
}

extern "C" std::size_t receiveBody(char* data, std::size_t size, std::size_t count, void* receipt) {
  const base::ByteView bytes(reinterpret_cast<const std::uint8_t*>(data), size * count);
  return static_cast<Receipt*>(receipt)->addBody(bytes) ? bytes.size() : 0;
}

// --- One try

template <class Value>
void set(const Handle& handle, CURLoption option, Value value) {
  LUMIGRID_CHECK(curl().easy_setopt(handle.get(), option, value) == CURLE_OK);
}

void setLimits(const Handle& handle, const HttpOptions& options) {
  set(handle, CURLOPT_NOSIGNAL, 1L);
  set(handle, CURLOPT_CONNECTTIMEOUT_MS, static_cast<long>(options.connect_timeout.count()));
  set(handle, CURLOPT_LOW_SPEED_LIMIT, kStallBytesPerSecond);
  set(handle, CURLOPT_LOW_SPEED_TIME, static_cast<long>(options.stall_timeout.count()));
  set(handle, CURLOPT_MAXCONNECTS, 2L);
  set(handle, CURLOPT_TCP_KEEPALIVE, 1L);
  set(handle, CURLOPT_NETRC, static_cast<long>(CURL_NETRC_OPTIONAL));  // names and passwords stay out of addresses
  if (!options.ca_file.empty()) set(handle, CURLOPT_CAINFO, options.ca_file.c_str());
}

void setRedirects(const Handle& handle, const HttpRequest& request, const HttpOptions& options) {
  const bool secure = request.url.rfind("https:", 0) == 0;
  set(handle, CURLOPT_PROTOCOLS_STR, secure ? "https" : "http");
  set(handle, CURLOPT_REDIR_PROTOCOLS_STR, secure ? "https" : "http,https");
  set(handle, CURLOPT_FOLLOWLOCATION, request.follow_redirects ? 1L : 0L);
  set(handle, CURLOPT_MAXREDIRS, static_cast<long>(options.redirects));
}

void setMethod(const Handle& handle, const HttpRequest& request) {
  if (request.method == "HEAD") {
    set(handle, CURLOPT_NOBODY, 1L);
  } else if (request.method == "PUT" || request.method == "POST") {
    set(handle, CURLOPT_POSTFIELDSIZE_LARGE, static_cast<curl_off_t>(request.body.size()));
    set(handle, CURLOPT_POSTFIELDS, request.body.empty() ? "" : reinterpret_cast<const char*>(request.body.data()));
    set(handle, CURLOPT_CUSTOMREQUEST, request.method.c_str());
  } else if (request.method != "GET") {
    set(handle, CURLOPT_CUSTOMREQUEST, request.method.c_str());
  }
}

HeaderList headerList(const HttpRequest& request) {
  HeaderList list;
  // Waiting for "100 Continue" costs a second where a server does not know it.
  for (const char* line : {"Expect:", "Accept-Encoding: identity", "User-Agent: lumigrid"})
    list.reset(curl().slist_append(list.release(), line));
  if (request.headers)
    for (const std::string& line : request.headers()) list.reset(curl().slist_append(list.release(), line.c_str()));
  return list;
}

struct Try {
  CURLcode code = CURLE_OK;
  Receipt receipt;
  std::string detail;           // libcurl's words for `code`
  milliseconds retry_after{0};  // what the server asks for
};

Try tryOnce(const Handle& handle, const HttpRequest& request, const HttpOptions& options) {
  Try result;
  result.receipt.most_bytes = request.most_bytes;
  std::array<char, CURL_ERROR_SIZE> words{};
  curl().easy_reset(handle.get());
  setLimits(handle, options);
  setRedirects(handle, request, options);
  setMethod(handle, request);
  const HeaderList headers = headerList(request);
  set(handle, CURLOPT_URL, request.url.c_str());
  set(handle, CURLOPT_PATH_AS_IS, 1L);  // what is signed is what travels
  set(handle, CURLOPT_HTTPHEADER, headers.get());
  set(handle, CURLOPT_ERRORBUFFER, words.data());
  set(handle, CURLOPT_HEADERFUNCTION, &receiveHeader);
  set(handle, CURLOPT_HEADERDATA, &result.receipt);
  set(handle, CURLOPT_WRITEFUNCTION, &receiveBody);
  set(handle, CURLOPT_WRITEDATA, &result.receipt);

  result.code = curl().easy_perform(handle.get());
  result.detail = words[0] != '\0' ? words.data() : curl().easy_strerror(result.code);
  curl_off_t seconds = 0;
  if (curl().easy_getinfo(handle.get(), CURLINFO_RETRY_AFTER, &seconds) == CURLE_OK && seconds > 0)
    result.retry_after = milliseconds(std::min<curl_off_t>(seconds, 1000000) * 1000);
  // We stopped it ourselves: what came is the answer.
  if (result.code == CURLE_WRITE_ERROR && !result.receipt.headers_too_long) result.code = CURLE_OK;
  // To libcurl a connection that ends among the headers is an answer without a body.
  if (result.code == CURLE_OK && !result.receipt.headers_whole) result.code = CURLE_PARTIAL_FILE;
  return result;
}

// --- Trying again

bool mayPass(const Try& tried) {
  switch (tried.code) {
    case CURLE_OK: {
      const int status = tried.receipt.response.status;
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

milliseconds pauseBefore(int retry, const HttpOptions& options) {
  thread_local std::minstd_rand random(std::random_device{}());
  milliseconds whole = options.first_pause;
  for (int i = 1; i < retry && whole < options.longest_pause; ++i) whole *= 2;
  whole = std::min(whole, options.longest_pause);
  return milliseconds(std::uniform_int_distribution<milliseconds::rep>(whole.count() / 2, whole.count())(random));
}

Error transportError(const Try& tried, const HttpOptions& options) {
  const auto say = [&](const std::string& what, ErrorCode code = ErrorCode::kNetwork) { return Error{code, what}; };
  const std::string detail = " (" + printable(tried.detail) + ")";
  if (tried.receipt.headers_too_long) return say("the server sends endless headers; it is no object server");
  switch (tried.code) {
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

// libcurl's handles, each with its connections; a request borrows one.
class HttpClient::Pool {
 public:
  explicit Pool(std::size_t most) : most_(most) {}
  Handle take() {
    const std::lock_guard lock(mutex_);
    if (idle_.empty()) {
      Handle made(curl().easy_init());
      LUMIGRID_CHECK(made != nullptr);  // only without memory
      return made;
    }
    Handle handle = std::move(idle_.back());
    idle_.pop_back();
    return handle;
  }
  void giveBack(Handle handle) {
    const std::lock_guard lock(mutex_);
    if (idle_.size() < most_) idle_.push_back(std::move(handle));
  }

 private:
  std::size_t most_;
  std::mutex mutex_;
  std::vector<Handle> idle_;
};

HttpClient::HttpClient(const HttpOptions& options)
    : options_(options), pool_(std::make_unique<Pool>(options.kept_connections)) {}

HttpClient::~HttpClient() = default;

Result<HttpResponse> HttpClient::send(const HttpRequest& request) const {
  if (const auto& library = curlLibrary(); !library) return library.error();
  const auto begin = std::chrono::steady_clock::now();
  Handle handle = pool_->take();
  Try tried = tryOnce(handle, request, options_);
  for (int retry = 1; retry <= options_.retries && mayPass(tried); ++retry) {
    if (tried.retry_after > options_.longest_pause) break;
    const milliseconds pause = std::max(pauseBefore(retry, options_), tried.retry_after);
    if (std::chrono::steady_clock::now() + pause > begin + options_.patience) break;
    std::this_thread::sleep_for(pause);
    tried = tryOnce(handle, request, options_);
  }
  pool_->giveBack(std::move(handle));
  if (tried.code != CURLE_OK) return transportError(tried, options_);
  return std::move(tried.receipt.response);
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
