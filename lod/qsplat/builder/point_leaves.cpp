#include "lod/qsplat/builder/point_leaves.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <map>
#include <mutex>
#include <ranges>
#include <vector>

#include "base/fields.h"
#include "base/parallel.h"
#include "lod/ingest/morton.h"
#include "lod/ingest/nearest_points.h"
#include "lod/ingest/work_directory.h"

namespace lod::qsplat::builder {
namespace {

// ---- planes ----

// The least eigenvalue of a symmetric matrix of trace 1 with its eigenvector, and the next one, by Jacobi's rotations
// (Golub and Van Loan 2013, section 8.5). The vector is zero where the least eigenvalue is a double one.
struct LeastEigenvector {
  glm::dvec3 direction{0.0};
  double value = 0.0;
  double next = 0.0;
};
LeastEigenvector leastEigenvector(glm::dmat3 a) {
  glm::dmat3 v(1.0);
  for (int sweep = 0; sweep < 12; ++sweep) {
    const double off = a[0][1] * a[0][1] + a[0][2] * a[0][2] + a[1][2] * a[1][2];
    if (off < 1e-24) break;
    for (int p = 0; p < 2; ++p)
      for (int q = p + 1; q < 3; ++q) {
        if (a[p][q] == 0.0) continue;
        const double theta = 0.5 * (a[q][q] - a[p][p]) / a[p][q];
        const double t = (theta < 0.0 ? -1.0 : 1.0) / (std::abs(theta) + std::sqrt(theta * theta + 1.0));
        const double c = 1.0 / std::sqrt(t * t + 1.0);
        const double s = t * c;
        glm::dmat3 turn(1.0);
        turn[p][p] = c, turn[q][q] = c, turn[p][q] = -s, turn[q][p] = s;
        a = glm::transpose(turn) * a * turn;
        v = v * turn;
      }
  }
  std::array<int, 3> order{0, 1, 2};
  std::sort(order.begin(), order.end(), [&](int x, int y) { return a[x][x] < a[y][y]; });
  constexpr double kMinGap = 1e-9;  // below, rounding decides the direction
  const double least = a[order[0]][order[0]], next = a[order[1]][order[1]];
  return {next - least > kMinGap ? v[order[0]] : glm::dvec3(0.0), least, next};
}

// The mean of squared distances from the points' centre, along each pair of axes, and its trace.
std::pair<glm::dmat3, double> spreadOf(std::span<const glm::dvec3> points) {
  glm::dvec3 mean(0.0);
  for (const glm::dvec3& p : points) mean += p;
  mean /= static_cast<double>(points.size());
  glm::dmat3 spread(0.0);
  for (const glm::dvec3& p : points) spread += glm::outerProduct(p - mean, p - mean);
  return {spread, spread[0][0] + spread[1][1] + spread[2][2]};
}

// Sparse points make a surface where their spread across it is at most so large beside the lesser one along it (squared
// distances), and are noise in the air otherwise. A choice: it is 0.5 for noise, and 0.01 on gentle ground.
constexpr double kMaxThickness = 0.06;
// Whether the points lie about in a plane.
bool areFlat(std::span<const glm::dvec3> points) {
  const auto [spread, trace] = spreadOf(points);
  if (!(trace > 0.0)) return false;
  const LeastEigenvector least = leastEigenvector(spread / trace);
  return least.value <= kMaxThickness * least.next;
}

// ---- leaves ----

constexpr std::size_t kNeighbours = 16;       // clip a Voronoi cell; hexagonal cells need 6, irregular ones more
constexpr std::size_t kPlaneNeighbours = 12;  // determine the plane
constexpr std::size_t kTreeNeighbours = 8;    // are candidates for the spanning tree
constexpr std::size_t kRimNeighbour = 6;      // limits the radius at the rim
// Points farther away than this many times the median distance of the sixth neighbour are no neighbours, but where
// points lie so sparsely all around in a surface. A choice: a larger ratio closes wider gaps of uneven samplings, and
// joins parts that are not connected.
constexpr float kMaxDistanceRatio = 8.0F;
// A point that fewer points have among their sixteen nearest is a stray: all around lie closer to others than to it. A
// choice: strays come in small groups, and a point at a rim is a neighbour of eight.
constexpr std::uint32_t kLeastListed = 6;
// A point whose sixth neighbour is less than this many times as far as that of one next to it lies in a denser part
// than that. A choice: in a scan from one place gaps grow by a tenth from a point to the next.
constexpr float kSparseShare = 0.25F;

// To a side without neighbours a point reaches so many times as far as its neighbours' sixth neighbours lie. A choice:
// less opens holes at gaps that chance leaves in a surface.
constexpr float kOpenReach = 1.5F;

// Disjoint sets whose members each have a sign relative to their root's.
class SignedSets {
 public:
  explicit SignedSets(std::size_t count) : parent_(count), turned_(count, 0) {
    for (std::uint32_t i = 0; i < parent_.size(); ++i) parent_[i] = i;
  }
  // The root, and whether `i` has the opposite sign.
  std::pair<std::uint32_t, bool> find(std::uint32_t i) {
    std::uint32_t root = i;
    bool turned = false;
    while (parent_[root] != root) turned ^= turned_[root] != 0, root = parent_[root];
    const bool all = turned;
    while (parent_[i] != root && i != root) {  // path compression
      const std::uint32_t next = parent_[i];
      const bool step = turned_[i] != 0;
      parent_[i] = root;
      turned_[i] = turned ? 1 : 0;
      turned ^= step;
      i = next;
    }
    return {root, all};
  }
  void unite(std::uint32_t a, std::uint32_t b, bool turned) {
    const auto [x, x_turned] = find(a);
    const auto [y, y_turned] = find(b);
    if (x == y) return;
    // The smaller number stays root, so that roots do not depend on the order of unions.
    const std::uint32_t low = std::min(x, y);
    parent_[std::max(x, y)] = low;
    turned_[std::max(x, y)] = x_turned ^ y_turned ^ turned ? 1 : 0;
  }

