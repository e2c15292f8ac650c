#pragma once
// Makes pmr.lgm files in memory from surfaces with known levels, for tests that need a file but no builder.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <glm/gtc/constants.hpp>
#include <map>
#include <utility>
#include <vector>

#include "base/geometry.h"
#include "lod/morton.h"
#include "lod/pmr/chunk_order.h"
#include "lod/pmr/chunks.h"
#include "lod/pmr/draw_list.h"
#include "lod/pmr/format.h"

namespace support {

/// Points of a surface, in eleven levels, and the triangles of each level.
struct LevelledSurface {
  lod::Lattice lattice;
  std::vector<lod::pmr::CodedPoint> points;
  std::vector<std::uint32_t> classes;  ///< of each point
  std::array<std::vector<std::array<std::uint32_t, 3>>, lod::pmr::kLevels> triangles;
};

/// A torus with bumps, of rows × columns points, both multiples of 32 and at least 96. Level L has each 2^(L / 2)-th
/// column and each 2^((L + 1) / 2)-th row, so each level is a closed mesh. It lies around the origin with an outer
/// radius of about 1.4.
inline LevelledSurface bumpyTorus(std::uint32_t rows, std::uint32_t columns) {
  using namespace lod::pmr;
  LevelledSurface made;
  made.lattice = {glm::dvec3(-2.0), 4.0 / (1 << kPositionBits)};
  const auto at = [](double u, double v) {
    const double thick =
        0.35 * (1.0 + 0.1 * std::sin(7.0 * u) * std::cos(3.0 * v) + 0.01 * std::sin(41.0 * u + 29.0 * v));
    const double around = 1.0 + thick * std::cos(v);
    return glm::dvec3(around * std::cos(u), around * std::sin(u), thick * std::sin(v));
  };
  const auto rowStep = [](std::uint32_t level) { return 1U << (level + 1) / 2; };
  const auto columnStep = [](std::uint32_t level) { return 1U << level / 2; };
  for (std::uint32_t r = 0; r < rows; ++r) {
    for (std::uint32_t c = 0; c < columns; ++c) {
      // The sample places are a little irregular, as those of a scanner are.
      const double u = glm::two_pi<double>() * (c + 0.3 * std::sin(12.9898 * r + 78.233 * c)) / columns;
      const double v = glm::two_pi<double>() * (r + 0.3 * std::sin(39.346 * r + 11.135 * c)) / rows;
      const glm::dvec3 p = at(u, v);
      const glm::dvec3 normal = glm::normalize(glm::cross(at(u + 1e-4, v) - p, at(u, v + 1e-4) - p));
      CodedPoint point;
      point.place = glm::ivec3(glm::round((p - made.lattice.origin) / made.lattice.step));
      point.normal = encodeNormal(glm::vec3(normal));
      point.color = glm::u8vec3(glm::round(127.5 + 60.0 * p + 20.0 * std::sin(60.0 * p.x)));
      made.points.push_back(point);
      std::uint32_t coarsest = kCoarsest;
      while (r % rowStep(coarsest) != 0 || c % columnStep(coarsest) != 0) --coarsest;
      made.classes.push_back(coarsest);
    }
  }
  for (std::uint32_t level = 0; level < kLevels; ++level) {
    const std::uint32_t dr = rowStep(level), dc = columnStep(level);
    for (std::uint32_t r = 0; r < rows; r += dr) {
      for (std::uint32_t c = 0; c < columns; c += dc) {
        const std::uint32_t a = r * columns + c, b = r * columns + (c + dc) % columns;
        const std::uint32_t d = (r + dr) % rows * columns + c, e = (r + dr) % rows * columns + (c + dc) % columns;
        made.triangles[level].push_back({a, b, e});
        made.triangles[level].push_back({a, e, d});
      }
    }
  }
  return made;
}

/// The part of a torus of 96 × 96 points in its first rows and columns: a small surface with a border.
inline LevelledSurface torusPatch(std::uint32_t rows, std::uint32_t columns) {
  constexpr std::uint32_t kSide = 96;
  const LevelledSurface torus = bumpyTorus(kSide, kSide);
  LevelledSurface patch;
  patch.lattice = torus.lattice;
  std::vector<std::uint32_t> numbers(torus.points.size(), kSide * kSide);
  for (std::uint32_t r = 0; r < rows; ++r) {
    for (std::uint32_t c = 0; c < columns; ++c) {
      numbers[r * kSide + c] = static_cast<std::uint32_t>(patch.points.size());
      patch.points.push_back(torus.points[r * kSide + c]);
      patch.classes.push_back(torus.classes[r * kSide + c]);
    }
  }
  for (std::uint32_t level = 0; level < lod::pmr::kLevels; ++level) {
    for (const auto& [a, b, c] : torus.triangles[level]) {
      const std::array<std::uint32_t, 3> triangle{numbers[a], numbers[b], numbers[c]};
      if (*std::max_element(triangle.begin(), triangle.end()) < patch.points.size())
        patch.triangles[level].push_back(triangle);
    }
  }
  return patch;
}

/// A file, and what is in it.
struct MadePmr {
  base::Bytes file;
  lod::pmr::Header header;
  std::vector<lod::pmr::Leaf> leaves;
  /// Each leaf has all its vertices by number, and the corners of each level's triangles.
  struct Content {
    std::vector<lod::pmr::CodedPoint> vertices;
    std::vector<bool> is_own;
    std::array<std::vector<std::uint16_t>, lod::pmr::kLevels> corners;
  };
  std::vector<Content> contents;
};

/// Cuts a surface into leaves and writes them.
class PmrMaker {
 public:
  /// Functions that spoil what is written. An empty one changes nothing.
  struct Changes {
    std::function<void(lod::pmr::Header&)> header;
    std::function<void(lod::pmr::Leaf&)> leaf;
    std::function<void(std::vector<lod::pmr::CodedPoint>& own, std::vector<lod::pmr::CodedPoint>& foreign)> points;
    std::function<void(std::vector<std::uint16_t>& corners, const std::vector<bool>& is_own)> corners;
  };

