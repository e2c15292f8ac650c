#pragma once
// Draws random patches, and compares surfaces regardless of the order of triangles and vertices.
#include <algorithm>
#include <array>
#include <random>
#include <tuple>
#include <vector>

#include "lod/patch/codec.h"
#include "tests/support/quantized_normal.h"

namespace patch_testing {

using Corner = std::tuple<int, int, int, float, float, float, int, int, int, int>;
using Surface = std::vector<std::array<Corner, 3>>;

inline Corner corner(const lod::patch::PatchGeometry& g, std::uint16_t i) {
  const glm::ivec3& q = g.positions[i];
  const glm::vec3 n = support::quantizedNormal(g.normals[i]);
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

/// Draws any triangles between any vertices, degenerate ones too.
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

/// A grid with holes of every shape, edges of many triangles and pieces that hang by a corner: every step that the
/// writer of connectivity knows.
inline lod::patch::PatchGeometry tornGrid() {
  constexpr int kSide = 24;
  std::mt19937 random(17);
  lod::patch::PatchGeometry g;
  for (int y = 0; y < kSide; ++y)
    for (int x = 0; x < kSide; ++x) {
      g.positions.emplace_back(10 * x, 10 * y, static_cast<int>(random() % 9));
      g.normals.emplace_back(0.0F, 0.0F, 1.0F);
    }
  const auto add = [&](int a, int b, int c) {
    for (const int v : {a, b, c}) g.indices.push_back(static_cast<std::uint16_t>(v));
  };
  for (int y = 0; y + 1 < kSide; ++y)
    for (int x = 0; x + 1 < kSide; ++x) {
      const int v = y * kSide + x;
      if (random() % 8 != 0) add(v, v + 1, v + kSide + 1);
      if (random() % 8 != 0) add(v, v + kSide + 1, v + kSide);
    }
  constexpr std::uint32_t kVertices = kSide * kSide;
  for (int i = 0; i < 30; ++i)
    add(static_cast<int>(random() % kVertices), static_cast<int>(random() % kVertices),
        static_cast<int>(random() % kVertices));
  // Pieces with new and known corners in every order.
  for (int i = 0; i < 24; ++i) {
    std::array<int, 3> corners{};
    for (int k = 0; k < 3; ++k) {
      const bool is_new = (i >> k & 1) != 0;
      corners[static_cast<std::size_t>(k)] = static_cast<int>(is_new ? g.positions.size() : random() % kVertices);
      if (!is_new) continue;
      g.positions.emplace_back(10 * i, -20, 5 * k);
      g.normals.emplace_back(0.0F, 0.0F, 1.0F);
    }
    add(corners[0], corners[1], corners[2]);
  }
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
