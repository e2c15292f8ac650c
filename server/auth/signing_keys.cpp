#include "server/auth/signing_keys.h"

#include <algorithm>
#include <utility>

#include "base/file.h"
#include "base/hash/sha256.h"
#include "base/number.h"
#include "base/text.h"

namespace server {
namespace {

constexpr std::size_t kMinKeyLength = 32;  // characters; in hexadecimal 128 bits
constexpr std::size_t kSignatureLength = 2 * sizeof(base::Sha256Digest);

/// The first line tells what is signed, so that the key can sign other things too, and none passes for another.
std::string signedText(std::string_view scene, std::int64_t expires) {
  return "lumigrid link 1\n" + std::string(scene) + "\n" + std::to_string(expires);
}

base::Sha256Digest signatureOf(const std::string& key, std::string_view scene, std::int64_t expires) {
  return base::hmacSha256(base::viewOfText(key), signedText(scene, expires));
}

}  // namespace

std::optional<LinkGrant> parseLinkGrant(std::string_view text) {
  const std::size_t dot = text.find('.');
  if (dot == std::string_view::npos) return std::nullopt;
  const auto expires = base::parseDecimal(text.substr(0, dot));
  const std::string_view signature = text.substr(dot + 1);
  if (!expires || signature.size() != kSignatureLength || !base::bytesOfHex(signature)) return std::nullopt;
  return LinkGrant{static_cast<std::int64_t>(*expires), std::string(signature)};
}

base::Result<SigningKeys> SigningKeys::read(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(const base::Bytes bytes, base::readFile(path));
  const auto problem = [&](const char* what) {
    return base::Error{base::ErrorCode::kInvalidInput,
                       path + ": " + what + "; `openssl rand -hex 32 > FILE` makes a key"};
  };
  SigningKeys keys;
  for (std::string_view rest = base::textOf(bytes); !rest.empty();) {
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    std::string line = base::trimmed(rest.substr(0, end));
    rest.remove_prefix(std::min(end + 1, rest.size()));
    if (line.empty() || line.front() == '#') continue;
    if (line.size() < kMinKeyLength) return problem("a key has fewer than 32 characters");
    if (std::any_of(line.begin(), line.end(), [](char c) { return c < 0x21 || c > 0x7E; }))
      return problem("a key has spaces or other characters than printable ASCII");
    keys.keys_.push_back(std::move(line));
  }
  if (keys.keys_.empty()) return problem("holds no key");
  return keys;
}

LinkGrant SigningKeys::sign(std::string_view scene, std::int64_t expires) const {
  return {expires, base::hexOf(signatureOf(keys_.front(), scene, expires))};
}

bool SigningKeys::hasSigned(std::string_view scene, const LinkGrant& grant) const {
  const auto bytes = base::bytesOfHex(grant.signature);
  base::Sha256Digest signature{};
  if (!bytes || bytes->size() != signature.size()) return false;
  std::copy(bytes->begin(), bytes->end(), signature.begin());
  bool found = false;
  for (const std::string& key : keys_)
    found = base::areEqual(signatureOf(key, scene, grant.expires), signature) || found;
  return found;
}

std::string signedUrl(const std::string& url, const LinkGrant& grant) {
  const std::size_t end = std::min(url.find('#'), url.size());
  std::string address = url.substr(0, end);
  address += address.find('?') == std::string::npos ? '?' : '&';
  return address + "expires=" + std::to_string(grant.expires) + "&signature=" + grant.signature + url.substr(end);
}

}  // namespace server
