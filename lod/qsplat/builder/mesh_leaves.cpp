#include "lod/qsplat/builder/mesh_leaves.h"

#include <algorithm>
#include <cmath>
#include <mutex>
#include <numeric>

#include "base/parallel.h"

namespace lod::qsplat::builder {
namespace {

// Coarse meshes too get leaves of at most this share of the longest side, as far as there is room for them.
constexpr double kWidestShare = 1.0 / 128.0;
// Lattice units: places in between mean nothing any more.
constexpr double kShortestCut = 4.0;
// Leaves that are added to a bucket: one for each two triangles, or so many where that is less.
constexpr std::uint64_t kMinRoom = std::uint64_t{1} << 14;
constexpr std::uint32_t kNoLeaf = std::numeric_limits<std::uint32_t>::max();
// Edge lengths that are tried, for each factor of two. A power of two.
constexpr int kLengths = 8;

// Squared radius of the smallest circle around a triangle with these squared sides and twice this area, squared.
double circleSquared(double a, double b, double c, double twice_area_squared) {
  const double longest = std::max({a, b, c});
  // Obtuse, or on a line: the longest side is a diameter.
  if (a + b + c - 2.0 * longest <= 0.0 || !(twice_area_squared > 0.0)) return 0.25 * longest;
  return 0.25 * a * b * c / twice_area_squared;
}

const glm::vec3& decodedNormal(const glm::vec3& normal) {
  return lod::qsplat::normalTable()[lod::qsplat::encodeNormal(normal)];
}

double squaredDistance(const glm::dvec3& a, const glm::dvec3& b) {
  const glm::dvec3 d = b - a;
  return glm::dot(d, d);
}

}  // namespace

// A triangle on the lattice.
struct MeshLeaves::Triangle {
  double area = 0.0;  // twice
  double circle_squared = 0.0;
  glm::vec3 unit{0.0F};  // zero where the corners lie on a line
  bool diced = false;

  // `normal`: its latticeNormal(). `longest`: an edge longer than that is cut.
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
  // A triangle without an area shows nothing of itself.
  float cosine(const glm::vec3& vertex_normal) const {
    return unit == glm::vec3(0.0F) ? 1.0F : glm::dot(unit, vertex_normal);
  }
  std::uint64_t wholeArea() const { return static_cast<std::uint64_t>(area + 0.5); }
  // The pieces of one that is diced come besides.
  Around at(const glm::vec3& vertex_normal) const {
    return diced ? Around{0.0, 1.0F, wholeArea(), 0}
                 : Around{circle_squared, cosine(vertex_normal), wholeArea(), wholeArea()};
  }
};

// A piece of a triangle that was diced.
struct MeshLeaves::Piece {
  double area = 0.0;  // twice
  double circle_squared = 0.0;

