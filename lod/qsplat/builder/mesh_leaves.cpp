#include "lod/qsplat/builder/mesh_leaves.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <numeric>

#include "base/fields.h"
#include "base/parallel.h"

namespace lod::qsplat::builder {
namespace {

// Edges longer than this share of the longest side are cut in coarse meshes too, as far as kMinAddedLeaves allow. Both
// numbers are choices: with them a mesh of few triangles, such as a cube, still gets splats that are small on a screen.
constexpr double kMaxEdgeShare = 1.0 / 128.0;
// Lattice steps; positions within a shorter edge would be rounded too coarsely.
constexpr double kMinLimit = 4.0;
// Dicing adds at most one leaf for two triangles, or this many leaves where that is fewer.
constexpr std::uint64_t kMinAddedLeaves = std::uint64_t{1} << 14;
constexpr std::uint32_t kNoLeaf = std::numeric_limits<std::uint32_t>::max();
// How many limits are tried within a factor of two; a power of two. A choice: a limit is then within 9 % of the best.
constexpr int kLengths = 8;

// The squared radius of the smallest circle around a triangle, from its squared sides and (2 area)^2.
double circleSquared(double a, double b, double c, double twice_area_squared) {
  const double longest = std::max({a, b, c});
  // In an obtuse triangle, or one on a line, the longest side is a diameter.
  if (a + b + c - 2.0 * longest <= 0.0 || !(twice_area_squared > 0.0)) return 0.25 * longest;
  return 0.25 * a * b * c / twice_area_squared;
}

auto fieldsOf(auto& leaf) {
  return std::tie(leaf.around.radius_squared, leaf.around.least_cosine, leaf.around.area, leaf.around.own, leaf.owner);
}

const glm::vec3& decodedNormal(const glm::vec3& normal) {
  return normalTable()[encodeNormal(normal)];
}

double squaredDistance(const glm::dvec3& a, const glm::dvec3& b) {
  const glm::dvec3 d = b - a;
  return glm::dot(d, d);
}

// A triangle on the lattice.
struct Triangle {
  double area = 0.0;  // twice the area
  double circle_squared = 0.0;
  glm::vec3 unit{0.0F};  // normal; zero where the corners lie on a line
  bool diced = false;

  // `normal` is its latticeNormal. Edges longer than `longest` are cut.
  Triangle(const std::array<glm::ivec3, 3>& corners, const glm::i64vec3& normal, double longest) {
    const glm::dvec3 n(normal);
    const double area_squared = glm::dot(n, n);
    const glm::dvec3 x(corners[0]), y(corners[1]), z(corners[2]);
    const double a = squaredDistance(x, y), b = squaredDistance(y, z), c = squaredDistance(z, x);
    circle_squared = circleSquared(a, b, c, area_squared);
    diced = std::max({a, b, c}) > longest * longest;
    area = std::sqrt(area_squared);
    if (area > 0.0) unit = glm::vec3(n / area);
  }
  // A triangle without an area is never seen, so any cone covers it.
  float cosine(const glm::vec3& vertex_normal) const {
    return unit == glm::vec3(0.0F) ? 1.0F : glm::dot(unit, vertex_normal);
  }
  std::uint64_t wholeArea() const { return static_cast<std::uint64_t>(area + 0.5); }
  // The sub-triangles of a diced one are added on their own.
  Surroundings at(const glm::vec3& vertex_normal) const {
    return diced ? Surroundings{0.0, 1.0F, wholeArea(), 0}
                 : Surroundings{circle_squared, cosine(vertex_normal), wholeArea(), wholeArea()};
  }
};

// A part of a triangle that was diced.
struct SubTriangle {
  double area = 0.0;  // twice the area
  double circle_squared = 0.0;

