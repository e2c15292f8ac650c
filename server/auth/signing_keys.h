#pragma once
// Links that open one scene until a time: the time and an HMAC-SHA-256 over scene and time stand in the query. The
// server keeps no list of them (docs/private-scenes.md).
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"

namespace server {

/// A link carries the time until which it opens its scene, and the proof.
struct LinkGrant {
  std::int64_t expires = 0;  ///< Unix seconds, from which on it opens nothing
  std::string signature;     ///< 64 lower-case hexadecimal digits

  /// "EXPIRES.SIGNATURE": the form in cookies and in the header field Authorization.
  std::string text() const { return std::to_string(expires) + "." + signature; }
};
/// Reads text(); nothing for another text.
std::optional<LinkGrant> parseLinkGrant(std::string_view text);

/// The keys of `--signing-key`. The first signs; all are accepted, so that a key can be replaced while links of the old
/// one are still in use.
class SigningKeys {
 public:
  /// Reads a key a line; empty lines and those that begin with '#' are passed over. Errors name the file, never a key:
  /// unreadable, no key, one of fewer than 32 characters or with others than printable ASCII.
  static base::Result<SigningKeys> read(const std::string& path);

  LinkGrant sign(std::string_view scene, std::int64_t expires) const;
  /// Whether one of the keys made the grant, for this scene. Whether its time is over is not asked here.
  bool hasSigned(std::string_view scene, const LinkGrant& grant) const;

 private:
  std::vector<std::string> keys_;  // at least one
};

/// `url` with the grant in its query, before a '#'.
std::string signedUrl(const std::string& url, const LinkGrant& grant);

}  // namespace server
