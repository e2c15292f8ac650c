#pragma once
// A fuzz target defines these two functions. Bytes from disk or wire may be anything: fuzzOne feeds one input to a
// reader, which must return a value or an error, without a crash, a sanitizer report or much memory. It aborts when a
// value breaks its promises. A target whose bytes carry checksums feeds each input twice: as it is, and with correct
// checksums.
#include <cstring>
#include <vector>

#include "base/bytes.h"
#include "base/crc32c.h"

namespace fuzz {

/// Returns valid inputs that mutations start from: at least one, and at best a few small ones.
std::vector<base::Bytes> seeds();

void fuzzOne(base::ByteView bytes);

/// The bytes with a correct CRC-32C of all others in the last four, of which there must be that many.
inline base::Bytes withChecksum(base::ByteView bytes) {
  base::Bytes signed_bytes(bytes.begin(), bytes.end());
  const std::uint32_t crc = base::crc32c(bytes.first(bytes.size() - sizeof(crc)));
  std::memcpy(signed_bytes.data() + bytes.size() - sizeof(crc), &crc, sizeof(crc));
  return signed_bytes;
}

}  // namespace fuzz
