#include "repository/objects/hmac.h"

#include <openssl/evp.h>
#include <openssl/hmac.h>

#include "base/check.h"

namespace repository {

base::Sha256Digest hmacSha256(base::ByteView key, std::string_view text) {
  base::Sha256Digest digest{};
  const base::ByteView bytes = base::viewOfText(text);
  LUMIGRID_CHECK(HMAC(EVP_sha256(), key.data(), static_cast<int>(key.size()), bytes.data(), bytes.size(), digest.data(),
                      nullptr) != nullptr);
  return digest;
}

}  // namespace repository
