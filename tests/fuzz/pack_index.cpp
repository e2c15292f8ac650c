// Feeds any bytes to the decoders of an index's root, parameters and list of packs, as they are and with correct
// checksums. An input holds an index without its blocks (header, parameters, how full the blocks are, and rows, one
// behind the other), so that mutations hit bytes that are read.
#include <algorithm>

#include "base/check.h"
#include "base/crc32c.h"
#include "repository/packs/pack_format.h"
#include "tests/fuzz/fuzz.h"

namespace {

constexpr std::size_t kHeaderBytes = 128;

base::ByteView slice(base::ByteView bytes, std::uint64_t offset, std::uint64_t length) {
  offset = std::min<std::uint64_t>(offset, bytes.size());
  return bytes.subspan(offset, std::min<std::uint64_t>(length, bytes.size() - offset));
}

struct Parts {
  base::ByteView parameters, fill, rows;
};
Parts partsOf(const repository::IndexRoot& root, base::ByteView bytes) {
  const std::uint64_t end = kHeaderBytes + root.parameter_bytes;
  return {slice(bytes, kHeaderBytes, root.parameter_bytes), slice(bytes, end, root.fill_bytes),
          slice(bytes, root.frontBytes(), bytes.size())};
}

void decode(base::ByteView bytes) {
  const auto root = repository::decodeIndexRoot(bytes);
  if (!root) return;
  // Lengths must not overflow, and every key must have a block that lies in the object.
  LUMIGRID_CHECK(root->rowsOffset() <= root->object_bytes && root->blocks_offset >= repository::kIndexFrontBytes);
  for (const std::uint64_t code : {std::uint64_t{0}, std::uint64_t{77}, ~std::uint64_t{0} >> 1})
    LUMIGRID_CHECK(repository::blockOfCode(*root, code) < root->blocks);
  LUMIGRID_CHECK(root->fill.empty() || root->fill.size() == root->blocks);
  for (const std::uint64_t block : {std::uint64_t{0}, root->blocks - 1})
    LUMIGRID_CHECK(root->bytesToRead(block) > 0 && root->bytesToRead(block) <= root->block_bytes);
  const Parts parts = partsOf(*root, bytes);
  if (repository::checkParameters(*root, parts.parameters))
    LUMIGRID_CHECK(parts.parameters.size() == root->parameter_bytes);
  const auto rows = repository::decodePackRows(*root, parts.rows);
  if (!rows) return;
  for (std::size_t i = 1; i < rows->size(); ++i) LUMIGRID_CHECK((*rows)[i - 1].last_code < (*rows)[i].first_code);
}

template <class T>
void put(base::Bytes& bytes, std::size_t offset, T value) {
  std::memcpy(bytes.data() + offset, &value, sizeof(T));
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  const std::vector<repository::PackEntry> entries{{0, 10}, {1, 0}, {64, 200}};
  repository::IndexBuilder builder;
  builder.addPack(entries);
  builder.addPack(std::vector<repository::PackEntry>{{70, 8}});
  const std::vector<base::Bytes> whole{
      *builder.build({{{1, 2, 3}, 500, 0, 64, 3}, {{4}, 200, 70, 70, 1}}, "{\"grid\": 1}", {218, 100, 20}),
      *repository::IndexBuilder().build({}, "", {})};
  std::vector<base::Bytes> seeds;
  for (const base::Bytes& index : whole) {
    const auto root = repository::decodeIndexRoot(index);
    LUMIGRID_CHECK(bool(root));
    base::Bytes seed(index.begin(), index.begin() + static_cast<std::ptrdiff_t>(root->frontBytes()));
    seed.insert(seed.end(), index.begin() + static_cast<std::ptrdiff_t>(root->rowsOffset()), index.end());
    LUMIGRID_CHECK(bool(repository::decodePackRows(*root, partsOf(*root, seed).rows)));
    seeds.push_back(seed);
  }
  return seeds;
}

void fuzzOne(base::ByteView bytes) {
  decode(bytes);
  if (bytes.size() < kHeaderBytes) return;
  base::Bytes made(bytes.begin(), bytes.end());
  const auto seal = [&] { put(made, kHeaderBytes - 4, base::crc32c(base::ByteView(made).first(kHeaderBytes - 4))); };
  seal();
  decode(made);
  // A front that ends with the header is accepted whatever the fill's checksum is.
  if (const auto root = repository::decodeIndexRoot(base::ByteView(made).first(kHeaderBytes))) {
    const Parts parts = partsOf(*root, made);
    put(made, 112, base::crc32c(parts.fill));
    put(made, 100, base::crc32c(parts.parameters));
    put(made, 104, base::crc32c(parts.rows));
    seal();
    decode(made);
  }
}

}  // namespace fuzz
