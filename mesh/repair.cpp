#include "mesh/repair.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <iterator>
#include <memory>
#include <span>

#include "base/check.h"
#include "base/parallel.h"
#include "mesh/mesh_stream.h"

namespace mesh {
namespace {

constexpr std::uint32_t kNone = 0xFFFFFFFFU;

// Finalizer of MurmurHash3 (Appleby 2011): every bit of the input moves every bit of the output.
std::uint64_t mix(std::uint64_t h) {
  h = (h ^ (h >> 33U)) * 0xFF51AFD7ED558CCDULL;
  h = (h ^ (h >> 33U)) * 0xC4CEB9FE1A85EC53ULL;
  return h ^ (h >> 33U);
}
template <class T>
std::uint64_t hashOf(const std::array<T, 3>& key) {
  return mix(static_cast<std::uint64_t>(key[0]) +
             0x9E3779B97F4A7C15ULL * mix(static_cast<std::uint64_t>(key[1]) +
                                         0x9E3779B97F4A7C15ULL * mix(static_cast<std::uint64_t>(key[2]))));
}

// Set of numbered things: open addressing over the numbers, equality asked of the caller.
class NumberSet {
 public:
  explicit NumberSet(std::size_t most) : slots_(std::bit_ceil(std::max<std::size_t>(16, 2 * most)), kNone) {}

  /// The number already there that `equal` accepts, or kNone.
  template <class Equal>
  std::uint32_t find(std::uint64_t hash, const Equal& equal) const {
    const std::size_t mask = slots_.size() - 1;
    for (std::size_t at = hash & mask;; at = (at + 1) & mask)
      if (slots_[at] == kNone || equal(slots_[at])) return slots_[at];
  }
  void insert(std::uint64_t hash, std::uint32_t number) {
    const std::size_t mask = slots_.size() - 1;
    std::size_t at = hash & mask;
    while (slots_[at] != kNone) at = (at + 1) & mask;
    slots_[at] = number;
  }

