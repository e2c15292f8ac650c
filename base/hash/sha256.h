#pragma once
// SHA-256 (FIPS 180-4), which names and checks whole files and objects, and what signs with it.
#include <array>
#include <cstdint>
#include <memory>
#include <string_view>

#include "base/bytes.h"

struct evp_md_ctx_st;  // OpenSSL's EVP_MD_CTX

namespace base {

using Sha256Digest = std::array<std::uint8_t, 32>;

/// Hashes bytes that come in pieces.
class Sha256 {
 public:
  Sha256();
  void add(ByteView bytes);
  /// Call it once, after the last piece.
  Sha256Digest finish();

 private:
  struct FreeContext {
    void operator()(evp_md_ctx_st* context) const;
  };
  std::unique_ptr<evp_md_ctx_st, FreeContext> context_;
};

Sha256Digest sha256(ByteView bytes);

/// HMAC-SHA-256 (RFC 2104): only who has the key can compute it.
Sha256Digest hmacSha256(ByteView key, std::string_view text);

/// Compares in a time that does not depend on where the digests differ, so that nobody can guess one byte by byte.
bool areEqual(const Sha256Digest& a, const Sha256Digest& b);

}  // namespace base
