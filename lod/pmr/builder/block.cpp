#include "lod/pmr/builder/block.h"

#include <algorithm>

#include "base/check.h"
#include "lod/ingest/morton.h"
#include "lod/ingest/source_spool.h"
#include "lod/pmr/builder/decimate.h"
#include "lod/pmr/builder/umbrellas.h"
#include "lod/pmr/chunk_order.h"
#include "lod/pmr/chunks.h"
#include "lod/pmr/draw_list.h"

namespace lod::pmr::builder {
namespace {

// A height counts up to this share of its cell's edge, so that polygons stay within kReach of them, where they are
// known for certain.
constexpr float kHeightLimit = 0.1F;
// Corners of polygons lie within a quarter of their cell's edge: the half edge of the square, of the edge.
constexpr double kReach = 0.17;

// The sign of a source's normal counts; where there is none, normals point up.
glm::vec3 signedNormal(const glm::dvec3& normal, std::uint32_t given) {
  const glm::dvec3 reference = given != 0 ? glm::dvec3(ingest::unpackNormal(given)) : glm::dvec3(0.0, 0.0, 1.0);
  return glm::vec3(glm::dot(normal, reference) < 0.0 ? -normal : normal);
}

// The place of a lattice point, moved by less than a thousandth of a step. Points of a regular grid then never lie on
// one circle, where any of four triangles is as right as the other two; and everybody moves them alike.
glm::dvec3 apart(std::uint64_t code) {
  std::uint64_t bits = code * 0x9e3779b97f4a7c15;  // Fibonacci hashing (Knuth 1998, section 6.4)
  bits ^= bits >> 29;
  bits *= 0xbf58476d1ce4e5b9;
  const glm::dvec3 by(static_cast<double>(bits >> 34 & 1023), static_cast<double>(bits >> 44 & 1023),
                      static_cast<double>(bits >> 54 & 1023));
  return glm::dvec3(ingest::mortonPoint(code)) + by / (1024.0 * 1024.0);
}

glm::u8vec3 colorOf(const OrderedPoint& point) {
  return {point.color & 255U, point.color >> 8 & 255U, point.color >> 16 & 255U};
}

// Builds the leaves of a block.
class LeafMaker {
 public:
  LeafMaker(const OrderedPoints& points, const LoadedBlock& loaded, const std::vector<PointClass>& classes, bool colors)
      : points_(points),
        loaded_(loaded),
        classes_(classes),
        colors_(colors),
        vertex_(loaded.points.size(), kNoVertex),
        foreign_class_(loaded.points.size(), kNoClass) {}

  std::vector<BuiltLeaf> run(const CellBlock& block) {
    triangles_.assign(block.end - block.first, {});
    umbrellas_.resize(loaded_.own);
    at_rim_.resize(loaded_.own);
    for (std::uint32_t level = 0; level < kLevels; ++level) findTriangles(block, level);
    std::vector<BuiltLeaf> leaves;
    std::size_t begin = 0;
    for (std::uint32_t c = block.first; c < block.end; ++c) {
      const std::size_t end = begin + points_.cells()[c].count;
      leaves.push_back(makeLeaf(points_.cells()[c], begin, end, triangles_[c - block.first]));
      begin = end;
    }
    return leaves;
  }

 private:
  using ByLevel = std::array<std::vector<Triangle>, kLevels>;
  static constexpr std::uint16_t kNoVertex = 65535;
  static constexpr std::uint8_t kNoClass = 255;
  static_assert(kMaxVertices <= kNoVertex);

  void findTriangles(const CellBlock& block, std::uint32_t level) {
    std::vector<glm::dvec3> places;
    std::vector<std::uint32_t> numbers;
    for (std::uint32_t i = 0; i < loaded_.points.size(); ++i)
      if (classes_[i].coarsest >= level) places.push_back(loaded_.places[i]), numbers.push_back(i);
    Umbrellas umbrellas(places, numbers);
    const auto isHere = [&](std::uint32_t i) { return classes_[i].coarsest >= level; };
    for (std::uint32_t k = 0; k < numbers.size() && numbers[k] < loaded_.own; ++k) {
      const std::uint32_t i = numbers[k];
      Umbrella& umbrella = umbrellas_[i];
      const bool is_same = level > 0 && umbrella.isClosed() &&
                           std::all_of(umbrella.around.begin(), umbrella.around.begin() + umbrella.count, isHere);
      if (!is_same) {
        const double reach = at_rim_[i] || level == 0 ? 0.0 : kReach * points_.cells()[loaded_.cell[i]].edge();
        umbrellas.find(k, decodeNormal(classes_[i].normal), reach, umbrella);
      }
      if (level == 0) at_rim_[i] = !umbrella.isClosed();
      umbrella.appendTriangles(i, triangles_[loaded_.cell[i] - block.first][level]);
    }
    for (ByLevel& cell : triangles_) {
      std::sort(cell[level].begin(), cell[level].end());
      cell[level].erase(std::unique(cell[level].begin(), cell[level].end()), cell[level].end());
    }
  }

