#include "server/render/umbrella_scene.h"

#include <gtest/gtest.h>

#include <cstdlib>

#include "base/egl/headless.h"
#include "base/file.h"
#include "base/gl/gl.h"
#include "tests/support/compared_pictures.h"
#include "tests/support/made_pmr.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

class UmbrellaSceneTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
    made_ = support::madePmr();
    scene_.light.mode = base::LightMode::kUnlit;
  }
  void TearDown() override {
    renderer_.reset();
    EXPECT_EQ(base::gl::takeError(), "");
  }

  /// Writes the file as it is now, and opens it.
  base::Result<std::unique_ptr<UmbrellaScene>> open() {
    EXPECT_TRUE(base::writeFileAtomically(directory_ / "pmr.lgm", made_.file));
    return UmbrellaScene::create(directory_.path(), scene_);
  }
  UmbrellaScene& renderer() {
    auto made = open();
    EXPECT_TRUE(made) << made.error().message;
    renderer_ = std::move(*made);
    return *renderer_;
  }
  static base::Camera camera(int width, int height, double away = 1.0) {
    base::ViewCamera view;
    view.position = away * glm::dvec3(2.5, 1.0, 2.0);
    view.direction = glm::normalize(-view.position);
    view.up = {0, 0, 1};
    view.width = width;
    view.height = height;
    return base::cameraForScene(view, glm::dvec3(0.0), {glm::vec3(0.0F), 1.5F});
  }

  const support::TemporaryDirectory directory_;
  std::unique_ptr<base::HeadlessContext> context_;
  support::MadePmr made_;
  base::Scene scene_;
  std::unique_ptr<UmbrellaScene> renderer_;
};

// Cameras of tiles round otherwise, which moves the edge of a triangle by a sample here and there.
TEST_F(UmbrellaSceneTest, aPictureInTilesIsThatInOne) {
  for (const auto& [away, tolerance] : {std::pair(1.0, 1.0F), {3.0, 1.0F}, {6.0, 0.25F}}) {
    UmbrellaOptions options;
    options.tolerance = tolerance;
    options.supersampling = 2;
    const auto whole = renderer().render(camera(150, 90, away), options);
    ASSERT_TRUE(whole) << whole.error().message;
    options.max_target_samples = 500;
    const auto tiled = renderer().render(camera(150, 90, away), options);
    ASSERT_TRUE(tiled) << tiled.error().message;
    EXPECT_LT(support::shareDifferent(whole->rgba, tiled->rgba), 0.0005) << away;
    EXPECT_GT(tiled->triangles + tiled->points, whole->triangles + whole->points) << "some leaves lie in several tiles";
  }
}

TEST_F(UmbrellaSceneTest, aClosedSurfaceHasNoHoles) {
  for (const float tolerance : {0.5F, 1.0F, 5.0F}) {
    UmbrellaOptions options;
    options.tolerance = tolerance;
    const auto picture = renderer().render(camera(120, 90), options);
    ASSERT_TRUE(picture) << picture.error().message;
    // A transparent pixel with the model on all four sides is a hole.
    int holes = 0, covered = 0;
    const auto isCovered = [&](int x, int y) { return picture->rgba.at(x, y)[3] > 0; };
    for (int y = 1; y + 1 < 90; ++y)
      for (int x = 1; x + 1 < 120; ++x) {
        covered += isCovered(x, y) ? 1 : 0;
        holes +=
            !isCovered(x, y) && isCovered(x - 1, y) && isCovered(x + 1, y) && isCovered(x, y - 1) && isCovered(x, y + 1)
                ? 1
                : 0;
      }
    EXPECT_GT(covered, 2000);
    EXPECT_EQ(holes, 0) << tolerance << " pixels";
  }
}

TEST_F(UmbrellaSceneTest, aLargerToleranceDrawsFewer) {
  UmbrellaScene& scene = renderer();
  UmbrellaOptions options;
  const auto fine = scene.render(camera(640, 480), options);
  options.tolerance = 64.0F;
  const auto coarse = scene.render(camera(640, 480), options);
  ASSERT_TRUE(fine && coarse);
  EXPECT_GT(fine->triangles + fine->points, 2 * (coarse->triangles + coarse->points));
}

TEST_F(UmbrellaSceneTest, umbrellasSmallerThanAPixelAreDrawnAsPoints) {
  UmbrellaOptions options;
  options.tolerance = 0.25F;
  const auto far = renderer().render(camera(120, 90, 8.0), options);
  ASSERT_TRUE(far) << far.error().message;
  EXPECT_GT(far->points, far->triangles);
}

TEST_F(UmbrellaSceneTest, aDamagedFileIsAnErrorThatNamesIt) {
  const base::Bytes whole = made_.file;
  made_.file[20] ^= 4;
  const auto header = open();
  ASSERT_FALSE(header);
  EXPECT_NE(header.error().message.find("pmr.lgm"), std::string::npos) << header.error().message;
  EXPECT_EQ(header.error().code, base::ErrorCode::kInvalidInput);

  made_.file = whole;
  const std::size_t first = made_.leaves.front().levels[lod::pmr::kCoarsest].point_offset;
  for (std::size_t i = first; i < made_.file.size(); i += 50) made_.file[i] ^= 4;
  const auto picture = renderer().render(camera(120, 90), {});
  ASSERT_FALSE(picture);
  EXPECT_NE(picture.error().message.find("pmr.lgm"), std::string::npos) << picture.error().message;
  EXPECT_EQ(picture.error().message.find('\n'), std::string::npos);
}

TEST_F(UmbrellaSceneTest, refusesInvalidSizesAndOptions) {
  UmbrellaScene& scene = renderer();
  EXPECT_FALSE(scene.render(camera(40000, 90), {}));
  UmbrellaOptions options;
  options.supersampling = 9;
  EXPECT_FALSE(scene.render(camera(120, 90), options));
  options = {};
  options.tolerance = 0.0F;
  EXPECT_FALSE(scene.render(camera(120, 90), options));
}

TEST_F(UmbrellaSceneTest, aSceneWithoutSaysHowToBuildThem) {
  const auto made = UmbrellaScene::create(directory_ / "nowhere", {});
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().code, base::ErrorCode::kNotFound);
  EXPECT_NE(made.error().message.find("--methods pmr"), std::string::npos) << made.error().message;
}

}  // namespace
}  // namespace server
