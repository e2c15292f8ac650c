#include "lod/hlod/builder/cracks.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <unordered_map>
#include <utility>

namespace lod::hlod::builder {
namespace {

/// Vertices that lie on an edge, in its direction.
struct Inserts {
  std::array<std::vector<std::uint32_t>, 3> on;  // by the corner at which the edge begins
  bool empty() const { return on[0].empty() && on[1].empty() && on[2].empty(); }
};

/// Finds vertices near a segment by a grid.
class VertexGrid {
 public:
  VertexGrid(const std::vector<glm::vec3>& positions, std::span<const std::uint32_t> vertices, float cell)
      : cell_(cell) {
    for (const std::uint32_t v : vertices) cells_[keyOf(cellOf(positions[v]))].push_back(v);
  }
  /// Visits vertices near the segment, maybe more than once. It is walked along piece by piece, so that a long one does
  /// not visit all cells of its box.
  template <class Visit>
  void near(const glm::vec3& a, const glm::vec3& b, float reach, const Visit& visit) const {
    const int pieces = std::max(1, static_cast<int>(std::min(glm::distance(a, b) / cell_, kMostPieces)));
    for (int i = 0; i < pieces; ++i) {
      const auto at = [&](int piece) { return a + static_cast<float>(piece) / static_cast<float>(pieces) * (b - a); };
      nearPiece(at(i), at(i + 1), reach, visit);
    }
  }

 private:
  /// A segment of more pieces has longer ones. A choice: by far more than a scan's own edges need.
  static constexpr float kMostPieces = 10'000.0F;

  template <class Visit>
  void nearPiece(const glm::vec3& a, const glm::vec3& b, float reach, const Visit& visit) const {
    const glm::ivec3 low = cellOf(glm::min(a, b) - reach), high = cellOf(glm::max(a, b) + reach);
    const glm::vec3 size(high - low + 1);
    // Nothing lies in most cells of a large box.
    if (size.x * size.y * size.z > static_cast<float>(cells_.size())) {
      for (const auto& [key, vertices] : cells_)
        for (const std::uint32_t v : vertices) visit(v);
      return;
    }
    for (int z = low.z; z <= high.z; ++z)
      for (int y = low.y; y <= high.y; ++y)
        for (int x = low.x; x <= high.x; ++x)
          if (const auto found = cells_.find(keyOf({x, y, z})); found != cells_.end())
            for (const std::uint32_t v : found->second) visit(v);
  }

  glm::ivec3 cellOf(const glm::vec3& p) const { return glm::ivec3(glm::floor(p / cell_)); }
  static std::uint64_t keyOf(const glm::ivec3& c) {
    const auto part = [](int x) { return static_cast<std::uint64_t>(x + (1 << 20)) & 0x1fffff; };
    return part(c.x) | part(c.y) << 21 | part(c.z) << 42;
  }
  const float cell_;
  std::unordered_map<std::uint64_t, std::vector<std::uint32_t>> cells_;
};

class CrackCloser {
 public:
  CrackCloser(NodeMesh& mesh, std::span<const std::uint64_t> parts, float reach)
      : mesh_(mesh), parts_(parts), reach_(reach) {}

  std::size_t run() {
    const auto open = openEdges(mesh_.indices);
    findInserts(open);
    if (inserts_.empty()) return 0;
    const std::size_t triangles = mesh_.triangles();
    mesh_.errors.resize(triangles, mesh_.error);
    for (const auto& [t, inserts] : inserts_) splitTriangle(t, inserts);
    // Each triangle that was split is the first of its pieces; the others follow behind all triangles.
    mesh_.indices.insert(mesh_.indices.end(), added_.begin(), added_.end());
    mesh_.errors.insert(mesh_.errors.end(), added_errors_.begin(), added_errors_.end());
    mesh_.error = *std::max_element(mesh_.errors.begin(), mesh_.errors.end());
    if (!mesh_.bounds.toward.empty()) {
      mesh_.bounds.toward.resize(triangles);
      mesh_.bounds.toward.insert(mesh_.bounds.toward.end(), added_toward_.begin(), added_toward_.end());
      mesh_.bounds.from.insert(mesh_.bounds.from.end(), added_from_.begin(), added_from_.end());
    }
    return put_in_;
  }

 private:
  const glm::vec3& at(std::uint32_t v) const { return mesh_.positions[v]; }

