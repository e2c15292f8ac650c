// The root of an index, its parameters and its list of packs, on any bytes: as they are, and with checksums made right.
#include <algorithm>

#include "base/check.h"
#include "base/crc32c.h"
#include "repository/pack_format.h"
#include "tests/fuzz/fuzz.h"

namespace {

constexpr std::size_t kHeaderBytes = 128;

base::ByteView slice(base::ByteView bytes, std::uint64_t offset, std::uint64_t length) {
  offset = std::min<std::uint64_t>(offset, bytes.size());
  return bytes.subspan(offset, std::min<std::uint64_t>(length, bytes.size() - offset));
}

void decode(base::ByteView bytes) {
  const auto root = repository::decodeIndexRoot(slice(bytes, 0, repository::kIndexFrontBytes));
  if (!root) return;
  // Lengths cannot overflow, and every key has a block that lies in the object.
  LUMIGRID_CHECK(root->rowsOffset() <= root->object_bytes && root->blocks_offset >= repository::kIndexFrontBytes);
  for (const std::uint64_t code : {std::uint64_t{0}, std::uint64_t{77}, ~std::uint64_t{0} >> 1})
    LUMIGRID_CHECK(repository::blockOfCode(*root, code) < root->blocks);
  const auto text = slice(bytes, repository::parameterOffset(), root->parameter_bytes);
  if (repository::checkParameters(*root, text)) LUMIGRID_CHECK(text.size() == root->parameter_bytes);
  const auto rows =
      repository::decodePackRows(*root, slice(bytes, root->rowsOffset(), root->packs * repository::kPackRowBytes));
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
  builder.add(entries);
  return {*builder.build({{{1, 2, 3}, 500, 0, 64, 3}}, "{\"grid\": 1}", {210, 100, 20}),
          *repository::IndexBuilder().build({}, "", {})};
}

void fuzzOne(base::ByteView bytes) {
  decode(bytes);
  if (bytes.size() < kHeaderBytes) return;
  base::Bytes made(bytes.begin(), bytes.end());
  const auto seal = [&] { put(made, kHeaderBytes - 4, base::crc32c(base::ByteView(made).first(kHeaderBytes - 4))); };
  seal();
  decode(made);
  if (const auto root = repository::decodeIndexRoot(slice(made, 0, repository::kIndexFrontBytes))) {
    put(made, 100, base::crc32c(slice(made, repository::parameterOffset(), root->parameter_bytes)));
    put(made, 104, base::crc32c(slice(made, root->rowsOffset(), root->packs * repository::kPackRowBytes)));
    seal();
    decode(made);
  }
}

}  // namespace fuzz
