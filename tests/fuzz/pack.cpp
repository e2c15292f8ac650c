// Feeds any bytes to decodePack, as they are and with correct checksums of header and table.
#include "base/check.h"
#include "base/crc32c.h"
#include "repository/packs/pack_format.h"
#include "tests/fuzz/fuzz.h"

namespace {

void decode(base::ByteView bytes) {
  const auto table = repository::decodePack(bytes);
  if (!table) return;
  // A table locates every value, and encoding the pack from these values must give the same bytes.
  const auto& entries = table->entries;
  base::Bytes values;
  for (std::size_t i = 0; i < entries.size(); ++i) {
    const base::ByteView value = bytes.subspan(table->offsets[i], entries[i].length);
    values.insert(values.end(), value.begin(), value.end());
  }
  LUMIGRID_CHECK(repository::encodePack(entries, values) == base::Bytes(bytes.begin(), bytes.end()));
}

template <class T>
void put(base::Bytes& bytes, std::size_t offset, T value) {
  std::memcpy(bytes.data() + offset, &value, sizeof(T));
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  const std::vector<repository::PackEntry> some{{0, 10}, {1, 0}, {64, 200}, {69, 8}, {1 << 20, 0}};
  const std::vector<repository::PackEntry> empty{{5, 0}};
  return {repository::encodePack(some, base::Bytes(218, 7)), repository::encodePack(empty, {})};
}

void fuzzOne(base::ByteView bytes) {
  decode(bytes);
  if (bytes.size() < repository::kPackHeaderBytes) return;
  base::Bytes made(bytes.begin(), bytes.end());
  std::uint64_t table = 0;
  std::memcpy(&table, made.data() + 24, sizeof(table));
  put(made, 16, std::uint64_t{made.size()});
  if (table <= made.size()) put(made, 56, base::crc32c(base::ByteView(made).subspan(table)));
  put(made, 60, base::crc32c(base::ByteView(made).first(60)));
  decode(made);
}

}  // namespace fuzz