  PmrMaker(const LevelledSurface& surface, bool colors, std::uint32_t max_leaf_points, Changes changes = {})
      : surface_(surface), colors_(colors), max_leaf_points_(max_leaf_points), changes_(std::move(changes)) {}

  MadePmr make() {
    std::vector<std::uint32_t> all(surface_.points.size());
    for (std::uint32_t i = 0; i < all.size(); ++i) all[i] = i;
    leaf_of_.resize(all.size());
    split(all, 0, 0);
    for (std::uint32_t leaf = 0; leaf < cells_.size(); ++leaf) addLeaf(leaf);
    return writeFile();
  }

 private:
  struct Cell {
    std::uint64_t code = 0;
    std::uint32_t depth = 0;
    std::vector<std::uint32_t> points;
  };

  void split(const std::vector<std::uint32_t>& points, std::uint64_t code, std::uint32_t depth) {
    using namespace lod::pmr;
    if (points.empty()) return;
    if (points.size() <= max_leaf_points_ || depth == kPositionBits) {
      for (const std::uint32_t p : points) leaf_of_[p] = static_cast<std::uint32_t>(cells_.size());
      cells_.push_back({code, depth, points});
      return;
    }
    const std::uint32_t shift = 3 * (kPositionBits - 1 - depth);
    std::array<std::vector<std::uint32_t>, 8> parts;
    for (const std::uint32_t p : points) parts[lod::mortonCode(surface_.points[p].place) >> shift & 7].push_back(p);
    for (std::uint64_t octant = 0; octant < 8; ++octant) split(parts[octant], code | octant << shift, depth + 1);
  }

