#pragma once
// HMAC-SHA-256 (RFC 2104) over OpenSSL.
#include <cstdint>
#include <string_view>

#include "base/bytes.h"
#include "base/hash/sha256.h"

namespace repository {

base::Sha256Digest hmacSha256(base::ByteView key, std::string_view text);

inline base::ByteView viewOfText(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

}  // namespace repository
