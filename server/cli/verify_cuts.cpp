#include "server/cli/verify_cuts.h"

#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Core/System/omstream.hh>
#include <algorithm>
#include <array>
#include <cmath>
#include <glm/glm.hpp>
#include <nlohmann/json.hpp>
#include <optional>
#include <random>
#include <string>
#include <unordered_map>

#include "base/geometry.h"
#include "lod/ingest/nearest_points.h"
#include "lod/patch/traverse.h"

namespace server::cli {
namespace {

using lod::patch::Hierarchy;
using HalfEdgeMesh = OpenMesh::TriMesh_ArrayKernelT<>;
using Vertex = HalfEdgeMesh::VertexHandle;
using LatticePoint = std::array<std::int32_t, 3>;

struct LatticePointHash {
  std::size_t operator()(const LatticePoint& p) const {
    // Large odd multipliers spread neighbouring points over the table (Teschner et al. 2003, section 4.1).
    return static_cast<std::size_t>(p[0]) * 73856093U ^ static_cast<std::size_t>(p[1]) * 19349663U ^
           static_cast<std::size_t>(p[2]) * 83492791U;
  }
};

/// A directed edge that lacks an opposite one.
struct OpenEdge {
  LatticePoint from, to;
  float error = 0.0F;  ///< the largest stated error of the patches at its ends, scene units
};

/// A cut as a half-edge mesh. A half-edge mesh cannot hold a non-manifold vertex or edge; there, triangles get copies
/// of the vertices, and seams between copies are closed again when open edges are counted.
class CutSurface {
 public:
  void addPatch(const lod::patch::PatchGeometry& geometry, float error);
  CutTopology topology(std::vector<OpenEdge>& open_edges);

 private:
  void addTriangle(const std::array<LatticePoint, 3>& corners, float error);
  bool addFace(const std::array<Vertex, 3>& corners, float error);
  bool fits(const std::array<Vertex, 3>& corners) const;
  Vertex addCopy(const LatticePoint& point);
  float errorAt(const LatticePoint& point) const;
  std::vector<OpenEdge> boundary() const;
  std::uint64_t nonManifoldVertices() const;