  void addLeaf(std::uint32_t number) {
    using namespace lod::pmr;
    const Cell& cell = cells_[number];
    Leaf leaf;
    leaf.code = cell.code;
    leaf.depth = cell.depth;
    MadePmr::Content content;
    std::array<base::Bytes, kLeafChunks> chunks;
    std::map<std::uint32_t, std::uint16_t> numbers;  // of points by their number in the surface
    std::vector<glm::vec3> positions;
    std::vector<glm::ivec3> places;
    for (std::uint32_t level = kLevels; level-- > 0;) {
      std::vector<std::uint32_t> own, foreign;
      for (const std::uint32_t p : cell.points)
        if (surface_.classes[p] == level) own.push_back(p);
      std::vector<std::array<std::uint32_t, 3>> umbrella;
      for (const auto& triangle : surface_.triangles[level]) {
        const auto isOwn = [&](std::uint32_t p) { return leaf_of_[p] == number; };
        if (std::none_of(triangle.begin(), triangle.end(), isOwn)) continue;
        umbrella.push_back(triangle);
        for (const std::uint32_t p : triangle)
          if (!isOwn(p) && numbers.count(p) == 0 && std::find(foreign.begin(), foreign.end(), p) == foreign.end())
            foreign.push_back(p);
      }

      // The points of the class.
      std::array<std::vector<CodedPoint>, 2> lists;
      for (const bool is_own : {true, false}) {
        std::vector<std::uint32_t>& points = is_own ? own : foreign;
        std::sort(points.begin(), points.end(), [&](std::uint32_t a, std::uint32_t b) {
          const std::uint64_t ma = lod::mortonCode(surface_.points[a].place),
                              mb = lod::mortonCode(surface_.points[b].place);
          return ma != mb ? ma < mb : a < b;
        });
        for (const std::uint32_t p : points) {
          CodedPoint point = surface_.points[p];
          if (!colors_) point.color = glm::u8vec3(255);
          lists[is_own ? 0 : 1].push_back(point);
          numbers[p] = static_cast<std::uint16_t>(content.vertices.size());
          content.vertices.push_back(point);
          content.is_own.push_back(is_own);
          places.push_back(point.place);
          positions.push_back(surface_.lattice.position(point.place));
          leaf.box.add(positions.back());
        }
      }
      for (const auto& triangle : umbrella)
        for (const std::uint32_t p : triangle) content.corners[level].push_back(numbers[p]);

      if (changes_.points) changes_.points(lists[0], lists[1]);
      if (changes_.corners) changes_.corners(content.corners[level], content.is_own);
      LevelRow& row = leaf.levels[level];
      row.points = static_cast<std::uint32_t>(own.size());
      row.foreign = static_cast<std::uint32_t>(foreign.size());
      row.triangles = static_cast<std::uint32_t>(content.corners[level].size() / 3);
      row.radius = meanRadius(makeDrawList(positions, content.is_own, content.corners[level]));
      chunks[level] = encodePoints(lists[0], lists[1], colors_);
      chunks[kLevels + level] = encodeTriangles(content.corners[level], places);
      row.point_bytes = static_cast<std::uint32_t>(chunks[level].size());
      row.triangle_bytes = static_cast<std::uint32_t>(chunks[kLevels + level].size());
    }
    for (std::uint32_t level = 1; level < kLevels; ++level)
      leaf.levels[level].radius = std::max(leaf.levels[level].radius, leaf.levels[level - 1].radius);
    const double edge = surface_.lattice.step * std::exp2(double{kPositionBits} - leaf.depth);
    for (LevelRow& row : leaf.levels)
      if (row.radius == 0.0F) row.radius = static_cast<float>(edge);
    if (changes_.leaf) changes_.leaf(leaf);
    made_.leaves.push_back(leaf);
    made_.contents.push_back(std::move(content));
    chunks_.push_back(std::move(chunks));
  }

  MadePmr writeFile() {
    using namespace lod::pmr;
    Header& header = made_.header;
    header.points = surface_.points.size();
    header.leaves = static_cast<std::uint32_t>(made_.leaves.size());
    header.colors = colors_;
    header.oriented = true;
    header.lattice = surface_.lattice;
    std::vector<glm::vec3> positions;
    for (const CodedPoint& point : surface_.points) positions.push_back(surface_.lattice.position(point.place));
    header.bounds = base::boundingSphere(positions);
    if (changes_.header) changes_.header(header);
    const base::Bytes table = tableBytes(made_.leaves, surface_.lattice);
    header.table_bytes = static_cast<std::uint32_t>(table.size());
    placeChunks(header, made_.leaves);

    made_.file = headerBytes(header);
    const auto append = [this](const base::Bytes& bytes) {
      made_.file.insert(made_.file.end(), bytes.begin(), bytes.end());
    };
    append(table);
    const ChunkOrder order(header.leaves);
    for (std::uint64_t place = 0; place < order.chunks(); ++place)
      append(chunks_[order.at(place).leaf][order.at(place).chunk]);
    made_.leaves = *readTable(header, table);  // with their boxes and radii rounded
    return std::move(made_);
  }

  const LevelledSurface& surface_;
  const bool colors_;
  const std::uint32_t max_leaf_points_;
  const Changes changes_;
  std::vector<std::uint32_t> leaf_of_;
  std::vector<Cell> cells_;
  std::vector<std::array<base::Bytes, lod::pmr::kLeafChunks>> chunks_;
  MadePmr made_;
};

/// A torus of side × side points, side a multiple of 32 from 96 on, in leaves of at most so many points.
inline MadePmr madePmr(std::uint32_t side = 128, bool colors = true, std::uint32_t max_leaf_points = 1000) {
  return PmrMaker(bumpyTorus(side, side), colors, max_leaf_points).make();
}

}  // namespace support
