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
#include "lod/hlod/builder/point_clusters.h"
#include "lod/hlod/builder/sheets.h"
#include "lod/ingest/code_map.h"
#include "lod/ingest/morton.h"

namespace lod::hlod::builder {
namespace {

// Triangles become points whose corners are at most half the node's error from the middle. The paper has twice the
// error (section 3.2); then there are more points than there were triangles, and pictures are 5 dB worse at one pixel
// (docs/decisions/hlod.md).
constexpr float kPointReach = 0.5F;
constexpr float kPointCell = 0.5F;
// Sheets become points for good whose boxes' diagonals are at most as long as a cell of the points: larger ones would
// become more points than they have triangles.
constexpr float kSheetSize = kPointCell;
// The circumradius of the triangle that casts the shadow of a point, as a share of the node's error. A choice: points
// lie half of that error apart.
constexpr float kFacetRadius = 0.25F;
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

/// The box of the mesh's vertices and points.
base::Aabb boxOf(const NodeMesh& mesh, const Lattice& lattice) {
  base::Aabb places;
  for (const glm::vec3& p : mesh.positions) places.add(p);
  for (const MeshPoint& p : mesh.points) places.add(p.position);
  base::Aabb box;
  box.add(lattice.position(mesh.corner + glm::ivec3(glm::floor(places.min))));
  box.add(lattice.position(mesh.corner + glm::ivec3(glm::ceil(places.max))));
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
void encodePicture(const Picture& picture, const NodeOptions& options, BuiltNode& node) {
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

/// A proven bound of the distance between the source and the mesh, both ways, lattice steps.
float shapeError(const NodeMesh& mesh) {
  return std::max({largest(mesh.bounds.toward), largest(mesh.bounds.from), mesh.points_bound});
}

void clusterPoints(NodeMesh& mesh, float cell) {
  PointClusters clusters(cell);
  for (const MeshPoint& point : mesh.points) clusters.add(point, mesh.points_error);
  mesh.points = clusters.points();
  mesh.points_error = clusters.error();
}

/// The mesh with triangles for its points, simplified where only shape counts.
NodeMesh casterOf(const NodeMesh& mesh, float limit, float facet_radius) {
  AppearanceOptions shape_alone;
  shape_alone.normals = shape_alone.colors = false;
  NodeMesh caster = mesh;
  applyLastCollapses(caster, collapseWithin(caster, limit, shape_alone, Carried::kBounds));
  addFacets(caster, facet_radius);
  caster.points.clear();
  return caster;
}

void encodeCaster(Picture caster, BuiltNode& node) {
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
    merged.points_error = std::max(merged.points_error, part.points_error);
    merged.points_bound = std::max(merged.points_bound, part.points_bound);
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
    for (MeshPoint point : part.points) {
      point.position += glm::vec3(part.corner - low);
      merged.points.push_back(point);
    }
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
  node.row.box = boxOf(mesh, options.lattice);
  node.row.cone = coneOf(mesh);
  node.vertices = static_cast<std::uint32_t>(mesh.positions.size());
  // The cracks beside a leaf are as wide as the other side's error, whose lines are as wide.
  encodePicture(makePicture(mesh, 0, {.edges = false}), options, node);
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
  // A triangle may become points if it is still within the limit when it is half of a cell's diagonal farther off.
  const float points_room = limit - rounding - kHalfDiagonal * kPointCell * limit;

  NodeMesh& mesh = node.mesh = mergeParts(parts);
  const float smoothed = smoothDetail(mesh, kSmoothed * limit, options.appearance);
  if (mesh.triangles() > 0)
    applyCollapses(mesh, collapseWithin(mesh, limit - rounding, options.appearance, Carried::kErrors));
  if (options.points) replaceSmallSheets(mesh, kSheetSize * limit, points_room);
  node.vertices = static_cast<std::uint32_t>(mesh.positions.size());
  const Picture picture = makePicture(mesh, node.row.step_bits,
                                      {options.points ? kPointReach * limit : 0.0F, kPointCell * limit, points_room});
  encodePicture(picture, options, node);
  node.row.shape_error = (shapeError(mesh) + rounding + picture.flattened) * step;
  node.row.error = (std::max({mesh.error + picture.flattened, picture.points_error, smoothed}) + rounding) * step;
  clusterPoints(mesh, kPointCell * limit);

  NodeMesh caster = casterOf(mesh, limit - rounding, kFacetRadius * limit);
  Picture thrown = makePicture(caster, node.row.step_bits, {.edges = false});
  const float facets_error = mesh.points.empty() ? 0.0F : mesh.points_error + kFacetRadius * limit + rounding;
  node.row.caster_error = std::max(limit + thrown.flattened, facets_error) * step;
  const float flattened = std::max(picture.flattened, thrown.flattened);
  encodeCaster(std::move(thrown), node);

  // Points of the picture are within the box of what they stand for, which is theirs and the vertices'.
  node.row.box = boxOf(mesh, options.lattice);
  node.row.box.add(boxOf(caster, options.lattice));
  const float margin = (rounding + flattened) * step;
  node.row.box.min -= margin, node.row.box.max += margin;
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