  SubTriangle(const Dicer& dicer, const std::array<std::uint32_t, 3>& corners) {
    const glm::dvec3 a = dicer.position(corners[0]), b = dicer.position(corners[1]), c = dicer.position(corners[2]);
    const glm::dvec3 n = glm::cross(b - a, c - a);
    const double area_squared = glm::dot(n, n);
    circle_squared = circleSquared(squaredDistance(a, b), squaredDistance(b, c), squaredDistance(c, a), area_squared);
    area = std::sqrt(area_squared);
  }
  Surroundings at(const Triangle& triangle, const glm::vec3& vertex_normal) const {
    return {circle_squared, triangle.cosine(vertex_normal), 0, static_cast<std::uint64_t>(area + 0.5)};
  }
};

// The shortest limit from `shortest` on that needs no more cuts than `max_cuts`. The search finds the factor of two
// first, and then the limit within it.
DiceLimit shortestLimit(std::span<const glm::ivec3> points, double shortest, std::uint64_t max_cuts) {
  DiceLimit limit;
  int length = -kLengths;
  const auto fits = [&](int at) {
    const double longest = shortest * std::exp2(static_cast<double>(at) / kLengths);
    const auto count = countCuts(points, longest, max_cuts);
    if (count) limit = {longest, *count}, length = at;
    return count.has_value();
  };
  for (int at = 0; !fits(at);) at += kLengths;
  for (int step = kLengths / 2; step > 0 && length > 0; step /= 2) (void)fits(length - step);
  return limit;
}

// Returns what a bucket's triangles add to the vertices on the border, by the vertices' places there.
std::vector<std::pair<std::uint32_t, Surroundings>> aroundBorder(std::span<const ingest::BorderTriangle> triangles,
                                                                 std::span<const glm::vec3> normals, double longest) {
  std::vector<std::pair<std::uint32_t, Surroundings>> found;
  for (const ingest::BorderTriangle& t : triangles) {
    const std::array<glm::ivec3, 3> points{ingest::mortonPoint(t.corner[0].code), ingest::mortonPoint(t.corner[1].code),
                                           ingest::mortonPoint(t.corner[2].code)};
    const Triangle triangle(points, ingest::latticeNormal(points[0], points[1], points[2]), longest);
    for (const std::uint32_t at : t.place)
      if (at != ingest::kNotOnBorder) found.emplace_back(at, triangle.at(normals[at]));
    if (!triangle.diced) continue;
    Dicer dicer(points, longest);
    dicer.cut({0, 1, 2}, 0);
    for (const Dicer::SubTriangle& part : dicer.subTriangles())
      for (const std::uint32_t corner : part.corners) {
        if (corner >= 3 || t.place[corner] == ingest::kNotOnBorder) continue;
        const std::uint32_t at = t.place[corner];
        found.emplace_back(at, SubTriangle(dicer, part.corners).at(triangle, normals[at]));
      }
  }
  return found;
}

// A vertex or midpoint that becomes a leaf.
struct LeafPoint {
  Surroundings around;
  glm::vec3 decoded{0.0F};      // the normal decoded from its code
  std::uint32_t direction = 0;  // the normal's code
  glm::vec3 normal{0.0F};       // unit
  glm::vec3 given{0.0F};        // unit normal of the source; zero where there is none
  glm::vec3 color{0.0F};
  glm::dvec3 face{0.0};  // sum of the triangles' normals

