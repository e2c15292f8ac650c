#pragma once
// Drawn patches, and surfaces compared regardless of the order of triangles and vertices.
#include <algorithm>
#include <array>
#include <random>
#include <tuple>
#include <vector>

#include "lod/patch/codec.h"

namespace patch_testing {

using Corner = std::tuple<int, int, int, float, float, float, int, int, int, int>;
using Surface = std::vector<std::array<Corner, 3>>;

inline Corner corner(const lod::patch::PatchGeometry& g, std::uint16_t i) {
  const glm::ivec3& q = g.positions[i];
  const glm::vec3 n = lod::patch::quantizedNormal(g.normals[i]);
  const glm::ivec4 c = g.colors.empty() ? glm::ivec4(0) : glm::ivec4(lod::patch::quantizedColor(g.colors[i]));
  return {q.x, q.y, q.z, n.x, n.y, n.z, c.x, c.y, c.z, c.w};
}

/// Triangles as the least of their three rotations (orientation kept), sorted.
inline Surface surfaceOf(const lod::patch::PatchGeometry& g) {
  Surface surface;
  for (std::size_t t = 0; t + 2 < g.indices.size(); t += 3) {
    std::array<Corner, 3> triangle{corner(g, g.indices[t]), corner(g, g.indices[t + 1]), corner(g, g.indices[t + 2])};
    std::array<Corner, 3> first = triangle;
    for (int turn = 0; turn < 2; ++turn) {
      std::rotate(triangle.begin(), triangle.begin() + 1, triangle.end());
      first = std::min(first, triangle);
    }
    surface.push_back(first);
  }
  std::sort(surface.begin(), surface.end());
  return surface;
}

struct Shape {
  int vertices = 100;
  int triangles = 180;
  int extent = 5000;
  bool colors = false;
  glm::ivec3 origin{0};
};

/// Any triangles between any vertices, degenerate ones too.
inline lod::patch::PatchGeometry drawPatch(const Shape& shape, std::mt19937& random) {
  lod::patch::PatchGeometry g;
  std::uniform_int_distribution<int> along(0, shape.extent);
  std::normal_distribution<float> direction;
  std::uniform_int_distribution<int> byte(0, 255);
  for (int v = 0; v < shape.vertices; ++v) {
    g.positions.push_back(shape.origin + glm::ivec3(along(random), along(random), along(random)));
    g.normals.push_back(glm::normalize(glm::vec3(direction(random), direction(random), direction(random))));
    if (shape.colors) g.colors.push_back(glm::u8vec4(byte(random), byte(random), byte(random), 255));
  }
  std::uniform_int_distribution<int> vertex(0, shape.vertices - 1);
  for (int i = 0; i < 3 * shape.triangles; ++i) g.indices.push_back(static_cast<std::uint16_t>(vertex(random)));
  return g;
}

inline std::vector<Shape> shapes() {
  constexpr int kFar = lod::patch::kMaxLattice;
  return {{1, 1, 0},
          {3, 1, 10},
          {50, 200, 65535, true},
          {50, 200, 65536, true, glm::ivec3(-40000)},
          {700, 1300, 900, false, glm::ivec3(123456789, -987654321, 5)},
          {700, 1300, 200'000, false},
          {10, 20, 1'000'000'000, true, glm::ivec3(kFar - 1'000'000'000)},
          {10, 20, 1000, true, glm::ivec3(-kFar)},
          {65535, 65535, 4000, true}};
}

}  // namespace patch_testing
