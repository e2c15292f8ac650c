#include "lod/hlod/builder/node_build.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "lod/hlod/block.h"
#include "lod/hlod/builder/collapse.h"
#include "lod/hlod/builder/cracks.h"
#include "lod/hlod/builder/detail.h"
#include "lod/hlod/builder/ordered_triangles.h"
#include "lod/ingest/code_map.h"
#include "lod/ingest/morton.h"

namespace lod::hlod::builder {
namespace {

// Triangles become points whose corners are at most half the node's error from the middle. The paper has twice the
// error (section 3.2); then there are more points than there were triangles, and pictures are 5 dB worse at one pixel
// (docs/decisions/hlod.md).
constexpr float kPointReach = 0.5F;
constexpr float kPointCell = 0.5F;
// Attributes are smoothed where edges are shorter than so many times the node's error: about a pixel, where the error
// is half of one.
constexpr float kSmoothed = 2.0F;
// Positions are rounded to a lattice so coarse that it moves them by at most this share of the node's error.
constexpr float kRoundedShare = 1.0F / 16.0F;
constexpr float kHalfDiagonal = 0.8660254F;
// Simplified neighbours are each within their own error of the line that they shared.
constexpr float kCrackReach = 2.0F;

std::uint32_t stepBitsFor(float limit) {
  std::uint32_t bits = 0;
  while (bits + 1 < kPositionBits && kHalfDiagonal * std::exp2(static_cast<float>(bits + 1)) <= kRoundedShare * limit)
    ++bits;
  return bits;
}

base::Aabb boxOf(const NodeMesh& mesh, const Lattice& lattice, float margin) {
  base::Aabb box;
  for (const glm::vec3& p : mesh.positions) box.add(lattice.position(mesh.corner + glm::ivec3(p)));
  box.min -= margin, box.max += margin;
  return box;
}

base::NormalCone coneOf(const NodeMesh& mesh) {
  std::vector<glm::vec3> normals;
  normals.reserve(mesh.triangles());
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3) {
    const glm::vec3& a = mesh.positions[mesh.indices[i]];
    const glm::vec3 n = glm::cross(mesh.positions[mesh.indices[i + 1]] - a, mesh.positions[mesh.indices[i + 2]] - a);
    const float length = glm::length(n);
    normals.push_back(length > 0.0F ? n / length : glm::vec3(0.0F));
  }
  return base::boundingCone(normals);
}

/// Fills a row's counts and makes the bytes of its picture.
void encodePicture(const NodeMesh& mesh, const PictureOptions& how, const NodeOptions& options, BuiltNode& node) {
  const NodeGeometry picture = makePicture(mesh, node.row.step_bits, how);
  node.row.triangles = static_cast<std::uint32_t>(picture.triangles.size() / 3);
  node.row.points = static_cast<std::uint32_t>(picture.points.size());
  node.row.edges = static_cast<std::uint32_t>(picture.edges.size() / 2);
  node.has_too_many |= std::max({node.row.triangles, node.row.points, node.row.edges}) > kMaxPrimitives;
  if (node.has_too_many) return;
  node.picture = encodeBlock(picture, {options.colors, false});
  node.row.picture.bytes = static_cast<std::uint32_t>(node.picture.size());
}

float largest(const std::vector<float>& values) {
  return values.empty() ? 0.0F : *std::max_element(values.begin(), values.end());
}

/// Simplifies the mesh so that its error comes to at most `limit` (lattice steps).
void simplify(NodeMesh& mesh, float limit, const AppearanceOptions& appearance) {
  const float room = limit - mesh.error;
  if (room > 0.0F && mesh.triangles() > 0) applyCollapses(mesh, collapseWithin(mesh, room, appearance));
}

/// A proven bound of the distance between the source and the mesh, both ways, lattice steps.
float shapeError(const NodeMesh& mesh) {
  return std::max(largest(mesh.bounds.toward), largest(mesh.bounds.from));
}

void encodeCaster(const NodeMesh& mesh, BuiltNode& node) {
  NodeGeometry caster = makePicture(mesh, node.row.step_bits, {.edges = false});
  for (NodeVertex& vertex : caster.vertices) vertex = {vertex.place, {0.0F, 0.0F, 1.0F}, glm::u8vec3(255)};
  node.row.caster_triangles = static_cast<std::uint32_t>(caster.triangles.size() / 3);
  node.has_too_many |= node.row.caster_triangles > kMaxPrimitives;
  if (node.has_too_many) return;
  node.caster = encodeBlock(caster, {false, true});
  node.row.caster.bytes = static_cast<std::uint32_t>(node.caster.size());
}

}  // namespace

NodeMesh sourceMesh(std::span<const ingest::Corner> corners, bool colors) {
  NodeMesh mesh;
  ingest::CodeMap map(corners.size() / 6 + 1);
  glm::ivec3 low(std::numeric_limits<int>::max());
  std::vector<glm::ivec3> places;
  for (const ingest::Corner& corner : corners) {
    const auto [number, is_new] = map.insert(corner.code);
    mesh.indices.push_back(number);
    if (!is_new) continue;
    places.push_back(ingest::mortonPoint(corner.code));
    low = glm::min(low, places.back());
    const glm::vec3 normal(ingest::unpackNormal(corner.normal & 0xFFFFFFU));
    mesh.normals.push_back(normal != glm::vec3(0.0F) ? glm::normalize(normal) : glm::vec3(0.0F, 0.0F, 1.0F));
    mesh.on_rim.push_back((corner.normal & kOnRim) != 0 ? 1 : 0);
    if (colors) mesh.colors.emplace_back(corner.color & 255U, corner.color >> 8 & 255U, corner.color >> 16 & 255U);
  }
  mesh.corner = low;
  mesh.positions.reserve(places.size());
  for (const glm::ivec3& place : places) mesh.positions.emplace_back(place - low);
  return mesh;
}