  HalfEdgeMesh mesh_;
  std::unordered_map<LatticePoint, std::vector<Vertex>, LatticePointHash> copies_;
  std::vector<LatticePoint> points_;  // by vertex
  std::vector<float> errors_;         // by vertex: the largest of its faces'
};

void CutSurface::addPatch(const lod::patch::PatchGeometry& geometry, float error) {
  const auto point = [&](std::size_t corner) {
    const glm::ivec3& p = geometry.positions[geometry.indices[corner]];
    return LatticePoint{p.x, p.y, p.z};
  };
  for (std::size_t i = 0; i + 2 < geometry.indices.size(); i += 3)
    addTriangle({point(i), point(i + 1), point(i + 2)}, error);
}

void CutSurface::addTriangle(const std::array<LatticePoint, 3>& corners, float error) {
  std::array<std::vector<Vertex>, 3> candidates;
  for (std::size_t k = 0; k < 3; ++k) {
    if (copies_[corners[k]].empty()) addCopy(corners[k]);
    candidates[k] = copies_[corners[k]];
  }
  for (const Vertex a : candidates[0])
    for (const Vertex b : candidates[1])
      for (const Vertex c : candidates[2])
        if (addFace({a, b, c}, error)) return;

  // Copies of the vertices that cannot take the triangle: those inside a closed fan, and the ends of a full edge.
  std::array<Vertex, 3> v{candidates[0].back(), candidates[1].back(), candidates[2].back()};
  std::array<bool, 3> full{};
  for (std::size_t k = 0; k < 3; ++k) {
    const auto edge = mesh_.find_halfedge(v[k], v[(k + 1) % 3]);
    if (!mesh_.is_boundary(v[k])) full[k] = true;
    if (edge.is_valid() && !mesh_.is_boundary(edge)) full[k] = full[(k + 1) % 3] = true;
  }
  for (std::size_t k = 0; k < 3; ++k)
    if (full[k]) v[k] = addCopy(corners[k]);
  if (addFace(v, error)) return;
  for (std::size_t k = 0; k < 3; ++k) v[k] = addCopy(corners[k]);
  addFace(v, error);
}

bool CutSurface::addFace(const std::array<Vertex, 3>& corners, float error) {
  if (!fits(corners) || !mesh_.add_face(corners[0], corners[1], corners[2]).is_valid()) return false;
  for (const Vertex v : corners) {
    float& largest = errors_[static_cast<std::size_t>(v.idx())];
    largest = std::max(largest, error);
  }
  return true;
}

/// The conditions of OpenMesh's add_face, asked first because it prints where they do not hold.
bool CutSurface::fits(const std::array<Vertex, 3>& corners) const {
  for (std::size_t k = 0; k < 3; ++k) {
    if (!mesh_.is_boundary(corners[k])) return false;
    const auto edge = mesh_.find_halfedge(corners[k], corners[(k + 1) % 3]);
    if (edge.is_valid() && !mesh_.is_boundary(edge)) return false;
  }
  return true;
}

Vertex CutSurface::addCopy(const LatticePoint& point) {
  const Vertex vertex =
      mesh_.add_vertex({static_cast<float>(point[0]), static_cast<float>(point[1]), static_cast<float>(point[2])});
  copies_[point].push_back(vertex);
  points_.push_back(point);
  errors_.push_back(0.0F);
  return vertex;
}

float CutSurface::errorAt(const LatticePoint& point) const {
  float largest = 0.0F;
  for (const Vertex v : copies_.at(point)) largest = std::max(largest, errors_[static_cast<std::size_t>(v.idx())]);
  return largest;
}

/// The edge of each triangle that has no triangle on its other side, in the triangle's direction. The border may have
/// moved there with a triangle of a neighbouring patch that went, so that its error counts, too.
std::vector<OpenEdge> CutSurface::boundary() const {
  std::vector<OpenEdge> edges;
  for (const auto half_edge : mesh_.halfedges()) {
    if (!mesh_.is_boundary(half_edge)) continue;
    const auto inner = mesh_.opposite_halfedge_handle(half_edge);
    if (!mesh_.face_handle(inner).is_valid()) continue;
    const LatticePoint& from = points_[static_cast<std::size_t>(mesh_.from_vertex_handle(inner).idx())];
    const LatticePoint& to = points_[static_cast<std::size_t>(mesh_.to_vertex_handle(inner).idx())];
    edges.push_back({from, to, std::max(errorAt(from), errorAt(to))});
  }
  return edges;
}

std::uint64_t CutSurface::nonManifoldVertices() const {
  std::uint64_t count = 0;
  for (const auto& [point, vertices] : copies_) {
    std::size_t fans = 0;
    bool manifold = true;
    for (const Vertex v : vertices) {
      if (mesh_.is_isolated(v)) continue;
      ++fans;
      manifold = manifold && mesh_.is_manifold(v);
    }
    count += fans > 1 || !manifold ? 1 : 0;
  }
  return count;
}

/// Appends the open edges, and counts everything else.
CutTopology CutSurface::topology(std::vector<OpenEdge>& open_edges) {
  CutTopology found;
  found.triangles = mesh_.n_faces();
  found.non_manifold_vertices = nonManifoldVertices();

  // Boundary edges by their ends, whatever the direction. Opposite ones cancel: they are seams between copies. One that
  // is left is open; of several left in the same direction, neighbours are wound inconsistently.
  std::vector<OpenEdge> edges = boundary();
  const auto ends = [](const OpenEdge& e) { return std::minmax(e.from, e.to); };
  std::sort(edges.begin(), edges.end(), [&](const OpenEdge& a, const OpenEdge& b) {
    return ends(a) != ends(b) ? ends(a) < ends(b) : a.from < b.from;
  });
  for (std::size_t begin = 0, end = 0; begin < edges.size(); begin = end) {
    std::int64_t balance = 0;
    for (end = begin; end < edges.size() && ends(edges[end]) == ends(edges[begin]); ++end)
      balance += edges[end].from < edges[end].to ? 1 : -1;
    if (std::abs(balance) == 1)
      open_edges.push_back(balance == (edges[begin].from < edges[begin].to ? 1 : -1) ? edges[begin] : edges[end - 1]);
    if (std::abs(balance) > 1) found.inconsistent_edges += static_cast<std::uint64_t>(std::abs(balance)) - 1;
  }
  found.open_edges = open_edges.size();
  return found;
}

/// The source's border, to look up how far a point is from it.
class SourceBorder {
 public:
  SourceBorder(const std::vector<OpenEdge>& edges, const lod::Lattice& lattice);
  /// Whether the border is within `distance` of p, scene units.
  bool isNear(const glm::vec3& p, float distance) const;

