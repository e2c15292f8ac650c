#pragma once
// Makes hlod.lgh files in memory from a height field, for tests that need a file but no builder.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <map>
#include <utility>
#include <vector>

#include "base/geometry.h"
#include "lod/hlod/block.h"
#include "lod/hlod/format.h"

namespace support {

/// A file, and what is in it.
struct MadeHlod {
  base::Bytes file;
  lod::hlod::Header header;
  std::vector<lod::hlod::Node> nodes;             ///< as readTable() gives them
  std::vector<lod::hlod::NodeGeometry> pictures;  ///< of each node, before they were coded
  std::vector<lod::hlod::NodeGeometry> casters;   ///< the same; empty for leaves
};

/// A bumpy square of 2 × 2 units around the origin, seen from above (+z), as a quadtree of the given depth. Each node
/// has `quads` × `quads` quads of its square, so a node's are twice as long as its children's. In inner nodes each
/// eighth quad is shown by points, which the triangles leave out.
class HlodMaker {
 public:
  /// Functions that spoil what is written. An empty one changes nothing.
  struct Changes {
    std::function<void(lod::hlod::Header&)> header;
    std::function<void(std::uint32_t number, lod::hlod::Node&)> node;
    std::function<void(std::uint32_t number, lod::hlod::NodeGeometry&)> picture, caster;
  };

  /// `quads`: a power of two; quads · 2^depth is 2^14 at most.
  HlodMaker(std::uint32_t depth, std::uint32_t quads, bool colors, Changes changes = {})
      : depth_(depth), quads_(quads), colors_(colors), changes_(std::move(changes)) {}

  MadeHlod make() {
    using namespace lod::hlod;
    made_.header.colors = colors_;
    made_.header.lattice = {glm::dvec3(-2.0), 4.0 / (1 << kPositionBits)};
    for (std::uint32_t d = 0; d <= depth_; ++d)
      for (std::uint32_t i = 0; i < 1U << 2 * d; ++i) addNode(d, i);
    linkNodes();
    return writeFile();
  }

 private:
  using NodeGeometry = lod::hlod::NodeGeometry;
  using NodeVertex = lod::hlod::NodeVertex;

  /// Lattice points between neighbouring samples of the finest level.
  std::int32_t finest() const {
    return (1 << (lod::hlod::kPositionBits - 1)) / static_cast<std::int32_t>(quads_ << depth_);
  }

  static double height(double x, double y) {
    return 0.12 * std::sin(4.0 * x) * std::cos(3.0 * y) + 0.02 * std::sin(23.0 * x + 17.0 * y);
  }
  static glm::vec3 normalAt(double x, double y) {
    constexpr double kStep = 1e-4;
    const double dx = (height(x + kStep, y) - height(x - kStep, y)) / (2.0 * kStep);
    const double dy = (height(x, y + kStep) - height(x, y - kStep)) / (2.0 * kStep);
    return glm::vec3(glm::normalize(glm::dvec3(-dx, -dy, 1.0)));
  }

  static double coordinate(std::int32_t place) { return 4.0 * place / (1 << lod::hlod::kPositionBits) - 2.0; }

  /// The place of the surface at lattice coordinates, in steps of 2^step_bits lattice steps.
  static glm::ivec3 placeAt(std::int32_t x, std::int32_t y, std::uint32_t step_bits) {
    const double z = (height(coordinate(x), coordinate(y)) + 2.0) / 4.0 * (1 << lod::hlod::kPositionBits);
    return {x >> step_bits, y >> step_bits, static_cast<std::int32_t>(std::lround(z / (1 << step_bits)))};
  }

  NodeVertex vertexAt(std::int32_t x, std::int32_t y, std::uint32_t step_bits, bool is_caster) const {
    NodeVertex vertex{placeAt(x, y, step_bits)};
    if (is_caster) return vertex;
    const double u = coordinate(x), v = coordinate(y);
    vertex.normal = normalAt(u, v);
    if (colors_)
      vertex.color =
          glm::u8vec3(glm::round(glm::dvec3(128.0 + 100.0 * u, 128.0 + 100.0 * v, 128.0 + 90.0 * std::sin(9.0 * u))));
    return vertex;
  }

  /// A node's square: where it begins, and how far its samples lie from each other.
  struct Square {
    std::int32_t x = 0, y = 0, spacing = 0;
    std::uint32_t step_bits = 0;
  };
  Square squareOf(std::uint32_t depth, std::uint32_t index) const {
    Square square;
    square.spacing = finest() << (depth_ - depth);
    for (std::uint32_t d = 0; d < depth; ++d) {
      square.x |= static_cast<std::int32_t>(index >> 2 * d & 1) << d;
      square.y |= static_cast<std::int32_t>(index >> (2 * d + 1) & 1) << d;
    }
    const std::int32_t edge = square.spacing * static_cast<std::int32_t>(quads_);
    constexpr std::int32_t kBegin = 1 << (lod::hlod::kPositionBits - 2);
    square.x = kBegin + square.x * edge, square.y = kBegin + square.y * edge;
    // Places of inner nodes are known to a 64th of a quad, or as well as those of the leaves.
    if (depth < depth_)
      while (1 << (square.step_bits + 1) <= square.spacing / 64) ++square.step_bits;
    return square;
  }