NodeMesh mergeParts(std::vector<NodeMesh>& parts) {
  NodeMesh merged;
  if (parts.size() == 1) return std::exchange(parts, {}).front();
  glm::ivec3 low(std::numeric_limits<int>::max());
  std::size_t vertices = 0;
  bool bounded = false;
  for (const NodeMesh& part : parts) {
    low = glm::min(low, part.corner);
    vertices += part.positions.size();
    merged.error = std::max(merged.error, part.error);
    bounded |= !part.bounds.toward.empty();
  }
  merged.corner = low;
  ingest::CodeMap map(vertices);
  std::vector<std::uint64_t> parts_of;
  std::vector<float> count;
  std::vector<std::uint32_t> number;
  for (std::size_t p = 0; p < parts.size(); ++p) {
    NodeMesh part = std::move(parts[p]);
    number.clear();
    for (std::size_t v = 0; v < part.positions.size(); ++v) {
      const glm::ivec3 place = part.corner + glm::ivec3(part.positions[v]);
      const auto [at, is_new] = map.insert(ingest::mortonCode(place));
      number.push_back(at);
      if (is_new) {
        merged.positions.emplace_back(place - low);
        merged.normals.push_back(part.normals[v]);
        if (!part.colors.empty()) merged.colors.push_back(part.colors[v]);
        merged.on_rim.push_back(part.on_rim[v]);
        parts_of.push_back(0);
        count.push_back(1.0F);
      } else {
        merged.normals[at] += part.normals[v];
        if (!part.colors.empty()) merged.colors[at] += part.colors[v];
        ++count[at];
      }
      parts_of[at] |= std::uint64_t{1} << p;
    }
    for (const std::uint32_t index : part.indices) merged.indices.push_back(number[index]);
    if (!bounded) continue;
    part.bounds.toward.resize(part.triangles(), 0.0F);
    part.bounds.from.resize(part.triangles(), 0.0F);
    const auto append = [](std::vector<float>& to, const std::vector<float>& more) {
      to.insert(to.end(), more.begin(), more.end());
    };
    append(merged.bounds.toward, part.bounds.toward);
    append(merged.bounds.from, part.bounds.from);
  }
  parts.clear();
  for (std::size_t v = 0; v < count.size(); ++v) {
    if (count[v] == 1.0F) continue;
    const float length = glm::length(merged.normals[v]);
    merged.normals[v] = length > 0.0F ? merged.normals[v] / length : glm::vec3(0.0F, 0.0F, 1.0F);
    if (!merged.colors.empty()) merged.colors[v] /= count[v];
  }
  closeCracks(merged, parts_of, kCrackReach * merged.error);
  return merged;
}

BuiltNode makeLeaf(const NodeMesh& mesh, const NodeOptions& options) {
  BuiltNode node;
  node.row.box = boxOf(mesh, options.lattice, 0.0F);
  node.row.cone = coneOf(mesh);
  // The cracks beside a leaf are as wide as the other side's error, whose lines are as wide.
  encodePicture(mesh, {.edges = false}, options, node);
  node.row.caster_triangles = node.row.triangles;
  return node;
}

BuiltNode makeInnerNode(float edge, std::vector<NodeMesh>& parts, const NodeOptions& options) {
  const float limit = edge / options.resolution;
  const auto step = static_cast<float>(options.lattice.step);
  BuiltNode node;
  node.row.step_bits = static_cast<std::uint8_t>(stepBitsFor(limit));
  const float rounding =
      node.row.step_bits == 0 ? 0.0F : kHalfDiagonal * std::exp2(static_cast<float>(node.row.step_bits));

  NodeMesh& mesh = node.mesh = mergeParts(parts);
  smoothDetail(mesh, kSmoothed * limit);
  simplify(mesh, limit - rounding, options.appearance);
  encodePicture(mesh, {options.points ? kPointReach * limit : 0.0F, kPointCell * limit}, options, node);
  node.row.shape_error = (shapeError(mesh) + rounding) * step;
  node.row.error = (mesh.error + rounding) * step;
  // A point is at most the diagonal of its cell away from what it stands for.
  if (node.row.points > 0) node.row.error = std::max(node.row.error, limit * step);

  AppearanceOptions shape_alone;
  shape_alone.normals = shape_alone.colors = false;
  NodeMesh caster = mesh;
  applyLastCollapses(caster, collapseWithin(caster, limit - rounding, shape_alone, true));
  encodeCaster(caster, node);
  node.row.caster_error = limit * step;

  // Points are means of places within the triangles' box, and casters have some of the picture's vertices.
  node.row.box = boxOf(mesh, options.lattice, rounding * step);
  return node;
}

base::NormalCone mergedCone(const base::NormalCone& a, const base::NormalCone& b) {
  const glm::vec3 sum = a.axis + b.axis;
  const float length = glm::length(sum);
  if (!(length > 1e-3F)) return {a.axis, -1.0F};
  base::NormalCone cone{sum / length, 1.0F};
  float angle = 0.0F;
  for (const base::NormalCone* one : {&a, &b})
    angle = std::max(angle, angleBetween(cone.axis, one->axis) + std::acos(std::clamp(one->cos_angle, -1.0F, 1.0F)));
  // Rounding of both functions is far below this.
  cone.cos_angle = angle >= 3.1415F ? -1.0F : std::max(-1.0F, std::cos(angle) - 1e-4F);
  return cone;
}

}  // namespace lod::hlod::builder