 private:
  std::vector<std::uint32_t> slots_;
};

// ---- 1. Welding
// ---------------------------------------------------------------------------------------------------------

std::array<std::uint32_t, 3> bitsOf(const glm::vec3& p) {
  const glm::vec3 q = p + 0.0F;  // −0 becomes +0
  return {std::bit_cast<std::uint32_t>(q.x), std::bit_cast<std::uint32_t>(q.y), std::bit_cast<std::uint32_t>(q.z)};
}

/// For each vertex the first one at exactly its position.
std::vector<std::uint32_t> weldExactly(const std::vector<glm::vec3>& positions) {
  std::vector<std::uint32_t> first(positions.size());
  NumberSet set(positions.size());
  for (std::uint32_t v = 0; v < positions.size(); ++v) {
    const std::uint64_t hash = hashOf(bitsOf(positions[v]));
    const std::uint32_t found = set.find(hash, [&](std::uint32_t other) { return positions[other] == positions[v]; });
    first[v] = found == kNone ? v : found;
    if (found == kNone) set.insert(hash, v);
  }
  return first;
}

/// For each vertex the first kept one closer than `distance`. A grid of that cell size holds the kept ones, so that all
/// candidates lie in the 27 cells around.
std::vector<std::uint32_t> weldWithin(const std::vector<glm::vec3>& positions, double distance) {
  std::vector<std::uint32_t> first(positions.size());
  NumberSet set(positions.size());
  const auto cellOf = [&](const glm::vec3& p) {
    const glm::dvec3 cell = glm::floor(glm::dvec3(p) / distance);
    return std::array<std::int64_t, 3>{static_cast<std::int64_t>(cell.x), static_cast<std::int64_t>(cell.y),
                                       static_cast<std::int64_t>(cell.z)};
  };
  for (std::uint32_t v = 0; v < positions.size(); ++v) {
    const std::array<std::int64_t, 3> cell = cellOf(positions[v]);
    const auto near = [&](std::uint32_t other) {
      return glm::distance(glm::dvec3(positions[other]), glm::dvec3(positions[v])) <= distance;
    };
    std::uint32_t found = kNone;
    for (int n = 0; n < 27 && found == kNone; ++n)
      found = set.find(
          hashOf(std::array<std::int64_t, 3>{cell[0] + n % 3 - 1, cell[1] + n / 3 % 3 - 1, cell[2] + n / 9 - 1}), near);
    first[v] = found == kNone ? v : found;
    if (found == kNone) set.insert(hashOf(cell), v);
  }
  return first;
}

/// Colours and normals of vertices that became one: their means, written to the one that stays.
void averageAttributes(Mesh& mesh, const std::vector<std::uint32_t>& first) {
  const std::size_t count = first.size();
  if (!mesh.colors.empty()) {
    std::vector<glm::uvec4> sums(count, glm::uvec4(0));
    for (std::size_t v = 0; v < count; ++v) sums[first[v]] += glm::uvec4(glm::uvec3(mesh.colors[v]), 1);
    for (std::size_t v = 0; v < count; ++v)
      if (sums[v].a > 1)
        mesh.colors[v] = glm::u8vec4(glm::u8vec3((glm::uvec3(sums[v]) + sums[v].a / 2) / sums[v].a), 255);
  }
  if (!mesh.normals.empty())
    for (std::size_t v = 0; v < count; ++v)
      if (first[v] != v) mesh.normals[first[v]] += mesh.normals[v];
}

void weld(Mesh& mesh, double distance, RepairCounts& counts) {
  // A distance below what float32 can tell apart is no distance (and would overflow the cell numbers).
  const base::Aabb box = mesh.box();
  const double reach = box.empty() ? 0.0 : static_cast<double>(glm::max(glm::length(box.min), glm::length(box.max)));
  const bool exact = distance <= 1e-9 * reach;
  const std::vector<std::uint32_t> first = exact ? weldExactly(mesh.positions) : weldWithin(mesh.positions, distance);

  std::uint64_t welded = 0;
  for (std::size_t v = 0; v < first.size(); ++v) welded += first[v] != v ? 1 : 0;
  if (welded == 0) return;
  counts.add("welded_vertices", welded);
  averageAttributes(mesh, first);
  for (std::uint32_t& index : mesh.indices) index = first[index];

  // The others go now rather than as "unreferenced", which would count them twice.
  std::vector<std::uint32_t> number(first.size());
  std::uint32_t kept = 0;
  for (std::size_t v = 0; v < first.size(); ++v) {
    if (first[v] != v) continue;
    mesh.positions[kept] = mesh.positions[v];
    if (!mesh.normals.empty()) mesh.normals[kept] = mesh.normals[v];
    if (!mesh.colors.empty()) mesh.colors[kept] = mesh.colors[v];
    number[v] = kept++;
  }
  mesh.positions.resize(kept);
  if (!mesh.normals.empty()) mesh.normals.resize(kept);
  if (!mesh.colors.empty()) mesh.colors.resize(kept);
  for (std::uint32_t& index : mesh.indices) index = number[index];
}

// ---- 2 and 3. Triangles that are none, or there already
// -----------------------------------------------------------------

bool isDegenerate(const Mesh& mesh, const std::uint32_t* t) {
  if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) return true;
  const glm::dvec3 a(mesh.positions[t[0]]);
  const glm::dvec3 b(mesh.positions[t[1]]);
  const glm::dvec3 c(mesh.positions[t[2]]);
  return glm::cross(b - a, c - a) == glm::dvec3(0.0);
}

std::array<std::uint32_t, 3> sortedCorners(const std::uint32_t* t) {
  std::array<std::uint32_t, 3> key{t[0], t[1], t[2]};
  std::sort(key.begin(), key.end());
  return key;
}

void dropTriangles(Mesh& mesh, RepairCounts& counts) {
  std::uint64_t degenerate = 0;
  std::uint64_t duplicate = 0;
  std::size_t kept = 0;
  NumberSet set(mesh.triangleCount());
  for (std::size_t i = 0; i < mesh.indices.size(); i += 3) {
    const std::uint32_t* t = mesh.indices.data() + i;
    if (isDegenerate(mesh, t)) {
      ++degenerate;
      continue;
    }
    const std::array<std::uint32_t, 3> key = sortedCorners(t);
    const std::uint64_t hash = hashOf(key);
    const auto same = [&](std::uint32_t other) {
      return sortedCorners(mesh.indices.data() + 3 * std::size_t{other}) == key;
    };
    if (set.find(hash, same) != kNone) {
      ++duplicate;
      continue;
    }
    std::copy_n(t, 3, mesh.indices.data() + kept);
    set.insert(hash, static_cast<std::uint32_t>(kept / 3));
    kept += 3;
  }
  mesh.indices.resize(kept);
  counts.add("degenerate_triangles", degenerate);
  counts.add("duplicate_triangles", duplicate);
}

// ---- Edges ----

// Half-edge h runs from corner h of its triangle h / 3 to the next corner.
std::uint32_t nextCorner(std::uint32_t h) {
  return h % 3 == 2 ? h - 2 : h + 1;
}

// All half-edges, grouped by the undirected edge they lie on.
class EdgeTable {
 public:
  struct Entry {
    std::uint32_t high;  // the edge's higher vertex
    std::uint32_t half_edge;
  };

