#include "lod/pmr/builder/octree.h"

#include <algorithm>
#include <array>
#include <bit>

#include "base/fields.h"
#include "lod/ingest/morton.h"
#include "lod/ingest/work_directory.h"

namespace lod::pmr::builder {
namespace {

// Points between two codes that are kept in memory to find cells by.
constexpr std::uint64_t kStride = 64;
// Cells with more points by that measure are divided; it is short of the exact number by less than two strides.
constexpr std::uint64_t kMaxEstimate = kMaxLeafPoints - 2 * kStride;
// Cells in whose surroundings there are more points are divided, too: next to a dense place a wide cell with few points
// would take in all of it.
constexpr std::uint64_t kMaxSurroundings = 12 * kMaxLeafPoints;
constexpr std::size_t kWriteRecords = 1 << 14;

std::uint64_t cellsCodes(std::uint32_t depth) {
  return std::uint64_t{1} << (3 * (kPositionBits - depth));
}

// Divides a cell until each part and its surroundings are small enough. `sampled`: every kStride-th code.
class Divider {
 public:
  Divider(std::span<const std::uint64_t> sampled, std::function<void(std::uint64_t, std::uint32_t)> leaf)
      : sampled_(sampled), leaf_(std::move(leaf)) {}
  void divide(std::uint64_t code, std::uint32_t depth) {
    // A cell without samples may have a few points all the same, between two samples.
    if (depth == kPositionBits || (pointsIn(code, depth) <= kMaxEstimate &&
                                   pointsWithin(cellBox(code, depth).withSurroundings(), 0, 0) <= kMaxSurroundings))
      return leaf_(code, depth);
    for (std::uint64_t k = 0; k < 8; ++k) divide(code + k * cellsCodes(depth + 1), depth + 1);
  }

 private:
  std::uint64_t pointsIn(std::uint64_t code, std::uint32_t depth) const {
    const auto from = std::lower_bound(sampled_.begin(), sampled_.end(), code);
    return kStride *
           static_cast<std::uint64_t>(std::lower_bound(from, sampled_.end(), code + cellsCodes(depth)) - from);
  }
  // Points within the box, or about as many as are too many.
  std::uint64_t pointsWithin(const LatticeBox& box, std::uint64_t code, std::uint32_t depth) const {
    const LatticeBox cell = cellBox(code, depth);
    if (!cell.overlaps(box)) return 0;
    const std::uint64_t points = pointsIn(code, depth);
    if (points <= kStride || box.contains(cell) || depth == kPositionBits) return points;
    std::uint64_t sum = 0;
    for (std::uint64_t k = 0; k < 8 && sum <= kMaxSurroundings; ++k)
      sum += pointsWithin(box, code + k * cellsCodes(depth + 1), depth + 1);
    return sum;
  }

  std::span<const std::uint64_t> sampled_;
  std::function<void(std::uint64_t, std::uint32_t)> leaf_;
};

// How far points are apart, by the number of bits that a lattice would have to lose for a point to fall together with
// the one before it in Morton order.
class MergeCounts {
 public:
  void add(std::uint64_t code) {
    if (any_ && code == last_) return;
    if (any_) ++merged_[(static_cast<std::size_t>(std::bit_width(code ^ last_)) + 2) / 3];
    any_ = true;
    last_ = code;
    ++points_;
  }
  // The bits that the lattice may lose: hardly any two points fall together then, and the steps are still a fraction of
  // the distances, also in the denser places.
  std::uint32_t spareBits() const {
    std::uint32_t bits = 0;
    while (bits + kMedianBits < kPositionBits - 1 && share(bits + 1) <= kMerged &&
           share(bits + 1 + kDenseBits) <= kDense && share(bits + 1 + kMedianBits) <= 0.5)
      ++bits;
    return bits;
  }

 private:
  static constexpr double kMerged = 0.0001;
  static constexpr double kDense = 0.02;  // of the points are nearer than 2^kDenseBits steps
  static constexpr std::uint32_t kDenseBits = 3, kMedianBits = 5;

  double share(std::uint32_t bits) const {
    std::uint64_t sum = 0;
    for (std::uint32_t k = 0; k <= bits && k < merged_.size(); ++k) sum += merged_[k];
    return static_cast<double>(sum) / static_cast<double>(std::max<std::uint64_t>(points_, 1));
  }

