#pragma once
// SHA-256 and HMAC-SHA-256 (FIPS 180-4, RFC 2104) over OpenSSL, a piece at a time.
#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "base/bytes.h"

namespace repository {

using Digest = std::array<std::uint8_t, 32>;

class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;
  void add(base::ByteView bytes);
  /// Once, at the end.
  Digest finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

Digest sha256(base::ByteView bytes);
Digest hmacSha256(base::ByteView key, std::string_view text);

/// Lower case.
std::string hex(base::ByteView bytes);

inline base::ByteView viewOfText(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

}  // namespace repository
