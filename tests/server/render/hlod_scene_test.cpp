#include "server/render/hlod_scene.h"

#include <gtest/gtest.h>

#include "base/egl/headless.h"
#include "base/file.h"
#include "base/gl/gl.h"
#include "tests/support/compared_pictures.h"
#include "tests/support/made_hlod.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

class HlodSceneTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
    made_ = support::HlodMaker(4, 8, true).make();
    scene_.light.mode = base::LightMode::kUnlit;
  }
  void TearDown() override {
    renderer_.reset();
    EXPECT_EQ(base::gl::takeError(), "");
  }

  /// Writes the file as it is now, and opens it.
  base::Result<std::unique_ptr<HlodScene>> open() {
    EXPECT_TRUE(base::writeFileAtomically(directory_ / "hlod.lgh", made_.file));
    return HlodScene::create(directory_.path(), scene_);
  }
  HlodScene& renderer() {
    auto made = open();
    EXPECT_TRUE(made) << made.error().message;
    renderer_ = std::move(*made);
    return *renderer_;
  }
  static base::Camera camera(int width, int height, double away = 1.0) {
    base::ViewCamera view;
    view.position = away * glm::dvec3(0.5, 0.4, 2.0);
    view.direction = glm::normalize(-view.position);
    view.width = width;
    view.height = height;
    return base::cameraForScene(view, glm::dvec3(0.0), {glm::vec3(0.0F), 1.5F});
  }

  const support::TemporaryDirectory directory_;
  std::unique_ptr<base::HeadlessContext> context_;
  support::MadeHlod made_;
  base::Scene scene_;
  std::unique_ptr<HlodScene> renderer_;
};

/// Counts transparent pixels that have the model on all four sides, and those that are covered.
struct Covered {
  int pixels = 0, holes = 0;
};
Covered coveredIn(const base::Image& picture) {
  Covered counted;
  const auto isCovered = [&](int x, int y) { return picture.at(x, y)[3] > 0; };
  for (int y = 1; y + 1 < picture.height; ++y)
    for (int x = 1; x + 1 < picture.width; ++x) {
      if (isCovered(x, y)) {
        ++counted.pixels;
      } else if (isCovered(x - 1, y) && isCovered(x + 1, y) && isCovered(x, y - 1) && isCovered(x, y + 1)) {
        ++counted.holes;
      }
    }
  return counted;
}

// Cameras of tiles round otherwise, which moves the edge of a triangle by a sample here and there.
TEST_F(HlodSceneTest, aPictureInTilesIsThatInOne) {
  for (const auto& [away, tolerance] : {std::pair(1.0, 0.5F), {3.0, 0.5F}, {2.0, 4.0F}}) {
    HlodOptions options;
    options.tolerance = tolerance;
    options.supersampling = 2;
    const auto whole = renderer().render(camera(150, 90, away), options);
    ASSERT_TRUE(whole) << whole.error().message;
    options.max_target_samples = 4000;
    const auto tiled = renderer().render(camera(150, 90, away), options);
    ASSERT_TRUE(tiled) << tiled.error().message;
    EXPECT_LT(support::shareDifferent(whole->rgba, tiled->rgba), 0.002) << away;
    EXPECT_GT(tiled->count.triangles, whole->count.triangles) << "some nodes lie in several tiles";
  }
}

TEST_F(HlodSceneTest, cellsOfAllLevelsShowNoHoleBetweenThem) {
  for (const int supersampling : {1, 4})
    for (const float tolerance : {0.1F, 0.5F, 1.0F, 3.0F}) {
      HlodOptions options;
      options.tolerance = tolerance;
      options.supersampling = supersampling;
      const auto picture = renderer().render(camera(120, 90), options);
      ASSERT_TRUE(picture) << picture.error().message;
      const Covered covered = coveredIn(picture->rgba);
      EXPECT_GT(covered.pixels, 2000);
      EXPECT_EQ(covered.holes, 0) << tolerance << " pixels";
    }
}