  std::array<std::uint64_t, kPositionBits + 1> merged_{};
  std::uint64_t points_ = 0, last_ = 0;
  bool any_ = false;
};

// Writes points in order. Those that fall together on the coarser lattice are one: the first stays.
class OrderedWriter {
 public:
  explicit OrderedWriter(ingest::SpoolFile& file) : file_(file) {}
  base::Result<void> add(const OrderedPoint& point) {
    if (count_ > 0 && point.code == last_) return {};
    last_ = point.code;
    if (count_++ % kStride == 0) sampled_.push_back(point.code);
    all_have_normals_ &= point.normal != 0;
    records_.push_back(point);
    return records_.size() < kWriteRecords ? base::Result<void>() : flush();
  }
  base::Result<void> flush() {
    const auto* bytes = reinterpret_cast<const std::uint8_t*>(records_.data());
    LUMIGRID_TRY(file_.append(base::ByteView(bytes, records_.size() * sizeof(OrderedPoint))));
    records_.clear();
    return {};
  }
  std::uint64_t count() const { return count_; }
  bool allHaveNormals() const { return all_have_normals_; }
  const std::vector<std::uint64_t>& sampled() const { return sampled_; }

 private:
  ingest::SpoolFile& file_;
  std::vector<OrderedPoint> records_;
  std::vector<std::uint64_t> sampled_;
  std::uint64_t count_ = 0, last_ = 0;
  bool all_have_normals_ = true;
};

base::Result<std::uint64_t> firstNotBelow(const ingest::SpoolFile& file, std::span<const std::uint64_t> sampled,
                                          std::uint64_t points, std::uint64_t code) {
  const auto after =
      static_cast<std::uint64_t>(std::lower_bound(sampled.begin(), sampled.end(), code) - sampled.begin());
  if (after == 0) return std::uint64_t{0};
  const std::uint64_t from = (after - 1) * kStride, to = std::min(points, after * kStride);
  std::vector<OrderedPoint> records(static_cast<std::size_t>(to - from));
  LUMIGRID_TRY(file.readAt(from * sizeof(OrderedPoint), std::span(reinterpret_cast<std::uint8_t*>(records.data()),
                                                                  records.size() * sizeof(OrderedPoint))));
  const auto it = std::partition_point(records.begin(), records.end(),
                                       [code](const OrderedPoint& point) { return point.code < code; });
  return from + static_cast<std::uint64_t>(it - records.begin());
}

std::uint32_t packed(const glm::u8vec3& color) {
  return static_cast<std::uint32_t>(color.x) | static_cast<std::uint32_t>(color.y) << 8 |
         static_cast<std::uint32_t>(color.z) << 16;
}

}  // namespace

LatticeBox cellBox(std::uint64_t code, std::uint32_t depth) {
  const glm::ivec3 low = ingest::mortonPoint(code);
  return {low, low + (std::int32_t{1} << (kPositionBits - depth))};
}

base::Result<OrderedPoints> OrderedPoints::order(const ingest::PointTiles& tiles, const Lattice& lattice,
                                                 const std::string& directory,
                                                 const std::function<bool(double)>& progress) {
  // The tiles are read twice: the first time to see how far the points are apart.
  MergeCounts distances;
  for (std::size_t t = 0; t < tiles.count(); ++t) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto codes, tiles.codes(t));
    for (const std::uint64_t code : codes) distances.add(code);
    if (progress && !progress(0.5 * static_cast<double>(t + 1) / static_cast<double>(tiles.count())))
      return base::Error{base::ErrorCode::kCancelled, "ordering the points was cancelled"};
  }
  const std::uint32_t shift = distances.spareBits();

  OrderedPoints out;
  LUMIGRID_ASSIGN_OR_RETURN(out.file_, ingest::SpoolFile::create(directory + "/ordered"));
  OrderedWriter writer(out.file_);
  for (std::size_t t = 0; t < tiles.count(); ++t) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto points, tiles.read(t));
    for (const ingest::SourcePoint& point : points)
      LUMIGRID_TRY(writer.add({point.code >> (3 * shift), ingest::packNormal(point.normal), packed(point.color)}));
    if (progress && !progress(0.5 + 0.5 * static_cast<double>(t + 1) / static_cast<double>(tiles.count())))
      return base::Error{base::ErrorCode::kCancelled, "ordering the points was cancelled"};
  }
  LUMIGRID_TRY(writer.flush());
  LUMIGRID_TRY(out.file_.flush());
  out.points_ = writer.count();
  out.has_normals_ = writer.allHaveNormals();

  // A coarse lattice point stands for 2^shift fine ones on each axis, and lies in their middle.
  out.lattice_.step = lattice.step * static_cast<double>(std::uint64_t{1} << shift);
  out.lattice_.origin = lattice.origin + glm::dvec3(0.5 * (out.lattice_.step - lattice.step));

  std::vector<std::pair<std::uint64_t, std::uint32_t>> leaves;
  Divider(writer.sampled(), [&](std::uint64_t code, std::uint32_t depth) {
    leaves.emplace_back(code, depth);
  }).divide(0, shift);
  std::uint64_t first = 0;
  for (std::size_t i = 0; i < leaves.size(); ++i) {
    std::uint64_t end = out.points_;
    if (i + 1 < leaves.size()) {
      LUMIGRID_ASSIGN_OR_RETURN(end, firstNotBelow(out.file_, writer.sampled(), out.points_, leaves[i + 1].first));
    }
    if (end > first)
      out.cells_.push_back({first, static_cast<std::uint32_t>(end - first), leaves[i].second, leaves[i].first});
    first = end;
  }
  return out;
}

