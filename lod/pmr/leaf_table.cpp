// Implements readTable and tableBytes of format.h.
#include <algorithm>
#include <cmath>

#include "base/check.h"
#include "base/crc32c.h"
#include "lod/lattice_box.h"
#include "lod/morton.h"
#include "lod/pmr/format.h"
#include "lod/pmr/range_coder.h"

namespace lod::pmr {
namespace {

/// Depths are 0 … kPositionBits.
constexpr std::uint32_t kDepths = kPositionBits + 1;
constexpr std::int32_t kLatticeEnd = 1 << kPositionBits;
/// A leaf's box lies on a lattice of which a cell's edge has so many steps, or on the lattice itself.
constexpr std::uint32_t kBoxBits = 8;
/// A radius is a code: 0 is 0, and code c is 2^((c − 1) / 32 − 10) steps of the lattice.
constexpr double kRadiusSteps = 32.0;
constexpr double kSmallestRadius = 10.0;
constexpr std::int32_t kMaxRadiusCode = 1 + 32 * 40;

std::int32_t radiusCode(float radius, const Lattice& lattice) {
  if (!(radius > 0.0F)) return 0;
  const double code = 1.0 + kRadiusSteps * (std::log2(static_cast<double>(radius) / lattice.step) + kSmallestRadius);
  return static_cast<std::int32_t>(std::lround(std::clamp(code, 1.0, static_cast<double>(kMaxRadiusCode))));
}
float radiusOfCode(std::int32_t code, const Lattice& lattice) {
  if (code == 0) return 0.0F;
  return static_cast<float>(lattice.step * std::exp2((code - 1) / kRadiusSteps - kSmallestRadius));
}

/// The octree cell of a leaf.
std::uint32_t edgeBits(std::uint32_t depth) {
  return kPositionBits - depth;
}
std::uint64_t cellVolume(std::uint32_t depth) {
  return std::uint64_t{1} << 3 * edgeBits(depth);
}

/// A leaf as the table codes it: all in integers.
struct CodedLeaf {
  std::uint64_t gap = 0;  ///< from the end of the cell before, in the smaller volume of both cells
  std::uint32_t depth = 0;
  std::array<std::int32_t, 6> box{};  ///< least x, y, z, largest x, y, z; from the cell's begin and its last point
  std::array<std::int32_t, kLevels> radius_codes{};
  std::array<LevelRow, kLevels> levels;
};

std::int32_t boxStep(std::uint32_t depth) {
  return edgeBits(depth) > kBoxBits ? 1 << (edgeBits(depth) - kBoxBits) : 1;
}

std::int32_t floorDivide(std::int32_t a, std::int32_t b) {
  return a >= 0 ? a / b : -((b - 1 - a) / b);
}

std::array<std::int32_t, 6> codedBox(const Leaf& leaf, const Lattice& lattice) {
  const glm::ivec3 begin = mortonPoint(leaf.code);
  const std::int32_t step = boxStep(leaf.depth);
  const std::int32_t last = (1 << edgeBits(leaf.depth)) - 1;
  std::array<std::int32_t, 6> box{};
  for (int axis = 0; axis < 3; ++axis) {
    const std::int32_t low =
        latticeBelow(static_cast<double>(leaf.box.min[axis]), lattice, axis, kLatticeEnd) - begin[axis];
    const std::int32_t high =
        latticeAbove(static_cast<double>(leaf.box.max[axis]), lattice, axis, kLatticeEnd) - begin[axis] - last;
    const auto k = static_cast<std::size_t>(axis);
    box[k] = floorDivide(low, step);
    box[k + 3] = -floorDivide(-high, step);
  }
  return box;
}

/// False where the box is none.
bool readBox(const std::array<std::int32_t, 6>& coded, const Lattice& lattice, Leaf& leaf) {
  const glm::ivec3 begin = mortonPoint(leaf.code);
  const std::int64_t step = boxStep(leaf.depth);
  const std::int32_t last = (1 << edgeBits(leaf.depth)) - 1;
  glm::ivec3 low, high;
  for (int axis = 0; axis < 3; ++axis) {
    const auto k = static_cast<std::size_t>(axis);
    const std::int64_t least = begin[axis] + step * coded[k];
    const std::int64_t largest = begin[axis] + last + step * coded[k + 3];
    if (least > largest || least >= kLatticeEnd || largest < 0) return false;
    low[axis] = static_cast<std::int32_t>(std::max<std::int64_t>(least, 0));
    high[axis] = static_cast<std::int32_t>(std::min<std::int64_t>(largest, kLatticeEnd - 1));
  }
  leaf.box.min = lattice.position(low);
  leaf.box.max = lattice.position(high);
  return true;
}

/// Codes leaf after leaf, in both directions (range_coder.h).
template <class Coder>
class LeafModel {
 public:
  explicit LeafModel(Coder& coder) : coder_(coder) {}

