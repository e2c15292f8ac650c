#include "lod/build/qsplat/mesh_leaves.h"

#include <algorithm>
#include <cmath>
#include <mutex>

#include "base/parallel.h"

namespace lod::build::qsplat {
namespace {

// Squared radius of the smallest circle around a triangle with these squared sides and twice this area, squared.
double circleSquared(double a, double b, double c, double twice_area_squared) {
  const double longest = std::max({a, b, c});
  // Obtuse, or on a line: the longest side is a diameter.
  if (a + b + c - 2.0 * longest <= 0.0 || !(twice_area_squared > 0.0)) return 0.25 * longest;
  return 0.25 * a * b * c / twice_area_squared;
}

const glm::vec3& decodedNormal(const VertexSums& sums) {
  return lod::qsplat::normalTable()[lod::qsplat::encodeNormal(sums.unitNormal())];
}

}  // namespace

// A triangle on the lattice.
struct MeshLeaves::Triangle {
  glm::i64vec3 normal{0};  // twice the area
  double circle_squared = 0.0;
  glm::vec3 unit{0.0F};  // zero where the corners lie on a line

  explicit Triangle(const glm::ivec3& a, const glm::ivec3& b, const glm::ivec3& c) : normal(latticeNormal(a, b, c)) {
    const auto squared = [](const glm::ivec3& v) {
      const glm::dvec3 d(v);
      return glm::dot(d, d);
    };
    const glm::dvec3 n(normal);
    const double area_squared = glm::dot(n, n);
    circle_squared = circleSquared(squared(b - a), squared(c - b), squared(a - c), area_squared);
    if (area_squared > 0.0) unit = glm::vec3(n / std::sqrt(area_squared));
  }
  Around at(const glm::vec3& vertex_normal) const {
    // A triangle without an area shows nothing of itself.
    return {circle_squared, unit == glm::vec3(0.0F) ? 1.0F : glm::dot(unit, vertex_normal)};
  }
};

base::Result<void> MeshLeaves::measureBorder(unsigned threads, const std::function<bool(double)>& progress) {
  const BorderVertices& border = buckets_.border();
  border_.assign(border.codes.size(), {});
  if (border_.empty()) return {};
  std::vector<glm::vec3> normals;
  normals.reserve(border.sums.size());
  for (const VertexSums& sums : border.sums) normals.push_back(decodedNormal(sums));
  std::mutex mutex;
  std::size_t done = 0;
  return base::tryParallelFor(buckets_.count(), threads, [&](std::size_t bucket) -> base::Result<void> {
    const auto triangles = buckets_.borderTriangles(bucket);
    if (!triangles) return triangles.error();
    std::vector<std::pair<std::size_t, Around>> found;
    for (const BorderTriangle& t : *triangles) {
      const Triangle triangle(mortonPoint(t.corner[0].code), mortonPoint(t.corner[1].code),
                              mortonPoint(t.corner[2].code));
      for (const std::uint32_t at : t.place)
        if (at != kNotOnBorder) found.emplace_back(at, triangle.at(normals[at]));
    }
    const std::lock_guard lock(mutex);
    for (const auto& [i, around] : found) {
      border_[i].around.add(around);
      border_[i].owner = std::min(border_[i].owner, static_cast<std::uint32_t>(bucket));
    }
    ++done;
    if (progress && !progress(static_cast<double>(done) / static_cast<double>(buckets_.count())))
      return base::Error{base::ErrorCode::kCancelled, "measuring the leaves was cancelled"};
    return {};
  });
}

void MeshLeaves::writeBorder(base::ByteWriter& out) const {
  out.u64(border_.size());
  for (const Border& vertex : border_) {
    out.f64(vertex.around.radius_squared);
    out.f32(vertex.around.least_cosine);
    out.u32(vertex.owner);
  }
}

bool MeshLeaves::readBorder(base::ByteReader& in) {
  if (in.u64() != buckets_.border().codes.size()) return false;
  border_.resize(buckets_.border().codes.size());
  for (Border& vertex : border_) {
    vertex.around.radius_squared = in.f64();
    vertex.around.least_cosine = in.f32();
    vertex.owner = in.u32();
  }
  return in.ok();
}

Splat MeshLeaves::leaf(std::uint64_t code, const VertexSums& sums, const Around& around) const {
  // Rounded up by more than what positions are off in float32.
  constexpr double kRoundUp = 1.0 + 1e-6;
  constexpr double kPlace = 1.1e-7;
  // A vertex whose triangles have no area still counts for something.
  constexpr float kLeastWeight = 1e-3F;
  Splat out;
  out.sphere.center = lattice_.lattice.position(mortonPoint(code));
  const glm::vec3 far = glm::abs(out.sphere.center);
  out.sphere.radius = static_cast<float>(std::sqrt(around.radius_squared) * lattice_.lattice.step * kRoundUp +
                                         kPlace * static_cast<double>(std::max({far.x, far.y, far.z})));
  const glm::vec3 normal = sums.unitNormal();
  out.weight = std::max(kLeastWeight, glm::length(glm::vec3(sums.face[0], sums.face[1], sums.face[2])));
  out.normal = normal * out.weight;
  out.color = glm::vec3(sums.meanColor()) * out.weight;
  out.direction = lod::qsplat::encodeNormal(normal);
  out.least_cosine = around.least_cosine;
  return out;
}

base::Result<std::vector<Splat>> MeshLeaves::leaves(std::size_t bucket) const {
  auto corners = buckets_.read(bucket);
  if (!corners) return corners.error();
  const NumberedCorners mesh(*corners);
  std::vector<glm::ivec3> points;
  points.reserve(mesh.codes.size());
  for (const std::uint64_t code : mesh.codes) points.push_back(mortonPoint(code));

  std::vector<Triangle> triangles;
  triangles.reserve(corners->size() / 3);
  std::vector<VertexSums> sums(mesh.codes.size());
  for (std::size_t i = 0; i < corners->size(); i += 3) {
    const std::uint32_t* v = &mesh.number[i];
    const Triangle& triangle = triangles.emplace_back(points[v[0]], points[v[1]], points[v[2]]);
    for (std::size_t k = 0; k < 3; ++k) sums[v[k]].add(triangle.normal, (*corners)[i + k]);
  }
  *corners = std::vector<Corner>();

  const BorderVertices& border = buckets_.border();
  std::vector<glm::vec3> normals;
  normals.reserve(sums.size());
  for (const VertexSums& sum : sums) normals.push_back(decodedNormal(sum));
  std::vector<Around> around(sums.size());
  for (std::size_t i = 0; i < mesh.number.size(); ++i) {
    const std::uint32_t v = mesh.number[i];
    around[v].add(triangles[i / 3].at(normals[v]));
  }

  std::vector<Splat> out;
  out.reserve(sums.size());
  for (std::size_t v = 0; v < sums.size(); ++v) {
    const std::int64_t at = border.find(mesh.codes[v]);
    if (at < 0) {
      out.push_back(leaf(mesh.codes[v], sums[v], around[v]));
      continue;
    }
    const Border& shared = border_[static_cast<std::size_t>(at)];
    if (shared.owner == bucket)
      out.push_back(leaf(mesh.codes[v], border.sums[static_cast<std::size_t>(at)], shared.around));
  }
  return out;
}

}  // namespace lod::build::qsplat
