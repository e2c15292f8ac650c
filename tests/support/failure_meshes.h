#pragma once
// Meshes on which methods fail, each for one reason.
#include <cmath>
#include <random>
#include <vector>

#include "tests/support/test_meshes.h"

namespace support {

/// Colours that vary smoothly with the place, so that any surface has something to show.
inline glm::u8vec4 colorAt(const glm::vec3& p) {
  const glm::vec3 waves =
      0.5F + 0.5F * glm::sin(glm::vec3(5.0F * p.x + 2.0F * p.z, 6.0F * p.y, 4.0F * p.z + 3.0F * p.x));
  return {glm::u8vec3(40.0F + 200.0F * waves), 255};
}

/// Gives every vertex without a colour that of its place.
inline void colorByPlace(Mesh& mesh) {
  for (std::size_t i = mesh.colors.size(); i < mesh.positions.size(); ++i)
    mesh.colors.push_back(colorAt(mesh.positions[i]));
}

/// Adds a part. Either both have colours or neither.
inline void append(Mesh& mesh, const Mesh& part) {
  const auto first = static_cast<std::uint32_t>(mesh.positions.size());
  mesh.positions.insert(mesh.positions.end(), part.positions.begin(), part.positions.end());
  mesh.colors.insert(mesh.colors.end(), part.colors.begin(), part.colors.end());
  for (const std::uint32_t i : part.indices) mesh.indices.push_back(first + i);
}

/// Returns a closed box with 2 n² triangles on each side.
inline Mesh box(const glm::vec3& low, const glm::vec3& high, std::uint32_t n) {
  Mesh mesh;
  for (int axis = 0; axis < 3; ++axis)
    for (const bool upper : {false, true}) {
      Mesh side;
      for (std::uint32_t v = 0; v <= n; ++v)
        for (std::uint32_t u = 0; u <= n; ++u) {
          glm::vec3 share(0.0F);
          share[axis] = upper ? 1.0F : 0.0F;
          share[(axis + 1) % 3] = static_cast<float>(u) / static_cast<float>(n);
          share[(axis + 2) % 3] = static_cast<float>(v) / static_cast<float>(n);
          side.positions.push_back(low + share * (high - low));
        }
      for (std::uint32_t v = 0; v < n; ++v)
        for (std::uint32_t u = 0; u < n; ++u) {
          const std::uint32_t a = v * (n + 1) + u, b = a + 1, c = a + n + 2, d = a + n + 1;
          if (upper)
            addTriangle(side, a, b, c), addTriangle(side, a, c, d);
          else
            addTriangle(side, a, c, b), addTriangle(side, a, d, c);
        }
      append(mesh, side);
    }
  return mesh;
}

/// Returns a wire bent to a closed ring.
inline Mesh wire(float radius, float thickness, const glm::vec3& tilt) {
  constexpr std::uint32_t kAround = 400, kAcross = 8;
  Mesh mesh = torus(kAround, kAcross);
  mesh.colors.clear();
  for (std::uint32_t i = 0; i < kAround; ++i)
    for (std::uint32_t j = 0; j < kAcross; ++j) {
      const float u = 6.2831853F * static_cast<float>(i) / kAround, v = 6.2831853F * static_cast<float>(j) / kAcross;
      const glm::vec3 out(std::cos(u), std::sin(u), tilt.x * std::cos(u) + tilt.y * std::sin(u));
      mesh.positions[i * kAcross + j] =
          out * (radius + thickness * std::cos(v)) + glm::vec3(0, 0, thickness * std::sin(v));
    }
  return mesh;
}

/// Returns four wires, one within the other.
inline Mesh wires() {
  Mesh mesh;
  for (const float radius : {0.4F, 0.6F, 0.8F, 1.0F}) append(mesh, wire(radius, 0.01F, {0.5F - radius, 0.3F, 0}));
  return mesh;
}

/// Returns a cup, closed, of walls a tenth of its radius thick, three times as deep as it is wide. Its axis is z.
inline Mesh cup() {
  constexpr std::uint32_t kAround = 120, kRows = 60;
  const glm::vec2 corners[] = {{0.01F, -1.0F}, {0.33F, -1.0F}, {0.33F, 1.0F},
                               {0.3F, 1.0F},   {0.3F, -0.95F}, {0.01F, -0.95F}};
  Mesh mesh;
  std::uint32_t rows = 0;
  for (std::size_t c = 0; c + 1 < std::size(corners); ++c)
    for (std::uint32_t r = 0; r < kRows; ++r, ++rows) {
      const glm::vec2 at = glm::mix(corners[c], corners[c + 1], static_cast<float>(r) / (kRows - 1));
      for (std::uint32_t s = 0; s < kAround; ++s) {
        const float angle = 6.2831853F * static_cast<float>(s) / kAround;
        mesh.positions.push_back({at.x * std::cos(angle), at.x * std::sin(angle), at.y});
      }
    }
  for (std::uint32_t r = 0; r + 1 < rows; ++r)
    for (std::uint32_t s = 0; s < kAround; ++s) {
      const std::uint32_t a = r * kAround + s, b = r * kAround + (s + 1) % kAround;
      addTriangle(mesh, a, b, b + kAround), addTriangle(mesh, a, b + kAround, a + kAround);
    }
  return mesh;
}

/// Returns a room seen from within, with three columns.
inline Mesh room() {
  Mesh mesh = box({-1, -1, -0.5F}, {1, 1, 0.5F}, 60);
  for (std::size_t i = 0; i + 2 < mesh.indices.size(); i += 3) std::swap(mesh.indices[i + 1], mesh.indices[i + 2]);
  for (const glm::vec2& at : {glm::vec2(0.5F, 0.3F), glm::vec2(0.1F, -0.5F), glm::vec2(-0.4F, 0.4F)})
    append(mesh, box({at - 0.06F, -0.5F}, {at + 0.06F, 0.5F}, 12));
  return mesh;
}

/// Returns leaves in a ball: squares of two triangles with their own turn and green.
inline Mesh leaves() {
  Mesh mesh;
  std::mt19937 random(9);
  const auto unit = [&random] { return static_cast<float>(random()) / 4294967296.0F; };
  for (int i = 0; i < 12'000; ++i) {
    glm::vec3 at;
    do at = 2.0F * glm::vec3(unit(), unit(), unit()) - 1.0F;
    while (glm::length(at) > 1.0F);
    const glm::vec3 u = 0.03F * glm::normalize(glm::vec3(unit(), unit(), unit()) - 0.5F);
    const glm::vec3 v = 0.02F * glm::normalize(glm::cross(u, glm::vec3(unit(), unit(), unit()) - 0.5F));
    const glm::u8vec4 green(40.0F + 60.0F * unit(), 90.0F + 120.0F * unit(), 30.0F, 255);
    const auto a = static_cast<std::uint32_t>(mesh.positions.size());
    for (const glm::vec3& corner : {at - u - v, at + u - v, at + u + v, at - u + v}) {
      mesh.positions.push_back(corner);
      mesh.colors.push_back(green);
    }
    addTriangle(mesh, a, a + 1, a + 2), addTriangle(mesh, a, a + 2, a + 3);
  }
  return mesh;
}

/// Returns a flat plate whose vertices are black and white by chance: no simplified shape keeps that.
inline Mesh speckledPlate() {
  Mesh mesh = openGrid(250, 0.0F);
  std::mt19937 random(4);
  for (std::size_t i = 0; i < mesh.positions.size(); ++i)
    mesh.colors.push_back(random() % 2 == 0 ? glm::u8vec4(20, 20, 20, 255) : glm::u8vec4(235, 235, 235, 255));
  return mesh;
}

/// Returns a smooth ball before a speckled wall: its silhouette runs against detail.
inline Mesh ballBeforeSpeckles() {
  Mesh mesh = speckledPlate();
  Mesh ball = bumpySphere(60, 120, 0.0F, {0.5F, 0.5F, 0.35F}, 0.2F);
  colorByPlace(ball);
  append(mesh, ball);
  return mesh;
}

/// Returns a scan line by line: points twelve times as close along a line as across, and noise as large as their steps.
inline Mesh noisyLines() {
  constexpr std::uint32_t kAlong = 600, kAcross = 50;
  Mesh mesh;
  std::mt19937 random(6);
  const auto noise = [&random] { return 0.002F * (static_cast<float>(random()) / 2147483648.0F - 1.0F); };
  for (std::uint32_t y = 0; y <= kAcross; ++y)
    for (std::uint32_t x = 0; x <= kAlong; ++x) {
      const glm::vec2 p(static_cast<float>(x) / kAlong, static_cast<float>(y) / kAcross);
      const float height = 0.1F * std::sin(9.0F * p.x) * std::cos(7.0F * p.y);
      mesh.positions.push_back(glm::vec3(p, height) + glm::vec3(noise(), noise(), noise()));
    }
  for (std::uint32_t y = 0; y < kAcross; ++y)
    for (std::uint32_t x = 0; x < kAlong; ++x) {
      const std::uint32_t a = y * (kAlong + 1) + x, up = a + kAlong + 1;
      addTriangle(mesh, a, a + 1, up + 1), addTriangle(mesh, a, up + 1, up);
    }
  return mesh;
}

/// Returns a ball of many triangles on one giant triangle.
inline Mesh ballOnAGiant() {
  Mesh mesh = bumpySphere(80, 160, 0.05F, {0, 0, 1.1F});
  const auto a = static_cast<std::uint32_t>(mesh.positions.size());
  for (const glm::vec3& corner : {glm::vec3(-9, -5, 0), glm::vec3(9, -5, 0), glm::vec3(0, 10, 0)})
    mesh.positions.push_back(corner);
  addTriangle(mesh, a, a + 1, a + 2);
  return mesh;
}

}  // namespace support
