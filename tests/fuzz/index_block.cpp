// Feeds any bytes, padded with zeros or cut to a block's length, to decodeIndexBlock, as they are, with a correct
// checksum, and with their own length besides. Seeds end where their zeros begin, so that mutations hit bytes that are
// read.
#include "base/check.h"
#include "base/crc32c.h"
#include "repository/packs/pack_format.h"
#include "tests/fuzz/fuzz.h"

namespace {

// The index has a single block of the smallest size, so that every run belongs in it.
repository::IndexRoot root() {
  repository::IndexRoot root;
  root.blocks = 1;
  root.block_bytes = 4096;
  root.hash_shift = 20;
  return root;
}

void decode(base::ByteView bytes) {
  const auto block = repository::decodeIndexBlock(root(), 0, bytes);
  if (!block) return;
  LUMIGRID_CHECK(block->emptyFlags() <= block->keys());
  std::uint64_t found = 0;
  for (std::uint64_t code = 0; code < 1024; ++code) {
    const auto place = block->find(code);
    if (!place) continue;
    ++found;
    LUMIGRID_CHECK(place->offset >= repository::kPackHeaderBytes);
    LUMIGRID_CHECK(place->offset + place->length <= repository::kMaxPackBytes);
  }
  LUMIGRID_CHECK(found <= block->keys());
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  // The writer makes larger blocks, whose first bytes hold all of these runs.
  repository::IndexBuilder builder;
  const std::vector<repository::PackEntry> first{{0, 10}, {1, 0}, {64, 200}};
  const std::vector<repository::PackEntry> second{{68, 20000}, {69, 3000000}, {512, 8}};
  builder.addPack(first);
  builder.addPack(second);
  const base::Bytes index = *builder.build({{{1}, 500, 0, 64, 3}, {{2}, 4000000, 68, 512, 3}}, "", {});
  const std::uint64_t used = repository::decodeIndexRoot(index)->bytesToRead(0);
  base::Bytes block(index.begin() + 16384, index.begin() + 16384 + static_cast<std::ptrdiff_t>(used));
  LUMIGRID_CHECK(bool(repository::decodeIndexBlock(root(), 0, block)));
  std::uint32_t exactly = 0;
  std::memcpy(&exactly, block.data() + 4, sizeof(exactly));
  block.resize(exactly);
  return {block};
}

void fuzzOne(base::ByteView bytes) {
  base::Bytes block(bytes.begin(), bytes.end());
  block.resize(root().block_bytes);
  decode(block);
  std::uint32_t used = 0;
  std::memcpy(&used, block.data() + 4, sizeof(used));
  for (const std::size_t length : {std::size_t{used}, bytes.size()}) {
    if (length < 8 || length > block.size()) continue;
    used = static_cast<std::uint32_t>(length);
    std::memcpy(block.data() + 4, &used, sizeof(used));
    const std::uint32_t crc = base::crc32c(base::ByteView(block).first(length).subspan(4));
    std::memcpy(block.data(), &crc, sizeof(crc));
    decode(block);
    decode(base::ByteView(block).first(length));
  }
}

}  // namespace fuzz
