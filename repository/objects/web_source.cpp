#include "repository/objects/web_source.h"

#include <limits>
#include <map>
#include <mutex>
#include <optional>
#include <utility>

#include "base/byte_range.h"
#include "base/number.h"

namespace repository {
namespace {

using base::Bytes;
using base::Error;
using base::ErrorCode;
using base::Result;

// The version of an object that an answer is about; a field is empty where the server does not state it.
struct Version {
  std::string tag;   // ETag
  std::string date;  // Last-Modified
  std::optional<std::uint64_t> size;

  // A server may state more in one answer than in another, so only fields that both have are compared.
  bool differsFrom(const Version& other) const {
    if (size && other.size && *size != *other.size) return true;
    if (!tag.empty() && !other.tag.empty()) return plain(tag) != plain(other.tag);
    return !date.empty() && !other.date.empty() && date != other.date;
  }

 private:
  static std::string plain(const std::string& tag) { return tag.rfind("W/", 0) == 0 ? tag.substr(2) : tag; }
};

Version versionOf(const HttpResponse& response, std::optional<std::uint64_t> size) {
  return {response.head.header("etag"), response.head.header("last-modified"), size};
}

class WebSource final : public ObjectSource {
 public:
  WebSource(std::string place, std::unique_ptr<ObjectServer> server)
      : place_(std::move(place)), server_(std::move(server)) {}

  Result<Bytes> read(const std::string& name, std::uint64_t offset, std::uint64_t length) const override {
    LUMIGRID_TRY(checkObjectName(place_, name));
    if (length == 0) return readNothing(name, offset);
    if (length - 1 > std::numeric_limits<std::int64_t>::max() - std::min<std::uint64_t>(offset, kMaxOffset))
      return tooShort(name, std::nullopt, offset, length);
    std::vector<std::string> headers{"Range: bytes=" + std::to_string(offset) + "-" +
                                     std::to_string(offset + length - 1)};
    // If-Match allows neither a weak tag (W/"…") nor a date; those are compared afterwards.
    if (const auto known = knownVersion(name); known && known->tag.rfind('"', 0) == 0)
      headers.push_back("If-Match: " + known->tag);
    LUMIGRID_ASSIGN_OR_RETURN(auto response, server_->request("GET", name, headers, length));
    switch (response.head.status) {
      case 200:
        LUMIGRID_TRY(checkWhole(name, response, offset, length));
        break;
      case 206:
        LUMIGRID_TRY(checkPart(name, response, offset, length));
        break;
      case 412:
        return changed(name);
      case 416: {
        const auto range = base::parseContentRange(response.head.header("content-range"));
        return tooShort(name, range ? range->size : std::nullopt, offset, length);
      }
      default:
        return server_->refusal(name, response);
    }
    return std::move(response.body);
  }

  Result<std::uint64_t> size(const std::string& name) const override {
    LUMIGRID_TRY(checkObjectName(place_, name));
    LUMIGRID_ASSIGN_OR_RETURN(const auto response, server_->request("HEAD", name, {}, 0));
    if (response.head.status != 200) return server_->refusal(name, response);
    LUMIGRID_TRY(checkEncoding(name, response));
    const auto size = base::parseDecimal(response.head.header("content-length"));
    if (!size)
      return Error{ErrorCode::kUnsupported,
                   server_->describe(name) +
                       ": the server does not say how long it is (no Content-Length); serve it "
                       "as a plain file"};
    const std::lock_guard lock(mutex_);
    versions_[name] = versionOf(response, size);
    return *size;
  }

  const std::string& place() const override { return place_; }

 private:
  static constexpr std::uint64_t kMaxOffset = std::numeric_limits<std::int64_t>::max();

  Result<Bytes> readNothing(const std::string& name, std::uint64_t offset) const {
    LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, size(name));
    if (offset > bytes) return tooShort(name, bytes, offset, 0);
    return Bytes();
  }

  // An answer 200 carries the whole object, which is right when the whole was asked for.
  Result<void> checkWhole(const std::string& name, const HttpResponse& response, std::uint64_t offset,
                          std::uint64_t length) const {
    LUMIGRID_TRY(checkEncoding(name, response));
    const std::uint64_t size = response.body.size();
    if (!response.too_long && offset == 0 && size == length) return checkVersion(name, versionOf(response, size));
    if (!response.too_long && (offset > size || length > size - offset)) return tooShort(name, size, offset, length);
    return Error{
        ErrorCode::kUnsupported,
        server_->describe(name) +
            ": this server ignores Range (it answers 200 with the whole object, not 206); switch ranges on, or "
            "publish to a server that has them"};
  }