 private:
  struct Segment {
    glm::vec3 a, b;
  };
  std::vector<Segment> segments_;  // the edges, cut up where they are much longer than others
  float half_length_ = 0.0F;       // the longest segment's
  std::optional<lod::ingest::NearestPoints> middles_;
};

SourceBorder::SourceBorder(const std::vector<OpenEdge>& edges, const lod::Lattice& lattice) {
  const auto position = [&](const LatticePoint& p) { return lattice.position({p[0], p[1], p[2]}); };
  double whole = 0.0;
  for (const OpenEdge& e : edges) whole += glm::length(position(e.to) - position(e.from));
  const auto longest = static_cast<float>(2.0 * whole / static_cast<double>(std::max<std::size_t>(edges.size(), 1)));
  half_length_ = 0.5F * longest;
  for (const OpenEdge& e : edges) {
    const glm::vec3 from = position(e.from), step = position(e.to) - from;
    const float pieces = longest > 0.0F ? std::max(1.0F, std::ceil(glm::length(step) / longest)) : 1.0F;
    for (float i = 0.0F; i < pieces; i += 1.0F)
      segments_.push_back({from + step * (i / pieces), from + step * ((i + 1.0F) / pieces)});
  }
  std::vector<glm::vec3> middles;
  middles.reserve(segments_.size());
  for (const Segment& s : segments_) middles.push_back(0.5F * (s.a + s.b));
  middles_.emplace(middles);
}

bool SourceBorder::isNear(const glm::vec3& p, float distance) const {
  constexpr float kRounding = 1.0001F;  // of lengths in float
  const float reach = kRounding * (distance + half_length_);
  bool near = false;
  middles_->visitWithin(p, reach * reach, [&](std::uint32_t i, float) {
    const auto& [a, b] = segments_[i];
    const glm::dvec3 closest = base::closestPointOnTriangle(glm::dvec3(p), glm::dvec3(a), glm::dvec3(b), glm::dvec3(b));
    near = near || glm::length(closest - glm::dvec3(p)) <= static_cast<double>(distance);
    return near ? -1.0F : reach * reach;
  });
  return near;
}

/// A random set of groups that holds with each group its parents. As many groups as a draw from 1, 2, 4 … says are
/// taken at random and completed by their ancestors; so cuts are anything from nearly the root to nearly the leaves.
std::vector<std::uint8_t> randomExpansion(const Hierarchy& hierarchy, std::mt19937_64& random) {
  const std::size_t groups = hierarchy.groups.size();
  std::vector<std::uint8_t> expanded(groups, 0);
  std::uint64_t draws = 1;
  for (std::uint64_t power = random() % (static_cast<std::uint64_t>(std::log2(static_cast<double>(groups))) + 1);
       power > 0; --power)
    draws *= 2;
  for (std::uint64_t i = 0; i < draws; ++i) expanded[random() % groups] = 1;
  expanded[0] = 1;
  // Parents have smaller numbers, so one pass reaches all ancestors.
  for (std::size_t g = groups; g-- > 1;)
    if (expanded[g] != 0)
      for (const std::uint32_t parent : hierarchy.parentsOf(static_cast<std::uint32_t>(g))) expanded[parent] = 1;
  return expanded;
}

lod::patch::Cut cutOfLeaves(const Hierarchy& hierarchy) {
  return lod::patch::cutOfExpanded(hierarchy, std::vector<std::uint8_t>(hierarchy.groups.size(), 1));
}

base::Result<CutTopology> topologyOf(const lod::patch::PatchFile& file, const lod::patch::Cut& cut,
                                     std::vector<OpenEdge>& open_edges) {
  const Hierarchy& hierarchy = file.hierarchy();
  CutSurface surface;
  for (const std::uint32_t patch : cut.patches) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto geometry, file.geometry(patch));
    const std::uint32_t producer = hierarchy.patches[patch].producer;
    surface.addPatch(geometry, producer == lod::patch::kNoGroup ? 0.0F : hierarchy.groups[producer].error);
  }
  return surface.topology(open_edges);
}

/// The surface's stated error does not bound how far the border moves along itself, e.g. at the tip of a slit narrower
/// than the error. A choice: no open edge of 20 cuts of machangara was farther from it than the error itself.
constexpr float kBorderReach = 1.5F;

/// Two borders that run alike may come to lie on each other, which looks like neighbours of opposite orientation and is
/// none: in machangara's cuts once in 1500 open edges or less. A part that is turned over has such edges all around.
constexpr std::uint64_t kOpenEdgesPerMeeting = 500;