  Piece(const Dicer& dicer, const std::array<std::uint32_t, 3>& corners) {
    const glm::dvec3 a = dicer.position(corners[0]), b = dicer.position(corners[1]), c = dicer.position(corners[2]);
    const glm::dvec3 n = glm::cross(b - a, c - a);
    const double area_squared = glm::dot(n, n);
    circle_squared = circleSquared(squaredDistance(a, b), squaredDistance(b, c), squaredDistance(c, a), area_squared);
    area = std::sqrt(area_squared);
  }
  Around at(const Triangle& triangle, const glm::vec3& vertex_normal) const {
    return {circle_squared, triangle.cosine(vertex_normal), 0, static_cast<std::uint64_t>(area + 0.5)};
  }
};

base::Result<MeshLeaves::Cuts> MeshLeaves::chooseCuts(std::size_t bucket) const {
  LUMIGRID_ASSIGN_OR_RETURN(const auto corners, buckets_.read(bucket));
  std::vector<glm::ivec3> points;
  points.reserve(corners.size());
  for (const ingest::Corner& corner : corners) points.push_back(ingest::mortonPoint(corner.code));
  const std::size_t triangles = points.size() / 3;
  if (triangles == 0) return Cuts();
  std::vector<double> squared(triangles);
  double logs = 0.0;
  for (std::size_t t = 0; t < triangles; ++t) {
    const glm::dvec3 a(points[3 * t]), b(points[3 * t + 1]), c(points[3 * t + 2]);
    squared[t] = std::max({squaredDistance(a, b), squaredDistance(b, c), squaredDistance(c, a)});
    logs += std::log2(squared[t]);
  }
  const double mean = std::exp2(0.5 * logs / static_cast<double>(triangles));
  const double least = std::max(kShortestCut, std::min(dice_ * mean, kWidestShare * std::exp2(lattice_.bits)));
  const std::uint64_t most = std::max<std::uint64_t>(kMinRoom, triangles / 2);

  // From here on, those that are cut only.
  std::size_t kept = 0;
  for (std::size_t t = 0; t < triangles; ++t) {
    if (squared[t] <= least * least) continue;
    for (std::size_t k = 0; k < 3; ++k) points[3 * kept + k] = points[3 * t + k];
    ++kept;
  }
  points.resize(3 * kept);
  return kept == 0 ? Cuts() : leastCuts(points, least, most);
}

// With the least length from `least` on that leaves room: first its factor of two, then within it.
MeshLeaves::Cuts MeshLeaves::leastCuts(std::span<const glm::ivec3> points, double least, std::uint64_t most) {
  Cuts cuts;
  int length = -kLengths;
  const auto fits = [&](int at) {
    const double longest = least * std::exp2(static_cast<double>(at) / kLengths);
    const auto count = countCuts(points, longest, most);
    if (count) cuts = {longest, *count}, length = at;
    return count.has_value();
  };
  for (int at = 0; !fits(at);) at += kLengths;
  for (int step = kLengths / 2; step > 0 && length > 0; step /= 2) (void)fits(length - step);
  return cuts;
}

base::Result<void> MeshLeaves::measureBorder(unsigned threads, const std::function<bool(double)>& progress) {
  const ingest::BorderVertices& border = buckets_.border();
  border_.assign(border.codes.size(), {});
  cuts_.assign(buckets_.count(), {});
  std::vector<glm::vec3> normals;
  normals.reserve(border.sums.size());
  for (const ingest::VertexSums& sums : border.sums) normals.push_back(decodedNormal(sums.unitNormal()));
  std::mutex mutex;
  std::size_t done = 0;
  return base::tryParallelFor(buckets_.count(), threads, [&](std::size_t bucket) -> base::Result<void> {
    if (dice_ > 0.0) {
      LUMIGRID_ASSIGN_OR_RETURN(const auto cuts, chooseCuts(bucket));
      cuts_[bucket] = cuts;
    }
    LUMIGRID_ASSIGN_OR_RETURN(const auto triangles, buckets_.borderTriangles(bucket));
    const auto found = aroundBorder(triangles, normals, cuts_[bucket].longest);
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

// What a bucket's triangles ask for at vertices on the border.
std::vector<std::pair<std::uint32_t, MeshLeaves::Around>> MeshLeaves::aroundBorder(
    std::span<const ingest::BorderTriangle> triangles, std::span<const glm::vec3> normals, double longest) const {
  std::vector<std::pair<std::uint32_t, Around>> found;
  for (const ingest::BorderTriangle& t : triangles) {
    const std::array<glm::ivec3, 3> points{ingest::mortonPoint(t.corner[0].code), ingest::mortonPoint(t.corner[1].code),
                                           ingest::mortonPoint(t.corner[2].code)};
    const Triangle triangle(points, ingest::latticeNormal(points[0], points[1], points[2]), longest);
    for (const std::uint32_t at : t.place)
      if (at != ingest::kNotOnBorder) found.emplace_back(at, triangle.at(normals[at]));
    if (!triangle.diced) continue;
    Dicer dicer(points, longest);
    dicer.cut({0, 1, 2}, 0);
    for (const Dicer::Piece& piece : dicer.pieces())
      for (const std::uint32_t corner : piece.corners) {
        if (corner >= 3 || t.place[corner] == ingest::kNotOnBorder) continue;
        const std::uint32_t at = t.place[corner];
        found.emplace_back(at, Piece(dicer, piece.corners).at(triangle, normals[at]));
      }
  }
  return found;
}

void MeshLeaves::writeBorder(base::ByteWriter& out) const {
  out.u64(border_.size());
  for (const Border& vertex : border_) {
    out.f64(vertex.around.radius_squared);
    out.f32(vertex.around.least_cosine);
    out.u64(vertex.around.area);
    out.u64(vertex.around.own);
    out.u32(vertex.owner);
  }
  out.u64(cuts_.size());
  for (const Cuts& cuts : cuts_) out.write(cuts);
}

bool MeshLeaves::readBorder(base::ByteReader& in) {
  if (in.u64() != buckets_.border().codes.size()) return false;
  border_.resize(buckets_.border().codes.size());
  for (Border& vertex : border_) {
    vertex.around.radius_squared = in.f64();
    vertex.around.least_cosine = in.f32();
    vertex.around.area = in.u64();
    vertex.around.own = in.u64();
    vertex.owner = in.u32();
  }
  if (in.u64() != buckets_.count()) return false;
  cuts_.resize(buckets_.count());
  for (Cuts& cuts : cuts_) {
    cuts = in.read<Cuts>();
    if (!(cuts.longest >= kShortestCut)) return false;
  }
  return in.ok();
}

std::uint64_t MeshLeaves::mostAdded() const {
  std::uint64_t cuts = 0;
  for (const Cuts& of_bucket : cuts_) cuts += of_bucket.count;
  return cuts;
}

// What a leaf is made of besides what its triangles ask for.
struct MeshLeaves::Point {
  Around around;
  glm::vec3 decoded{0.0F};      // the normal as its code says
  std::uint32_t direction = 0;  // that code
  glm::vec3 normal{0.0F};       // unit
  glm::vec3 given{0.0F};        // unit normal of the source; zero: none
  glm::vec3 color{0.0F};
  glm::dvec3 face{0.0};  // sum of the triangles' normals

  void setNormal(const glm::vec3& unit) {
    normal = unit;
    direction = lod::qsplat::encodeNormal(unit);
    decoded = lod::qsplat::normalTable()[direction];
  }
};

// `place` is on the lattice.
Splat MeshLeaves::leaf(const glm::dvec3& place, const Point& point, const Around& around) const {
  // Rounded up by more than what positions are off in float32.
  constexpr double kRoundUp = 1.0 + 1e-6;
  constexpr double kPlace = 1.1e-7;
  // A vertex whose triangles have no area still counts for something.
  constexpr float kMinWeight = 1e-3F;
  Splat out;
  out.sphere.center = glm::vec3(lattice_.lattice.origin + lattice_.lattice.step * place);
  const glm::vec3 far = glm::abs(out.sphere.center);
  out.sphere.radius = static_cast<float>(std::sqrt(around.radius_squared) * lattice_.lattice.step * kRoundUp +
                                         kPlace * static_cast<double>(std::max({far.x, far.y, far.z})));
  // Of its triangles' area what is nearer to other leaves is theirs.
  const double share =
      around.own < around.area ? static_cast<double>(around.own) / static_cast<double>(around.area) : 1.0;
  out.weight = std::max(kMinWeight, static_cast<float>(share) * glm::length(glm::vec3(point.face)));
  out.normal = point.normal * out.weight;
  out.color = point.color * out.weight;
  out.direction = point.direction;
  out.least_cosine = around.least_cosine;
  return out;
}

// A vertex: `sums` over all triangles around it.
MeshLeaves::Point MeshLeaves::vertex(const ingest::VertexSums& sums) {
  Point point;
  point.setNormal(sums.unitNormal());
  if (sums.normal[0] != 0 || sums.normal[1] != 0 || sums.normal[2] != 0) point.given = point.normal;
  point.color = glm::vec3(sums.meanColor());
  point.face = glm::dvec3(sums.face[0], sums.face[1], sums.face[2]);
  return point;
}

// The points between pieces: colours and given normals are means of those at the ends of the edge, else normals are
// their pieces'. Then what the pieces ask for.
void MeshLeaves::addPieces(const Dicer& dicer, std::span<const Triangle> triangles, std::vector<Point>& points,
                           std::vector<Outlier>& outliers) {
  const std::size_t vertices = points.size();
  for (const Dicer::Middle& middle : dicer.middles()) {
    Point point;
    const Point &a = points[middle.a], &b = points[middle.b];
    point.color = 0.5F * (a.color + b.color);
    if (const glm::vec3 sum = a.given + b.given;
        a.given != glm::vec3(0.0F) && b.given != glm::vec3(0.0F) && glm::dot(sum, sum) > 0.0F)
      point.given = glm::normalize(sum);
    points.push_back(point);
  }
  std::vector<Piece> pieces;
  pieces.reserve(dicer.pieces().size());
  for (const Dicer::Piece& p : dicer.pieces()) {
    pieces.emplace_back(dicer, p.corners);
    const glm::dvec3 face = pieces.back().area * glm::dvec3(triangles[p.triangle].unit);
    for (const std::uint32_t corner : p.corners)
      if (corner >= vertices) points[corner].face += face;
  }
  for (std::size_t i = vertices; i < points.size(); ++i) {
    Point& point = points[i];
    const glm::dvec3 sum = point.given != glm::vec3(0.0F) ? glm::dvec3(point.given) : point.face;
    point.setNormal(glm::dot(sum, sum) > 0.0 ? glm::vec3(glm::normalize(sum)) : glm::vec3(0.0F, 0.0F, 1.0F));
  }
  for (std::size_t i = 0; i < pieces.size(); ++i) {
    const Dicer::Piece& p = dicer.pieces()[i];
    for (const std::uint32_t corner : p.corners) {
      const Around around = pieces[i].at(triangles[p.triangle], points[corner].decoded);
      points[corner].around.add(around);
      if (around.least_cosine < LeafFacets::kCoreCosine) outliers.push_back({corner, p.triangle});
    }
  }
}

// Leaf by leaf; `leaf_of_point`: kNoLeaf where they are of no use.
LeafFacets MeshLeaves::facetsOf(std::span<const Outlier> outliers, std::span<const std::uint32_t> leaf_of_point,
                                std::size_t leaves, std::span<const Triangle> triangles) {
  LeafFacets out;
  if (outliers.empty()) return out;
  // The end of each, then by filling from there its beginning.
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

base::Result<TileLeaves> MeshLeaves::leaves(std::size_t bucket) const {
  LUMIGRID_ASSIGN_OR_RETURN(auto read, buckets_.readNumbered(bucket));
  std::vector<ingest::Corner>& corners = read.corners;
  const ingest::NumberedCorners& mesh = read.mesh;
  std::vector<glm::ivec3> places;
  places.reserve(mesh.codes.size());
  for (const std::uint64_t code : mesh.codes) places.push_back(ingest::mortonPoint(code));

  const double longest = cuts_[bucket].longest;
  std::vector<Triangle> triangles;
  triangles.reserve(corners.size() / 3);
  // Of a mesh without colours and normals, their sums would be so much memory to fetch for nothing.
  const bool attributes = buckets_.hasColors() || buckets_.hasNormals();
  std::vector<ingest::VertexSums> sums(attributes ? mesh.codes.size() : 0);
  std::vector<glm::i64vec3> faces(attributes ? 0 : mesh.codes.size(), glm::i64vec3(0));
  // Where the source's triangles are in no order, most of the time goes into waiting for their vertices.
  const auto expect = [&](std::size_t corner, auto&& placeOf) {
    constexpr std::size_t kAhead = 24;
    if (corner + kAhead + 3 > mesh.number.size()) return;
    for (std::size_t k = 0; k < 3; ++k) __builtin_prefetch(placeOf(mesh.number[corner + kAhead + k]), 1);
  };
  for (std::size_t i = 0; i < corners.size(); i += 3) {
    expect(i, [&](std::uint32_t v) -> const void* { return attributes ? &sums[v].face[0] : &faces[v].x; });
    const std::uint32_t* v = &mesh.number[i];
    const std::array<glm::ivec3, 3> points{places[v[0]], places[v[1]], places[v[2]]};
    const glm::i64vec3 normal = ingest::latticeNormal(points[0], points[1], points[2]);
    triangles.emplace_back(points, normal, longest);
    for (std::size_t k = 0; k < 3; ++k) {
      if (attributes)
        sums[v[k]].add(normal, corners[i + k]);
      else
        faces[v[k]] += normal;
    }
  }
  corners = std::vector<ingest::Corner>();

  const ingest::BorderVertices& border = buckets_.border();
  std::vector<Point> points;
  points.reserve(places.size() + static_cast<std::size_t>(cuts_[bucket].count));
  std::vector<std::int64_t> at(places.size());
  for (std::size_t v = 0; v < places.size(); ++v) {
    at[v] = border.find(mesh.codes[v]);
    if (at[v] >= 0)
      points.push_back(vertex(border.sums[static_cast<std::size_t>(at[v])]));
    else
      points.push_back(vertex(attributes ? sums[v] : ingest::VertexSums{{faces[v].x, faces[v].y, faces[v].z}}));
  }
  sums = std::vector<ingest::VertexSums>();
  faces = std::vector<glm::i64vec3>();

  std::vector<Outlier> outliers;
  Dicer dicer(places, longest);
  for (std::size_t t = 0; t < triangles.size(); ++t) {
    expect(3 * t, [&](std::uint32_t v) { return &points[v].around; });
    const std::uint32_t* v = &mesh.number[3 * t];
    if (triangles[t].diced) dicer.cut({v[0], v[1], v[2]}, static_cast<std::uint32_t>(t));
    for (std::size_t k = 0; k < 3; ++k) {
      Point& point = points[v[k]];
      const Around around = triangles[t].at(point.decoded);
      point.around.add(around);
      if (around.least_cosine < LeafFacets::kCoreCosine) outliers.push_back({v[k], static_cast<std::uint32_t>(t)});
    }
  }
  addPieces(dicer, triangles, points, outliers);

  TileLeaves out;
  out.added = points.size() - places.size();
  out.splats.reserve(points.size());
  std::vector<std::uint32_t> leaf_of_point(points.size(), kNoLeaf);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Border* shared = i < at.size() && at[i] >= 0 ? &border_[static_cast<std::size_t>(at[i])] : nullptr;
    // Other buckets' facets around it are not known here one by one.
    if (shared == nullptr) leaf_of_point[i] = static_cast<std::uint32_t>(out.splats.size());
    if (shared == nullptr || shared->owner == bucket)
      out.splats.push_back(leaf(dicer.position(static_cast<std::uint32_t>(i)), points[i],
                                shared != nullptr ? shared->around : points[i].around));
  }
  out.facets = facetsOf(outliers, leaf_of_point, out.splats.size(), triangles);
  return out;
}

}  // namespace lod::qsplat::builder