// Seen aslant, cells of different levels leave cracks, through which there is nothing to see.
TEST_F(HlodSceneTest, pixelsWithinTheModelAreWhollyCovered) {
  base::ViewCamera view;
  view.position = {1.2, 0.2, 0.5};
  view.direction = glm::normalize(glm::dvec3(-1.0, -0.1, -0.6));
  view.width = view.height = 160;
  const base::Camera aslant = base::cameraForScene(view, glm::dvec3(0.0), {glm::vec3(0.0F), 1.5F});
  HlodOptions options;
  options.supersampling = 4;
  for (const float tolerance : {0.5F, 2.0F, 8.0F}) {
    options.tolerance = tolerance;
    const auto picture = renderer().render(aslant, options);
    ASSERT_TRUE(picture) << picture.error().message;
    int open = 0;
    for (int y = 60; y < 140; ++y)
      for (int x = 40; x < 120; ++x) open += picture->rgba.at(x, y)[3] < 255 ? 1 : 0;
    EXPECT_EQ(open, 0) << tolerance;
  }
}

TEST_F(HlodSceneTest, aLargerToleranceDrawsFewer) {
  HlodScene& scene = renderer();
  HlodOptions options;
  const auto fine = scene.render(camera(640, 480), options);
  options.tolerance = 64.0F;
  const auto coarse = scene.render(camera(640, 480), options);
  ASSERT_TRUE(fine && coarse);
  EXPECT_GT(fine->count.triangles, 2 * coarse->count.triangles);
  EXPECT_GT(coarse->count.points, 0U);
  EXPECT_GT(coarse->count.lines, 0U);
}

TEST_F(HlodSceneTest, aPictureWithinTheToleranceIsNearToThatOfTheLeaves) {
  HlodOptions options;
  options.tolerance = 1e-6F;
  options.supersampling = 4;
  const auto leaves = renderer().render(camera(120, 90, 4.0), options);
  options.tolerance = 0.5F;
  const auto usual = renderer().render(camera(120, 90, 4.0), options);
  ASSERT_TRUE(leaves && usual);
  EXPECT_GT(leaves->count.triangles, 2 * usual->count.triangles);
  EXPECT_LT(support::shareDifferent(leaves->rgba, usual->rgba), 0.02);
}

TEST_F(HlodSceneTest, aDamagedFileIsAnErrorThatNamesIt) {
  const base::Bytes whole = made_.file;
  made_.file[20] ^= 4;
  const auto header = open();
  ASSERT_FALSE(header);
  EXPECT_NE(header.error().message.find("hlod.lgh"), std::string::npos) << header.error().message;
  EXPECT_EQ(header.error().code, base::ErrorCode::kInvalidInput);

  made_.file = whole;
  for (std::size_t i = made_.nodes.front().picture.offset; i < made_.file.size(); i += 50) made_.file[i] ^= 4;
  auto opened = open();  // the root may be read with the header
  const auto picture = opened ? (*opened)->render(camera(120, 90), {}) : base::Result<HlodPicture>(opened.error());
  ASSERT_FALSE(picture);
  EXPECT_NE(picture.error().message.find("hlod.lgh"), std::string::npos) << picture.error().message;
  EXPECT_EQ(picture.error().message.find('\n'), std::string::npos);
}

TEST_F(HlodSceneTest, refusesInvalidSizesAndOptions) {
  HlodScene& scene = renderer();
  EXPECT_FALSE(scene.render(camera(40000, 90), {}));
  HlodOptions options;
  options.supersampling = 9;
  EXPECT_FALSE(scene.render(camera(120, 90), options));
  options = {};
  options.tolerance = 0.0F;
  EXPECT_FALSE(scene.render(camera(120, 90), options));
}

TEST_F(HlodSceneTest, aSceneWithoutSaysHowToBuildThem) {
  const auto made = HlodScene::create(directory_ / "nowhere", {});
  ASSERT_FALSE(made);
  EXPECT_EQ(made.error().code, base::ErrorCode::kNotFound);
  EXPECT_NE(made.error().message.find("--methods hlod"), std::string::npos) << made.error().message;
}

}  // namespace
}  // namespace server
