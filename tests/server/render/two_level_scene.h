#pragma once
// A patch file of two levels, drawn by hand: one root patch over any number of leaves.
#include <unistd.h>

#include <gtest/gtest.h>

#include <filesystem>
#include <string>
#include <vector>

#include "base/json/scene_file.h"
#include "lod/patch/codec.h"
#include "lod/patch/format.h"
#include "tests/support/quantized_normal.h"

namespace server::test {

/// Corners on the lattice of step 1/64 around the origin, in units of 1 (rounded to the lattice).
inline lod::Lattice testLattice() {
  return {glm::dvec3(-32.0), 1.0 / 64.0};
}
inline glm::ivec3 latticePoint(const glm::vec3& p) {
  return glm::ivec3(glm::round((p + 32.0F) * 64.0F));
}

struct Triangle {
  glm::vec3 a, b, c;
  glm::u8vec4 color{255};
  glm::vec3 normal{0.0F};  ///< of its corners; zero: its own
};

inline lod::patch::PatchGeometry geometryOf(const std::vector<Triangle>& triangles) {
  lod::patch::PatchGeometry geometry;
  for (const Triangle& t : triangles) {
    const glm::vec3 own = glm::cross(t.b - t.a, t.c - t.a);
    const glm::vec3 normal = support::quantizedNormal(t.normal == glm::vec3(0.0F) ? own : t.normal);
    for (const glm::vec3& corner : {t.a, t.b, t.c}) {
      geometry.indices.push_back(static_cast<std::uint16_t>(geometry.positions.size()));
      geometry.positions.push_back(latticePoint(corner));
      geometry.normals.push_back(normal);
      geometry.colors.push_back(t.color);
    }
  }
  return geometry;
}

inline lod::patch::Patch recordOf(const lod::patch::PatchGeometry& geometry) {
  lod::patch::Patch patch;
  std::vector<glm::vec3> points;
  for (const glm::ivec3& q : geometry.positions) points.push_back(testLattice().position(q));
  for (const glm::vec3& p : points) patch.box.add(p);
  patch.bounds = base::boundingSphere(points);
  patch.cone = base::boundingCone(geometry.normals);
  patch.triangles = static_cast<std::uint32_t>(geometry.indices.size() / 3);
  patch.vertices = static_cast<std::uint32_t>(geometry.positions.size());
  return patch;
}

/// Holds the file and the scene made of it. `error` is the distance of the root from the leaves in scene units.
class TwoLevelScene {
 public:
  TwoLevelScene(const std::vector<Triangle>& root, const std::vector<std::vector<Triangle>>& leaves, float error) {
    const std::string name = testing::UnitTest::GetInstance()->current_test_info()->name();
    path_ = (std::filesystem::path(testing::TempDir()) /
             ("lumigrid_render_" + name + "_" + std::to_string(::getpid()) + ".lgp"))
                .string();
    std::vector<lod::patch::PatchGeometry> geometries{geometryOf(root)};
    for (const auto& leaf : leaves) geometries.push_back(geometryOf(leaf));
    write(geometries, error);
    auto opened = lod::patch::PatchFile::open(path_);
    if (!opened) {
      ADD_FAILURE() << opened.error().message;
      return;
    }
    file_ = std::make_unique<lod::patch::PatchFile>(std::move(*opened));
    scene_.light.mode = base::LightMode::kUnlit;
    scene_.has_colors = true;
  }
  ~TwoLevelScene() { std::filesystem::remove(path_); }
  TwoLevelScene(const TwoLevelScene&) = delete;
  TwoLevelScene& operator=(const TwoLevelScene&) = delete;

  const lod::patch::PatchFile& file() const { return *file_; }
  base::Scene& scene() { return scene_; }
  const std::string& path() const { return path_; }

 private:
  void write(const std::vector<lod::patch::PatchGeometry>& geometries, float error) {
    // Group 0 consumes patch 0, the root, which group 1 made by merging patches 1 …, the leaves.
    lod::patch::Hierarchy hierarchy;
    hierarchy.lattice = testLattice();
    hierarchy.has_colors = true;
    std::vector<base::Sphere> spheres;
    for (const auto& geometry : geometries) {
      lod::patch::Patch patch = recordOf(geometry);
      const bool is_root = hierarchy.patches.empty();
      patch.level = is_root ? 1 : 0;
      patch.producer = is_root ? 1 : lod::patch::kNoGroup;
      patch.consumer = is_root ? 0 : 1;
      if (!is_root) hierarchy.source_triangles += patch.triangles;
      spheres.push_back(patch.bounds);
      hierarchy.patches.push_back(patch);
    }
    lod::patch::Group top;
    top.bounds = base::boundingSphere(spheres);
    top.error = top.typical_error = top.visible_error = std::numeric_limits<float>::infinity();
    top.level = 2;
    top.patch_count = 1;
    lod::patch::Group merged = top;
    merged.error = merged.visible_error = error;
    merged.typical_error = error / lod::patch::kVisibleRatio;
    merged.level = 1;
    merged.first_patch = 1;
    merged.patch_count = static_cast<std::uint32_t>(geometries.size() - 1);
    merged.parent_count = 1;
    hierarchy.groups = {top, merged};
    hierarchy.parents = {0};
    const auto written = lod::patch::writePatchFile(
        path_, hierarchy, [&](std::uint32_t group) -> base::Result<std::vector<base::Bytes>> {
          std::vector<base::Bytes> blocks;
          const lod::patch::Group& g = hierarchy.groups[group];
          for (std::uint32_t i = 0; i < g.patch_count; ++i)
            blocks.push_back(lod::patch::encodePatch(geometries[g.first_patch + i]));
          return blocks;
        });
    EXPECT_TRUE(written) << (written ? "" : written.error().message);
  }

  std::string path_;
  std::unique_ptr<lod::patch::PatchFile> file_;
  base::Scene scene_;
};

}  // namespace server::test
