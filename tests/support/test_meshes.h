#pragma once
// These functions make small meshes, named by their properties.
#include <array>
#include <cmath>
#include <cstdint>
#include <glm/glm.hpp>
#include <map>
#include <random>

#include "tests/support/mesh.h"

namespace support {

using support::Mesh;

inline void addTriangle(Mesh& mesh, std::uint32_t a, std::uint32_t b, std::uint32_t c) {
  mesh.indices.insert(mesh.indices.end(), {a, b, c});
}

/// Returns a bumpy sphere, closed, of genus 0, with about 2 · rings · sectors triangles.
inline Mesh bumpySphere(std::uint32_t rings, std::uint32_t sectors, float bump = 0.05F,
                        glm::vec3 center = glm::vec3(0.0F), float radius = 1.0F) {
  Mesh mesh;
  auto point = [&](float theta, float phi) {
    const float r = radius * (1.0F + bump * std::sin(7.0F * theta) * std::cos(9.0F * phi));
    return center + r * glm::vec3(std::sin(theta) * std::cos(phi), std::sin(theta) * std::sin(phi), std::cos(theta));
  };
  constexpr float kPi = 3.14159265F;
  mesh.positions.push_back(point(0.0F, 0.0F));
  for (std::uint32_t r = 1; r < rings; ++r)
    for (std::uint32_t s = 0; s < sectors; ++s)
      mesh.positions.push_back(point(kPi * static_cast<float>(r) / static_cast<float>(rings),
                                     2.0F * kPi * static_cast<float>(s) / static_cast<float>(sectors)));
  mesh.positions.push_back(point(kPi, 0.0F));
  const auto last = static_cast<std::uint32_t>(mesh.positions.size() - 1);
  auto at = [&](std::uint32_t r, std::uint32_t s) { return 1 + (r - 1) * sectors + s % sectors; };
  for (std::uint32_t s = 0; s < sectors; ++s) {
    addTriangle(mesh, 0, at(1, s), at(1, s + 1));
    for (std::uint32_t r = 1; r + 1 < rings; ++r) {
      addTriangle(mesh, at(r, s), at(r + 1, s), at(r + 1, s + 1));
      addTriangle(mesh, at(r, s), at(r + 1, s + 1), at(r, s + 1));
    }
    addTriangle(mesh, at(rings - 1, s), last, at(rings - 1, s + 1));
  }
  return mesh;
}

/// Returns a torus, closed, of genus 1, with 2 · a · b triangles.
inline Mesh torus(std::uint32_t a, std::uint32_t b) {
  Mesh mesh;
  constexpr float kTurn = 6.2831853F;
  for (std::uint32_t i = 0; i < a; ++i)
    for (std::uint32_t j = 0; j < b; ++j) {
      const float u = kTurn * static_cast<float>(i) / static_cast<float>(a);
      const float v = kTurn * static_cast<float>(j) / static_cast<float>(b);
      const float r = 1.0F + 0.35F * std::cos(v) + 0.02F * std::sin(11.0F * u) * std::sin(5.0F * v);
      mesh.positions.push_back({r * std::cos(u), r * std::sin(u), 0.35F * std::sin(v)});
      mesh.colors.push_back(glm::u8vec4(static_cast<std::uint8_t>(127.0F + 127.0F * std::cos(u)),
                                        static_cast<std::uint8_t>(127.0F + 127.0F * std::cos(v)), 60, 255));
    }
  auto at = [&](std::uint32_t i, std::uint32_t j) { return (i % a) * b + j % b; };
  for (std::uint32_t i = 0; i < a; ++i)
    for (std::uint32_t j = 0; j < b; ++j) {
      addTriangle(mesh, at(i, j), at(i + 1, j), at(i + 1, j + 1));
      addTriangle(mesh, at(i, j), at(i + 1, j + 1), at(i, j + 1));
    }
  return mesh;
}

/// A winding passage with walls of rock, 60 long and 2 to 3 wide, open at both ends, that faces inwards.
inline Mesh cave(float rise = 0.0F) {
  constexpr int kAlong = 300, kAround = 40;
  Mesh mesh;
  for (int i = 0; i <= kAlong; ++i)
    for (int k = 0; k < kAround; ++k) {
      const float t = static_cast<float>(i) / kAlong;
      const float angle = 6.28318531F * static_cast<float>(k) / kAround;
      const float radius = 1.25F + 0.25F * std::sin(37.0F * t) + 0.1F * std::sin(5.0F * angle + 61.0F * t);
      mesh.positions.emplace_back(60.0F * t, 6.0F * std::sin(9.0F * t) + radius * std::cos(angle),
                                  rise * t + radius * std::sin(angle));
    }
  for (int i = 0; i < kAlong; ++i)
    for (int k = 0; k < kAround; ++k) {
      const auto at = [&](int along, int around) {
        return static_cast<std::uint32_t>((i + along) * kAround + (k + around) % kAround);
      };
      addTriangle(mesh, at(0, 0), at(1, 0), at(1, 1));
      addTriangle(mesh, at(0, 0), at(1, 1), at(0, 1));
    }
  return mesh;
}

/// Returns an open height field of 2 · n · n triangles over [0, 1]².
inline Mesh openGrid(std::uint32_t n, float height = 0.05F) {
  Mesh mesh;
  for (std::uint32_t y = 0; y <= n; ++y)
    for (std::uint32_t x = 0; x <= n; ++x) {
      const glm::vec2 p = glm::vec2(x, y) / static_cast<float>(n);
      mesh.positions.push_back({p, height * std::sin(9.0F * p.x) * std::cos(7.0F * p.y)});
    }
  for (std::uint32_t y = 0; y < n; ++y)
    for (std::uint32_t x = 0; x < n; ++x) {
      const std::uint32_t a = y * (n + 1) + x;
      addTriangle(mesh, a, a + 1, a + n + 2);
      addTriangle(mesh, a, a + n + 2, a + n + 1);
    }
  return mesh;
}

/// Returns an industrial site in a unit square: subdivided flat sides of boxes on flat ground, and round pipes. About
/// 20 000 triangles.
inline Mesh plant() {
  Mesh mesh;
  const auto sheet = [&](std::uint32_t n, std::uint32_t m, auto&& at) {
    const auto first = static_cast<std::uint32_t>(mesh.positions.size());
    for (std::uint32_t i = 0; i <= n; ++i)
      for (std::uint32_t j = 0; j <= m; ++j)
        mesh.positions.push_back(
            at(static_cast<float>(i) / static_cast<float>(n), static_cast<float>(j) / static_cast<float>(m)));
    for (std::uint32_t i = 0; i < n; ++i)
      for (std::uint32_t j = 0; j < m; ++j) {
        const std::uint32_t a = first + i * (m + 1) + j;
        addTriangle(mesh, a, a + m + 1, a + m + 2), addTriangle(mesh, a, a + m + 2, a + 1);
      }
  };
  std::mt19937 random(11);
  std::uniform_real_distribution<float> unit(0.0F, 1.0F);
  sheet(40, 40, [](float u, float v) { return glm::vec3(u, v, 0.0F); });
  for (int b = 0; b < 20; ++b) {
    const glm::vec3 foot(0.9F * unit(random), 0.9F * unit(random), 0.0F);
    const glm::vec3 size = 0.02F + 0.08F * glm::vec3(unit(random), unit(random), unit(random));
    for (int axis = 0; axis < 3; ++axis)
      for (const float side : {0.0F, 1.0F})
        sheet(8, 8, [&](float u, float v) {
          glm::vec3 share;
          share[axis] = side, share[(axis + 1) % 3] = u, share[(axis + 2) % 3] = v;
          return foot + size * share;
        });
  }
  for (int i = 0; i < 5; ++i) {
    const float y = unit(random), z = 0.12F + 0.1F * unit(random), radius = 0.005F + 0.01F * unit(random);
    sheet(60, 16, [&](float u, float v) {
      const float turn = 6.2831853F * v;
      return glm::vec3(u, y + radius * std::cos(turn), z + radius * std::sin(turn));
    });
  }
  return mesh;
}

/// Returns small random triangles in a unit cube, none of which share a vertex.
inline Mesh triangleSoup(std::uint32_t count, float size = 0.02F) {
  Mesh mesh;
  std::mt19937 random(3);
  std::uniform_real_distribution<float> unit(0.0F, 1.0F);
  for (std::uint32_t t = 0; t < count; ++t) {
    const glm::vec3 at(unit(random), unit(random), unit(random));
    for (int k = 0; k < 3; ++k)
      mesh.positions.push_back(at + size * glm::vec3(unit(random), unit(random), unit(random)));
    addTriangle(mesh, 3 * t, 3 * t + 1, 3 * t + 2);
  }
  return mesh;
}

/// `count` separate closed tetrahedra in a unit cube.
inline Mesh tinyComponents(std::uint32_t count) {
  Mesh mesh;
  std::mt19937 random(5);
  std::uniform_real_distribution<float> unit(0.0F, 1.0F);
  for (std::uint32_t c = 0; c < count; ++c) {
    const glm::vec3 at(unit(random), unit(random), unit(random));
    for (const glm::vec3& d : {glm::vec3(0), glm::vec3(1, 0, 0), glm::vec3(0, 1, 0), glm::vec3(0, 0, 1)})
      mesh.positions.push_back(at + 0.004F * d);
    const std::uint32_t v = 4 * c;
    addTriangle(mesh, v, v + 2, v + 1), addTriangle(mesh, v, v + 1, v + 3), addTriangle(mesh, v, v + 3, v + 2),
        addTriangle(mesh, v + 1, v + 2, v + 3);
  }
  return mesh;
}

}  // namespace support
