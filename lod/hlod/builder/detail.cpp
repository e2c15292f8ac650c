#include "lod/hlod/builder/detail.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <unordered_map>
#include <utility>
#include <vector>

namespace lod::hlod::builder {
namespace {

constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();

glm::vec3 unit(const glm::vec3& v, const glm::vec3& otherwise) {
  const float length = glm::length(v);
  return length > 0.0F ? v / length : otherwise;
}

glm::u8vec3 colorOf(const glm::vec3& color) {
  return glm::u8vec3(glm::clamp(glm::round(color), 0.0F, 255.0F));
}

/// Collects points in the cells of a grid; those that face different ways stay apart, so that both sides of a thin wall
/// remain.
class PointClusters {
 public:
  explicit PointClusters(float cell) : cell_(cell) {}

  void add(const glm::vec3& place, const glm::vec3& normal, const glm::vec3& color) {
    const glm::ivec3 cell = glm::ivec3(glm::floor(place / cell_));
    const glm::vec3 size = glm::abs(normal);
    const int axis = size.x >= size.y && size.x >= size.z ? 0 : size.y >= size.z ? 1 : 2;
    const auto side = static_cast<std::uint64_t>(2 * axis + (normal[axis] < 0.0F ? 1 : 0));
    const auto part = [](int x) { return static_cast<std::uint64_t>(x) & 0xfffff; };
    const std::uint64_t key = part(cell.x) | part(cell.y) << 20 | part(cell.z) << 40 | side << 60;
    const auto [found, is_new] = numbers_.try_emplace(key, clusters_.size());
    if (is_new) clusters_.emplace_back();
    Cluster& cluster = clusters_[found->second];
    cluster.place += place, cluster.normal += normal, cluster.color += color;
    ++cluster.count;
    cluster.last_normal = normal;
  }

  template <class Place>
  std::vector<NodeVertex> points(const Place& placeOf) const {
    std::vector<NodeVertex> points;
    points.reserve(clusters_.size());
    for (const Cluster& c : clusters_) {
      const float share = 1.0F / static_cast<float>(c.count);
      points.push_back({placeOf(c.place * share), unit(c.normal, c.last_normal), colorOf(c.color * share)});
    }
    return points;
  }

 private:
  struct Cluster {
    glm::vec3 place{0.0F}, normal{0.0F}, color{0.0F}, last_normal{0.0F, 0.0F, 1.0F};
    std::uint32_t count = 0;
  };
  const float cell_;
  std::unordered_map<std::uint64_t, std::size_t> numbers_;
  std::vector<Cluster> clusters_;
};

class PictureMaker {
 public:
  PictureMaker(const NodeMesh& mesh, std::uint32_t step_bits, const PictureOptions& options)
      : mesh_(mesh), step_bits_(step_bits), options_(options), clusters_(options.cell) {}

  NodeGeometry run() {
    std::vector<std::uint8_t> is_small(mesh_.triangles(), 0);
    for (std::uint32_t t = 0; t < mesh_.triangles(); ++t) {
      is_small[t] = isSmall(t) ? 1 : 0;
      if (is_small[t] != 0)
        addPoints(t);
      else if (hasArea(t))
        for (std::size_t k = 0; k < 3; ++k) picture_.triangles.push_back(vertex(corner(t, k)));
      else
        flat_.push_back(t);
    }
    keepThinParts();
    if (options_.edges) addEdges(is_small);
    picture_.points = clusters_.points([this](const glm::vec3& place) { return placeOf(place); });
    return std::move(picture_);
  }

 private:
  void addEdges(const std::vector<std::uint8_t>& is_small) {
    for (const OpenEdge edge : openEdges(mesh_.indices)) {
      const glm::uvec2 ends = endsOf(edge, mesh_.indices);
      const bool is_crack = mesh_.on_rim[ends.x] == 0 || mesh_.on_rim[ends.y] == 0;
      if (!is_crack || is_small[edge / 3] != 0 || !hasArea(edge / 3)) continue;
      picture_.edges.push_back(vertex(ends.x));
      picture_.edges.push_back(vertex(ends.y));
    }
  }