  /// False where what was decoded cannot be.
  bool code(CodedLeaf& leaf) {
    leaf.depth = depth_[depth_before_].code(coder_, leaf.depth);
    if (leaf.depth >= kDepths) return false;
    depth_before_ = leaf.depth;
    leaf.gap = gap_.code(coder_, leaf.gap);
    for (std::size_t i = 0; i < leaf.box.size(); ++i) leaf.box[i] = box_[i].code(coder_, leaf.box[i]);

    std::int32_t radius = last_radius_;
    std::uint64_t own = 0, vertices = 0, foreign = 0;
    for (std::uint32_t l = kLevels; l-- > 0;) {
      LevelRow& row = leaf.levels[l];
      LevelRow& before = before_[l];
      row.points = number(points_[l], row.points);
      row.foreign = number(foreign_[l], row.foreign);
      own += row.points, foreign += row.foreign;
      vertices = own + foreign;
      if (own > kMaxLeafPoints || vertices > kMaxVertices) return false;

      // A triangulated patch has twice as many triangles as points within it, and as many more as on its border.
      if (!codeLength(triangles_[l], 2 * own + foreign, kMaxTriangles, row.triangles)) return false;
      const std::uint64_t count = row.points + std::uint64_t{row.foreign};
      const std::uint64_t count_before = before.points + std::uint64_t{before.foreign};
      if (!codeBytes(point_bytes_[l], count, count_before, before.point_bytes, row.point_bytes) ||
          !codeBytes(triangle_bytes_[l], row.triangles, before.triangles, before.triangle_bytes, row.triangle_bytes))
        return false;

      const std::int64_t coded = std::int64_t{radius} + radius_[l].code(coder_, leaf.radius_codes[l] - radius);
      if (coded < 0 || coded > kMaxRadiusCode) return false;
      leaf.radius_codes[l] = radius = static_cast<std::int32_t>(coded);
      if (l == kCoarsest) last_radius_ = radius;
      if (count > 0) before.points = row.points, before.foreign = row.foreign, before.point_bytes = row.point_bytes;
      if (row.triangles > 0) before.triangles = row.triangles, before.triangle_bytes = row.triangle_bytes;
    }
    return own > 0;
  }

 private:
  std::uint32_t number(NumberModel& model, std::uint32_t value) {
    return static_cast<std::uint32_t>(model.code(coder_, value));
  }

  // A number as its difference to what is expected.
  bool codeLength(SignedModel& model, std::uint64_t expected, std::uint32_t limit, std::uint32_t& value) {
    const auto middle = static_cast<std::int64_t>(expected);
    const std::int64_t decoded = middle + model.code(coder_, static_cast<std::int32_t>(value - middle));
    value = static_cast<std::uint32_t>(decoded);
    return decoded >= 0 && decoded <= limit;
  }

  // The length of a chunk, which is none where nothing is in it; expected is one like that of the leaf before.
  bool codeBytes(SignedModel& model, std::uint64_t count, std::uint64_t count_before, std::uint64_t bytes_before,
                 std::uint32_t& bytes) {
    if (count == 0) {
      bytes = 0;
      return true;
    }
    const std::uint64_t expected = count_before > 0 ? bytes_before * count / count_before : 4 * count;
    return codeLength(model, std::min<std::uint64_t>(expected, kMaxChunkBytes), kMaxChunkBytes, bytes) && bytes > 0;
  }

