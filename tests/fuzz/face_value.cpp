// decodeFaceValue on any bytes: as they are, and with their checksum made right.
#include "repository/face_value.h"

#include "base/check.h"
#include "base/crc32c.h"
#include "tests/fuzz/fuzz.h"

namespace {

constexpr std::size_t kCrcOffset = 4;
constexpr std::size_t kHeaderBytes = 8;

void decode(base::ByteView bytes) {
  const auto value = repository::decodeFaceValue(bytes);
  if (!value) return;
  const base::Bytes again = repository::encodeFaceValue(*value);
  LUMIGRID_CHECK(base::Bytes(bytes.begin(), bytes.end()) == again);
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  const base::Bytes jpeg(40, 0xD8);
  const base::Bytes coverage(9, 1);
  return {repository::encodeFaceValue({}), repository::encodeFaceValue({false, jpeg, coverage}),
          repository::encodeFaceValue({false, jpeg, {}})};
}

void fuzzOne(base::ByteView bytes) {
  decode(bytes);
  if (bytes.size() < kHeaderBytes) return;
  base::Bytes signed_bytes(bytes.begin(), bytes.end());
  const std::uint32_t crc = base::crc32c(bytes.subspan(kHeaderBytes), base::crc32c(bytes.first(kCrcOffset)));
  std::memcpy(signed_bytes.data() + kCrcOffset, &crc, sizeof(crc));
  decode(signed_bytes);
}

}  // namespace fuzz
