#pragma once
// SHA-256 (FIPS 180-4), which names and checks whole files and objects.
#include <array>
#include <cstdint>
#include <memory>

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

}  // namespace base
