#include "lod/pmr/check_file.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <optional>
#include <unordered_map>

#include "lod/morton.h"
#include "lod/pmr/chunks.h"
#include "lod/pmr/draw_list.h"
#include "lod/pmr/leaf_picture.h"

namespace lod::pmr {
namespace {

constexpr std::size_t kMaxFaults = 10;
/// Leaves whose points are kept to look up the foreign points of others. Leaves follow each other in Morton order, so
/// most neighbours have been read not long before.
constexpr std::size_t kKeptLeaves = 64;
/// Radii are stored in steps of 2^(1/32), and means of floats depend on their order.
constexpr float kRadiusTolerance = 0.02F;

/// A leaf's own points of a class, in the order of sortForChunk.
using OwnPoints = std::array<std::vector<CodedPoint>, kLevels>;

bool isBefore(const CodedPoint& a, const CodedPoint& b) {
  const std::uint64_t ma = mortonCode(a.place), mb = mortonCode(b.place);
  return ma < mb;
}

class Checker {
 public:
  explicit Checker(const FileBytes& file) : file_(file) {}

  std::vector<std::string> run() {
    if (readFront())
      for (std::uint32_t leaf = 0; leaf < leaves_.size() && faults_.size() < kMaxFaults; ++leaf) checkLeaf(leaf);
    return std::move(faults_);
  }

 private:
  void fault(const std::string& text) {
    if (faults_.size() < kMaxFaults) faults_.push_back(text);
  }
  void leafFault(std::uint32_t leaf, const std::string& text) { fault("leaf " + std::to_string(leaf) + ": " + text); }
  static std::string ofLevel(const char* what, std::uint32_t level) {
    return std::string(what) + " " + std::to_string(level);
  }

  bool readFront() {
    base::Bytes front(static_cast<std::size_t>(std::min<std::uint64_t>(file_.size(), kHeaderBytes)));
    if (!file_.read(0, front)) return fault("cannot be read; copy the file again"), false;
    const auto header = readHeader(front);
    if (!header) return fault(header.error().message), false;
    header_ = *header;
    if (header_.file_bytes != file_.size()) {
      fault("has " + std::to_string(file_.size()) + " bytes, its header says " + std::to_string(header_.file_bytes));
      return false;
    }
    base::Bytes table(header_.table_bytes);
    if (!file_.read(kHeaderBytes, table)) return fault("table: cannot be read; copy the file again"), false;
    auto leaves = readTable(header_, table);
    if (!leaves) return fault(leaves.error().message), false;
    leaves_ = std::move(*leaves);
    return true;
  }

  std::optional<base::Bytes> readChunk(std::uint32_t leaf, std::uint32_t chunk) const {
    const ChunkPlace place = placeOf(leaves_[leaf], chunk);
    base::Bytes bytes(place.bytes);
    return file_.read(place.offset, bytes) ? std::optional(std::move(bytes)) : std::nullopt;
  }

  /// Appends a class's points to `points`; false where they are damaged.
  bool readPoints(std::uint32_t leaf, std::uint32_t point_class, std::vector<CodedPoint>& points) const {
    const LevelRow& row = leaves_[leaf].levels[point_class];
    const auto chunk = readChunk(leaf, point_class);
    return chunk && decodePoints(*chunk, row.points, row.foreign, header_.colors, points);
  }

  void checkLeaf(std::uint32_t leaf) {
    std::vector<CodedPoint> points;
    std::vector<bool> is_own;
    std::vector<glm::ivec3> places;
    std::vector<glm::vec3> positions;
    std::array<float, kLevels> means{};
    for (std::uint32_t level = kLevels; level-- > 0;) {
      const LevelRow& row = leaves_[leaf].levels[level];
      const std::size_t before = points.size();
      if (!readPoints(leaf, level, points))
        return leafFault(leaf, ofLevel("its points of class", level) + " are damaged; copy the file again");
      is_own.resize(before + row.points, true);
      is_own.resize(points.size(), false);
      for (std::size_t p = before; p < points.size(); ++p) {
        places.push_back(points[p].place);
        positions.push_back(header_.lattice.position(points[p].place));
      }
      checkPoints(leaf, level, std::span(points).subspan(before), row.points);

      const auto chunk = readChunk(leaf, kLevels + level);
      auto corners = chunk ? decodeTriangles(*chunk, row.triangles, places) : damaged("");
      if (!corners)
        return leafFault(leaf, ofLevel("its triangles of level", level) + " are damaged; copy the file again");
      checkTriangles(leaf, level, is_own, before + row.points, *corners);
      means[level] = meanRadius(makeDrawList(positions, is_own, std::move(*corners)));
    }
    checkRadii(leaf, means);
    checkBounds(leaf, positions);
  }

  void checkPoints(std::uint32_t leaf, std::uint32_t point_class, std::span<const CodedPoint> points,
                   std::uint32_t own_points) {
    const std::string place = ofLevel("class", point_class);
    const auto own = points.first(own_points), foreign = points.subspan(own_points);
    for (const auto& list : {own, foreign})
      if (!std::is_sorted(list.begin(), list.end(), isBefore)) leafFault(leaf, place + ": its points are not in order");
    if (std::any_of(own.begin(), own.end(), [&](const CodedPoint& point) { return leafAt(point) != leaf; }))
      leafFault(leaf, place + ": a point lies outside its cell");
    if (!std::all_of(foreign.begin(), foreign.end(),
                     [&](const CodedPoint& point) { return isOwnElsewhere(point, point_class, leaf); }))
      leafFault(leaf, place + ": a foreign point is no point of that level of another leaf");
  }

