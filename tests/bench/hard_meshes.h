#pragma once
// Generates meshes at which builders of hierarchies slow down or keep too much: what scans of trees, machines and
// nothing in particular look like. All are coloured.
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <glm/glm.hpp>
#include <glm/gtc/constants.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tests/bench/bench.h"

namespace bench {

class HardMesh {
 public:
  HardMesh(std::string name, std::size_t triangles) : name_(std::move(name)), wanted_(triangles) {}

  /// Leaves of two triangles each, in clumps, each turned at random.
  void addLeaves(std::size_t triangles, const glm::vec3& low, const glm::vec3& high) {
    const float size = 0.3F * glm::length(high - low) / std::sqrt(static_cast<float>(triangles));
    glm::vec3 clump = low;
    for (std::size_t leaf = 0; leaf < triangles / 2; ++leaf) {
      if (leaf % 200 == 0) clump = between(low, high);
      const glm::vec3 at = clump + 12.0F * size * (direction() * random());
      const glm::vec3 along = 2.0F * size * direction();
      const glm::vec3 across = size * glm::normalize(glm::cross(along, direction()));
      const auto green = static_cast<std::uint8_t>(90.0F + 120.0F * random());
      const std::uint32_t a = vertex(at, {60, green, 40});
      const std::uint32_t b = vertex(at + 0.5F * along + across, {70, green, 40});
      const std::uint32_t c = vertex(at + along, {90, green, 50});
      const std::uint32_t d = vertex(at + 0.5F * along - across, {70, green, 40});
      triangle(a, b, c);
      triangle(a, c, d);
    }
  }

  /// A grid of columns × rows quads over the unit square; `place` maps it to space. Triangles: two a quad.
  void addSheet(std::size_t columns, std::size_t rows, const std::function<glm::vec3(float, float)>& place) {
    const auto first = static_cast<std::uint32_t>(positions_.size());
    for (std::size_t r = 0; r <= rows; ++r)
      for (std::size_t c = 0; c <= columns; ++c) {
        const float u = static_cast<float>(c) / static_cast<float>(columns);
        const float v = static_cast<float>(r) / static_cast<float>(rows);
        const glm::vec3 p = place(u, v);
        const float shade = 150.0F + 60.0F * std::sin(40.0F * p.x) * std::sin(37.0F * p.y + 11.0F * p.z);
        vertex(p, glm::u8vec3(static_cast<std::uint8_t>(shade), static_cast<std::uint8_t>(0.9F * shade), 120));
      }
    const auto stride = static_cast<std::uint32_t>(columns + 1);
    for (std::uint32_t r = 0; r < rows; ++r)
      for (std::uint32_t c = 0; c < columns; ++c) {
        const std::uint32_t a = first + r * stride + c;
        triangle(a, a + 1, a + stride);
        triangle(a + 1, a + stride + 1, a + stride);
      }
  }

  /// A wall with windows and mouldings, rough by a little noise.
  void addFacade(std::size_t triangles) {
    const auto side = static_cast<std::size_t>(std::sqrt(0.5 * static_cast<double>(triangles)));
    addSheet(side, side, [this](float u, float v) {
      const float frame = std::abs(std::sin(12.0F * glm::pi<float>() * u) * std::sin(9.0F * glm::pi<float>() * v));
      return glm::vec3(u, 2e-4F * random() + (frame > 0.7F ? -0.01F : 0.0F) + 0.002F * std::sin(90.0F * v), v);
    });
  }

  /// Triangles with corners of their own at equal places; a third of the edges has a fin, so more than two triangles.
  void addSoup(std::size_t triangles) {
    const auto side = static_cast<std::size_t>(std::sqrt(0.5 * static_cast<double>(triangles) / 1.5));
    HardMesh sheet("", 0);
    sheet.addSheet(side, side, [](float u, float v) {
      return glm::vec3(u, v, 0.03F * std::sin(25.0F * u) * std::cos(31.0F * v) + 0.004F * std::sin(170.0F * u * v));
    });
    const float edge = 1.0F / static_cast<float>(side);
    for (std::size_t i = 0; i < sheet.corners_.size(); i += 3) {
      std::array<std::uint32_t, 3> own{};
      for (std::size_t k = 0; k < 3; ++k)
        own[k] = vertex(sheet.positions_[sheet.corners_[i + k]], sheet.colors_[sheet.corners_[i + k]]);
      triangle(own[0], own[1], own[2]);
      if (i % 6 != 0) continue;
      const glm::vec3 a = positions_[own[0]];
      const glm::vec3 b = positions_[own[1]];
      const std::uint32_t foot = vertex(a, {120, 120, 120});
      const std::uint32_t other = vertex(b, {120, 120, 120});
      triangle(foot, other, vertex(0.5F * (a + b) + glm::vec3(0, 0, edge * (0.3F + random())), {60, 160, 60}));
    }
  }

  /// Long thin triangles, 200 times as long as wide.
  void addNeedles(std::size_t triangles) {
    const auto rows = static_cast<std::size_t>(std::sqrt(0.5 * static_cast<double>(triangles) / 200.0));
    addSheet(200 * rows, rows, [](float u, float v) {
      return glm::vec3(u, v, 0.05F * std::sin(40.0F * u) * std::sin(23.0F * v) + 0.001F * std::sin(900.0F * u));
    });
  }