  explicit EdgeTable(const Mesh& mesh) : start_(mesh.positions.size() + 1, 0), entries_(mesh.indices.size()) {
    // Counting sort by the lower vertex, then each vertex's few entries by the higher.
    const std::uint32_t count = static_cast<std::uint32_t>(mesh.indices.size());
    const auto low = [&](std::uint32_t h) { return std::min(mesh.indices[h], mesh.indices[nextCorner(h)]); };
    for (std::uint32_t h = 0; h < count; ++h) ++start_[low(h)];
    std::uint32_t sum = 0;
    for (std::uint32_t& s : start_) {
      sum += s;
      s = sum;
    }
    for (std::uint32_t h = count; h-- > 0;)
      entries_[--start_[low(h)]] = {std::max(mesh.indices[h], mesh.indices[nextCorner(h)]), h};
    constexpr std::size_t kBlock = 1 << 15;
    const std::size_t vertices = mesh.positions.size();
    base::parallelFor((vertices + kBlock - 1) / kBlock, 0, [&](std::size_t block) {
      for (std::size_t v = block * kBlock; v < std::min(vertices, (block + 1) * kBlock); ++v)
        std::sort(entries_.begin() + start_[v], entries_.begin() + start_[v + 1], [](const Entry& a, const Entry& b) {
          return a.high != b.high ? a.high < b.high : a.half_edge < b.half_edge;
        });
    });
  }

  /// Calls visit(lower vertex, half-edges) for every edge.
  template <class Visit>
  void forEachEdge(const Visit& visit) const {
    for (std::size_t v = 0; v + 1 < start_.size(); ++v)
      for (std::size_t i = start_[v]; i < start_[v + 1];) {
        std::size_t end = i + 1;
        while (end < start_[v + 1] && entries_[end].high == entries_[i].high) ++end;
        visit(static_cast<std::uint32_t>(v), std::span<const Entry>(entries_).subspan(i, end - i));
        i = end;
      }
  }

