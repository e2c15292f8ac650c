// Reads header and table from any bytes, as they are and with checksums and lengths made right, checks the whole file,
// and streams a view of it.
#include "base/check.h"
#include "lod/pmr/check_file.h"
#include "lod/pmr/stream.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/made_pmr.h"

namespace {

using namespace lod::pmr;

constexpr std::size_t kFileBytesAt = 16, kTableBytesAt = 36;

void checkLeaves(const Header& header, const std::vector<Leaf>& leaves) {
  LUMIGRID_CHECK_EQ(leaves.size(), header.leaves);
  std::uint64_t points = 0, end = 0;
  for (const Leaf& leaf : leaves) {
    LUMIGRID_CHECK(leaf.code >= end && leaf.depth <= kPositionBits);
    end = leaf.code + (std::uint64_t{1} << 3 * (kPositionBits - leaf.depth));
    LUMIGRID_CHECK(leaf.pointsAt(0) <= kMaxLeafPoints && leaf.verticesAt(0) <= kMaxVertices && !leaf.box.empty());
    for (std::uint32_t level = 0; level < kLevels; ++level) {
      LUMIGRID_CHECK(leaf.levels[level].point_offset + leaf.levels[level].point_bytes <= header.file_bytes);
      LUMIGRID_CHECK(leaf.levels[level].triangle_offset + leaf.levels[level].triangle_bytes <= header.file_bytes);
      LUMIGRID_CHECK(leaf.levels[level].triangles <= kMaxTriangles && leaf.levels[level].radius >= 0.0F);
    }
    points += leaf.pointsAt(0);
  }
  LUMIGRID_CHECK_EQ(points, header.points);
}

void readAll(base::ByteView file) {
  const auto header = readHeader(file);
  if (header && file.size() >= std::size_t{kHeaderBytes} + header->table_bytes)
    if (const auto leaves = readTable(*header, file.subspan(kHeaderBytes, header->table_bytes)))
      checkLeaves(*header, *leaves);
  const lod::MemoryBytes bytes(file);
  for (const std::string& fault : checkFile(bytes)) LUMIGRID_CHECK(fault.find('\n') == std::string::npos);

  Stream stream(std::make_shared<lod::MemoryBytes>(file), {});
  TraverseRequest request;
  request.cull = false;
  std::vector<DrawnLeaf> drawn;
  stream.update(request, drawn);
  LUMIGRID_CHECK(!stream.problem().empty() || stream.complete());
}

base::Bytes sealed(base::ByteView bytes) {
  base::Bytes out(bytes.begin(), bytes.end());
  const std::uint64_t length = out.size();
  std::memcpy(out.data() + kFileBytesAt, &length, sizeof(length));
  const auto seal = [&](std::size_t begin, std::size_t end) {
    const std::uint32_t crc = base::crc32c(base::ByteView(out).subspan(begin, end - begin - sizeof(std::uint32_t)));
    std::memcpy(out.data() + end - sizeof(crc), &crc, sizeof(crc));
  };
  seal(0, kHeaderBytes);
  std::uint32_t table_bytes = 0;
  std::memcpy(&table_bytes, out.data() + kTableBytesAt, sizeof(table_bytes));
  if (table_bytes >= sizeof(std::uint32_t) && table_bytes <= out.size() - kHeaderBytes)
    seal(kHeaderBytes, kHeaderBytes + table_bytes);
  return out;
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  std::vector<base::Bytes> all;
  const support::LevelledSurface patch = support::torusPatch(34, 20);
  all.push_back(support::PmrMaker(patch, true, 1000).make().file);
  const support::MadePmr many = support::PmrMaker(patch, false, 60).make();
  all.push_back(many.file);
  // The front alone: mutations meet the table more often.
  all.emplace_back(many.file.begin(), many.file.begin() + kHeaderBytes + many.header.table_bytes);
  return all;
}

void fuzzOne(base::ByteView bytes) {
  readAll(bytes);
  if (bytes.size() >= kHeaderBytes) readAll(sealed(bytes));
}

}  // namespace fuzz