  void findInserts(const std::vector<OpenEdge>& open) {
    std::vector<std::uint32_t> vertices;
    double length = 0.0;
    for (const OpenEdge edge : open) {
      const glm::uvec2 ends = endsOf(edge, mesh_.indices);
      vertices.push_back(ends.x), vertices.push_back(ends.y);
      length += static_cast<double>(glm::distance(at(ends.x), at(ends.y)));
    }
    if (open.empty()) return;
    std::sort(vertices.begin(), vertices.end());
    vertices.erase(std::unique(vertices.begin(), vertices.end()), vertices.end());
    const float mean = static_cast<float>(length / static_cast<double>(open.size()));
    const VertexGrid grid(mesh_.positions, vertices, std::max(mean, 2.0F * reach_));
    for (const OpenEdge edge : open) findInserts(edge, grid);
    std::sort(inserts_.begin(), inserts_.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
    // The edges of one triangle.
    std::size_t kept = 0;
    for (std::size_t i = 0; i < inserts_.size(); ++i) {
      if (kept > 0 && inserts_[kept - 1].first == inserts_[i].first) {
        for (std::size_t k = 0; k < 3; ++k)
          if (!inserts_[i].second.on[k].empty()) inserts_[kept - 1].second.on[k] = std::move(inserts_[i].second.on[k]);
      } else if (kept++ != i) {
        inserts_[kept - 1] = std::move(inserts_[i]);
      }
    }
    inserts_.resize(kept);
  }

  void findInserts(OpenEdge edge, const VertexGrid& grid) {
    const std::uint32_t t = edge / 3;
    const glm::uvec2 ends = endsOf(edge, mesh_.indices);
    const std::uint32_t across = mesh_.indices[3 * std::size_t{t} + (edge - 3 * t + 2) % 3];
    const std::uint64_t own = parts_[ends.x] & parts_[ends.y] & parts_[across];
    const glm::vec3 along = at(ends.y) - at(ends.x);
    const float length2 = glm::dot(along, along);
    std::vector<std::pair<float, std::uint32_t>> found;
    grid.near(at(ends.x), at(ends.y), reach_, [&](std::uint32_t v) {
      if ((parts_[v] & own) != 0 || v == ends.x || v == ends.y || v == across) return;
      const glm::vec3 to = at(v) - at(ends.x);
      const float share = glm::dot(to, along) / length2;
      if (!(share > 0.0F && share < 1.0F)) return;
      const glm::vec3 off = to - share * along;
      if (glm::dot(off, off) <= reach_ * reach_) found.emplace_back(share, v);
    });
    if (found.empty()) return;
    std::sort(found.begin(), found.end());
    found.erase(std::unique(found.begin(), found.end()), found.end());
    Inserts inserts;
    for (const auto& [share, v] : found) inserts.on[edge - 3 * t].push_back(v);
    inserts_.emplace_back(t, std::move(inserts));
  }

  void splitTriangle(std::uint32_t t, const Inserts& inserts) {
    const std::array<std::uint32_t, 3> corners{mesh_.indices[3 * std::size_t{t}], mesh_.indices[3 * std::size_t{t} + 1],
                                               mesh_.indices[3 * std::size_t{t} + 2]};
    pieces_.clear();
    normal_ = glm::cross(at(corners[1]) - at(corners[0]), at(corners[2]) - at(corners[0]));
    moved_ = 0.0F;
    split(corners, inserts);
    const bool bounded = !mesh_.bounds.toward.empty();
    mesh_.errors[t] += moved_;
    for (std::size_t i = 0; i < pieces_.size(); ++i) {
      if (i == 0) {
        std::copy(pieces_[0].begin(), pieces_[0].end(), mesh_.indices.begin() + 3 * static_cast<std::ptrdiff_t>(t));
      } else {
        added_.insert(added_.end(), pieces_[i].begin(), pieces_[i].end());
        added_errors_.push_back(mesh_.errors[t]);
      }
      if (!bounded || i == 0) continue;
      added_toward_.push_back(mesh_.bounds.toward[t] + moved_);
      added_from_.push_back(mesh_.bounds.from[t] + moved_);
    }
    if (!bounded) return;
    mesh_.bounds.toward[t] += moved_;
    mesh_.bounds.from[t] += moved_;
  }

  bool isOnSide(std::uint32_t a, std::uint32_t b, std::uint32_t c) const {
    return glm::dot(glm::cross(at(b) - at(a), at(c) - at(a)), normal_) > 0.0F;
  }

  /// Cuts the triangle at the vertices on its edges, one edge after the other. A vertex that would turn a part over is
  /// left out.
  void split(std::array<std::uint32_t, 3> corners, Inserts inserts) {
    const std::size_t k = inserts.on[0].empty() ? inserts.on[1].empty() ? 2 : 1 : 0;
    const std::vector<std::uint32_t> on = std::move(inserts.on[k]);
    inserts.on[k].clear();
    if (on.empty()) return pieces_.push_back(corners);
    std::uint32_t a = corners[k];
    const std::uint32_t b = corners[(k + 1) % 3], c = corners[(k + 2) % 3];
    // Each vertex cuts a part off; the edge c a belongs to the first part, b c to the last.
    Inserts first;
    first.on[2] = std::move(inserts.on[(k + 2) % 3]);
    for (const std::uint32_t v : on) {
      if (!isOnSide(a, v, c) || !isOnSide(v, b, c)) continue;
      const glm::vec3 along = at(b) - at(a), to = at(v) - at(a);
      moved_ = std::max(moved_, glm::length(to - glm::dot(to, along) / glm::dot(along, along) * along));
      ++put_in_;
      split({a, v, c}, std::exchange(first, {}));
      a = v;
    }
    Inserts last = std::move(first);
    last.on[1] = std::move(inserts.on[(k + 1) % 3]);
    split({a, b, c}, std::move(last));
  }

  NodeMesh& mesh_;
  const std::span<const std::uint64_t> parts_;
  const float reach_;
  std::vector<std::pair<std::uint32_t, Inserts>> inserts_;  // by triangle
  std::vector<std::uint32_t> added_;
  std::vector<float> added_toward_, added_from_, added_errors_;
  std::size_t put_in_ = 0;
  // These belong to the triangle that is split.
  std::vector<std::array<std::uint32_t, 3>> pieces_;
  glm::vec3 normal_{0.0F};
  float moved_ = 0.0F;
};

}  // namespace

std::size_t closeCracks(NodeMesh& mesh, std::span<const std::uint64_t> parts, float reach) {
  return reach > 0.0F ? CrackCloser(mesh, parts, reach).run() : 0;
}

}  // namespace lod::hlod::builder