  Result<void> checkPart(const std::string& name, const HttpResponse& response, std::uint64_t offset,
                         std::uint64_t length) const {
    LUMIGRID_TRY(checkEncoding(name, response));
    const std::uint64_t last = offset + length - 1;
    const std::string header = response.head.header("content-range");
    const auto range = base::parseContentRange(header);
    const auto wrong = [&](const std::string& problem) {
      return Error{ErrorCode::kNetwork, server_->describe(name) + ": bytes " + std::to_string(offset) + "-" +
                                            std::to_string(last) + " were asked for, " + problem +
                                            "; the server or a cache before it is broken"};
    };
    if (!range || !range->has_bytes) return wrong("the answer says '" + printable(header) + "'");
    if (range->first == offset && range->last < last && range->size && *range->size <= last)
      return tooShort(name, range->size, offset, length);
    if (range->first != offset || range->last != last) return wrong("the answer says '" + printable(header) + "'");
    LUMIGRID_TRY(checkVersion(name, versionOf(response, range->size)));
    if (response.too_long) return wrong("more bytes came");
    if (response.body.size() != length)
      return wrong("the answer is truncated: " + std::to_string(response.body.size()) + " bytes came");
    return {};
  }

  Result<void> checkEncoding(const std::string& name, const HttpResponse& response) const {
    const std::string encoding = response.head.header("content-encoding");
    if (encoding.empty() || encoding == "identity") return {};
    return Error{ErrorCode::kUnsupported, server_->describe(name) + ": the server compresses it (Content-Encoding: " +
                                              printable(encoding) + "); switch that off for this folder"};
  }

  std::optional<Version> knownVersion(const std::string& name) const {
    const std::lock_guard lock(mutex_);
    const auto it = versions_.find(name);
    return it == versions_.end() ? std::nullopt : std::optional(it->second);
  }

  // The first version seen is the one that all later reads must meet.
  Result<void> checkVersion(const std::string& name, const Version& seen) const {
    const std::lock_guard lock(mutex_);
    const auto [it, is_first] = versions_.emplace(name, seen);
    if (!is_first && it->second.differsFrom(seen)) return changed(name);
    return {};
  }

  Error changed(const std::string& name) const {
    return {ErrorCode::kInvalidInput,
            server_->describe(name) + ": changed while it was read; it was published anew, open the scene again"};
  }

  Error tooShort(const std::string& name, std::optional<std::uint64_t> size, std::uint64_t offset,
                 std::uint64_t length) const {
    return tooShortError(server_->describe(name), size, offset, length);
  }

  std::string place_;
  std::unique_ptr<ObjectServer> server_;
  mutable std::mutex mutex_;
  mutable std::map<std::string, Version> versions_;
};

// A plain web server, whose objects are files below a folder.
class HttpServer final : public ObjectServer {
 public:
  HttpServer(std::string place, const HttpOptions& options) : place_(std::move(place)), client_(options) {}

  Result<HttpResponse> request(const std::string& method, const std::string& name,
                               const std::vector<std::string>& headers, std::uint64_t max_body_bytes) const override {
    HttpRequest http;
    http.method = method;
    http.url = place_ + "/" + percentEncoded(name, true);
    http.headers = [&headers] { return headers; };
    http.max_body_bytes = max_body_bytes;
    http.follow_redirects = true;
    auto response = client_.send(http);
    if (!response) return base::within(describe(name), response.error());
    return response;
  }
  Error refusal(const std::string& name, const HttpResponse& response) const override {
    return statusError(describe(name), response.head.status);
  }
  std::string describe(const std::string& name) const override { return place_ + "/" + name; }

 private:
  std::string place_;
  HttpClient client_;
};

}  // namespace

std::unique_ptr<ObjectSource> makeWebSource(const std::string& place, std::unique_ptr<ObjectServer> server) {
  return std::make_unique<WebSource>(place, std::move(server));
}

Error statusError(const std::string& object, int status) {
  const std::string begin = object + ": the server answers " + std::to_string(status);
  switch (status) {
    case 401:
    case 403:
      return {ErrorCode::kIo, begin +
                                  " (not allowed): it is not public and the credentials are missing or wrong; make it "
                                  "public or give the right ones"};
    case 404:
    case 410:
      return {ErrorCode::kNotFound, begin + " (not there): look at the address, or publish the scene again"};
    case 405:
    case 501:
      return {ErrorCode::kUnsupported, begin + " (not supported): it does not serve files by HEAD and GET"};
    case 429:
    case 503:
      return {ErrorCode::kNetwork, begin + " (overloaded): try again later, or with fewer readers"};
    default:
      break;
  }
  if (status >= 500) return {ErrorCode::kNetwork, begin + " (its own fault): look into its log, or try again later"};
  return {ErrorCode::kNetwork, begin + ", which is no answer for an object: look at the address"};
}

Result<std::unique_ptr<ObjectSource>> openHttpSource(const std::string& place, const HttpOptions& options) {
  const auto wrong = [&](const std::string& problem) {
    return Error{ErrorCode::kInvalidInput, place + ": " + problem};
  };
  const auto host = place.find("://") + 3;
  const std::string authority = place.substr(host, place.find('/', host) - host);
  if (authority.find('@') != std::string::npos)
    return Error{ErrorCode::kInvalidInput, place.substr(0, host) + "…" + authority.substr(authority.rfind('@')) +
                                               ": a password in an address would show in every message; put it into "
                                               "~/.netrc"};
  if (place.find_first_of("?#") != std::string::npos)
    return wrong("an address with '?' or '#' is no folder of objects");
  if (authority.empty()) return wrong("an address without a host");
  std::string folder = place;
  while (folder.back() == '/') folder.pop_back();
  return makeWebSource(folder, std::make_unique<HttpServer>(folder, options));
}

}  // namespace repository