base::Bytes OrderedPoints::encodeTables() const {
  base::ByteWriter out;
  out.u64(points_);
  out.write(lattice_);
  out.u8(has_normals_ ? 1 : 0);
  out.u64(cells_.size());
  for (const OctreeCell& cell : cells_) out.write(cell);
  return out.takeBytes();
}

base::Result<OrderedPoints> OrderedPoints::open(const std::string& directory, base::ByteView state) {
  OrderedPoints out;
  base::ByteReader in(state);
  out.points_ = in.u64();
  out.lattice_ = in.read<Lattice>();
  out.has_normals_ = in.u8() != 0;
  const std::uint64_t cells = in.u64();
  if (!in.ok() || in.remaining() != cells * sizeof(OctreeCell)) return ingest::damagedWorkFiles(directory);
  for (std::uint64_t i = 0; i < cells; ++i) out.cells_.push_back(in.read<OctreeCell>());
  LUMIGRID_ASSIGN_OR_RETURN(out.file_, ingest::SpoolFile::open(directory + "/ordered"));
  if (out.file_.size() != out.points_ * sizeof(OrderedPoint)) return ingest::damagedWorkFiles(directory);
  return out;
}

base::Result<std::vector<OrderedPoint>> OrderedPoints::read(const OctreeCell& cell) const {
  std::vector<OrderedPoint> points(cell.count);
  LUMIGRID_TRY(file_.readAt(cell.first * sizeof(OrderedPoint), std::span(reinterpret_cast<std::uint8_t*>(points.data()),
                                                                         points.size() * sizeof(OrderedPoint))));
  return points;
}

std::vector<CellBlock> makeBlocks(const std::vector<OctreeCell>& cells) {
  std::vector<CellBlock> blocks;
  std::uint64_t points = 0;
  for (std::uint32_t i = 0; i < cells.size(); ++i) {
    if (blocks.empty() || points + cells[i].count > kBlockPoints) {
      blocks.push_back({i, i, {}});
      points = 0;
    }
    points += cells[i].count;
    blocks.back().end = i + 1;
  }
  for (CellBlock& block : blocks) {
    std::vector<LatticeBox> surroundings;
    LatticeBox all{glm::ivec3(1 << kPositionBits), glm::ivec3(0)};
    for (std::uint32_t own = block.first; own < block.end; ++own) {
      surroundings.push_back(cells[own].box().withSurroundings());
      all = {glm::min(all.low, surroundings.back().low), glm::max(all.high, surroundings.back().high)};
    }
    for (std::uint32_t other = 0; other < cells.size(); ++other) {
      const LatticeBox box = cells[other].box();
      const bool is_own = other >= block.first && other < block.end;
      if (!is_own && all.touches(box) &&
          std::any_of(surroundings.begin(), surroundings.end(),
                      [&](const LatticeBox& one) { return one.touches(box); }))
        block.around.push_back(other);
    }
  }
  return blocks;
}

}  // namespace lod::pmr::builder