  Coder& coder_;
  std::array<SymbolModel<5>, kDepths> depth_;
  LongNumberModel gap_;
  std::array<SignedModel, 6> box_;
  std::array<NumberModel, kLevels> points_, foreign_;
  std::array<SignedModel, kLevels> triangles_, point_bytes_, triangle_bytes_, radius_;
  std::uint32_t depth_before_ = 0;
  std::int32_t last_radius_ = 0;
  std::array<LevelRow, kLevels> before_;
};

/// Places a decoded leaf's cell behind the one before; false where it is not aligned or beyond the lattice.
bool placeCell(std::uint64_t gap, std::uint32_t depth_before, std::uint64_t end_before, Leaf& leaf) {
  const std::uint64_t unit = cellVolume(std::max(leaf.depth, depth_before));
  const std::uint64_t whole = cellVolume(0);
  if (end_before > whole || gap > (whole - end_before) / unit) return false;
  leaf.code = end_before + gap * unit;
  const std::uint64_t volume = cellVolume(leaf.depth);
  return leaf.code % volume == 0 && leaf.code <= whole - volume;
}

}  // namespace

base::Bytes tableBytes(const std::vector<Leaf>& leaves, const Lattice& lattice) {
  RangeEncoder encoder;
  LeafModel<RangeEncoder> model(encoder);
  std::uint64_t end = 0;
  std::uint32_t depth_before = kPositionBits;
  for (const Leaf& leaf : leaves) {
    CodedLeaf coded;
    coded.depth = leaf.depth;
    coded.gap = (leaf.code - end) / cellVolume(std::max(leaf.depth, depth_before));
    coded.box = codedBox(leaf, lattice);
    coded.levels = leaf.levels;
    for (std::uint32_t l = 0; l < kLevels; ++l) coded.radius_codes[l] = radiusCode(leaf.levels[l].radius, lattice);
    const bool good = model.code(coded);
    LUMIGRID_CHECK(good);
    end = leaf.code + cellVolume(leaf.depth);
    depth_before = leaf.depth;
  }
  base::ByteWriter out;
  out.bytes(encoder.finish());
  while (out.size() + sizeof(std::uint32_t) < kMinLeafBytes * leaves.size()) out.u8(0);
  out.u32(base::crc32c(out.view()));
  return out.takeBytes();
}

base::Result<std::vector<Leaf>> readTable(const Header& header, base::ByteView table) {
  if (table.size() != header.table_bytes || table.size() / kMinLeafBytes < header.leaves)
    return damaged("table: cut short");
  const base::ByteView coded_bytes = table.first(table.size() - sizeof(std::uint32_t));
  std::uint32_t crc = 0;
  std::memcpy(&crc, table.data() + coded_bytes.size(), sizeof(crc));
  if (crc != base::crc32c(coded_bytes)) return damaged("table: checksum does not match");

  RangeDecoder decoder(coded_bytes);
  LeafModel<RangeDecoder> model(decoder);
  // It grows with what is decoded: a file's own word for the number of leaves takes no memory.
  std::vector<Leaf> leaves;
  std::uint64_t end = 0, points = 0;
  std::uint32_t depth_before = kPositionBits;
  for (std::uint32_t i = 0; i < header.leaves; ++i) {
    const std::string place = "table: leaf " + std::to_string(i) + ": ";
    CodedLeaf coded;
    if (!model.code(coded)) return damaged(place + "its counts cannot be");
    Leaf& leaf = leaves.emplace_back();
    leaf.depth = coded.depth;
    if (!placeCell(coded.gap, depth_before, end, leaf)) return damaged(place + "its cell cannot be there");
    if (!readBox(coded.box, header.lattice, leaf)) return damaged(place + "its box is none");
    leaf.levels = coded.levels;
    for (std::uint32_t l = 0; l < kLevels; ++l)
      leaf.levels[l].radius = radiusOfCode(coded.radius_codes[l], header.lattice);
    end = leaf.code + cellVolume(leaf.depth);
    depth_before = leaf.depth;
    points += leaf.pointsAt(0);
  }

  Header placed = header;
  placeChunks(placed, leaves);
  if (points != header.points || placed.base_bytes != header.base_bytes || placed.file_bytes != header.file_bytes)
    return damaged("table: it contradicts the header");
  return leaves;
}

}  // namespace lod::pmr