  // Own points are [begin, end).
  BuiltLeaf makeLeaf(const OctreeCell& cell, std::size_t begin, std::size_t end, ByLevel& triangles) {
    BuiltLeaf out;
    out.leaf.code = cell.code;
    out.leaf.depth = cell.depth;
    const auto isOwn = [&](std::uint32_t i) { return i >= begin && i < end; };
    const std::vector<std::uint32_t> foreign = findForeign(end - begin, isOwn, triangles);

    std::vector<std::uint32_t> order;  // of vertices
    std::array<std::size_t, kLevels> vertices_at{};
    std::array<base::Bytes, kLeafChunks> chunks;
    for (std::uint32_t c = kLevels; c-- > 0;) {
      const std::size_t first = order.size();
      for (std::size_t i = begin; i < end; ++i)
        if (classes_[i].coarsest == c) order.push_back(static_cast<std::uint32_t>(i));
      const std::size_t own = order.size() - first;
      for (const std::uint32_t f : foreign)
        if (foreign_class_[f] == c) order.push_back(f);
      LevelRow& row = out.leaf.levels[c];
      row.points = static_cast<std::uint32_t>(own);
      row.foreign = static_cast<std::uint32_t>(order.size() - first - own);
      std::vector<CodedPoint> coded;
      for (std::size_t i = first; i < order.size(); ++i) coded.push_back(codedPoint(order[i]));
      chunks[c] = encodePoints(std::span(coded).first(own), std::span(coded).subspan(own), colors_);
      row.point_bytes = static_cast<std::uint32_t>(chunks[c].size());
      vertices_at[c] = order.size();
    }
    std::vector<glm::ivec3> places;
    std::vector<glm::vec3> positions;
    std::vector<bool> is_own;
    for (std::uint32_t v = 0; v < order.size(); ++v) {
      vertex_[order[v]] = static_cast<std::uint16_t>(v);
      places.push_back(ingest::mortonPoint(loaded_.points[order[v]].code));
      positions.push_back(points_.lattice().position(places.back()));
      is_own.push_back(isOwn(order[v]));
      out.leaf.box.add(positions.back());
    }

    float finer = 0.0F;  // radius
    for (std::uint32_t level = 0; level < kLevels; ++level) {
      LevelRow& row = out.leaf.levels[level];
      std::vector<std::uint16_t> corners;
      for (const Triangle& triangle : triangles[level])
        for (const std::uint32_t i : triangle.corners()) corners.push_back(vertex_[i]);
      const std::size_t vertices = vertices_at[level];
      row.triangles = static_cast<std::uint32_t>(triangles[level].size());
      chunks[kLevels + level] = encodeTriangles(corners, std::span(places).first(vertices));
      row.triangle_bytes = static_cast<std::uint32_t>(chunks[kLevels + level].size());
      const DrawList list = makeDrawList(std::span(positions).first(vertices), is_own, std::move(corners));
      row.radius = finer = std::max(finer, meanRadius(list));
      if (level == 0)
        out.unused = static_cast<std::uint64_t>(std::count(list.point_radii.begin(), list.point_radii.end(), 0.0F));
    }
    // A leaf of points without umbrellas looks the same at all levels.
    const auto edge = static_cast<float>(cell.edge() * points_.lattice().step);
    for (LevelRow& row : out.leaf.levels)
      if (row.radius == 0.0F) row.radius = edge;

    for (const base::Bytes& chunk : chunks) out.chunks.insert(out.chunks.end(), chunk.begin(), chunk.end());

    for (const std::uint32_t i : order) vertex_[i] = kNoVertex;
    for (const std::uint32_t f : foreign) foreign_class_[f] = kNoClass;
    return out;
  }

  // The foreign points that the triangles use, in order, each with the coarsest level at which they do. Triangles for
  // whose points the leaf has no number left are dropped.
  template <class IsOwn>
  std::vector<std::uint32_t> findForeign(std::size_t own, const IsOwn& isOwn, ByLevel& triangles) {
    std::vector<std::uint32_t> foreign;
    for (std::uint32_t level = kLevels; level-- > 0;) {
      std::uint32_t kept = 0;
      const auto has_no_room = [&](const Triangle& triangle) {
        const auto corners = triangle.corners();
        const auto isNew = [&](std::uint32_t i) { return !isOwn(i) && foreign_class_[i] == kNoClass; };
        const auto fresh = static_cast<std::size_t>(std::count_if(corners.begin(), corners.end(), isNew));
        if (own + foreign.size() + fresh > kMaxVertices || ++kept > kMaxTriangles) return true;
        for (const std::uint32_t i : corners) {
          if (!isNew(i)) continue;
          foreign_class_[i] = static_cast<std::uint8_t>(level);
          foreign.push_back(i);
        }
        return false;
      };
      std::erase_if(triangles[level], has_no_room);
    }
    std::sort(foreign.begin(), foreign.end(),
              [this](std::uint32_t a, std::uint32_t b) { return loaded_.points[a].code < loaded_.points[b].code; });
    return foreign;
  }

