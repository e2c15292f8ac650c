// Scenes in which umbrellas fail, each at one view, and how far off they are beside patches and splats when everything
// has arrived (docs/pmr.md, "Limits"). Bounds lie about 1 dB below what was measured.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <map>
#include <random>

#include "base/file.h"
#include "base/json/camera_file.h"
#include "compare/sim/matrix.h"
#include "tests/support/added_methods.h"
#include "tests/support/failure_meshes.h"
#include "tests/support/made_scene.h"
#include "tests/support/mesh_reader.h"
#include "tests/support/temporary_directory.h"

namespace {

using support::Mesh;

class UmbrellaFailures : public testing::Test {
 protected:
  using Figures = std::map<std::string, compare::Accuracy>;

  /// Returns the accuracy of each method at rest. PSNR, and the share of the model that stays uncovered, are also
  /// printed.
  Figures compareAt(Mesh mesh, const base::ViewCamera& view, const char* name) {
    support::colorByPlace(mesh);
    const auto scene = support::makeScene(mesh, directory_.path(), {.splats = true});
    EXPECT_TRUE(scene) << scene.error().message;
    const auto added = support::addUmbrellas(mesh, directory_.path());
    EXPECT_TRUE(added) << added.error().message;
    if (!scene || !added) return {};

    compare::MatrixOptions options;
    options.scenes = {directory_.path()};
    options.parts = {{{"orbit"}, {compare::parseLink("1Gbit/1ms").value()}}};
    options.path_files = {directory_ / "path.json"};
    options.methods = {"patches", "qsplat", "pmr"};
    options.stop_seconds = 0.5;
    options.play.instants = 1;
    options.truth_supersampling = 8;
    options.report = directory_ / "report";
    options.pictures = std::getenv("LUMIGRID_PICTURES") != nullptr;
    const base::CameraPath path{{view}, 0.0, false};
    EXPECT_TRUE(base::writeFileAtomically(options.path_files[0], base::viewOfText(base::formatCameraPath(path))));
    const auto runs = compare::playMatrix(options, [](const std::string&) {});
    EXPECT_TRUE(runs) << runs.error().message;
    if (!runs) return {};
    Figures figures;
    std::printf("| %s ", name);
    for (const compare::PlayedRun& run : *runs) {
      const compare::Accuracy& accuracy = run.frames.back().accuracy;
      figures[run.setting.method] = accuracy;
      std::printf("| %s %.1f (%.2f %%) ", run.setting.method.c_str(), accuracy.psnr_db, 100.0 * accuracy.missing_share);
    }
    std::printf("|\n");
    EXPECT_EQ(figures.size(), 3U);
    return figures;
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
  const support::TemporaryDirectory directory_;
};

/// A plate with n × n quads on each side.
Mesh plate(float thickness, int n) {
  return support::box({-1, -1, -0.5F * thickness}, {1, 1, 0.5F * thickness}, n);
}

/// Moves each point by up to `by` in each direction.
Mesh shaken(Mesh mesh, float by) {
  std::mt19937 random(5);
  std::uniform_real_distribution<float> move(-by, by);
  for (glm::vec3& p : mesh.positions) p += glm::vec3(move(random), move(random), move(random));
  return mesh;
}

// For comparison, the case that umbrellas are made for: a scan sampled evenly and finer than its bends.
TEST_F(UmbrellaFailures, evenlySampledScanIsNearTheTruth) {
  mesh::generate::SampleOptions sample;
  sample.triangles = 150'000;
  const Mesh mesh = support::makeSample(sample);
  const glm::dvec3 middle(mesh.box().center());
  const double size = mesh.box().diagonal();
  auto figures = compareAt(mesh, lookAt(middle + size * glm::dvec3(1.1, 0.5, 0.3), middle), "even scan");
  EXPECT_GT(figures["pmr"].psnr_db, 33.5);
  EXPECT_GT(figures["pmr"].psnr_db, figures["qsplat"].psnr_db);
  EXPECT_LT(figures["pmr"].missing_share, 0.001);
}

TEST_F(UmbrellaFailures, closeUpBeyondTheSampleSpacingIsBounded) {
  const Mesh mesh = support::bumpySphere(100, 200, 0.05F);
  auto figures = compareAt(mesh, lookAt({1.25, 0.0, 0.0}, {0.9, 0.05, 0.05}), "close-up");
  EXPECT_GT(figures["pmr"].psnr_db, 43.0);
  EXPECT_LT(figures["pmr"].missing_share, 0.001);
}

// Eight points of a box are too few to tell its shape.
TEST_F(UmbrellaFailures, largeFlatsOfFewPointsAreBounded) {
  Mesh mesh = support::box({-1, -1, -0.1F}, {1, 1, 0}, 1);
  support::append(mesh, support::box({-0.3F, -0.3F, 0.001F}, {0.3F, 0.3F, 0.6F}, 1));
  auto figures = compareAt(mesh, lookAt({2.2, 1.4, 1.6}, {0, 0, 0.1}), "large flats");
  EXPECT_GT(figures["pmr"].psnr_db, 15.0);
  EXPECT_LT(figures["pmr"].missing_share, 0.01);
}

TEST_F(UmbrellaFailures, sharpCornersAreBounded) {
  auto figures = compareAt(support::box({-0.5F, -0.5F, -0.5F}, {0.5F, 0.5F, 0.5F}, 60),
                           lookAt({1.3, 1.0, 0.9}, {0.2, 0.2, 0.2}), "sharp corners");
  EXPECT_GT(figures["pmr"].psnr_db, 41.5);
}

TEST_F(UmbrellaFailures, thinPartsAreBounded) {
  auto figures = compareAt(support::wires(), lookAt({1.6, 1.2, 1.2}, {0, 0, 0}), "thin parts");
  EXPECT_GT(figures["pmr"].psnr_db, 30.5);
}

// Points of the other side are nearer than neighbours on the same side.
TEST_F(UmbrellaFailures, sheetsNearerThanTheSampleSpacingAreBounded) {
  auto figures = compareAt(plate(0.02F, 40), lookAt({1.6, 1.2, 1.2}, {0, 0, 0}), "near sheets");
  EXPECT_GT(figures["pmr"].psnr_db, 36.5);
}

TEST_F(UmbrellaFailures, noiseOfHalfTheSampleSpacingIsBounded) {
  auto figures =
      compareAt(shaken(support::bumpySphere(100, 200, 0.05F), 0.015F), lookAt({2.5, 0.5, 1.0}, {0, 0, 0}), "noise");
  EXPECT_GT(figures["pmr"].psnr_db, 34.0);
}

}  // namespace