  static bool isPointQuad(std::uint32_t column, std::uint32_t row) { return (column + 3 * row) % 8 == 0; }

  NodeGeometry geometryOf(const Square& square, bool with_points, bool is_caster) const {
    NodeGeometry geometry;
    const auto at = [&](std::uint32_t i, std::int32_t begin) {
      return begin + static_cast<std::int32_t>(i) * square.spacing;
    };
    for (std::uint32_t row = 0; row <= quads_; ++row)
      for (std::uint32_t column = 0; column <= quads_; ++column)
        geometry.vertices.push_back(vertexAt(at(column, square.x), at(row, square.y), square.step_bits, is_caster));
    for (std::uint32_t row = 0; row < quads_; ++row) {
      for (std::uint32_t column = 0; column < quads_; ++column) {
        if (with_points && isPointQuad(column, row)) {
          addPoints(geometry, square, at(column, square.x), at(row, square.y));
          continue;
        }
        const std::uint32_t a = row * (quads_ + 1) + column, b = a + 1, c = a + quads_ + 1, d = c + 1;
        for (const std::uint32_t v : {a, b, d, a, d, c}) geometry.triangles.push_back(v);
      }
    }
    if (!is_caster) geometry.edges = openEdges(geometry.triangles);
    return geometry;
  }

  /// Four by four points in place of a quad.
  void addPoints(NodeGeometry& geometry, const Square& square, std::int32_t x, std::int32_t y) const {
    for (std::int32_t i = 0; i < 4; ++i)
      for (std::int32_t k = 0; k < 4; ++k)
        geometry.points.push_back(vertexAt(x + (2 * i + 1) * square.spacing / 8, y + (2 * k + 1) * square.spacing / 8,
                                           square.step_bits, false));
  }

  static std::vector<std::uint32_t> openEdges(const std::vector<std::uint32_t>& triangles) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, int> uses;
    for (std::size_t i = 0; i < triangles.size(); ++i) {
      const std::uint32_t a = triangles[i], b = triangles[i % 3 == 2 ? i - 2 : i + 1];
      ++uses[{std::min(a, b), std::max(a, b)}];
    }
    std::vector<std::uint32_t> edges;
    for (const auto& [ends, count] : uses)
      if (count == 1) edges.insert(edges.end(), {ends.first, ends.second});
    return edges;
  }

  /// The largest vertical distance, scene units, of the node's triangles from those of the finest level. Quads of all
  /// levels are cut along the same direction, so it is found at a vertex of the finest level.
  float shapeError(const Square& square) const {
    const std::int32_t step = finest();
    double largest = 0.0;
    const auto z = [&](std::int32_t x, std::int32_t y, std::uint32_t step_bits) {
      return static_cast<double>(placeAt(x, y, step_bits).z) * (1 << step_bits);
    };
    const std::int32_t edge = square.spacing * static_cast<std::int32_t>(quads_);
    for (std::int32_t y = 0; y <= edge; y += step) {
      for (std::int32_t x = 0; x <= edge; x += step) {
        const std::int32_t i = std::min(x / square.spacing * square.spacing, edge - square.spacing);
        const std::int32_t k = std::min(y / square.spacing * square.spacing, edge - square.spacing);
        const double u = static_cast<double>(x - i) / square.spacing, v = static_cast<double>(y - k) / square.spacing;
        const auto corner = [&](std::int32_t a, std::int32_t b) {
          return z(square.x + i + a * square.spacing, square.y + k + b * square.spacing, square.step_bits);
        };
        const double flat = u >= v ? (1.0 - u) * corner(0, 0) + (u - v) * corner(1, 0) + v * corner(1, 1)
                                   : (1.0 - v) * corner(0, 0) + (v - u) * corner(0, 1) + u * corner(1, 1);
        largest = std::max(largest, std::abs(flat - z(square.x + x, square.y + y, 0)));
      }
    }
    return static_cast<float>(1.0001 * made_.header.lattice.step * largest);
  }

  void addNode(std::uint32_t depth, std::uint32_t index) {
    using namespace lod::hlod;
    const bool is_leaf = depth == depth_;
    const Square square = squareOf(depth, index);
    Node node;
    node.step_bits = static_cast<std::uint8_t>(square.step_bits);
    if (!is_leaf) {
      // Between samples, and between points, normals and colours are off by as much as half a quad away.
      node.shape_error = node.caster_error = shapeError(square);
      node.error = std::max(node.shape_error, static_cast<float>(0.5 * square.spacing * made_.header.lattice.step));
    }
    NodeGeometry picture = geometryOf(square, !is_leaf, false);
    NodeGeometry caster = is_leaf ? NodeGeometry{} : geometryOf(square, false, true);
    for (const auto* geometry : {&picture, &caster})
      for (const auto* list : {&geometry->vertices, &geometry->points})
        for (const NodeVertex& vertex : *list)
          node.box.add(made_.header.lattice.position(vertex.place * (1 << square.step_bits)));
    if (is_leaf) node.cone = coneOf(picture);
    made_.nodes.push_back(node);
    made_.pictures.push_back(std::move(picture));
    made_.casters.push_back(std::move(caster));
  }

