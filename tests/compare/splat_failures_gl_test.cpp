// Scenes in which splats fail, each at one view, and how far off they are beside patches and the Grid-Lumigraph
// (docs/results/qsplat.md). Bounds lie about 1 dB below what was measured there.
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <cmath>
#include <cstdio>
#include <map>

#include "compare/run.h"
#include "tests/support/failure_meshes.h"
#include "tests/support/made_scene.h"
#include "tests/support/mesh_reader.h"
#include "tests/support/temporary_directory.h"

namespace {

using support::Mesh;

/// Each method reaches at least this PSNR in dB.
struct MinPsnr {
  double lumigraph, patches, square, circle, fuzzy, ellipse;
};

class SplatFailures : public testing::Test {
 protected:
  using Figures = std::map<std::string, compare::Accuracy>;

  void SetUp() override { spdlog::set_level(spdlog::level::err); }  // servers log each client

  /// Returns the accuracy of each method at the view. PSNR is also printed as a row of docs/results/qsplat.md.
  Figures compareAt(Mesh mesh, const base::ViewCamera& view, const char* name) {
    support::colorByPlace(mesh);
    build(mesh);
    compare::RunOptions options;
    options.scene = directory_.path();
    options.path = {view};
    options.report = directory_ / "report";
    options.methods = {"lumigraph", "patches", "qsplat"};
    options.splats = {"square", "circle", "fuzzy", "ellipse"};
    options.cutoffs = {1};
    options.patch_tolerances = {1};
    options.frames = false;
    options.pictures = std::getenv("LUMIGRID_PICTURES") != nullptr;
    auto runs = compare::runComparison(options, [](const std::string&) {});
    EXPECT_TRUE(runs) << runs.error().message;
    Figures figures;
    if (!runs) return figures;
    std::printf("| %s ", name);
    for (const compare::RunResult& run : *runs) {
      figures[run.method] = run.frames.at(0).accuracy;
      std::printf("| %s %.1f ", run.method.c_str(), figures[run.method].psnr_db);
    }
    std::printf("|\n");
    return figures;
  }

  /// However inaccurate the colours are, square, circle and fuzzy splats leave no holes in closed surfaces.
  static void expectAtLeast(const Figures& figures, const MinPsnr& min) {
    EXPECT_EQ(figures.size(), 7U);
    EXPECT_GT(figures.at("lumigraph").psnr_db, min.lumigraph);
    EXPECT_GT(figures.at("patches").psnr_db, min.patches);
    EXPECT_GT(figures.at("qsplat square").psnr_db, min.square);
    EXPECT_GT(figures.at("qsplat circle").psnr_db, min.circle);
    EXPECT_GT(figures.at("qsplat fuzzy").psnr_db, min.fuzzy);
    EXPECT_GT(figures.at("qsplat ellipse").psnr_db, min.ellipse);
    for (const char* kernel : {"qsplat square", "qsplat circle", "qsplat fuzzy"})
      EXPECT_LT(figures.at(kernel).missing_share, 0.001) << kernel;
  }

  static base::ViewCamera lookAt(const glm::dvec3& from, const glm::dvec3& to) {
    base::ViewCamera view;
    view.position = from;
    view.direction = glm::normalize(to - from);
    view.up = {0, 0, 1};
    view.width = 320;
    view.height = 240;
    return view;
  }

 private:
  void build(const Mesh& mesh) {
    const auto scene = support::makeScene(mesh, directory_.path(), {.splats = true, .points = 5});
    ASSERT_TRUE(scene) << scene.error().message;
  }

  const support::TemporaryDirectory directory_;
};

// For comparison, the case that splats are made for: a scan sampled evenly and finer than the pixels.
TEST_F(SplatFailures, evenlySampledScanFromAfarIsNearTheTruth) {
  mesh::generate::SampleOptions sample;
  sample.triangles = 150'000;
  const Mesh mesh = support::makeSample(sample);
  const glm::dvec3 middle(mesh.box().center());
  const double size = mesh.box().diagonal();
  auto figures = compareAt(mesh, lookAt(middle + size * glm::dvec3(1.1, 0.5, 0.3), middle), "even scan");
  expectAtLeast(figures, {33.0, 30.5, 23.5, 27.0, 28.5, 31.5});
  EXPECT_GT(figures["qsplat ellipse"].psnr_db, figures["patches"].psnr_db - 2.0);
}

TEST_F(SplatFailures, closeUpBeyondTheSampleSpacingIsBounded) {
  const Mesh mesh = support::bumpySphere(100, 200, 0.05F);
  auto figures = compareAt(mesh, lookAt({1.25, 0.0, 0.0}, {0.9, 0.05, 0.05}), "close-up");
  expectAtLeast(figures, {48.0, 60.5, 31.5, 36.0, 40.5, 36.0});
}

TEST_F(SplatFailures, largeFlatsOfFewTrianglesAreBounded) {
  Mesh mesh = support::box({-1, -1, -0.1F}, {1, 1, 0}, 1);
  support::append(mesh, support::box({-0.3F, -0.3F, 0.001F}, {0.3F, 0.3F, 0.6F}, 1));
  auto figures = compareAt(mesh, lookAt({2.2, 1.4, 1.6}, {0, 0, 0.1}), "large flats");
  expectAtLeast(figures, {36.0, 37.5, 20.5, 21.0, 20.5, 25.0});
}

TEST_F(SplatFailures, sharpCornersAreBounded) {
  auto figures = compareAt(support::box({-0.5F, -0.5F, -0.5F}, {0.5F, 0.5F, 0.5F}, 60),
                           lookAt({1.3, 1.0, 0.9}, {0.2, 0.2, 0.2}), "sharp corners");
  expectAtLeast(figures, {17.0, 31.0, 22.0, 24.0, 23.5, 30.5});
}

TEST_F(SplatFailures, thinPartsAreBounded) {
  auto figures = compareAt(support::wires(), lookAt({1.6, 1.2, 1.2}, {0, 0, 0}), "thin parts");
  expectAtLeast(figures, {21.5, 23.0, 12.5, 13.0, 12.0, 16.5});
}

}  // namespace
