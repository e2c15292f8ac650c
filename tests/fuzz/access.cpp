// Feeds any bytes to decodeAccess, as they are and with both checksums correct. Accepted counts must encode to the same
// bytes, and adding and ranking them must work.
#include "repository/access.h"

#include "base/check.h"
#include "base/crc32c.h"
#include "base/hash/sha256.h"
#include "tests/fuzz/fuzz.h"

namespace {

constexpr std::size_t kHeaderBytes = 136;

repository::AccessIdentity identity() {
  repository::Grid grid;
  grid.count = {5, 4, 3};
  grid.face_size = 64;
  return {grid, 1000, base::sha256({})};
}

void decode(base::ByteView bytes) {
  const auto file = repository::decodeAccess(bytes);
  if (!file) return;
  const base::Bytes again = repository::encodeAccess(file->identity, file->counts);
  LUMIGRID_CHECK(base::Bytes(bytes.begin(), bytes.end()) == again);
  const auto twice = repository::addCounts(file->counts, file->counts);
  LUMIGRID_CHECK_EQ(twice.faces.size(), file->counts.faces.size());
  LUMIGRID_CHECK(repository::decodeAccess(repository::encodeAccess(file->identity, twice)));
  (void)repository::rankPoints(twice);
}

template <class T>
void putAt(base::Bytes& bytes, std::size_t offset, T value) {
  std::memcpy(bytes.data() + offset, &value, sizeof(value));
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  repository::AccessCounts some;
  some.faces = {{{0, 0, 0, 0}, 1}, {{1, 0, 0, 3}, 300}, {{4, 3, 2, 5}, ~std::uint64_t{0}}};
  some.groups = {{0, 7}, {999, 1}};
  some.uncounted = 2;
  some.since = 1'700'000'000;
  some.until = 1'700'003'600;
  return {repository::encodeAccess(identity(), {}), repository::encodeAccess(identity(), some),
          repository::encodeAccess({{}, 1, {}}, {{}, {{0, 1}}, 0, 0, 0})};
}

void fuzzOne(base::ByteView bytes) {
  decode(bytes);
  if (bytes.size() < kHeaderBytes) return;
  base::Bytes signed_bytes(bytes.begin(), bytes.end());
  const base::ByteView view(signed_bytes);
  putAt(signed_bytes, 12, base::crc32c(view.subspan(kHeaderBytes)));
  putAt(signed_bytes, 16, std::uint64_t{bytes.size() - kHeaderBytes});
  putAt(signed_bytes, 8, base::crc32c(view.subspan(12, kHeaderBytes - 12), base::crc32c(view.first(8))));
  decode(signed_bytes);
}

}  // namespace fuzz
