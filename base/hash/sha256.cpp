#include "base/hash/sha256.h"

#include <openssl/evp.h>

#include "base/check.h"

namespace base {

// OpenSSL's digests fail only in builds that have them switched off, so a failure stops the program.
struct Sha256::Context {
  EVP_MD_CTX* evp = EVP_MD_CTX_new();
  Context() { LUMIGRID_CHECK(evp != nullptr && EVP_DigestInit_ex(evp, EVP_sha256(), nullptr) == 1); }
  ~Context() { EVP_MD_CTX_free(evp); }
  Context(const Context&) = delete;
  Context& operator=(const Context&) = delete;
};

Sha256::Sha256() : context_(std::make_unique<Context>()) {}
Sha256::~Sha256() = default;

void Sha256::add(ByteView bytes) {
  LUMIGRID_CHECK_EQ(EVP_DigestUpdate(context_->evp, bytes.data(), bytes.size()), 1);
}

Sha256Digest Sha256::finish() {
  Sha256Digest digest{};
  LUMIGRID_CHECK_EQ(EVP_DigestFinal_ex(context_->evp, digest.data(), nullptr), 1);
  return digest;
}

Sha256Digest sha256(ByteView bytes) {
  Sha256 hash;
  hash.add(bytes);
  return hash.finish();
}

}  // namespace base