 private:
  std::vector<std::uint32_t> parent_;
  std::vector<std::uint8_t> turned_;
};

// The nearest neighbours of each point and the point itself, nearest first.
class Neighbourhoods {
 public:
  explicit Neighbourhoods(std::size_t points) : found_(points * kMax), count_(points, 0) {}
  std::span<const ingest::NearestPoints::Neighbour> of(std::size_t i) const {
    return std::span(found_).subspan(i * kMax, count_[i]);
  }
  void set(std::size_t i, std::span<const ingest::NearestPoints::Neighbour> found) {
    std::copy(found.begin(), found.end(), found_.begin() + static_cast<std::ptrdiff_t>(i * kMax));
    count_[i] = static_cast<std::uint8_t>(found.size());
  }
  // Adds the neighbours among `positions` behind the points' own, and drops those beyond the squared distance `ball`.
  void add(std::span<const glm::vec3> positions, std::span<const float> ball) {
    const std::size_t points = count_.size();
    const ingest::NearestPoints others(positions.subspan(points));
    std::vector<ingest::NearestPoints::Neighbour> more, all;
    for (std::size_t i = 0; i < points; ++i) {
      all.clear();
      for (const ingest::NearestPoints::Neighbour& f : of(i))
        if (f.distance_squared <= ball[i]) all.push_back(f);
      others.find(positions[i], kMax, ball[i], more);
      for (ingest::NearestPoints::Neighbour f : more) {
        f.index += static_cast<std::uint32_t>(points);
        all.push_back(f);
      }
      if (!more.empty()) std::sort(all.begin(), all.end());
      all.resize(std::min(all.size(), kMax));
      set(i, all);
    }
  }