  /// The leaf whose cell contains the point; as many as there are leaves where there is none.
  std::uint32_t leafAt(const CodedPoint& point) const {
    const std::uint64_t code = mortonCode(point.place);
    const auto after = std::upper_bound(leaves_.begin(), leaves_.end(), code,
                                        [](std::uint64_t c, const Leaf& leaf) { return c < leaf.code; });
    if (after == leaves_.begin()) return static_cast<std::uint32_t>(leaves_.size());
    const auto found = after - 1;
    const bool inside = (code - found->code) >> 3 * (kPositionBits - found->depth) == 0;
    return static_cast<std::uint32_t>(inside ? found - leaves_.begin() : leaves_.end() - leaves_.begin());
  }

  bool isOwnElsewhere(const CodedPoint& point, std::uint32_t level, std::uint32_t leaf) {
    const std::uint32_t owner = leafAt(point);
    if (owner == leaf || owner == leaves_.size()) return false;
    const OwnPoints& points = ownPoints(owner);
    for (std::uint32_t c = level; c < kLevels; ++c) {
      const auto [begin, end] = std::equal_range(points[c].begin(), points[c].end(), point, isBefore);
      if (std::find(begin, end, point) != end) return true;
    }
    return false;
  }

  // A damaged leaf has no points; it is told of by itself.
  const OwnPoints& ownPoints(std::uint32_t leaf) {
    const auto found = kept_.find(leaf);
    if (found != kept_.end()) return found->second;
    if (order_.size() == kKeptLeaves) {
      kept_.erase(order_.front());
      order_.pop_front();
    }
    order_.push_back(leaf);
    OwnPoints& points = kept_[leaf];
    for (std::uint32_t c = 0; c < kLevels; ++c)
      if (readPoints(leaf, c, points[c])) points[c].resize(leaves_[leaf].levels[c].points);
    return points;
  }

  /// `first_foreign`: the first vertex that only this level's triangles and finer ones use.
  void checkTriangles(std::uint32_t leaf, std::uint32_t level, const std::vector<bool>& is_own,
                      std::size_t first_foreign, const std::vector<std::uint16_t>& corners) {
    const std::string place = ofLevel("level", level);
    std::vector<bool> is_used(is_own.size(), false);
    bool all_own = true;
    for (std::size_t i = 0; i < corners.size(); i += 3) {
      for (std::size_t k = i; k < i + 3; ++k) is_used[corners[k]] = true;
      all_own &= is_own[corners[i]] || is_own[corners[i + 1]] || is_own[corners[i + 2]];
    }
    if (!all_own) leafFault(leaf, place + ": a triangle has no point of the leaf");
    const auto foreign = is_used.begin() + static_cast<std::ptrdiff_t>(first_foreign);
    if (!std::all_of(foreign, is_used.end(), [](bool used) { return used; }))
      leafFault(leaf, place + ": a foreign point has no triangle");
  }

  /// `means`: meanRadius() of each level's list. Radii don't fall from level to level; where there is no umbrella up to
  /// a level, its radius is the edge of the cell.
  void checkRadii(std::uint32_t leaf, const std::array<float, kLevels>& means) {
    const Leaf& of = leaves_[leaf];
    const auto edge = static_cast<float>(header_.lattice.step * std::exp2(double{kPositionBits} - of.depth));
    float largest = 0.0F;
    for (std::uint32_t level = 0; level < kLevels; ++level) {
      largest = std::max(largest, means[level]);
      const float expected = largest > 0.0F ? largest : edge;
      if (!(std::abs(of.levels[level].radius - expected) <= kRadiusTolerance * expected))
        leafFault(leaf, ofLevel("level", level) + ": its mean radius is not that of its points");
    }
  }

  void checkBounds(std::uint32_t leaf, const std::vector<glm::vec3>& positions) {
    const base::Sphere& bounds = header_.bounds;
    const float largest = bounds.radius * (1.0F + 1e-5F);
    bool in_box = true, in_bounds = true;
    for (const glm::vec3& p : positions) {
      in_box &= leaves_[leaf].box.contains(p);
      in_bounds &= glm::length(p - bounds.center) <= largest;
    }
    if (!in_box) leafFault(leaf, "a point lies outside its box");
    if (!in_bounds) leafFault(leaf, "a point lies outside the header's bounds");
  }

  const FileBytes& file_;
  Header header_;
  std::vector<Leaf> leaves_;
  std::vector<std::string> faults_;
  std::unordered_map<std::uint32_t, OwnPoints> kept_;
  std::deque<std::uint32_t> order_;  // of the kept leaves: the first goes first
};

}  // namespace

std::vector<std::string> checkFile(const FileBytes& file) {
  return Checker(file).run();
}

}  // namespace lod::pmr