  /// Spheres around one centre.
  void addShells(std::size_t triangles, std::size_t shells) {
    const auto rows = static_cast<std::size_t>(std::sqrt(0.25 * static_cast<double>(triangles / shells)));
    for (std::size_t s = 0; s < shells; ++s) {
      const float radius = 0.5F + 0.5F * static_cast<float>(s) / static_cast<float>(shells);
      addSheet(2 * rows, rows, [&](float u, float v) {
        const float around = glm::two_pi<float>() * (u == 1.0F ? 0.0F : u);
        const float down = glm::pi<float>() * v;
        const float bump = 1.0F + 0.001F * std::sin(30.0F * around) * std::sin(30.0F * down);
        return radius * bump *
               glm::vec3(std::sin(down) * std::cos(around), std::sin(down) * std::sin(around), std::cos(down));
      });
    }
  }

  /// Tubes of eight sides along random ways.
  void addTubes(std::size_t triangles, std::size_t tubes) {
    const std::size_t rows = std::max<std::size_t>(2, triangles / tubes / 16);
    const float radius = 0.002F;
    for (std::size_t t = 0; t < tubes; ++t) {
      std::vector<glm::vec3> way{between(glm::vec3(0.0F), glm::vec3(1.0F))};
      std::vector<std::pair<glm::vec3, glm::vec3>> sides;
      glm::vec3 heading = direction();
      for (std::size_t r = 0; r <= rows; ++r) {
        const glm::vec3 right = glm::normalize(glm::cross(heading, glm::vec3(0.3F, 0.5F, 0.81F)));
        sides.emplace_back(right, glm::cross(heading, right));
        way.push_back(way.back() + radius * heading);
        heading = glm::normalize(heading + 0.15F * direction());
      }
      addSheet(8, rows, [&](float u, float v) {
        const auto r = static_cast<std::size_t>(v * static_cast<float>(rows) + 0.5F);
        const float around = glm::two_pi<float>() * (u == 1.0F ? 0.0F : u);
        return way[r] + radius * (std::cos(around) * sides[r].first + std::sin(around) * sides[r].second);
      });
    }
  }

  const std::string& name() const { return name_; }
  std::size_t wanted() const { return wanted_; }
  std::size_t triangles() const { return corners_.size() / 3; }

  void writePly(const std::string& path) const {
    std::FILE* out = std::fopen(path.c_str(), "wb");
    if (out == nullptr) stop("cannot write " + path);
    std::fprintf(out,
                 "ply\nformat binary_little_endian 1.0\nelement vertex %zu\nproperty float x\nproperty float y\n"
                 "property float z\nproperty uchar red\nproperty uchar green\nproperty uchar blue\nelement face %zu\n"
                 "property list uchar int vertex_indices\nend_header\n",
                 positions_.size(), triangles());
    for (std::size_t v = 0; v < positions_.size(); ++v) {
      std::fwrite(&positions_[v], 1, 12, out);
      std::fwrite(&colors_[v], 1, 3, out);
    }
    for (std::size_t i = 0; i < corners_.size(); i += 3) {
      std::fputc(3, out);
      std::fwrite(&corners_[i], 4, 3, out);
    }
    const bool is_whole = std::ferror(out) == 0;
    if (std::fclose(out) != 0 || !is_whole) stop("cannot write all of " + path);
  }

 private:
  std::uint32_t vertex(const glm::vec3& at, const glm::u8vec3& color) {
    positions_.push_back(at);
    colors_.push_back(color);
    return static_cast<std::uint32_t>(positions_.size() - 1);
  }
  void triangle(std::uint32_t a, std::uint32_t b, std::uint32_t c) { corners_.insert(corners_.end(), {a, b, c}); }

  /// From 0 to 1: splitmix64.
  float random() {
    std::uint64_t z = state_ += 0x9e3779b97f4a7c15ULL;
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9ULL;
    z = (z ^ z >> 27) * 0x94d049bb133111ebULL;
    return static_cast<float>((z ^ z >> 31) >> 40) / static_cast<float>(1 << 24);
  }
  glm::vec3 between(const glm::vec3& low, const glm::vec3& high) {
    const float x = random(), y = random(), z = random();
    return low + (high - low) * glm::vec3(x, y, z);
  }
  glm::vec3 direction() {
    for (;;) {
      const glm::vec3 d = between(glm::vec3(-1.0F), glm::vec3(1.0F));
      const float length = glm::length(d);
      if (length > 0.1F && length < 1.0F) return d / length;
    }
  }

  std::string name_;
  std::size_t wanted_ = 0;
  std::uint64_t state_ = 1;
  std::vector<glm::vec3> positions_;
  std::vector<glm::u8vec3> colors_;
  std::vector<std::uint32_t> corners_;
};

/// The hard meshes by name, with the triangles that each has at full size.
inline const std::vector<std::pair<std::string, std::size_t>>& hardMeshes() {
  static const std::vector<std::pair<std::string, std::size_t>> all{{"leaves", 2'000'000}, {"needles", 10'000'000},
                                                                    {"soup", 30'000'000},  {"shells", 10'000'000},
                                                                    {"tubes", 10'000'000}, {"mixed", 30'000'000}};
  return all;
}

inline HardMesh makeHardMesh(const std::string& name, std::size_t triangles) {
  HardMesh mesh(name, triangles);
  if (name == "leaves") mesh.addLeaves(triangles, glm::vec3(0.0F), glm::vec3(1.0F));
  if (name == "needles") mesh.addNeedles(triangles);
  if (name == "soup") mesh.addSoup(triangles);
  if (name == "shells") mesh.addShells(triangles, 100);
  if (name == "tubes") mesh.addTubes(triangles, 10'000);
  if (name == "mixed") {
    mesh.addFacade(triangles / 2);
    mesh.addLeaves(triangles / 2, glm::vec3(0.0F, -0.6F, 0.0F), glm::vec3(1.0F, -0.1F, 0.5F));
  }
  if (mesh.triangles() == 0) stop("no mesh is named " + name);
  return mesh;
}

}  // namespace bench
