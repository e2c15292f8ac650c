#pragma once
// Computes HMAC-SHA-256 (RFC 2104) with OpenSSL.
#include <cstdint>
#include <string_view>

#include "base/bytes.h"
#include "base/hash/sha256.h"

namespace repository {

base::Sha256Digest hmacSha256(base::ByteView key, std::string_view text);

}  // namespace repository
