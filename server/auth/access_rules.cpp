#include "server/auth/access_rules.h"

#include <algorithm>
#include <utility>

namespace server {
namespace {

constexpr std::string_view kCookiePrefix = "lumigrid-";
constexpr std::size_t kCookieNameDigits = 8;

std::string_view takeUntil(std::string_view& rest, char separator) {
  const std::size_t end = rest.find(separator);
  const std::string_view piece = rest.substr(0, end);
  rest = end == std::string_view::npos ? std::string_view() : rest.substr(end + 1);
  return piece;
}

std::string_view withoutSpaces(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

/// A target's query, taken apart. No credential has a character that would be percent-encoded.
struct LinkQuery {
  std::string credential;  ///< empty: none
  std::string rest;        ///< the query without it
};

LinkQuery readLinkQuery(std::string_view target) {
  LinkQuery query;
  std::string_view expires, signature;
  takeUntil(target, '?');
  while (!target.empty()) {
    const std::string_view part = takeUntil(target, '&');
    std::string_view value = part;
    const std::string_view name = takeUntil(value, '=');
    if (name == "token") {
      query.credential = value;
    } else if (name == "expires") {
      expires = value;
    } else if (name == "signature") {
      signature = value;
    } else {
      query.rest += (query.rest.empty() ? "" : "&") + std::string(part);
    }
  }
  if (query.credential.empty() && !signature.empty())
    query.credential = std::string(expires) + "." + std::string(signature);
  return query;
}

std::string_view bearerOf(std::string_view authorization) {
  constexpr std::string_view kScheme = "bearer ";
  const auto same = [](char a, char b) { return (a >= 'A' && a <= 'Z' ? static_cast<char>(a - 'A' + 'a') : a) == b; };
  if (authorization.size() < kScheme.size() ||
      !std::equal(kScheme.begin(), kScheme.end(), authorization.begin(),
                  [&](char scheme, char given) { return same(given, scheme); }))
    return {};
  return withoutSpaces(authorization.substr(kScheme.size()));
}

/// The name holds a piece of the value's hash: so cookies of several links stand side by side, and servers on other
/// ports of the host, which browsers do not tell apart, do not replace each other's.
std::string cookieOf(std::string_view credential, std::int64_t seconds, bool is_secure) {
  const std::string name = base::hexOf(base::sha256(base::viewOfText(credential))).substr(0, kCookieNameDigits);
  std::string cookie = std::string(kCookiePrefix) + name + "=" + std::string(credential) + "; HttpOnly; SameSite=Lax";
  if (seconds != kNoEnd) cookie += "; Max-Age=" + std::to_string(seconds);
  if (is_secure) cookie += "; Secure";
  return cookie;
}

/// "./" and the last part of the path: what comes before it may have been changed by a proxy.
std::string cleanLocation(std::string_view target, const std::string& query) {
  const std::string_view path = target.substr(0, target.find('?'));
  return "./" + std::string(path.substr(path.rfind('/') + 1)) + (query.empty() ? "" : "?" + query);
}

Refusal unauthorized(const char* error, std::string line) {
  std::string challenge = "Bearer realm=\"lumigrid\"";
  if (error != nullptr) challenge += std::string(", error=\"") + error + "\"";
  return {401, std::move(line), {{"WWW-Authenticate", std::move(challenge)}}};
}

}  // namespace

// ---- Making

base::Result<AccessRules> AccessRules::make(const AccessOptions& options, const std::string& address) {
  const auto wrong = [](const std::string& message) { return base::Error{base::ErrorCode::kInvalidInput, message}; };
  AccessRules rules;
  rules.options_ = options;
  rules.has_tokens_ = !options.token_file.empty();
  if (rules.has_tokens_) {
    LUMIGRID_ASSIGN_OR_RETURN(rules.tokens_, readTokenFile(options.token_file));
  }
  if (!options.signing_keys.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(rules.keys_, SigningKeys::read(options.signing_keys));
  }
  if (options.is_open && rules.isPrivate())
    return wrong(
        "--open lets anybody see the scenes, --tokens and --signing-key do not; leave out the one or the other");
  if (!isLocalAddress(address) && (!options.is_public || !(options.is_open || rules.isPrivate())))
    return wrong("other machines can reach " + address +
                 "; if they shall, add --public, and either --tokens FILE or --signing-key FILE (private scenes) or "
                 "--open (anybody may see them)");
  LUMIGRID_ASSIGN_OR_RETURN(rules.origins_,
                            OriginRules::make({address, options.is_open, options.origins, options.hosts}));
  LUMIGRID_ASSIGN_OR_RETURN(rules.proxies_, TrustedProxies::parse(options.trusted_proxies));
  return rules;
}

std::vector<std::string> AccessRules::warnings(std::span<const std::string> served, std::int64_t now) const {
  std::vector<std::string> lines;
  warnOfFile(options_.token_file, lines);
  warnOfFile(options_.signing_keys, lines);
  std::size_t number = 0;
  for (const Token& token : tokens_.all()) {
    const std::string place = options_.token_file + ": token " + std::to_string(++number);
    if (token.expires && *token.expires <= now) lines.push_back(place + " has expired");
    for (const std::string& scene : token.scenes)
      if (std::find(served.begin(), served.end(), scene) == served.end())
        lines.push_back(place + " is for the scene '" + scene + "', which is not served here");
  }
  return lines;
}

void AccessRules::warnOfFile(const std::string& path, std::vector<std::string>& lines) const {
  if (!path.empty() && isReadableByAll(path))
    lines.push_back(path + " can be read by every user of this machine; chmod 600 keeps it secret");
}

// ---- Deciding

AccessRules::Credential AccessRules::lookUp(std::string_view text) const {
  if (const Token* token = tokens_.find(text)) return {token, std::nullopt};
  return {nullptr, parseLinkGrant(text)};
}

AccessRules::Credentials AccessRules::credentialsOf(const RequestHead& request) const {
  Credentials credentials;
  if (!isPrivate()) return credentials;
  const auto add = [&](std::string_view text) {
    if (!text.empty()) credentials.push_back(lookUp(text));
  };
  add(bearerOf(request.authorization));
  add(readLinkQuery(request.target).credential);
  for (std::string_view rest = request.cookie; !rest.empty();) {
    std::string_view value = withoutSpaces(takeUntil(rest, ';'));
    if (takeUntil(value, '=').starts_with(kCookiePrefix)) add(value);
  }
  return credentials;
}

AccessRules::Finding AccessRules::judge(const Credential& credential, std::string_view scene, std::int64_t now) const {
  if (const Token* token = credential.token) {
    if (token->expires && *token->expires <= now) return {Verdict::kExpired};
    if (!token->opens(scene)) return {Verdict::kOtherScene};
    return {Verdict::kOpens, token->expires.value_or(kNoEnd)};
  }
  const auto& grant = credential.grant;
  if (!grant || !keys_ || !keys_->hasSigned(scene, *grant)) return {Verdict::kUnknown};
  if (grant->expires <= now) return {Verdict::kExpired};
  return {Verdict::kOpens, grant->expires};
}

SceneAccess AccessRules::accessTo(std::string_view scene, const Credentials& credentials, std::int64_t now) const {
  if (!isPrivate()) return {};
  Finding best;
  bool expired = false, other_scene = false;
  for (const Credential& credential : credentials) {
    const Finding finding = judge(credential, scene, now);
    if (finding.verdict == Verdict::kOpens && (best.verdict != Verdict::kOpens || finding.until > best.until))
      best = finding;
    expired = expired || finding.verdict == Verdict::kExpired;
    other_scene = other_scene || finding.verdict == Verdict::kOtherScene;
  }
  if (best.verdict == Verdict::kOpens) return {std::nullopt, best.until};
  if (credentials.empty())
    return {unauthorized(nullptr,
                         "this is private: follow the link that you were given, or send a token (lumigrid-view "
                         "--token-file FILE)")};
  if (expired)
    return {unauthorized("invalid_token", "this link or token has expired; ask for a new one where you had it from")};
  if (other_scene)
    return {Refusal{403,
                    "this token is for other scenes",
                    {{"WWW-Authenticate", "Bearer realm=\"lumigrid\", error=\"insufficient_scope\""}}}};
  return {unauthorized("invalid_token",
                       "this link or token is not valid here: it is incomplete, for another scene, or was withdrawn")};
}

std::optional<AccessRules::CleanedAddress> AccessRules::cleanAddress(std::span<const std::string> scenes,
                                                                     const RequestHead& request,
                                                                     std::int64_t now) const {
  if (!isPrivate() || request.is_upgrade || (request.method != "GET" && request.method != "HEAD")) return std::nullopt;
  const LinkQuery query = readLinkQuery(request.target);
  if (query.credential.empty()) return std::nullopt;
  CleanedAddress cleaned{cleanLocation(request.target, query.rest), ""};
  const Credential of_link = lookUp(query.credential);
  for (const std::string& scene : scenes) {
    const Finding finding = judge(of_link, scene, now);
    if (finding.verdict != Verdict::kOpens) continue;
    cleaned.cookie =
        cookieOf(query.credential, finding.until == kNoEnd ? kNoEnd : finding.until - now, request.is_secure);
    return cleaned;
  }
  const Credentials credentials = credentialsOf(request);
  for (const std::string& scene : scenes)
    if (!accessTo(scene, credentials, now).refusal) return cleaned;
  return std::nullopt;
}

}  // namespace server