  std::uint32_t corner(std::uint32_t t, std::size_t k) const { return mesh_.indices[3 * std::size_t{t} + k]; }
  glm::vec3 color(std::uint32_t v) const { return mesh_.colors.empty() ? glm::vec3(255.0F) : mesh_.colors[v]; }

  bool isSmall(std::uint32_t t) const {
    if (!(options_.triangle_reach > 0.0F)) return false;
    const auto& p = mesh_.positions;
    const glm::vec3 middle = (p[corner(t, 0)] + p[corner(t, 1)] + p[corner(t, 2)]) / 3.0F;
    for (std::size_t k = 0; k < 3; ++k)
      if (glm::distance(p[corner(t, k)], middle) > options_.triangle_reach) return false;
    return true;
  }

  /// Rounding flattens a thin triangle or turns it over. It is left out where a triangle beside it still has the
  /// edge that remains; otherwise, as in a wire, it stays, one step thick.
  void keepThinParts() {
    if (flat_.empty()) return;
    std::map<EdgePlaces, std::uint32_t> left;  // the edge that remains of each flat triangle
    for (const std::uint32_t t : flat_) {
      const std::uint32_t from = vertex(corner(t, 0));
      left.emplace(edgeBetween(from, farthestFrom(t, from)), t);
    }
    for (std::size_t i = 0; i < picture_.triangles.size(); ++i)
      left.erase(edgeBetween(picture_.triangles[i], picture_.triangles[i - i % 3 + (i + 1) % 3]));
    for (const auto& [edge, t] : left) addSliver(t);
  }
  /// The places of both ends, the lower one first.
  using EdgePlaces = std::array<std::array<int, 3>, 2>;
  EdgePlaces edgeBetween(std::uint32_t a, std::uint32_t b) const {
    const auto at = [&](std::uint32_t v) {
      const glm::ivec3& place = picture_.vertices[v].place;
      return std::array{place.x, place.y, place.z};
    };
    return {std::min(at(a), at(b)), std::max(at(a), at(b))};
  }
  void addSliver(std::uint32_t t) {
    std::uint32_t from = vertex(corner(t, 0)), to = farthestFrom(t, from);
    const glm::ivec3 a = picture_.vertices[from].place, b = picture_.vertices[to].place;
    if (a == b) return;
    const glm::ivec3 along = glm::abs(b - a);
    const int axis = along.x <= along.y && along.x <= along.z ? 0 : along.y <= along.z ? 1 : 2;
    NodeVertex beside = picture_.vertices[from];
    beside.place[axis] += beside.place[axis] > 0 ? -1 : 1;
    if (glm::dot(normalOf(a, b, beside.place), normalOf(t)) < 0.0) std::swap(from, to);
    picture_.triangles.insert(picture_.triangles.end(),
                              {from, to, static_cast<std::uint32_t>(picture_.vertices.size())});
    picture_.vertices.push_back(beside);
  }

  /// The corner, as a vertex of the picture, whose place is farther from that one.
  std::uint32_t farthestFrom(std::uint32_t t, std::uint32_t from) {
    const std::uint32_t one = vertex(corner(t, 1)), other = vertex(corner(t, 2));
    const auto distance = [&](std::uint32_t v) {
      return glm::distance(glm::dvec3(picture_.vertices[from].place), glm::dvec3(picture_.vertices[v].place));
    };
    return distance(one) >= distance(other) ? one : other;
  }

  glm::dvec3 normalOf(std::uint32_t t) const {
    const glm::dvec3 a(mesh_.positions[corner(t, 0)]);
    return glm::cross(glm::dvec3(mesh_.positions[corner(t, 1)]) - a, glm::dvec3(mesh_.positions[corner(t, 2)]) - a);
  }
  static glm::dvec3 normalOf(const glm::ivec3& a, const glm::ivec3& b, const glm::ivec3& c) {
    return glm::cross(glm::dvec3(b - a), glm::dvec3(c - a));
  }