  base::NormalCone coneOf(const NodeGeometry& leaf) const {
    std::vector<glm::vec3> normals;
    for (std::size_t i = 0; i < leaf.triangles.size(); i += 3) {
      const auto at = [&](std::size_t k) { return glm::vec3(leaf.vertices[leaf.triangles[i + k]].place); };
      normals.push_back(glm::normalize(glm::cross(at(1) - at(0), at(2) - at(0))));
    }
    return base::boundingCone(normals);
  }

  /// A cone that contains those of all children.
  static base::NormalCone coneAround(const std::vector<base::NormalCone>& cones) {
    base::NormalCone around{glm::vec3(0.0F), 1.0F};
    for (const base::NormalCone& cone : cones) around.axis += cone.axis;
    around.axis = glm::normalize(around.axis);
    double angle = 0.0;
    for (const base::NormalCone& cone : cones)
      angle = std::max(angle, std::acos(std::clamp(static_cast<double>(glm::dot(around.axis, cone.axis)), -1.0, 1.0)) +
                                  std::acos(std::clamp(static_cast<double>(cone.cos_angle), -1.0, 1.0)));
    around.cos_angle = static_cast<float>(std::cos(std::min(angle + 1e-3, 3.141592)));
    return around;
  }

  /// Children, and what parents take from them.
  void linkNodes() {
    using namespace lod::hlod;
    std::uint32_t begin = 0;
    for (std::uint32_t d = 0; d < depth_; ++d) {
      const std::uint32_t count = 1U << 2 * d;
      for (std::uint32_t i = 0; i < count; ++i) {
        made_.nodes[begin + i].first_child = begin + count + 4 * i;
        made_.nodes[begin + i].children = 4;
      }
      begin += count;
    }
    for (std::size_t i = made_.nodes.size(); i-- > 0;) {
      Node& node = made_.nodes[i];
      std::vector<base::NormalCone> cones;
      for (std::uint32_t c = node.first_child; c < node.first_child + node.children; ++c) {
        const Node& child = made_.nodes[c];
        node.box.add(child.box);
        node.error = std::max(node.error, child.error);
        node.shape_error = std::max(node.shape_error, child.shape_error);
        node.caster_error = std::max(node.caster_error, child.caster_error);
        cones.push_back(child.cone);
      }
      if (!cones.empty()) node.cone = coneAround(cones);
    }
  }

  MadeHlod writeFile() {
    using namespace lod::hlod;
    Header& header = made_.header;
    std::vector<base::Bytes> pictures, casters;
    for (std::uint32_t i = 0; i < made_.nodes.size(); ++i) {
      Node& node = made_.nodes[i];
      NodeGeometry &picture = made_.pictures[i], &caster = made_.casters[i];
      if (changes_.picture) changes_.picture(i, picture);
      if (changes_.caster && !node.isLeaf()) changes_.caster(i, caster);
      node.triangles = static_cast<std::uint32_t>(picture.triangles.size() / 3);
      node.points = static_cast<std::uint32_t>(picture.points.size());
      node.edges = static_cast<std::uint32_t>(picture.edges.size() / 2);
      node.caster_triangles = static_cast<std::uint32_t>(caster.triangles.size() / 3);
      if (node.isLeaf()) header.source_triangles += node.triangles;
      pictures.push_back(encodeBlock(picture, {colors_, false}));
      casters.push_back(encodeBlock(caster, {colors_, true}));
      node.picture.bytes = static_cast<std::uint32_t>(pictures.back().size());
      node.caster.bytes = static_cast<std::uint32_t>(casters.back().size());
      if (changes_.node) changes_.node(i, node);
    }
    const base::Bytes table = tableBytes(made_.nodes, header);
    if (changes_.header) changes_.header(header);
    placeBlocks(header, made_.nodes);

    made_.file = headerBytes(header);
    const auto append = [this](const base::Bytes& bytes) {
      made_.file.insert(made_.file.end(), bytes.begin(), bytes.end());
    };
    append(table);
    for (const base::Bytes& block : pictures) append(block);
    for (const base::Bytes& block : casters) append(block);
    made_.nodes = *readTable(header, table);
    return std::move(made_);
  }

  const std::uint32_t depth_, quads_;
  const bool colors_;
  const Changes changes_;
  MadeHlod made_;
};

/// A file of (4^(depth + 1) − 1) / 3 nodes, of about 2 · quads² triangles each.
inline MadeHlod madeHlod(std::uint32_t depth = 3, std::uint32_t quads = 8, bool colors = true) {
  return HlodMaker(depth, quads, colors).make();
}

}  // namespace support
