// GroupRecords on any object, chunk by chunk as a client reads it, with checksums made right so that mutations of the
// numbers are met; and a hierarchy grown from what it gives.
#include "lod/patch/group_records.h"

#include <cstring>

#include "base/check.h"
#include "base/crc32c.h"
#include "lod/patch/format.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/synthetic_hierarchy.h"

namespace {

using lod::patch::GroupRecords;
constexpr std::uint32_t kMaxChunks = 8;

void seal(base::Bytes& bytes, std::size_t begin, std::size_t end, std::size_t at) {
  const std::uint32_t crc = base::crc32c(base::ByteView(bytes).subspan(begin, end - begin));
  std::memcpy(bytes.data() + at, &crc, sizeof(crc));
}

void walk(base::ByteView object) {
  auto read = GroupRecords::open(object);
  if (!read) return;
  const lod::patch::RecordCounts& counts = read->counts();
  LUMIGRID_CHECK(read->leadingGroups() <= counts.groups);
  lod::patch::Hierarchy growing;
  for (std::uint32_t chunk = 0; chunk < std::min(read->chunkCount(), kMaxChunks); ++chunk) {
    const std::uint64_t offset = read->chunkOffset(chunk), length = read->chunkBytes(chunk);
    if (!read->has(chunk) && offset + length <= object.size())
      static_cast<void>(read->add(chunk, object.subspan(offset, length)));
    if (!read->has(chunk)) continue;
    const std::uint32_t end = std::min((chunk + 1) * GroupRecords::kGroupsPerChunk, counts.groups);
    for (std::uint32_t group = chunk * GroupRecords::kGroupsPerChunk; group < end; ++group) {
      base::ByteReader in(read->record(group));
      if (!lod::patch::addGroup(in, growing, counts.groups, std::min(counts.patches, 1U << 20))) continue;
      const lod::patch::Group& g = growing.groups[group];
      LUMIGRID_CHECK(g.block_offset + g.block_bytes <= counts.patch_bytes);
    }
  }
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  std::vector<base::Bytes> all;
  for (const int n : {1, 4, 12}) {
    const auto scene = support::syntheticHierarchy(n, n == 4);
    all.push_back(lod::patch::encodeRecords(scene.hierarchy, 1'000'000));
  }
  return all;
}

void fuzzOne(base::ByteView bytes) {
  walk(bytes);
  constexpr std::size_t kHeader = lod::patch::RecordCounts::kHeaderBytes;
  if (bytes.size() < kHeader) return;
  base::Bytes sealed(bytes.begin(), bytes.end());
  std::uint32_t front = 0;
  std::memcpy(&front, sealed.data() + 12, sizeof(front));
  if (front >= kHeader && front <= sealed.size()) seal(sealed, kHeader, front, 88);
  const std::uint64_t length = sealed.size();
  std::memcpy(sealed.data() + 16, &length, sizeof(length));
  seal(sealed, 0, 92, 92);
  walk(sealed);
  // Chunks follow the directory, each with its checksum in front.
  const auto read = GroupRecords::open(base::ByteView(sealed).first(std::min<std::size_t>(front, sealed.size())));
  if (!read) return;
  for (std::uint32_t chunk = 0; chunk < std::min(read->chunkCount(), kMaxChunks); ++chunk) {
    const std::uint64_t begin = read->chunkOffset(chunk), end = begin + read->chunkBytes(chunk);
    if (end <= sealed.size() && end - begin > 4) seal(sealed, begin + 4, end, begin);
  }
  walk(sealed);
}

}  // namespace fuzz