  CodedPoint codedPoint(std::uint32_t i) const {
    const OrderedPoint& point = loaded_.points[i];
    return {ingest::mortonPoint(point.code), classes_[i].normal, colors_ ? colorOf(point) : glm::u8vec3(255)};
  }

  const OrderedPoints& points_;
  const LoadedBlock& loaded_;
  const std::vector<PointClass>& classes_;
  const bool colors_;
  std::vector<ByLevel> triangles_;           // by cell of the block; of numbers in loaded_
  std::vector<Umbrella> umbrellas_;          // by own point, at the level looked at last
  std::vector<bool> at_rim_;                 // by own point
  std::vector<std::uint16_t> vertex_;        // by point, in the leaf that is being made
  std::vector<std::uint8_t> foreign_class_;  // by point, likewise
};

}  // namespace

base::Result<LoadedBlock> loadBlock(const OrderedPoints& points, const CellBlock& block) {
  LoadedBlock out;
  const auto& cells = points.cells();
  std::vector<LatticeBox> surroundings;
  for (std::uint32_t c = block.first; c < block.end; ++c) surroundings.push_back(cells[c].box().withSurroundings());
  const auto isNear = [&](const glm::ivec3& place) {
    return std::any_of(surroundings.begin(), surroundings.end(),
                       [&](const LatticeBox& one) { return one.contains(place); });
  };
  const auto load = [&](std::uint32_t cell, bool own) -> base::Result<void> {
    LUMIGRID_ASSIGN_OR_RETURN(const auto read, points.read(cells[cell]));
    for (std::uint32_t i = 0; i < read.size(); ++i) {
      const glm::ivec3 place = ingest::mortonPoint(read[i].code);
      if (!own && !isNear(place)) continue;
      out.points.push_back(read[i]);
      out.cell.push_back(cell);
      out.number.push_back(i);
      out.places.push_back(apart(read[i].code));
    }
    return {};
  };
  for (std::uint32_t c = block.first; c < block.end; ++c) LUMIGRID_TRY(load(c, true));
  out.own = out.points.size();
  for (const std::uint32_t c : block.around) LUMIGRID_TRY(load(c, false));
  LUMIGRID_CHECK(out.points.size() < Triangle::kMaxPoints);
  return out;
}

base::Result<std::vector<PointClass>> classify(const OrderedPoints& points, const CellBlock& block) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto loaded, loadBlock(points, block));
  std::vector<VoronoiCell> cells = voronoiCells(loaded.places);
  std::vector<float> most;
  for (const std::uint32_t cell : loaded.cell)
    most.push_back(kHeightLimit * static_cast<float>(points.cells()[cell].edge()));
  const Neighbourhoods near(loaded.places);
  const std::vector<float> limits = heightLimits(loaded.places, near, loaded.cell, std::move(most));
  const PointBlock decided{loaded.places, loaded.own, limits};
  mendRims(decided, near, cells);
  const auto normals = umbrellaNormals(decided, near, cells, loaded.own);
  const auto coarsest = decimate(decided, near, cells);
  std::vector<PointClass> classes(loaded.own);
  for (std::size_t i = 0; i < loaded.own; ++i)
    classes[i] = {coarsest[i], encodeNormal(signedNormal(normals[i], loaded.points[i].normal))};
  return classes;
}

base::Result<std::vector<BuiltLeaf>> makeLeaves(const OrderedPoints& points, const ClassStore& classes,
                                                const CellBlock& block, bool colors) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto loaded, loadBlock(points, block));
  std::vector<PointClass> all;
  std::vector<PointClass> of_cell;
  std::uint32_t cell = ~std::uint32_t{0};
  for (std::size_t i = 0; i < loaded.points.size(); ++i) {
    if (loaded.cell[i] != cell) {
      cell = loaded.cell[i];
      LUMIGRID_ASSIGN_OR_RETURN(of_cell, classes.read(cell));
    }
    all.push_back(of_cell[loaded.number[i]]);
  }
  return LeafMaker(points, loaded, all, colors).run(block);
}

}  // namespace lod::pmr::builder
