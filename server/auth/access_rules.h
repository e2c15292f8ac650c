#pragma once
// Decides who may see which scene: tokens and signed links open private ones (docs/private-scenes.md). Nothing of a
// credential is ever in a message. Knows no sockets and no clock.
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "server/auth/client_address.h"
#include "server/auth/origin_rules.h"
#include "server/auth/request_head.h"
#include "server/auth/signing_keys.h"
#include "server/auth/token_file.h"

namespace server {

struct AccessOptions {
  std::string token_file = {};                        ///< empty: no tokens
  std::string signing_keys = {};                      ///< file; empty: no signed links
  bool is_public = false;                             ///< other machines may reach the server
  bool is_open = false;                               ///< anybody may see all scenes
  std::vector<std::string> origins = {}, hosts = {};  ///< origin_rules.h
  std::vector<std::string> trusted_proxies = {};      ///< client_address.h
};

inline constexpr std::int64_t kNoEnd = std::numeric_limits<std::int64_t>::max();

/// Whether a visitor may see a scene, and until when.
struct SceneAccess {
  std::optional<Refusal> refusal;  ///< none: the visitor may
  std::int64_t until = kNoEnd;     ///< Unix seconds
};

class AccessRules {
 public:
  /// `address`: the one that the server listens at. Errors are one line that says which option is wrong or missing; an
  /// address that other machines reach needs --public, and a word on who may see the scenes.
  static base::Result<AccessRules> make(const AccessOptions& options, const std::string& address);

  /// Whether scenes open by tokens and links only.
  bool isPrivate() const { return has_tokens_ || keys_.has_value(); }
  const OriginRules& origins() const { return origins_; }
  const TrustedProxies& proxies() const { return proxies_; }
  /// Warnings for the log: files that are no secret, tokens of scenes that are not `served`, tokens that have expired.
  std::vector<std::string> warnings(std::span<const std::string> served, std::int64_t now) const;

  /// A token or a link of a request, looked up once for all scenes. It points into the rules.
  struct Credential {
    const Token* token = nullptr;
    std::optional<LinkGrant> grant;  // neither: a text that opens nothing
  };
  using Credentials = std::vector<Credential>;
  /// Those in Authorization (Bearer), query and cookies. How many there are, the length of the request's header bounds.
  Credentials credentialsOf(const RequestHead& request) const;
  /// One credential that opens the scene is enough.
  SceneAccess accessTo(std::string_view scene, const Credentials& credentials, std::int64_t now) const;
  SceneAccess accessTo(std::string_view scene, const RequestHead& request, std::int64_t now) const {
    return accessTo(scene, credentialsOf(request), now);
  }
  /// For a request by which a visitor follows a link with a credential: moves the visitor to the same address without
  /// it, and makes it a cookie, so that it neither stays in the address nor goes into Referer. `scenes`: those of which
  /// the link must open one. Nothing when the request has no credential in its query, is none that a browser follows,
  /// or opens none of them; accessTo() then says why.
  struct CleanedAddress {
    std::string location;  ///< relative to the address asked
    std::string cookie;    ///< value of Set-Cookie; empty when another credential is there already
  };
  std::optional<CleanedAddress> cleanAddress(std::span<const std::string> scenes, const RequestHead& request,
                                             std::int64_t now) const;

 private:
  AccessRules() = default;
  enum class Verdict { kOpens, kOtherScene, kUnknown, kExpired };  // from good to bad news
  struct Finding {
    Verdict verdict = Verdict::kUnknown;
    std::int64_t until = kNoEnd;
  };
  Credential lookUp(std::string_view text) const;
  Finding judge(const Credential& credential, std::string_view scene, std::int64_t now) const;
  void warnOfFile(const std::string& path, std::vector<std::string>& lines) const;

  AccessOptions options_;
  bool has_tokens_ = false;
  TokenList tokens_;
  std::optional<SigningKeys> keys_;
  OriginRules origins_;
  TrustedProxies proxies_;
};

}  // namespace server