 private:
  static constexpr std::size_t kMax = kNeighbours + 1;
  std::vector<ingest::NearestPoints::Neighbour> found_;  // kMax for each point
  std::vector<std::uint8_t> count_;
};

// How far points lie from others of their tile.
class Gaps {
 public:
  // `near` holds neighbours among the tile's `points` points.
  Gaps(const Neighbourhoods& near, std::size_t points)
      : listed_(points, 0), sixth_(points, 0.0F), has_others_(points > kNeighbours + 1) {
    for (std::uint32_t i = 0; i < points; ++i) {
      const auto found = near.of(i);
      for (const auto& f : found) listed_[f.index] += f.index != i ? 1U : 0U;
      if (found.size() > kRimNeighbour) sixth_[i] = found[kRimNeighbour].distance_squared;
    }
  }
  // The median squared distance of the sixth neighbour; `otherwise` where there are fewer points.
  float usual(float otherwise) const {
    if (sixth_.size() <= kRimNeighbour) return otherwise;
    std::vector<float> sixth = sixth_;
    const auto middle = sixth.begin() + static_cast<std::ptrdiff_t>(sixth.size() / 2);
    std::nth_element(sixth.begin(), middle, sixth.end());
    return *middle;
  }
  // Whether hardly any other point is near the point `i`, though others are near each other.
  bool isStray(std::uint32_t i) const { return has_others_ && listed_[i] < kLeastListed; }
  // How far a point reaches at most where it has no neighbour: little farther than its neighbours' sixth neighbours
  // lie, a stray no farther than these and than is usual. Infinite where a neighbour lies in another tile, so that this
  // is not known.
  double openReach(std::uint32_t i, std::span<const ingest::NearestPoints::Neighbour> found, float usual) const {
    std::vector<float> sixth;
    for (const auto& f : found) {
      if (f.index >= sixth_.size()) return std::numeric_limits<double>::infinity();
      if (f.index != i) sixth.push_back(sixth_[f.index]);
    }
    float most = isStray(i) ? usual : kMaxDistanceRatio * kMaxDistanceRatio * usual;
    if (has_others_ && !sixth.empty()) {
      const auto middle = sixth.begin() + static_cast<std::ptrdiff_t>(sixth.size() / 2);
      std::nth_element(sixth.begin(), middle, sixth.end());
      most = std::min(most, (isStray(i) ? 1.0F : kOpenReach * kOpenReach) * *middle);
    }
    return static_cast<double>(std::sqrt(most));
  }
  // Whether most of a point's neighbours lie about as far from others as it does.
  bool isSparseAround(std::span<const ingest::NearestPoints::Neighbour> found) const {
    const auto sparse = std::count_if(found.begin() + 1, found.end(), [&](const auto& f) {
      return kSparseShare * kSparseShare * sixth_[found[0].index] <= sixth_[f.index];
    });
    return 2 * static_cast<std::size_t>(sparse) >= found.size();
  }

