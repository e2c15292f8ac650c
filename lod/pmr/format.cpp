#include "lod/pmr/format.h"

#include <cmath>
#include <string>
#include <tuple>

#include "base/crc32c.h"
#include "base/fields.h"
#include "lod/pmr/chunk_order.h"

namespace lod::pmr {
namespace {

constexpr std::array<char, 8> kMagic{'L', 'G', 'P', 'M', 'R', 'E', 'S', '\n'};
constexpr std::uint32_t kVersion = 2;
constexpr std::uint32_t kHasColors = 1;
constexpr std::uint32_t kOriented = 2;
constexpr std::size_t kChecked = kHeaderBytes - sizeof(std::uint32_t);

// The fields behind the header's length, but for the flags.
auto fieldsOf(auto& header) {
  return std::tie(header.file_bytes, header.points, header.leaves, header.table_bytes, header.base_bytes,
                  header.lattice.origin, header.lattice.step, header.bounds.center, header.bounds.radius);
}

bool isFinite(const auto& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

base::Result<void> checkHeader(const Header& header, std::uint32_t flags) {
  if ((flags & ~(kHasColors | kOriented)) != 0) return damaged("header: unknown flags");
  if (!isFinite(header.lattice.origin) || !std::isfinite(header.lattice.step) || !(header.lattice.step > 0.0) ||
      !isFinite(header.lattice.position(glm::ivec3(0))) ||
      !isFinite(header.lattice.position(glm::ivec3((1 << kPositionBits) - 1))))
    return damaged("header: the lattice is none");
  if (!isFinite(header.bounds.center) || !std::isfinite(header.bounds.radius) || header.bounds.radius < 0.0F)
    return damaged("header: the bounds are no sphere");
  if (header.leaves == 0 || header.points < header.leaves ||
      header.points > std::uint64_t{header.leaves} * kMaxLeafPoints)
    return damaged("header: points and leaves contradict each other");
  if (header.table_bytes / kMinLeafBytes < header.leaves) return damaged("header: the table is too short");
  if (header.file_bytes >> 48 != 0 || header.file_bytes < kHeaderBytes ||
      header.table_bytes > header.file_bytes - kHeaderBytes ||
      header.base_bytes > header.file_bytes - kHeaderBytes - header.table_bytes)
    return damaged("header: the lengths contradict each other");
  return {};
}

}  // namespace

base::Error damaged(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, problem + "; copy or build the file again"};
}

std::uint32_t Leaf::pointsAt(std::uint32_t level) const {
  std::uint32_t points = 0;
  for (std::uint32_t c = level; c < kLevels; ++c) points += levels[c].points;
  return points;
}

std::uint32_t Leaf::verticesAt(std::uint32_t level) const {
  std::uint32_t vertices = 0;
  for (std::uint32_t c = level; c < kLevels; ++c) vertices += levels[c].points + levels[c].foreign;
  return vertices;
}

base::Result<Header> readHeader(base::ByteView front) {
  // Is this a pmr.lgm of a version that this program reads?
  base::ByteReader in(front);
  if (in.read<std::array<char, 8>>() != kMagic || !in.ok()) return damaged("not a pmr.lgm");
  const std::uint32_t version = in.u32();
  if (in.ok() && version != kVersion)
    return base::Error{base::ErrorCode::kVersion, "format version " + std::to_string(version) +
                                                      ", this program reads " + std::to_string(kVersion) +
                                                      "; use a newer program or build the scene again"};
  if (front.size() < kHeaderBytes) return damaged("header: cut short");
  std::uint32_t crc = 0;
  std::memcpy(&crc, front.data() + kChecked, sizeof(crc));
  if (crc != base::crc32c(front.first(kChecked))) return damaged("header: checksum does not match");

  Header header;
  const std::uint32_t flags = in.u32();
  header.colors = (flags & kHasColors) != 0;
  header.oriented = (flags & kOriented) != 0;
  base::readFields(in, fieldsOf(header));
  while (in.offset() < kChecked)
    if (in.u8() != 0) return damaged("header: bytes that are to be zero are not");
  LUMIGRID_TRY(checkHeader(header, flags));
  return header;
}

base::Bytes headerBytes(const Header& header) {
  base::ByteWriter out;
  out.write(kMagic);
  out.u32(kVersion);
  out.u32((header.colors ? kHasColors : 0U) | (header.oriented ? kOriented : 0U));
  base::writeFields(out, fieldsOf(header));
  while (out.size() < kChecked) out.u8(0);
  out.u32(base::crc32c(out.view()));
  return out.takeBytes();
}

void placeChunks(Header& header, std::vector<Leaf>& leaves) {
  const ChunkOrder order(static_cast<std::uint32_t>(leaves.size()));
  std::uint64_t offset = kHeaderBytes + std::uint64_t{header.table_bytes};
  for (std::uint64_t place = 0; place < order.chunks(); ++place) {
    if (place == order.baseChunks()) header.base_bytes = offset - kHeaderBytes - header.table_bytes;
    const ChunkId id = order.at(place);
    LevelRow& row = leaves[id.leaf].levels[id.chunk % kLevels];
    (id.chunk < kLevels ? row.point_offset : row.triangle_offset) = offset;
    offset += id.chunk < kLevels ? row.point_bytes : row.triangle_bytes;
  }
  header.file_bytes = offset;
}

}  // namespace lod::pmr