/// The largest stated error of the groups in the cut that reach to p.
float largestErrorAt(const glm::vec3& p, const Hierarchy& hierarchy, const lod::patch::Cut& cut) {
  float largest = 0.0F;
  for (const std::uint32_t patch : cut.patches) {
    const std::uint32_t producer = hierarchy.patches[patch].producer;
    if (producer == lod::patch::kNoGroup) continue;
    const lod::patch::Group& group = hierarchy.groups[producer];
    if (glm::distance(group.bounds.center, p) <= group.bounds.radius) largest = std::max(largest, group.error);
  }
  return largest;
}

/// The number of open edges that do not run along the source's border.
std::size_t strayEdges(const std::vector<OpenEdge>& open_edges, const SourceBorder& border, const Hierarchy& hierarchy,
                       const lod::patch::Cut& cut) {
  const auto rounding = static_cast<float>(2.0 * hierarchy.lattice.positionError());  // the error of both surfaces
  return static_cast<std::size_t>(std::count_if(open_edges.begin(), open_edges.end(), [&](const OpenEdge& e) {
    const glm::vec3 a = hierarchy.lattice.position({e.from[0], e.from[1], e.from[2]});
    const glm::vec3 b = hierarchy.lattice.position({e.to[0], e.to[1], e.to[2]});
    const glm::vec3 middle = 0.5F * (a + b);
    const auto isNear = [&](float error) {
      const float reach = kBorderReach * (error + rounding);
      return border.isNear(a, reach) && border.isNear(b, reach) && border.isNear(middle, reach);
    };
    // The border also moves where another group's triangle went whose every other edge was open.
    return !isNear(e.error) && !isNear(largestErrorAt(middle, hierarchy, cut));
  }));
}

}  // namespace

base::Result<CutReport> verifyCuts(const lod::patch::PatchFile& patches, std::uint32_t count, std::uint64_t seed,
                                   const VerifyProgress& progress) {
  omerr().disable();  // add_face prints where it refuses a triangle; CutSurface::addTriangle deals with that
  const Hierarchy& hierarchy = patches.hierarchy();
  CutReport report;
  report.seed = seed;
  std::vector<OpenEdge> source_edges;
  LUMIGRID_ASSIGN_OR_RETURN(report.source, topologyOf(patches, cutOfLeaves(hierarchy), source_edges));
  const SourceBorder border(source_edges, hierarchy.lattice);

  std::mt19937_64 random(seed);
  for (std::uint32_t i = 0; i < count; ++i) {
    if (progress && !progress(static_cast<double>(i) / count))
      return base::Error{base::ErrorCode::kCancelled, "stopped before all cuts were checked"};
    std::vector<OpenEdge> open_edges;
    const lod::patch::Cut cut = lod::patch::cutOfExpanded(hierarchy, randomExpansion(hierarchy, random));
    LUMIGRID_ASSIGN_OR_RETURN(const auto found, topologyOf(patches, cut, open_edges));
    report.cuts.push_back(found);

    const std::string name = patches.path() + ": cut " + std::to_string(i + 1) + " of seed " + std::to_string(seed);
    if (const std::size_t stray = strayEdges(open_edges, border, hierarchy, cut); stray > 0)
      report.faults.push_back(name + ": " + std::to_string(stray) + " open edges away from the source's border");
    else if (found.open_edges > report.source.open_edges)
      report.faults.push_back(name + ": " + std::to_string(found.open_edges) + " open edges, the source has " +
                              std::to_string(report.source.open_edges));
    if (found.inconsistent_edges > report.source.inconsistent_edges + found.open_edges / kOpenEdgesPerMeeting)
      report.faults.push_back(name + ": " + std::to_string(found.inconsistent_edges) +
                              " edges between triangles of opposite orientation, the source has " +
                              std::to_string(report.source.inconsistent_edges));
  }
  return report;
}

std::string cutsAsText(const CutReport& report) {
  const auto line = [](const std::string& name, const CutTopology& t) {
    return name + ": " + std::to_string(t.triangles) + " triangles, " + std::to_string(t.open_edges) + " open edges, " +
           std::to_string(t.non_manifold_vertices) + " non-manifold vertices, " + std::to_string(t.inconsistent_edges) +
           " edges between triangles of opposite orientation\n";
  };
  std::string text = line("source", report.source);
  for (std::size_t i = 0; i < report.cuts.size(); ++i) text += line("cut " + std::to_string(i + 1), report.cuts[i]);
  return text;
}

NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(CutTopology, triangles, open_edges, non_manifold_vertices, inconsistent_edges)

nlohmann::json cutsAsJson(const CutReport& report) {
  return {{"seed", report.seed}, {"source", report.source}, {"cuts", report.cuts}};
}

}  // namespace server::cli