 private:
  std::vector<std::uint32_t> listed_;  // by point: how many have it among their nearest
  std::vector<float> sixth_;           // by point: squared distance of its sixth neighbour
  bool has_others_ = false;
};

std::vector<glm::dvec3> placesOf(std::span<const ingest::NearestPoints::Neighbour> found,
                                 std::span<const glm::vec3> positions) {
  std::vector<glm::dvec3> places;
  for (const auto& f : found) places.emplace_back(positions[f.index]);
  return places;
}

float distanceSquared(const base::Aabb& box, const glm::vec3& p) {
  const glm::vec3 d = glm::max(glm::max(box.min - p, p - box.max), glm::vec3(0.0F));
  return glm::dot(d, d);
}

}  // namespace

glm::dvec3 planeNormal(std::span<const glm::dvec3> points) {
  const auto [spread, trace] = spreadOf(points);
  const glm::dvec3 up(0.0, 0.0, 1.0);
  if (!(trace > 0.0)) return up;
  const glm::dvec3 n = leastEigenvector(spread / trace).direction;
  return glm::length(n) > 0.5 ? glm::normalize(n) : up;
}

double cellReach(const glm::dvec3& center, const glm::dvec3& normal, std::span<const glm::dvec3> others,
                 const CellLimits& limits) {
  const glm::dvec3 side = std::abs(normal.x) < 0.8 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  const glm::dvec3 u = glm::normalize(glm::cross(normal, side));
  const glm::dvec3 v = glm::cross(normal, u);
  // A square around the circle of radius `limits.reach` is clipped by each neighbour's bisector.
  struct Corner {
    glm::dvec2 at;
    bool opens;  // whether the side that begins here is one of the square's
  };
  const double r = limits.reach;
  std::vector<Corner> cell{{{-r, -r}, true}, {{r, -r}, true}, {{r, r}, true}, {{-r, r}, true}};
  std::vector<Corner> cut;
  for (auto* corners : {&cell, &cut}) corners->reserve(others.size() + 4);
  for (const glm::dvec3& other : others) {
    const glm::dvec3 d = other - center;
    const glm::dvec2 p(glm::dot(d, u), glm::dot(d, v));
    const double half = 0.5 * glm::dot(p, p);
    if (!(half > 0.0)) continue;
    cut.clear();
    for (std::size_t i = 0; i < cell.size(); ++i) {
      const Corner &a = cell[i], &b = cell[(i + 1) % cell.size()];
      const double x = glm::dot(a.at, p) - half, y = glm::dot(b.at, p) - half;
      // The bisector's side begins where the cell's boundary leaves the half-plane.
      if (x <= 0.0) cut.push_back(x == 0.0 && y > 0.0 ? Corner{a.at, false} : a);
      if (x < 0.0 && y > 0.0) cut.push_back({a.at + (b.at - a.at) * (x / (x - y)), false});
      if (x > 0.0 && y < 0.0) cut.push_back({a.at + (b.at - a.at) * (x / (x - y)), a.opens});
    }
    std::swap(cell, cut);
  }
  const bool at_rim = std::any_of(cell.begin(), cell.end(), [](const Corner& corner) { return corner.opens; });
  double reach = 0.0;
  for (std::size_t i = 0; i < cell.size(); ++i) {
    const bool open = cell[i].opens || cell[(i + cell.size() - 1) % cell.size()].opens;
    reach = std::max(reach, std::min(glm::length(cell[i].at), open ? limits.open : at_rim ? limits.rim : limits.reach));
  }
  return reach;
}

// A tile's points with their fitted normals and radii.
struct PointLeaves::FittedTile {
  std::vector<ingest::SourcePoint> points;  // the tile's own, then their neighbours in other tiles
  std::size_t own = 0;                      // how many are the tile's own
  std::vector<glm::vec3> normals;           // unit, of own points
  std::vector<float> radii;
  std::vector<std::uint32_t> part;  // by own point, the part whose signs agree; empty where normals are given
  std::uint32_t parts = 0;
  std::vector<std::pair<std::uint32_t, std::uint32_t>> links;  // own points and neighbours in other tiles
};

// Adds the points of other tiles that lie within the balls around this tile's points.
base::Result<void> PointLeaves::addNeighbours(std::size_t tile, std::span<const glm::vec3> positions,
                                              std::span<const float> ball,
                                              std::vector<ingest::SourcePoint>& points) const {
  const float widest = positions.empty() ? 0.0F : std::sqrt(*std::max_element(ball.begin(), ball.end()));
  for (std::size_t other = 0; other < tiles_.count(); ++other) {
    const base::Aabb& box = tiles_.box(other);
    if (other == tile || box.empty()) continue;
    const base::Aabb& mine = tiles_.box(tile);
    if (glm::any(glm::greaterThan(mine.min - widest, box.max)) || glm::any(glm::lessThan(mine.max + widest, box.min)))
      continue;
    base::Aabb wanted;
    for (std::size_t i = 0; i < positions.size(); ++i)
      if (distanceSquared(box, positions[i]) <= ball[i])
        wanted.add(base::Aabb{positions[i] - std::sqrt(ball[i]), positions[i] + std::sqrt(ball[i])});
    if (wanted.empty()) continue;
    LUMIGRID_ASSIGN_OR_RETURN(auto neighbours, tiles_.read(other));
    for (const ingest::SourcePoint& p : neighbours)
      if (wanted.contains(p.position)) points.push_back(p);
  }
  return {};
}

// Joins points along the edges across which normals differ least (Kruskal's algorithm), and flips normals to agree.
void PointLeaves::makeSignsAgree(FittedTile& out, std::span<const std::uint32_t> tree_neighbours) {
  struct Edge {
    std::uint32_t a, b;
  };
  std::vector<Edge> edges;
  std::vector<ingest::KeyedIndex> order;
  const auto ofPoint = [&](std::uint32_t i) { return tree_neighbours.subspan(i * kTreeNeighbours, kTreeNeighbours); };
  for (std::uint32_t i = 0; i < out.own; ++i)
    for (const std::uint32_t j : ofPoint(i)) {
      // An edge between mutual neighbours counts once.
      if (j == i || (j < i && std::ranges::find(ofPoint(j), i) != ofPoint(j).end())) continue;
      const float cost = std::max(0.0F, 1.0F - std::abs(glm::dot(out.normals[i], out.normals[j])));
      order.push_back({std::bit_cast<std::uint32_t>(cost), static_cast<std::uint32_t>(edges.size())});
      edges.push_back({i, j});
    }
  // The bits of floats that are not negative sort like the floats.
  ingest::radixSort(order, 32);
  SignedSets sets(out.own);
  for (const ingest::KeyedIndex& next : order) {
    const Edge& edge = edges[next.index];
    sets.unite(edge.a, edge.b, glm::dot(out.normals[edge.a], out.normals[edge.b]) < 0.0F);
  }
  std::map<std::uint32_t, std::uint32_t> number;
  for (std::uint32_t i = 0; i < out.own; ++i) {
    const auto [root, turned] = sets.find(i);
    out.part.push_back(number.emplace(root, static_cast<std::uint32_t>(number.size())).first->second);
    if (turned) out.normals[i] = -out.normals[i];
  }
  out.parts = static_cast<std::uint32_t>(number.size());
}

base::Result<PointLeaves::FittedTile> PointLeaves::fit(std::size_t tile) const {
  FittedTile out;
  LUMIGRID_ASSIGN_OR_RETURN(out.points, tiles_.read(tile));
  out.own = out.points.size();
  std::vector<glm::vec3> positions;
  for (const ingest::SourcePoint& p : out.points) positions.push_back(p.position);

  // Neighbours within the tile come first, with the distance beyond which none counts.
  constexpr float kAnywhere = std::numeric_limits<float>::max();
  Neighbourhoods near(out.own);
  std::vector<float> ball(out.own, 0.0F);  // squared distance within which neighbours count
  {
    const ingest::NearestPoints own(positions);
    std::vector<ingest::NearestPoints::Neighbour> found;
    for (std::size_t i = 0; i < out.own; ++i) {
      own.find(positions[i], kNeighbours + 1, kAnywhere, found);
      near.set(i, found);
      ball[i] = found.size() > kNeighbours ? found.back().distance_squared : kAnywhere;
    }
  }
  const Gaps gaps(near, out.own);
  const float usual = gaps.usual(glm::dot(tiles_.box(tile).size(), tiles_.box(tile).size()));
  for (std::uint32_t i = 0; i < out.own; ++i)
    if (const float most = kMaxDistanceRatio * kMaxDistanceRatio * usual;
        ball[i] > most &&
        (gaps.isStray(i) || !gaps.isSparseAround(near.of(i)) || !areFlat(placesOf(near.of(i), positions))))
      ball[i] = most;

  LUMIGRID_TRY(addNeighbours(tile, positions, ball, out.points));
  for (std::size_t i = out.own; i < out.points.size(); ++i) positions.push_back(out.points[i].position);
  near.add(positions, ball);

  std::vector<std::uint32_t> tree_neighbours;  // kTreeNeighbours for each point
  tree_neighbours.reserve(kTreeNeighbours * out.own);
  std::vector<glm::dvec3> around, plane;
  for (std::uint32_t i = 0; i < out.own; ++i) {
    const auto found = near.of(i);
    around.clear();
    for (const auto& f : found)
      if (f.index != i) around.emplace_back(positions[f.index]);
    const glm::dvec3 center(positions[i]);
    const glm::vec3 given = out.points[i].normal;
    glm::dvec3 normal(0.0);
    if (glm::length(given) > 0.0F) {
      normal = glm::dvec3(glm::normalize(given));
    } else {
      plane.assign(around.begin(),
                   around.begin() + static_cast<std::ptrdiff_t>(std::min(around.size(), kPlaneNeighbours)));
      plane.push_back(center);
      normal = planeNormal(plane);
    }
    out.normals.emplace_back(normal);
    const double min_radius = 0.5 * lattice_.lattice.step;
    CellLimits limits;
    limits.reach = around.empty() ? static_cast<double>(std::sqrt(usual))
                                  : glm::distance(around[std::min(around.size(), kRimNeighbour) - 1], center);
    limits.open = std::min(limits.reach, gaps.openReach(i, found, usual));
    if (gaps.isStray(i)) limits.reach = limits.open;
    limits.rim = std::min(limits.reach, static_cast<double>(kMaxDistanceRatio * std::sqrt(usual)));
    out.radii.push_back(
        static_cast<float>(std::max(min_radius, cellReach(center, normal, around, limits)) * (1.0 + 1e-5)));
    std::size_t kept = 0;
    for (const auto& f : found) {
      if (f.index == i || kept == kTreeNeighbours) continue;
      ++kept;
      if (f.index >= out.own) out.links.emplace_back(i, f.index);
      tree_neighbours.push_back(f.index < out.own ? f.index : i);
    }
    for (; kept < kTreeNeighbours; ++kept) tree_neighbours.push_back(i);
  }
  if (given_normals_) return out;

  makeSignsAgree(out, tree_neighbours);
  return out;
}

// A record holds the tile's number and its leaves.
base::Result<void> PointLeaves::store(std::size_t tile, const FittedTile& fitted) {
  base::ByteWriter out;
  out.u32(static_cast<std::uint32_t>(tile));
  for (std::size_t i = 0; i < fitted.own; ++i)
    out.write(StoredLeaf{{fitted.points[i].position, fitted.radii[i]},
                         fitted.normals[i],
                         glm::u8vec4(fitted.points[i].color, 255),
                         fitted.part.empty() ? 0 : fitted.part[i]});
  LUMIGRID_ASSIGN_OR_RETURN(const auto offset, fitted_.add(out.view()));
  (void)noteRecord(offset, out.view());
  return {};
}

bool PointLeaves::noteRecord(std::uint64_t offset, base::ByteView record) {
  base::ByteReader in(record);
  const std::uint32_t tile = in.u32();
  if (!in.ok() || tile >= records_.size() || in.remaining() % sizeof(StoredLeaf) != 0) return false;
  records_[tile] = {offset + in.offset(), in.remaining() / sizeof(StoredLeaf)};
  return true;
}

// Decides which way the parts of all tiles face, from their points at the borders.
struct PointLeaves::Orientation {
  struct Part {
    float top = std::numeric_limits<float>::lowest();
    float top_normal = 1.0F;
    glm::dvec3 sum{0.0};
  };
  struct BorderPoint {
    std::uint64_t code = 0;
    std::uint32_t tile = 0, part = 0;
    glm::vec3 normal{0.0F};
  };
  struct Link {
    std::uint32_t tile = 0, part = 0;
    glm::vec3 normal{0.0F};
    std::uint64_t other = 0;  // code of the point in another tile
  };