  void setNormal(const glm::vec3& unit) {
    normal = unit;
    direction = encodeNormal(unit);
    decoded = normalTable()[direction];
  }
};

// `place` is in lattice steps.
Splat leafAt(const ingest::SourceLattice& lattice, const glm::dvec3& place, const LeafPoint& point,
             const Surroundings& around) {
  // The radius is rounded up by more than the rounding errors of float32 radii and positions.
  constexpr double kRoundUp = 1.0 + 1e-6;
  constexpr double kPositionRounding = 1.1e-7;
  // A vertex whose triangles have no area still has a weight.
  constexpr float kMinWeight = 1e-3F;
  Splat out;
  out.sphere.center = glm::vec3(lattice.lattice.origin + lattice.lattice.step * place);
  const glm::vec3 far = glm::abs(out.sphere.center);
  out.sphere.radius = static_cast<float>(std::sqrt(around.radius_squared) * lattice.lattice.step * kRoundUp +
                                         kPositionRounding * static_cast<double>(std::max({far.x, far.y, far.z})));
  // The area of its triangles that lies nearer to other leaves counts for those.
  const double share =
      around.own < around.area ? static_cast<double>(around.own) / static_cast<double>(around.area) : 1.0;
  out.weight = std::max(kMinWeight, static_cast<float>(share) * glm::length(glm::vec3(point.face)));
  out.normal = point.normal * out.weight;
  out.color = point.color * out.weight;
  out.direction = point.direction;
  out.least_cosine = around.least_cosine;
  return out;
}

// `sums` are over all triangles around a vertex.
LeafPoint pointOf(const ingest::VertexSums& sums) {
  LeafPoint point;
  point.setNormal(sums.unitNormal());
  if (sums.normal != glm::i64vec3(0)) point.given = point.normal;
  point.color = glm::vec3(sums.meanColor());
  point.face = glm::dvec3(sums.facets.by_area);
  return point;
}

// A triangle that lies outside the narrow cone around a point's normal (LeafFacets).
struct Outlier {
  std::uint32_t point = 0;
  std::uint32_t triangle = 0;
};

// Adds the midpoints and what the sub-triangles add to all points. The colours and given normals of midpoints are means
// of those at the ends of their edge; without given normals the sub-triangles' count.
void addSubTriangles(const Dicer& dicer, std::span<const Triangle> triangles, std::vector<LeafPoint>& points,
                     std::vector<Outlier>& outliers) {
  const std::size_t vertices = points.size();
  for (const Dicer::Midpoint& midpoint : dicer.midpoints()) {
    LeafPoint point;
    const LeafPoint &a = points[midpoint.a], &b = points[midpoint.b];
    point.color = 0.5F * (a.color + b.color);
    if (const glm::vec3 sum = a.given + b.given;
        a.given != glm::vec3(0.0F) && b.given != glm::vec3(0.0F) && glm::dot(sum, sum) > 0.0F)
      point.given = glm::normalize(sum);
    points.push_back(point);
  }
  std::vector<SubTriangle> parts;
  parts.reserve(dicer.subTriangles().size());
  for (const Dicer::SubTriangle& p : dicer.subTriangles()) {
    parts.emplace_back(dicer, p.corners);
    const glm::dvec3 face = parts.back().area * glm::dvec3(triangles[p.triangle].unit);
    for (const std::uint32_t corner : p.corners)
      if (corner >= vertices) points[corner].face += face;
  }
  for (std::size_t i = vertices; i < points.size(); ++i) {
    LeafPoint& point = points[i];
    const glm::dvec3 sum = point.given != glm::vec3(0.0F) ? glm::dvec3(point.given) : point.face;
    point.setNormal(glm::dot(sum, sum) > 0.0 ? glm::vec3(glm::normalize(sum)) : glm::vec3(0.0F, 0.0F, 1.0F));
  }
  for (std::size_t i = 0; i < parts.size(); ++i) {
    const Dicer::SubTriangle& p = dicer.subTriangles()[i];
    for (const std::uint32_t corner : p.corners) {
      const Surroundings around = parts[i].at(triangles[p.triangle], points[corner].decoded);
      points[corner].around.add(around);
      if (around.least_cosine < LeafFacets::kCoreCosine) outliers.push_back({corner, p.triangle});
    }
  }
}

// Sorts the outliers by leaf. `leaf_of_point` is kNoLeaf for points whose outliers are not used.
LeafFacets facetsOf(std::span<const Outlier> outliers, std::span<const std::uint32_t> leaf_of_point, std::size_t leaves,
                    std::span<const Triangle> triangles) {
  LeafFacets out;
  if (outliers.empty()) return out;
  // `first` holds each leaf's end at first; filling backwards from there leaves its beginning.
  out.first.assign(leaves + 1, 0);
  for (const Outlier& outlier : outliers)
    if (const std::uint32_t leaf = leaf_of_point[outlier.point]; leaf != kNoLeaf) ++out.first[leaf];
  std::partial_sum(out.first.begin(), out.first.end(), out.first.begin());
  out.normals.resize(out.first.back());
  for (const Outlier& outlier : outliers)
    if (const std::uint32_t leaf = leaf_of_point[outlier.point]; leaf != kNoLeaf)
      out.normals[--out.first[leaf]] = triangles[outlier.triangle].unit;
  return out;
}

}  // namespace

base::Result<DiceLimit> MeshLeaves::chooseLimit(std::size_t bucket) const {
  LUMIGRID_ASSIGN_OR_RETURN(const auto corners, buckets_.read(bucket));
  std::vector<glm::ivec3> points;
  points.reserve(corners.size());
  for (const ingest::Corner& corner : corners) points.push_back(ingest::mortonPoint(corner.code));
  const std::size_t triangles = points.size() / 3;
  if (triangles == 0) return DiceLimit();
  std::vector<double> squared(triangles);
  double logs = 0.0;
  for (std::size_t t = 0; t < triangles; ++t) {
    const glm::dvec3 a(points[3 * t]), b(points[3 * t + 1]), c(points[3 * t + 2]);
    squared[t] = std::max({squaredDistance(a, b), squaredDistance(b, c), squaredDistance(c, a)});
    logs += std::log2(squared[t]);
  }
  const double mean = std::exp2(0.5 * logs / static_cast<double>(triangles));
  const double shortest = std::max(kMinLimit, std::min(dice_ * mean, kMaxEdgeShare * std::exp2(lattice_.bits)));
  const std::uint64_t max_cuts = std::max<std::uint64_t>(kMinAddedLeaves, triangles / 2);

  // Only triangles that are cut matter from here on.
  std::size_t kept = 0;
  for (std::size_t t = 0; t < triangles; ++t) {
    if (squared[t] <= shortest * shortest) continue;
    for (std::size_t k = 0; k < 3; ++k) points[3 * kept + k] = points[3 * t + k];
    ++kept;
  }
  points.resize(3 * kept);
  return kept == 0 ? DiceLimit() : shortestLimit(points, shortest, max_cuts);
}

base::Result<void> MeshLeaves::measureBorder(unsigned threads, const std::function<bool(double)>& progress) {
  const ingest::BorderVertices& border = buckets_.border();
  border_.assign(border.codes.size(), {});
  limits_.assign(buckets_.count(), {});
  std::vector<glm::vec3> normals;
  normals.reserve(border.sums.size());
  for (const ingest::VertexSums& sums : border.sums) normals.push_back(decodedNormal(sums.unitNormal()));
  std::mutex mutex;
  std::size_t done = 0;
  return base::tryParallelFor(buckets_.count(), threads, [&](std::size_t bucket) -> base::Result<void> {
    if (dice_ > 0.0) {
      LUMIGRID_ASSIGN_OR_RETURN(limits_[bucket], chooseLimit(bucket));
    }
    LUMIGRID_ASSIGN_OR_RETURN(const auto triangles, buckets_.borderTriangles(bucket));
    const auto found = aroundBorder(triangles, normals, limits_[bucket].longest);
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
  for (const BorderLeaf& vertex : border_) base::writeFields(out, fieldsOf(vertex));
  out.u64(limits_.size());
  for (const DiceLimit& limit : limits_) out.write(limit);
}

bool MeshLeaves::readBorder(base::ByteReader& in) {
  if (in.u64() != buckets_.border().codes.size()) return false;
  border_.resize(buckets_.border().codes.size());
  for (BorderLeaf& vertex : border_) base::readFields(in, fieldsOf(vertex));
  if (in.u64() != buckets_.count()) return false;
  limits_.resize(buckets_.count());
  for (DiceLimit& limit : limits_) {
    limit = in.read<DiceLimit>();
    if (!(limit.longest >= kMinLimit)) return false;
  }
  return in.ok();
}

std::uint64_t MeshLeaves::maxAddedLeaves() const {
  std::uint64_t cuts = 0;
  for (const DiceLimit& limit : limits_) cuts += limit.cuts;
  return cuts;
}

base::Result<TileLeaves> MeshLeaves::leaves(std::size_t bucket) const {
  LUMIGRID_ASSIGN_OR_RETURN(auto read, buckets_.readNumbered(bucket));
  std::vector<ingest::Corner>& corners = read.corners;
  const ingest::NumberedCorners& mesh = read.mesh;
  std::vector<glm::ivec3> places;
  places.reserve(mesh.codes.size());
  for (const std::uint64_t code : mesh.codes) places.push_back(ingest::mortonPoint(code));

  const double longest = limits_[bucket].longest;
  std::vector<Triangle> triangles;
  triangles.reserve(corners.size() / 3);
  // A mesh without colours and normals needs only the sums of the triangles, half of the memory.
  const bool attributes = buckets_.hasColors() || buckets_.hasNormals();
  std::vector<ingest::VertexSums> sums(attributes ? mesh.codes.size() : 0);
  std::vector<ingest::FacetSums> facets(attributes ? 0 : mesh.codes.size());
  // Where the source's triangles are in no order, most of the time is spent waiting for their vertices.
  const auto prefetch = [&](std::size_t corner, auto&& placeOf) {
    constexpr std::size_t kPrefetchDistance = 24;
    if (corner + kPrefetchDistance + 3 > mesh.number.size()) return;
    for (std::size_t k = 0; k < 3; ++k) __builtin_prefetch(placeOf(mesh.number[corner + kPrefetchDistance + k]), 1);
  };
  for (std::size_t i = 0; i < corners.size(); i += 3) {
    prefetch(i, [&](std::uint32_t v) -> const void* { return attributes ? &sums[v].facets : &facets[v]; });
    const std::uint32_t* v = &mesh.number[i];
    const std::array<glm::ivec3, 3> points{places[v[0]], places[v[1]], places[v[2]]};
    const glm::i64vec3 normal = ingest::latticeNormal(points[0], points[1], points[2]);
    triangles.emplace_back(points, normal, longest);
    const auto facet = ingest::facetAtCorners(normal, points[0], points[1], points[2]);
    for (std::size_t k = 0; k < 3; ++k) {
      if (attributes)
        sums[v[k]].add(facet[k], corners[i + k]);
      else
        facets[v[k]] += facet[k];
    }
  }
  corners = std::vector<ingest::Corner>();

  const ingest::BorderVertices& border = buckets_.border();
  std::vector<LeafPoint> points;
  points.reserve(places.size() + static_cast<std::size_t>(limits_[bucket].cuts));
  std::vector<std::int64_t> at(places.size());
  for (std::size_t v = 0; v < places.size(); ++v) {
    at[v] = border.find(mesh.codes[v]);
    if (at[v] >= 0)
      points.push_back(pointOf(border.sums[static_cast<std::size_t>(at[v])]));
    else
      points.push_back(pointOf(attributes ? sums[v] : ingest::VertexSums{facets[v]}));
  }
  sums = std::vector<ingest::VertexSums>();
  facets = std::vector<ingest::FacetSums>();

  std::vector<Outlier> outliers;
  Dicer dicer(places, longest);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    prefetch(3 * t, [&](std::uint32_t v) { return &points[v].around; });
    const std::uint32_t* v = &mesh.number[3 * t];
    if (triangles[t].diced) dicer.cut({v[0], v[1], v[2]}, static_cast<std::uint32_t>(t));
    for (std::size_t k = 0; k < 3; ++k) {
      LeafPoint& point = points[v[k]];
      const Surroundings around = triangles[t].at(point.decoded);
      point.around.add(around);
      if (around.least_cosine < LeafFacets::kCoreCosine) outliers.push_back({v[k], static_cast<std::uint32_t>(t)});
    }
  }
  addSubTriangles(dicer, triangles, points, outliers);

  TileLeaves out;
  out.added = points.size() - places.size();
  out.splats.reserve(points.size());
  std::vector<std::uint32_t> leaf_of_point(points.size(), kNoLeaf);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const BorderLeaf* shared = i < at.size() && at[i] >= 0 ? &border_[static_cast<std::size_t>(at[i])] : nullptr;
    // The facets of a border vertex in other buckets are not known here, so it gets none.
    if (shared == nullptr) leaf_of_point[i] = static_cast<std::uint32_t>(out.splats.size());
    if (shared == nullptr || shared->owner == bucket)
      out.splats.push_back(leafAt(lattice_, dicer.position(static_cast<std::uint32_t>(i)), points[i],
                                  shared != nullptr ? shared->around : points[i].around));
  }
  out.facets = facetsOf(outliers, leaf_of_point, out.splats.size(), triangles);
  return out;
}

}  // namespace lod::qsplat::builder
