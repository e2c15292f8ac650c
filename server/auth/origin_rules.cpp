#include "server/auth/origin_rules.h"

#include <algorithm>

#include "server/auth/client_address.h"

namespace server {
namespace {

std::string lowerCase(std::string_view text) {
  std::string lower(text);
  for (char& c : lower)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return lower;
}

/// The name of "Example.org:8080" or "[::1]:8080", in lower case, without brackets, port and last dot.
std::string nameOfHost(std::string_view host) {
  if (host.starts_with('[')) {
    const std::size_t end = host.find(']');
    return lowerCase(host.substr(1, end == std::string_view::npos ? end : end - 1));
  }
  std::string name = lowerCase(host.substr(0, host.find(':')));
  if (!name.empty() && name.back() == '.') name.pop_back();
  return name;
}

/// "scheme://host:port" in lower case, without the port that the scheme has anyway; empty for any other text.
std::string normalizedOrigin(std::string_view text) {
  std::string origin = lowerCase(text);
  const bool is_https = origin.starts_with("https://");
  if (!is_https && !origin.starts_with("http://")) return "";
  const std::size_t host = origin.find("//") + 2;
  if (host == origin.size() || origin.find_first_of("/?#@, ", host) != std::string::npos) return "";
  const std::string_view port = is_https ? ":443" : ":80";
  if (origin.ends_with(port)) origin.resize(origin.size() - port.size());
  return origin;
}

/// Whether a Host can be a name or an address with a port at all. Programs that stand between browsers and servers
/// differ in what they make of other characters.
bool isHostText(std::string_view host) {
  return host.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.:_-[]") ==
         std::string_view::npos;
}

bool isLoopbackName(const std::string& name) {
  if (name == "localhost" || name.ends_with(".localhost")) return true;
  const auto address = parseIpAddress(name);
  return address && address->isLoopback();
}

}  // namespace

base::Result<OriginRules> OriginRules::make(const OriginOptions& options) {
  const auto wrong = [](const std::string& message) { return base::Error{base::ErrorCode::kInvalidInput, message}; };
  OriginRules rules;
  for (const std::string& origin : options.origins) {
    std::string normalized = normalizedOrigin(origin.ends_with('/') ? origin.substr(0, origin.size() - 1) : origin);
    if (normalized.empty())
      return wrong("--allow-origin: '" + origin + "' is no origin like https://example.org or http://host:8080");
    rules.origins_.push_back(std::move(normalized));
  }
  for (const std::string& host : options.hosts) {
    std::string name = nameOfHost(
        parseIpAddress(host) && host.find(':') != std::string::npos && host.front() != '[' ? "[" + host + "]" : host);
    if (name.empty() || !isHostText(host)) return wrong("--host: '" + host + "' is no host name like example.org");
    rules.hosts_.push_back(std::move(name));
  }
  rules.any_origin_ = options.is_open && rules.origins_.empty();
  rules.loopback_names_ = isLocalAddress(options.address);
  rules.any_host_ = rules.hosts_.empty() && (options.is_open || !rules.loopback_names_);
  return rules;
}

std::optional<Refusal> OriginRules::check(const RequestHead& request) const {
  if (!isHostText(request.host))
    return Refusal{421, "the address names a host with characters that stand in no host's name"};
  if (!isHostAllowed(request))
    return Refusal{421,
                   "this server does not answer by the name in this address; whoever runs it may add the name with "
                   "`lumigrid serve --host NAME`"};
  if (!isOriginAllowed(request))
    return Refusal{403,
                   "pages of other hosts may not ask this server; whoever runs it may allow one with `lumigrid serve "
                   "--allow-origin ORIGIN`"};
  return std::nullopt;
}

HeaderFields OriginRules::fields(const RequestHead& request) const {
  constexpr const char* kExposed = "Accept-Ranges, Content-Length, Content-Range, ETag, Retry-After";
  if (any_origin_)
    return {{"Access-Control-Allow-Origin", "*"},
            {"Access-Control-Expose-Headers", kExposed},
            {"Cross-Origin-Resource-Policy", "cross-origin"}};
  HeaderFields fields{{"Cross-Origin-Resource-Policy", "same-origin"}};
  if (origins_.empty()) return fields;
  fields.emplace_back("Vary", "Origin");
  if (isListed(request)) {
    fields.emplace_back("Access-Control-Allow-Origin", request.origin);
    fields.emplace_back("Access-Control-Expose-Headers", kExposed);
  }
  return fields;
}

bool OriginRules::isHostAllowed(const RequestHead& request) const {
  if (any_host_ || request.host.empty()) return true;
  const std::string name = nameOfHost(request.host);
  if (loopback_names_ && isLoopbackName(name)) return true;
  return std::find(hosts_.begin(), hosts_.end(), name) != hosts_.end();
}

bool OriginRules::isOriginAllowed(const RequestHead& request) const {
  if (any_origin_) return true;
  if (!request.origin.empty()) return isOwnOrigin(request) || isListed(request);
  // A page that shows a picture or runs a script from here sends no Origin; newer browsers tell by Sec-Fetch-Site that
  // it is another's. Following a link is no such request.
  const bool is_own = request.fetch_site.empty() || request.fetch_site == "same-origin" || request.fetch_site == "none";
  return is_own || request.fetch_mode == "navigate";
}

/// The scheme counts where we know ours. Where TLS ends at a proxy that is not trusted, we do not.
bool OriginRules::isOwnOrigin(const RequestHead& request) const {
  const std::string origin = normalizedOrigin(request.origin);
  // Texts that are no origin ("null" of a sandboxed page, "file://") are all normalized to "", which is nobody's own.
  if (request.host.empty() || origin.empty()) return false;
  if (origin == normalizedOrigin("https://" + std::string(request.host))) return true;
  return !request.is_secure && origin == normalizedOrigin("http://" + std::string(request.host));
}

bool OriginRules::isListed(const RequestHead& request) const {
  const std::string origin = normalizedOrigin(request.origin);
  return !origin.empty() && std::find(origins_.begin(), origins_.end(), origin) != origins_.end();
}

bool isLocalAddress(const std::string& address) {
  if (address.starts_with("unix:")) return true;
  const auto parsed = parseIpAddress(address);
  return parsed && parsed->isLoopback();
}

}  // namespace server