  explicit Orientation(std::size_t tiles) : parts(tiles) {}
  // Adds a tile's parts and the points at its border. One thread at a time.
  void add(std::size_t tile, const FittedTile& fitted);
  // Returns the flips by tile and part, and adds all normals by area to `facing`.
  std::vector<std::vector<std::uint8_t>> decide(bool given_normals, glm::dvec3& facing);
  // The sets of parts whose signs agree, by number through all tiles.
  SignedSets joinParts();

  std::vector<std::vector<Part>> parts;  // by tile
  std::vector<std::uint32_t> first;      // number of each tile's first part
  std::vector<BorderPoint> border;
  std::vector<Link> links;
};

void PointLeaves::Orientation::add(std::size_t tile, const FittedTile& fitted) {
  const auto t = static_cast<std::uint32_t>(tile);
  parts[tile].resize(std::max(1U, fitted.parts));
  for (std::size_t i = 0; i < fitted.own; ++i) {
    Part& part = parts[tile][fitted.part.empty() ? 0U : fitted.part[i]];
    const glm::vec3& n = fitted.normals[i];
    part.sum += glm::dvec3(n) * static_cast<double>(fitted.radii[i] * fitted.radii[i]);
    if (const float z = fitted.points[i].position.z; z > part.top) part.top = z, part.top_normal = n.z;
  }
  if (fitted.part.empty()) return;
  std::uint32_t last = 0xFFFFFFFFU;
  for (const auto& [i, j] : fitted.links) {
    links.push_back({t, fitted.part[i], fitted.normals[i], fitted.points[j].code});
    if (i != last) border.push_back({fitted.points[i].code, t, fitted.part[i], fitted.normals[i]});
    last = i;
  }
}

SignedSets PointLeaves::Orientation::joinParts() {
  // Two parts agree as most of their pairs of neighbouring points do.
  std::sort(border.begin(), border.end(), [](const BorderPoint& a, const BorderPoint& b) { return a.code < b.code; });
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::int64_t> votes;
  for (const Link& link : links) {
    const auto at = std::lower_bound(border.begin(), border.end(), link.other,
                                     [](const BorderPoint& b, std::uint64_t code) { return b.code < code; });
    if (at == border.end() || at->code != link.other) continue;
    const std::uint32_t a = first[link.tile] + link.part, b = first[at->tile] + at->part;
    votes[{std::min(a, b), std::max(a, b)}] += glm::dot(link.normal, at->normal) < 0.0F ? -1 : 1;
  }

  // The clearest votes count first, since unite() keeps what was decided before.
  std::vector<std::pair<std::pair<std::uint32_t, std::uint32_t>, std::int64_t>> clearest(votes.begin(), votes.end());
  std::stable_sort(clearest.begin(), clearest.end(),
                   [](const auto& a, const auto& b) { return std::abs(a.second) > std::abs(b.second); });
  SignedSets sets(first.back());
  for (const auto& [pair, vote] : clearest) sets.unite(pair.first, pair.second, vote < 0);
  return sets;
}

std::vector<std::vector<std::uint8_t>> PointLeaves::Orientation::decide(bool given_normals, glm::dvec3& facing) {
  first = {0};
  for (const auto& of_tile : parts) first.push_back(first.back() + static_cast<std::uint32_t>(of_tile.size()));
  SignedSets sets = joinParts();

  // Each set faces up at its highest point.
  std::map<std::uint32_t, std::pair<float, bool>> tops;  // by root: height, and whether the root is to be flipped
  for (std::size_t tile = 0; tile < parts.size(); ++tile)
    for (std::uint32_t p = 0; p < parts[tile].size(); ++p) {
      const auto [root, turned] = sets.find(first[tile] + p);
      const Part& part = parts[tile][p];
      const bool down = part.top_normal < 0.0F;
      const auto [it, is_new] = tops.try_emplace(root, part.top, down != turned);
      if (!is_new && part.top > it->second.first) it->second = {part.top, down != turned};
    }

  // Given normals stay as they are.
  std::vector<std::vector<std::uint8_t>> flips(parts.size());
  for (std::size_t tile = 0; tile < parts.size(); ++tile)
    for (std::uint32_t p = 0; p < parts[tile].size(); ++p) {
      const auto [root, turned] = sets.find(first[tile] + p);
      const bool flip = !given_normals && tops.at(root).second != turned;
      flips[tile].push_back(flip ? 1 : 0);
      facing += flip ? -parts[tile][p].sum : parts[tile][p].sum;
    }
  return flips;
}

base::Result<void> PointLeaves::fitAll(const std::string& path, unsigned threads,
                                       const std::function<bool(double)>& progress) {
  flips_.assign(tiles_.count(), {});
  records_.assign(tiles_.count(), {});
  LUMIGRID_ASSIGN_OR_RETURN(fitted_, ingest::RecordLog::open(path, false, {}));
  Orientation orientation(tiles_.count());
  std::mutex mutex;
  std::size_t done = 0;
  const auto fitTile = [&](std::size_t tile) -> base::Result<void> {
    LUMIGRID_ASSIGN_OR_RETURN(const auto fitted, fit(tile));
    LUMIGRID_TRY(store(tile, fitted));
    const std::lock_guard lock(mutex);
    orientation.add(tile, fitted);
    ++done;
    if (progress && !progress(static_cast<double>(done) / static_cast<double>(tiles_.count())))
      return base::Error{base::ErrorCode::kCancelled, "fitting normals was cancelled"};
    return {};
  };
  LUMIGRID_TRY(base::tryParallelFor(tiles_.count(), threads, fitTile));
  flips_ = orientation.decide(given_normals_, facing_);
  return {};
}

void PointLeaves::writeSigns(base::ByteWriter& out) const {
  out.write(facing_);
  out.u64(flips_.size());
  for (const auto& of_tile : flips_) {
    out.u32(static_cast<std::uint32_t>(of_tile.size()));
    out.bytes(of_tile);
  }
}

base::Result<void> PointLeaves::reopen(const std::string& path, base::ByteReader& signs) {
  const base::Error damaged = ingest::damagedWorkFiles(path.substr(0, path.rfind('/')));
  facing_ = signs.read<glm::dvec3>();
  if (signs.u64() != tiles_.count()) return damaged;
  flips_.assign(tiles_.count(), {});
  for (auto& of_tile : flips_) {
    const base::ByteView bytes = signs.bytes(signs.u32());
    of_tile.assign(bytes.begin(), bytes.end());
  }
  records_.assign(tiles_.count(), {});
  LUMIGRID_ASSIGN_OR_RETURN(fitted_,
                            ingest::RecordLog::open(path, true, [this](std::uint64_t offset, base::ByteView record) {
                              return noteRecord(offset, record);
                            }));
  const bool all = std::all_of(records_.begin(), records_.end(), [](const TileRecord& r) { return r.offset > 0; });
  return signs.ok() && all ? base::Result<void>() : damaged;
}

base::Result<TileLeaves> PointLeaves::leaves(std::size_t tile) const {
  std::vector<StoredLeaf> stored(static_cast<std::size_t>(records_[tile].leaves));
  LUMIGRID_TRY(fitted_.readAt(records_[tile].offset, std::span(reinterpret_cast<std::uint8_t*>(stored.data()),
                                                               stored.size() * sizeof(StoredLeaf))));
  TileLeaves out;
  out.splats.reserve(stored.size());
  for (const StoredLeaf& from : stored) {
    if (from.part >= flips_[tile].size()) return ingest::damagedWorkFiles("points");
    const glm::vec3 normal = flips_[tile][from.part] != 0 ? -from.normal : from.normal;
    Splat& leaf = out.splats.emplace_back();
    leaf.sphere = from.sphere;
    leaf.weight = std::max(leaf.sphere.radius * leaf.sphere.radius, std::numeric_limits<float>::min());
    leaf.normal = leaf.weight * normal;
    leaf.color = leaf.weight * glm::vec3(glm::u8vec3(from.color));
    leaf.direction = encodeNormal(normal);
    leaf.least_cosine = -1.0F;  // unknown, since orientations are guessed
  }
  return out;
}

}  // namespace lod::qsplat::builder
