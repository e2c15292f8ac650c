#pragma once
// A built hierarchy to look at with rays, and rays that look at it from near and far.
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <memory>
#include <random>
#include <string>
#include <utility>

#include "lod/patch/format.h"
#include "lod/patch/ray_cast.h"
#include "tests/lod/patch/builder/built_cut.h"
#include "tests/support/test_meshes.h"

namespace lod::patch {

/// A hierarchy file made by the builder from a small mesh; removed in the end.
class BuiltScene {
 public:
  BuiltScene(const support::Mesh& mesh, const std::string& name) {
    path_ = std::filesystem::temp_directory_path() / ("lumigrid_ray_" + name + std::to_string(::getpid()) + ".lgp");
    const auto built = support::buildHierarchy(mesh, support::smallPatches(), path_.string());
    EXPECT_TRUE(built) << built.error().message;
    auto file = PatchFile::open(path_.string());
    EXPECT_TRUE(file) << file.error().message;
    file_ = std::make_unique<PatchFile>(std::move(*file));
  }
  ~BuiltScene() {
    file_.reset();
    std::filesystem::remove(path_);
  }
  BuiltScene(const BuiltScene&) = delete;
  BuiltScene& operator=(const BuiltScene&) = delete;

  const PatchFile& file() const { return *file_; }
  const Hierarchy& hierarchy() const { return file_->hierarchy(); }
  RayCast cast(const Ray& ray, float tolerance = 0.0F) const {
    const auto cast = castRay(hierarchy(), ray, blocksOf(*file_), tolerance);
    EXPECT_TRUE(cast) << cast.error().message;
    EXPECT_TRUE(cast->needed.empty());
    return *cast;
  }

 private:
  std::filesystem::path path_;
  std::unique_ptr<PatchFile> file_;
};

class RandomRays {
 public:
  explicit RandomRays(const PatchFile& file) {
    for (const Patch& patch : file.hierarchy().patches) box_.add(patch.box);
  }
  glm::dvec3 unit() {
    std::normal_distribution<double> normal;
    return glm::normalize(glm::dvec3(normal(random_), normal(random_), normal(random_)));
  }
  /// Draws a ray from outside or within, towards somewhere in the box.
  Ray next() {
    std::uniform_real_distribution<double> share(-0.5, 0.5);
    const auto inside = [&] {
      return glm::dvec3(box_.center()) +
             glm::dvec3(share(random_), share(random_), share(random_)) * glm::dvec3(box_.size());
    };
    const glm::dvec3 target = inside();
    const double away[] = {0.0, 0.6, 3.0, 1000.0};
    const glm::dvec3 from = target + away[turn_++ % 4] * box_.diagonal() * unit();
    const glm::dvec3 origin = from == target ? inside() : from;
    return {origin, 0.5 * (target - origin)};
  }

 private:
  base::Aabb box_;
  std::mt19937 random_{11};
  std::size_t turn_ = 0;
};

}  // namespace lod::patch