 private:
  std::vector<std::uint32_t> start_;
  std::vector<Entry> entries_;
};

// ---- 4. Winding
// ---------------------------------------------------------------------------------------------------------

/// Per half-edge the one of the neighbour across an edge of exactly two triangles, else kNone.
std::vector<std::uint32_t> matesOf(const Mesh& mesh, const EdgeTable& edges) {
  std::vector<std::uint32_t> mate(mesh.indices.size(), kNone);
  edges.forEachEdge([&](std::uint32_t, std::span<const EdgeTable::Entry> e) {
    if (e.size() != 2) return;
    mate[e[0].half_edge] = e[1].half_edge;
    mate[e[1].half_edge] = e[0].half_edge;
  });
  return mate;
}

/// Two triangles wound alike run along their edge in opposite directions.
bool runAlike(const Mesh& mesh, std::uint32_t a, std::uint32_t b) {
  return mesh.indices[a] == mesh.indices[b];
}

enum Side : std::uint8_t { kUnseen, kAsIs, kTurned };

/// Spreads sides from `seed` over its part. Members go to `part`; false when no sides fit all edges.
bool spreadSides(const Mesh& mesh, const std::vector<std::uint32_t>& mate, std::uint32_t seed, std::vector<Side>& side,
                 std::vector<std::uint32_t>& part) {
  bool orientable = true;
  part.assign(1, seed);
  side[seed] = kAsIs;
  for (std::size_t i = 0; i < part.size(); ++i)
    for (std::uint32_t h = 3 * part[i]; h < 3 * part[i] + 3; ++h) {
      if (mate[h] == kNone) continue;
      const std::uint32_t other = mate[h] / 3;
      const Side turned = side[part[i]] == kAsIs ? kTurned : kAsIs;
      const Side wanted = runAlike(mesh, h, mate[h]) ? turned : side[part[i]];
      if (side[other] == kUnseen) {
        side[other] = wanted;
        part.push_back(other);
      }
      orientable = orientable && side[other] == wanted;
    }
  return orientable;
}

/// True when a triangle was turned (the edge table is then out of date).
bool alignWinding(Mesh& mesh, const EdgeTable& edges, RepairCounts& counts) {
  const std::vector<std::uint32_t> mate = matesOf(mesh, edges);
  bool mixed = false;
  for (std::uint32_t h = 0; h < mate.size() && !mixed; ++h) mixed = mate[h] != kNone && runAlike(mesh, h, mate[h]);
  if (!mixed) return false;

  std::vector<Side> side(mesh.triangleCount(), kUnseen);
  std::vector<std::uint32_t> part;
  std::vector<std::uint32_t> to_turn;
  for (std::uint32_t t = 0; t < side.size(); ++t) {
    if (side[t] != kUnseen) continue;
    if (!spreadSides(mesh, mate, t, side, part)) {
      counts.add("non_orientable_parts", 1);
      continue;
    }
    const std::size_t turned =
        static_cast<std::size_t>(std::count_if(part.begin(), part.end(), [&](auto m) { return side[m] == kTurned; }));
    const Side minority = 2 * turned > part.size() ? kAsIs : kTurned;
    std::copy_if(part.begin(), part.end(), std::back_inserter(to_turn), [&](auto m) { return side[m] == minority; });
  }
  for (const std::uint32_t t : to_turn)
    std::swap(mesh.indices[3 * std::size_t{t} + 1], mesh.indices[3 * std::size_t{t} + 2]);
  counts.add("flipped_triangles", to_turn.size());
  return !to_turn.empty();
}

// ---- 5. Non-manifold edges and vertices
// ---------------------------------------------------------------------------------

// The surface is cut along the edges that no two triangles can share, and triangles around a vertex that are then no
// longer joined across an edge get a vertex of their own (Guéziec et al. 2001, "Cutting and stitching", the local
// cutting).
class Splitter {
 public:
  Splitter(Mesh& mesh, const EdgeTable& edges) : mesh_(mesh), edges_(edges), link_(mesh.indices.size(), kNone) {}
  void run(RepairCounts& counts);

 private:
  using Edge = std::span<const EdgeTable::Entry>;
  void linkEdge(Edge edge);
  void pairByAngle(Edge edge);
  void uniteFans();
  std::uint32_t root(std::uint32_t corner);
  void unite(std::uint32_t a, std::uint32_t b);
  bool cutSharedEdges();
  std::vector<std::uint32_t> vertexOfCorner();

