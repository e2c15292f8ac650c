#include "lod/hlod/format.h"

#include <array>
#include <cmath>
#include <tuple>

#include "base/crc32c.h"
#include "base/fields.h"

namespace lod::hlod {
namespace {

constexpr std::array<char, 8> kMagic{'L', 'G', 'H', 'L', 'O', 'D', 'S', '\n'};
constexpr std::uint32_t kVersion = 2;
constexpr std::uint32_t kHasColors = 1;
constexpr std::size_t kChecked = kHeaderBytes - sizeof(std::uint32_t);

// The fields behind the flags.
auto fieldsOf(auto& header) {
  return std::tie(header.file_bytes, header.source_triangles, header.nodes, header.table_bytes, header.lattice.origin,
                  header.lattice.step, header.low, header.high);
}

bool isFinite(const auto& v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

base::Result<void> checkHeader(const Header& header, std::uint32_t flags) {
  if ((flags & ~kHasColors) != 0) return damaged("header: unknown flags");
  if (!isFinite(header.lattice.origin) || !std::isfinite(header.lattice.step) || !(header.lattice.step > 0.0) ||
      !isFinite(header.lattice.position(glm::ivec3(0))) || !isFinite(header.lattice.position(glm::ivec3(kLatticeEnd))))
    return damaged("header: the lattice is none");
  if (glm::any(glm::lessThan(header.low, glm::ivec3(0))) || glm::any(glm::greaterThan(header.low, header.high)) ||
      glm::any(glm::greaterThan(header.high, glm::ivec3(kLatticeEnd))))
    return damaged("header: the box is none");
  if (!std::isfinite(boundsOf(header.low, header.high, header.lattice).radius))
    return damaged("header: the box is too large");
  if (header.nodes == 0) return damaged("header: there is no node");
  if (header.source_triangles > std::uint64_t{header.nodes} * kMaxPrimitives)
    return damaged("header: triangles and nodes contradict each other");
  if (header.table_bytes / kMinNodeBytes < header.nodes) return damaged("header: the table is too short");
  if (header.file_bytes >> 48 != 0 || header.file_bytes < kHeaderBytes ||
      header.table_bytes > header.file_bytes - kHeaderBytes)
    return damaged("header: the lengths contradict each other");
  return {};
}

}  // namespace

base::Sphere boundsOf(const glm::ivec3& low, const glm::ivec3& high, const Lattice& lattice) {
  const base::Aabb box{lattice.position(low), lattice.position(high)};
  // Rounding of the centre and of the root is far below this.
  return {box.center(), 0.5F * box.diagonal() * 1.000001F};
}

base::Error damaged(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, problem + "; copy or build the file again"};
}

base::Result<Header> readHeader(base::ByteView front) {
  // Is this a hlod.lgh of a version that this program reads?
  base::ByteReader in(front);
  if (in.read<std::array<char, 8>>() != kMagic || !in.ok()) return damaged("not a hlod.lgh");
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
  base::readFields(in, fieldsOf(header));
  while (in.offset() < kChecked)
    if (in.u8() != 0) return damaged("header: bytes that are to be zero are not");
  LUMIGRID_TRY(checkHeader(header, flags));
  header.bounds = boundsOf(header.low, header.high, header.lattice);
  return header;
}

base::Bytes headerBytes(const Header& header) {
  base::ByteWriter out;
  out.write(kMagic);
  out.u32(kVersion);
  out.u32(header.colors ? kHasColors : 0U);
  base::writeFields(out, fieldsOf(header));
  while (out.size() < kChecked) out.u8(0);
  out.u32(base::crc32c(out.view()));
  return out.takeBytes();
}

void placeBlocks(Header& header, std::vector<Node>& nodes) {
  std::uint64_t offset = kHeaderBytes + std::uint64_t{header.table_bytes};
  const auto place = [&offset](BlockPlace& block) {
    block.offset = offset;
    offset += block.bytes;
  };
  for (Node& node : nodes) place(node.picture);
  for (Node& node : nodes) place(node.caster);
  header.file_bytes = offset;
}

}  // namespace lod::hlod
