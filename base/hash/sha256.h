#pragma once
// SHA-256 (FIPS 180-4), which names and checks whole files and objects.
#include <array>
#include <cstdint>
#include <memory>

#include "base/bytes.h"

namespace base {

using Sha256Digest = std::array<std::uint8_t, 32>;

/// Hashes bytes that come in pieces.
class Sha256 {
 public:
  Sha256();
  ~Sha256();
  Sha256(const Sha256&) = delete;
  Sha256& operator=(const Sha256&) = delete;
  void add(ByteView bytes);
  /// Call it once, after the last piece.
  Sha256Digest finish();

 private:
  struct Context;
  std::unique_ptr<Context> context_;
};

Sha256Digest sha256(ByteView bytes);
}  // namespace base