  /// Whether the triangle faces after rounding as before: thin ones may be flat then, or turned over.
  bool hasArea(std::uint32_t t) const {
    const auto at = [&](std::size_t k) { return placeOf(mesh_.positions[corner(t, k)]); };
    if (at(0) == at(1) || at(1) == at(2) || at(2) == at(0)) return false;
    if (step_bits_ == 0) return true;
    return glm::dot(normalOf(at(0), at(1), at(2)), normalOf(t)) > 0.0;
  }

  void addPoints(std::uint32_t t) {
    for (std::size_t k = 0; k < 3; ++k) {
      const std::uint32_t a = corner(t, k), b = corner(t, (k + 1) % 3);
      const auto& p = mesh_.positions;
      const auto& n = mesh_.normals;
      clusters_.add(p[a], n[a], color(a));
      clusters_.add(0.5F * (p[a] + p[b]), unit(n[a] + n[b], n[a]), 0.5F * (color(a) + color(b)));
    }
  }

  glm::ivec3 placeOf(const glm::vec3& position) const {
    const double step = std::exp2(static_cast<double>(step_bits_));
    const glm::dvec3 place = (glm::dvec3(mesh_.corner) + glm::dvec3(position)) / step;
    return glm::ivec3(
        glm::clamp(glm::round(place), 0.0, static_cast<double>(kLatticeEnd >> step_bits_)));
  }
  std::uint32_t vertex(std::uint32_t v) {
    if (number_.empty()) number_.assign(mesh_.positions.size(), kNone);
    if (number_[v] == kNone) {
      number_[v] = static_cast<std::uint32_t>(picture_.vertices.size());
      picture_.vertices.push_back({placeOf(mesh_.positions[v]), mesh_.normals[v], colorOf(color(v))});
    }
    return number_[v];
  }

  const NodeMesh& mesh_;
  const std::uint32_t step_bits_;
  const PictureOptions options_;
  PointClusters clusters_;
  std::vector<std::uint32_t> flat_;    // triangles of which rounding leaves an edge
  std::vector<std::uint32_t> number_;  // by vertex of the mesh: that of the picture
  NodeGeometry picture_;
};

}  // namespace

void smoothDetail(NodeMesh& mesh, float size) {
  const std::size_t vertices = mesh.positions.size();
  std::vector<std::uint8_t> is_fine(vertices, 1);
  std::vector<std::uint32_t> count(vertices, 1);
  std::vector<glm::vec3> normals = mesh.normals;
  std::vector<glm::vec3> colors = mesh.colors;
  for (std::size_t i = 0; i < mesh.indices.size(); ++i) {
    const std::uint32_t a = mesh.indices[i], b = mesh.indices[i - i % 3 + (i + 1) % 3];
    const glm::vec3 along = mesh.positions[b] - mesh.positions[a];
    if (glm::dot(along, along) > size * size) is_fine[a] = is_fine[b] = 0;
    // Each inner edge comes once in either direction, so each neighbour is added twice.
    for (const auto& [to, from] : {std::pair(a, b), std::pair(b, a)}) {
      normals[to] += mesh.normals[from];
      if (!colors.empty()) colors[to] += mesh.colors[from];
      ++count[to];
    }
  }
  for (std::size_t v = 0; v < vertices; ++v) {
    if (is_fine[v] == 0) continue;
    mesh.normals[v] = unit(normals[v], mesh.normals[v]);
    if (!colors.empty()) mesh.colors[v] = colors[v] / static_cast<float>(count[v]);
  }
}

NodeGeometry makePicture(const NodeMesh& mesh, std::uint32_t step_bits, const PictureOptions& options) {
  return PictureMaker(mesh, step_bits, options).run();
}

}  // namespace lod::hlod::builder
