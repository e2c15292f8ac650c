#include "base/hash/sha256.h"

#include <openssl/crypto.h>
#include <openssl/evp.h>
#include <openssl/hmac.h>

#include "base/check.h"

namespace base {

// OpenSSL's digests fail only in builds that have them switched off, so a failure stops the program.
Sha256::Sha256() : context_(EVP_MD_CTX_new()) {
  LUMIGRID_CHECK(context_ != nullptr && EVP_DigestInit_ex(context_.get(), EVP_sha256(), nullptr) == 1);
}

void Sha256::FreeContext::operator()(evp_md_ctx_st* context) const {
  EVP_MD_CTX_free(context);
}

void Sha256::add(ByteView bytes) {
  LUMIGRID_CHECK_EQ(EVP_DigestUpdate(context_.get(), bytes.data(), bytes.size()), 1);
}

Sha256Digest Sha256::finish() {
  Sha256Digest digest{};
  LUMIGRID_CHECK_EQ(EVP_DigestFinal_ex(context_.get(), digest.data(), nullptr), 1);
  return digest;
}

Sha256Digest sha256(ByteView bytes) {
  Sha256 hash;
  hash.add(bytes);
  return hash.finish();
}

Sha256Digest hmacSha256(ByteView key, std::string_view text) {
  Sha256Digest digest{};
  const ByteView bytes = viewOfText(text);
  LUMIGRID_CHECK(HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()), bytes.data(), bytes.size(), digest.data(),
                      nullptr) != nullptr);
  return digest;
}

bool areEqual(const Sha256Digest& a, const Sha256Digest& b) {
  return CRYPTO_memcmp(a.data(), b.data(), a.size()) == 0;
}

}  // namespace base
