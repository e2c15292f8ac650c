#include "lod/hlod/builder/detail.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <utility>
#include <vector>

#include "lod/hlod/builder/point_clusters.h"

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

class PictureMaker {
 public:
  PictureMaker(const NodeMesh& mesh, std::uint32_t step_bits, const PictureOptions& options)
      : mesh_(mesh), step_bits_(step_bits), options_(options), clusters_(options.cell) {
    places_.reserve(mesh.positions.size());
    for (const glm::vec3& position : mesh.positions) places_.push_back(placeOf(position));
  }

  Picture run() {
    for (const MeshPoint& point : mesh_.points) clusters_.add(point, mesh_.points_error);
    std::vector<std::uint8_t> is_small(mesh_.triangles(), 0);
    for (std::uint32_t t = 0; t < mesh_.triangles(); ++t) {
      is_small[t] = isSmall(t) ? 1 : 0;
      if (is_small[t] != 0)
        visitSamples(mesh_, t, [&](const MeshPoint& point) { clusters_.add(point, mesh_.errorOf(t)); });
      else if (hasArea(t))
        for (std::size_t k = 0; k < 3; ++k) picture_.triangles.push_back(vertex(corner(t, k)));
      else
        flat_.push_back(t);
    }
    keepThinParts();
    if (options_.edges) addEdges(is_small);
    for (const MeshPoint& point : clusters_.points())
      picture_.points.push_back({placeOf(point.position), point.normal, colorOf(point.color)});
    picture_.points_error = clusters_.error();
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
    if (!(options_.triangle_reach > 0.0F) || mesh_.errorOf(t) > options_.room) return false;
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
    double beside2 = 0.0;
    for (const std::uint32_t t : flat_) {
      const std::array<std::uint32_t, 3> corners = longestFirst(t);
      left.emplace(edgeBetween(corners[0], corners[1]), t);
      beside2 = std::max(beside2, distance2(corners[2], corners[0], corners[1]));
    }
    for (std::size_t i = 0; i < picture_.triangles.size(); ++i)
      left.erase(edgeBetween(picture_.triangles[i], picture_.triangles[i - i % 3 + (i + 1) % 3]));
    for (const auto& [edge, t] : left) addSliver(t);
    const double beside = std::max(std::sqrt(beside2), left.empty() ? 0.0 : 1.0);
    picture_.flattened = static_cast<float>(std::ldexp(beside, static_cast<int>(step_bits_)));
  }
  /// The square of the vertex' distance from the edge, in steps.
  double distance2(std::uint32_t v, std::uint32_t from, std::uint32_t to) const {
    const auto at = [&](std::uint32_t of) { return glm::dvec3(picture_.vertices[of].place); };
    const glm::dvec3 along = at(to) - at(from), off = at(v) - at(from);
    const double length2 = glm::dot(along, along);
    const double share = length2 > 0.0 ? std::clamp(glm::dot(off, along) / length2, 0.0, 1.0) : 0.0;
    const glm::dvec3 beside = off - share * along;
    return glm::dot(beside, beside);
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
    const std::array<std::uint32_t, 3> corners = longestFirst(t);
    std::uint32_t from = corners[0], to = corners[1];
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

  /// The triangle's corners as vertices of the picture, in their winding: its longest edge leads from the first to the
  /// second.
  std::array<std::uint32_t, 3> longestFirst(std::uint32_t t) {
    const std::array<std::uint32_t, 3> corners{vertex(corner(t, 0)), vertex(corner(t, 1)), vertex(corner(t, 2))};
    const auto length = [&](std::size_t k) {
      return glm::distance(glm::dvec3(picture_.vertices[corners[k]].place),
                           glm::dvec3(picture_.vertices[corners[(k + 1) % 3]].place));
    };
    std::size_t longest = 0;
    for (std::size_t k = 1; k < 3; ++k)
      if (length(k) > length(longest)) longest = k;
    return {corners[longest], corners[(longest + 1) % 3], corners[(longest + 2) % 3]};
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
    const glm::ivec3 &a = places_[corner(t, 0)], &b = places_[corner(t, 1)], &c = places_[corner(t, 2)];
    if (a == b || b == c || c == a) return false;
    return step_bits_ == 0 || glm::dot(normalOf(a, b, c), normalOf(t)) > 0.0;
  }

  glm::ivec3 placeOf(const glm::vec3& position) const {
    // Both are exact: the step is a power of two, and no place is below 0 when it is cut off to a whole number.
    const double share = 1.0 / static_cast<double>(1U << step_bits_);
    const glm::dvec3 place = (glm::dvec3(mesh_.corner) + glm::dvec3(position)) * share;
    return glm::ivec3(glm::clamp(place, 0.0, static_cast<double>(kLatticeEnd >> step_bits_)) + 0.5);
  }
  std::uint32_t vertex(std::uint32_t v) {
    if (number_.empty()) number_.assign(mesh_.positions.size(), kNone);
    if (number_[v] == kNone) {
      number_[v] = static_cast<std::uint32_t>(picture_.vertices.size());
      picture_.vertices.push_back({places_[v], mesh_.normals[v], colorOf(color(v))});
    }
    return number_[v];
  }

  const NodeMesh& mesh_;
  const std::uint32_t step_bits_;
  const PictureOptions options_;
  PointClusters clusters_;
  std::vector<glm::ivec3> places_;     // by vertex of the mesh, rounded
  std::vector<std::uint32_t> flat_;    // triangles of which rounding leaves an edge
  std::vector<std::uint32_t> number_;  // by vertex of the mesh: that of the picture
  Picture picture_;
};

}  // namespace

float smoothDetail(NodeMesh& mesh, float size, const AppearanceOptions& appearance) {
  const std::size_t vertices = mesh.positions.size();
  std::vector<float> longest2(vertices, 0.0F);  // of the edges around each vertex
  std::vector<std::uint32_t> count(vertices, 1);
  std::vector<glm::vec3> normals = mesh.normals;
  std::vector<glm::vec3> colors = mesh.colors;
  for (std::size_t i = 0; i < mesh.indices.size(); ++i) {
    const std::uint32_t a = mesh.indices[i], b = mesh.indices[i - i % 3 + (i + 1) % 3];
    const glm::vec3 along = mesh.positions[b] - mesh.positions[a];
    const float length2 = glm::dot(along, along);
    // Each inner edge comes once in either direction, so each neighbour is added twice.
    for (const auto& [to, from] : {std::pair(a, b), std::pair(b, a)}) {
      longest2[to] = std::max(longest2[to], length2);
      normals[to] += mesh.normals[from];
      if (!colors.empty()) colors[to] += mesh.colors[from];
      ++count[to];
    }
  }
  float moved2 = 0.0F;
  for (std::size_t v = 0; v < vertices; ++v) {
    if (longest2[v] > size * size) continue;
    const glm::vec3 normal = unit(normals[v], mesh.normals[v]);
    bool is_seen = appearance.normals && angleBetween(normal, mesh.normals[v]) > appearance.negligible_turn;
    mesh.normals[v] = normal;
    if (!colors.empty()) {
      const glm::vec3 color = colors[v] / static_cast<float>(count[v]);
      is_seen |= appearance.colors && glm::distance(color, mesh.colors[v]) > appearance.negligible_color;
      mesh.colors[v] = color;
    }
    if (is_seen) moved2 = std::max(moved2, longest2[v]);
  }
  return 0.5F * std::sqrt(moved2);
}

Picture makePicture(const NodeMesh& mesh, std::uint32_t step_bits, const PictureOptions& options) {
  return PictureMaker(mesh, step_bits, options).run();
}

}  // namespace lod::hlod::builder
