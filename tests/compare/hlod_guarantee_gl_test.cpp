// The promise of HLOD: a place of its picture finds its colour in the full-resolution picture within half a pixel.
#include <gtest/gtest.h>

#include "base/egl/headless.h"
#include "lod/hlod/builder/build.h"
#include "server/render/hlod_scene.h"
#include "server/render/scene_renderer.h"
#include "tests/compare/found_colors.h"
#include "tests/support/made_scene.h"
#include "tests/support/ply_file.h"
#include "tests/support/random_views.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"

namespace {

// Each pixel of a view is looked at in so many places a side, drawn one by one without a filter.
constexpr int kPlaces = 4;
constexpr int kSide = 100;  // pixels of a view
constexpr int kNoise = 8;   // 0 … 255; codes of colours and normals change both pictures
constexpr int kViews = 12;

class HlodGuarantee : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
  }

  void make(const support::Mesh& mesh, lod::hlod::builder::Appearance appearance) {
    auto scene = support::makeScene(mesh, directory_.path());
    ASSERT_TRUE(scene) << scene.error().message;
    scene_ = *scene;
    support::PlyMesh ply;
    for (const glm::vec3& p : mesh.positions) ply.positions.emplace_back(p);
    ply.colors = mesh.colors;
    ply.indices = mesh.indices;
    writePly(directory_ / "mesh.ply", ply);
    lod::hlod::builder::BuildOptions options;
    options.leaf_triangles = 2000;
    options.resolution = 64.0F;
    options.appearance = appearance;
    const auto built = lod::hlod::builder::buildFromFiles({directory_ / "mesh.ply"}, options, directory_ / "hlod.lgh");
    ASSERT_TRUE(built) << built.error().message;
  }

  /// The share over random views at which the cut is no finer than half a pixel asks for.
  support::FoundColors found() {
    support::FoundColors sum;
    auto patches = lod::patch::PatchFile::open(directory_ / "patch.lgp");
    auto truth = server::SceneRenderer::create(scene_, *patches);
    auto nodes = server::HlodScene::create(directory_.path(), scene_);
    EXPECT_TRUE(truth && nodes);
    if (!truth || !nodes) return sum;
    support::RandomViews views(5, (*nodes)->bounds(), kSide);
    triangles_ = 0;
    for (int i = 0; i < kViews; ++i) {
      base::Camera camera = views.next();
      // A camera of more pixels, at which the tolerance of half a pixel is as many times as large.
      camera.width *= kPlaces, camera.height *= kPlaces;
      server::HlodOptions options;
      options.supersampling = 1;
      options.tolerance = 0.5F * kPlaces;
      const auto seen = (*nodes)->render(camera, options);
      const auto full = (*truth)->render(camera, {.tolerance_px = 0.0F, .supersampling = 1});
      EXPECT_TRUE(seen && full);
      if (!seen || !full) return sum;
      triangles_ += seen->count.triangles + seen->count.points;
      sum.add(support::countFoundColors(seen->rgba, full->rgba, {kPlaces / 2, kNoise}));
    }
    EXPECT_GT(sum.places, 20'000U);
    return sum;
  }

  const support::TemporaryDirectory directory_;
  std::unique_ptr<base::HeadlessContext> context_;
  base::Scene scene_;
  std::uint64_t triangles_ = 0;
};

support::Mesh paintedTorus() {
  support::Mesh mesh = support::torus(900, 300);
  for (std::size_t v = 0; v < mesh.positions.size(); ++v) {
    const glm::vec3& p = mesh.positions[v];
    const float wave = std::sin(23.0F * p.x) * std::sin(29.0F * p.y) * std::cos(31.0F * p.z);
    mesh.colors[v] = glm::u8vec4(glm::u8vec3(127.0F + 90.0F * wave, 110.0F, 127.0F - 60.0F * wave), 255);
  }
  return mesh;
}

TEST_F(HlodGuarantee, colorsAreFoundWithinHalfAPixel) {
  make(paintedTorus(), lod::hlod::builder::Appearance::kAuto);
  EXPECT_GT(found().share(), 0.995);
}

TEST_F(HlodGuarantee, shadingIsFoundWithinHalfAPixelAndShapeAloneDoesNotKeepIt) {
  support::Mesh mesh = support::torus(900, 300);
  mesh.colors.clear();
  make(mesh, lod::hlod::builder::Appearance::kAuto);
  const double kept = found().share();
  const std::uint64_t triangles = triangles_;
  EXPECT_GT(kept, 0.995);
  make(mesh, lod::hlod::builder::Appearance::kShape);
  EXPECT_LT(found().share(), kept);
  EXPECT_LT(triangles_, triangles);
}

}  // namespace