  Mesh& mesh_;
  const EdgeTable& edges_;
  std::vector<std::uint32_t> link_;                     // per half-edge: the one it is joined to across its edge
  std::vector<std::uint32_t> parent_;                   // union-find over corners
  std::vector<std::vector<std::uint32_t>> wide_edges_;  // half-edges of each edge with three and more triangles
  std::vector<std::uint32_t> copies_of_;                // the vertices that new ones double
};

void Splitter::linkEdge(Edge edge) {
  if (edge.size() == 2) {
    if (runAlike(mesh_, edge[0].half_edge, edge[1].half_edge)) return;
    link_[edge[0].half_edge] = edge[1].half_edge;
    link_[edge[1].half_edge] = edge[0].half_edge;
  } else if (edge.size() > 2) {
    std::vector<std::uint32_t>& halves = wide_edges_.emplace_back();
    for (const auto& entry : edge) halves.push_back(entry.half_edge);
    pairByAngle(edge);
  }
}

// Around an edge of many triangles each wedge of material lies between a triangle that runs along the edge backwards
// and the next one, counter-clockwise, that runs forwards: these two are joined, as brackets are matched. Two cubes
// that touch along an edge come apart so. What finds no partner stays cut.
void Splitter::pairByAngle(Edge edge) {
  const std::uint32_t first = edge[0].half_edge;
  const std::uint32_t from = mesh_.indices[first];
  const glm::dvec3 a(mesh_.positions[from]);
  const glm::dvec3 axis = glm::normalize(glm::dvec3(mesh_.positions[mesh_.indices[nextCorner(first)]]) - a);
  const auto armOf = [&](std::uint32_t h) {
    const glm::dvec3 d = glm::dvec3(mesh_.positions[mesh_.indices[nextCorner(nextCorner(h))]]) - a;
    return d - glm::dot(d, axis) * axis;
  };
  const glm::dvec3 x = armOf(first);
  const glm::dvec3 y = glm::cross(axis, x);

  struct Arm {
    double angle;
    std::uint32_t half_edge;
    bool forward;
  };
  std::vector<Arm> arms;
  for (const auto& entry : edge) {
    const glm::dvec3 d = armOf(entry.half_edge);
    arms.push_back(
        {std::atan2(glm::dot(d, y), glm::dot(d, x)), entry.half_edge, mesh_.indices[entry.half_edge] == from});
  }
  std::stable_sort(arms.begin(), arms.end(), [](const Arm& p, const Arm& q) { return p.angle < q.angle; });

  // Twice around, so that a bracket opened before the end of the circle can close after its start.
  std::vector<std::uint32_t> open;
  for (std::size_t i = 0; i < 2 * arms.size(); ++i) {
    const Arm& arm = arms[i % arms.size()];
    if (link_[arm.half_edge] != kNone) continue;
    if (!arm.forward) {
      if (i < arms.size()) open.push_back(arm.half_edge);
    } else if (!open.empty()) {
      link_[arm.half_edge] = open.back();
      link_[open.back()] = arm.half_edge;
      open.pop_back();
    }
  }
}

std::uint32_t Splitter::root(std::uint32_t corner) {
  while (parent_[corner] != corner) {
    parent_[corner] = parent_[parent_[corner]];
    corner = parent_[corner];
  }
  return corner;
}

// The lowest corner is the root, so that the result does not depend on the order of unions.
void Splitter::unite(std::uint32_t a, std::uint32_t b) {
  a = root(a);
  b = root(b);
  if (a != b) parent_[std::max(a, b)] = std::min(a, b);
}

void Splitter::uniteFans() {
  parent_.resize(link_.size());
  for (std::uint32_t c = 0; c < parent_.size(); ++c) parent_[c] = c;
  for (std::uint32_t h = 0; h < link_.size(); ++h) {
    const std::uint32_t other = link_[h];
    if (other == kNone || other < h) continue;
    unite(h, nextCorner(other));
    unite(nextCorner(h), other);
  }
}

// Two pairs of one wide edge may still meet at both of its ends, by way of other triangles: then the edge would stay
// wide, and it has to be cut altogether. One more round suffices: a fan that runs out at an edge does so at most twice.
bool Splitter::cutSharedEdges() {
  bool cut = false;
  for (const std::vector<std::uint32_t>& halves : wide_edges_) {
    std::vector<std::array<std::uint32_t, 2>> ends;
    for (const std::uint32_t h : halves) {
      std::array<std::uint32_t, 2> e{root(h), root(nextCorner(h))};
      if (e[0] > e[1]) std::swap(e[0], e[1]);
      ends.push_back(e);
    }
    std::sort(ends.begin(), ends.end());
    bool wide = false;
    for (std::size_t i = 2; i < ends.size(); ++i) wide = wide || ends[i] == ends[i - 2];
    if (!wide) continue;
    cut = true;
    for (const std::uint32_t h : halves) link_[h] = kNone;
  }
  return cut;
}

// The first fan of a vertex keeps it, every other gets a new one.
std::vector<std::uint32_t> Splitter::vertexOfCorner() {
  std::vector<std::uint32_t> vertex(parent_.size(), kNone);
  std::vector<bool> taken(mesh_.positions.size(), false);
  const std::uint64_t before = mesh_.positions.size();
  for (std::uint32_t c = 0; c < parent_.size(); ++c) {
    const std::uint32_t r = root(c);
    if (vertex[r] == kNone) {
      const std::uint32_t old = mesh_.indices[c];
      if (taken[old]) {
        vertex[r] = static_cast<std::uint32_t>(before + copies_of_.size());
        copies_of_.push_back(old);
      } else {
        vertex[r] = old;
        taken[old] = true;
      }
    }
    vertex[c] = vertex[r];
  }
  return vertex;
}

void Splitter::run(RepairCounts& counts) {
  edges_.forEachEdge([&](std::uint32_t, Edge edge) { linkEdge(edge); });
  counts.add("non_manifold_edges", wide_edges_.size());
  uniteFans();
  if (cutSharedEdges()) uniteFans();
  std::vector<std::uint32_t> vertex = vertexOfCorner();
  counts.add("split_non_manifold_vertices", copies_of_.size());
  mesh_.indices = std::move(vertex);
  for (const std::uint32_t old : copies_of_) {
    mesh_.positions.push_back(mesh_.positions[old]);
    if (!mesh_.normals.empty()) mesh_.normals.push_back(mesh_.normals[old]);
    if (!mesh_.colors.empty()) mesh_.colors.push_back(mesh_.colors[old]);
  }
}

// ---- 6. Vertices of no triangle
// -----------------------------------------------------------------------------------------

void dropUnreferenced(Mesh& mesh, RepairCounts& counts) {
  std::vector<std::uint32_t> number(mesh.positions.size(), kNone);
  for (const std::uint32_t index : mesh.indices) number[index] = 0;
  std::uint32_t kept = 0;
  for (std::size_t v = 0; v < number.size(); ++v) {
    if (number[v] == kNone) continue;
    mesh.positions[kept] = mesh.positions[v];
    if (!mesh.normals.empty()) mesh.normals[kept] = mesh.normals[v];
    if (!mesh.colors.empty()) mesh.colors[kept] = mesh.colors[v];
    number[v] = kept++;
  }
  if (kept == number.size()) return;
  counts.add("unreferenced_vertices", number.size() - kept);
  mesh.positions.resize(kept);
  if (!mesh.normals.empty()) mesh.normals.resize(kept);
  if (!mesh.colors.empty()) mesh.colors.resize(kept);
  for (std::uint32_t& index : mesh.indices) index = number[index];
}

void normaliseNormals(Mesh& mesh) {
  for (glm::vec3& n : mesh.normals) {
    const double length = glm::length(glm::dvec3(n));
    n = std::isfinite(length) && length > 0.0 ? glm::vec3(glm::dvec3(n) / length) : glm::vec3(0.0F);
  }
}

}  // namespace

void repairMesh(Mesh& mesh, double weld_distance, RepairCounts& counts) {
  LUMIGRID_CHECK_LE(mesh.positions.size(), kMaxVertices);
  LUMIGRID_CHECK_LE(mesh.triangleCount(), kMaxTriangles);
  normaliseNormals(mesh);
  if (weld_distance >= 0.0) {
    weld(mesh, weld_distance, counts);
    normaliseNormals(mesh);
  }
  dropTriangles(mesh, counts);

  // Turning a triangle renumbers its half-edges.
  auto edges = std::make_unique<EdgeTable>(mesh);
  if (alignWinding(mesh, *edges, counts)) edges = std::make_unique<EdgeTable>(mesh);
  Splitter(mesh, *edges).run(counts);
  edges.reset();
  dropUnreferenced(mesh, counts);
}

}  // namespace mesh
