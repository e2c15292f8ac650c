#include "server/render/splat_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>

#include "base/egl/headless.h"
#include "base/gl/gl.h"
#include "tests/support/compared_pictures.h"
#include "tests/support/splat_tree.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"

namespace server {
namespace {

class SplatSceneTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
    bytes_ = support::splatFile(support::torus(120, 60));
  }
  void TearDown() override {
    renderer_.reset();
    EXPECT_EQ(base::gl::takeError(), "");
  }

  /// Creates a renderer for the file as it is now.
  SplatScene& renderer() {
    std::ofstream(directory_ / "qsplat.lgq", std::ios::binary)
        .write(reinterpret_cast<const char*>(bytes_.data()), static_cast<std::streamsize>(bytes_.size()));
    base::Scene scene;
    scene.light.mode = base::LightMode::kUnlit;
    auto file = openSplats(directory_.path(), scene);
    EXPECT_TRUE(file) << file.error().message;
    file_ = std::move(*file);
    auto made = SplatScene::create(scene, file_);
    EXPECT_TRUE(made) << made.error().message;
    renderer_ = std::move(*made);
    return *renderer_;
  }

  static base::Camera camera(int width, int height) {
    base::ViewCamera view;
    view.position = {2.5, 1.0, 2.0};
    view.direction = glm::normalize(-view.position);
    view.up = {0, 0, 1};
    view.width = width;
    view.height = height;
    return base::cameraForScene(view, glm::dvec3(0.0), {glm::vec3(0.0F), 1.5F});
  }

  const support::TemporaryDirectory directory_;
  std::unique_ptr<base::HeadlessContext> context_;
  base::Bytes bytes_;
  lod::qsplat::SplatFile file_;
  std::unique_ptr<SplatScene> renderer_;
};

TEST_F(SplatSceneTest, aPictureInTilesIsThatInOne) {
  for (const auto kernel : {lod::draw::SplatKernel::kSquare, lod::draw::SplatKernel::kFuzzy}) {
    SplatOptions options;
    options.kernel = kernel;
    options.supersampling = 2;
    auto whole = renderer().render(camera(150, 90), options);
    ASSERT_TRUE(whole) << whole.error().message;
    options.max_target_samples = 5000;
    auto tiled = renderer().render(camera(150, 90), options);
    ASSERT_TRUE(tiled) << tiled.error().message;
    EXPECT_LT(support::shareDifferent(whole->rgba, tiled->rgba), 0.01);
    EXPECT_GT(tiled->splats, whole->splats) << "some belong to several tiles";
  }
}

TEST_F(SplatSceneTest, colourIsNotDarkenedAtSoftEdges) {
  SplatOptions options;
  options.supersampling = 4;
  options.kernel = lod::draw::SplatKernel::kFuzzy;
  auto picture = renderer().render(camera(120, 90), options);
  ASSERT_TRUE(picture) << picture.error().message;
  int soft = 0;
  for (std::size_t i = 0; i < picture->rgba.pixels.size(); i += 4) {
    const std::uint8_t* pixel = &picture->rgba.pixels[i];
    if (pixel[3] < 20 || pixel[3] > 235) continue;
    ++soft;
    EXPECT_NEAR(pixel[2], 60, 12) << "blue is the same all over the ring";
  }
  EXPECT_GT(soft, 50);
}

TEST_F(SplatSceneTest, blocksAreCountedOnceAndFewerWhereLessIsSeen) {
  SplatScene& scene = renderer();
  SplatOptions coarse;
  coarse.cutoff_px = 30.0F;
  auto first = scene.render(camera(120, 90), coarse);
  ASSERT_TRUE(first);
  auto again = scene.render(camera(120, 90), coarse);
  ASSERT_TRUE(again);
  EXPECT_EQ(again->blocks, first->blocks);
  auto fine = scene.render(camera(120, 90), {});
  ASSERT_TRUE(fine);
  EXPECT_GT(fine->blocks, first->blocks);
  EXPECT_GT(fine->splats, 4 * first->splats);
  EXPECT_LT(fine->blocks, file_.header().blocks());
}

TEST_F(SplatSceneTest, backFacesAreLeftOutUnlessAskedFor) {
  SplatOptions options;
  auto culled = renderer().render(camera(120, 90), options);
  options.cull_back_faces = false;
  auto all = renderer().render(camera(120, 90), options);
  ASSERT_TRUE(culled && all);
  EXPECT_GT(static_cast<double>(all->splats), 1.4 * static_cast<double>(culled->splats));
  EXPECT_LT(support::shareDifferent(culled->rgba, all->rgba), 0.02) << "a closed surface looks the same";
}

TEST_F(SplatSceneTest, aDamagedBlockIsAnErrorThatNamesIt) {
  bytes_[3 * lod::qsplat::kBlockBytes + 17] ^= 4;
  SplatOptions options;
  options.cutoff_px = 0.0F;
  options.cull_back_faces = false;
  auto picture = renderer().render(camera(120, 90), options);
  ASSERT_FALSE(picture);
  EXPECT_NE(picture.error().message.find("block 3"), std::string::npos) << picture.error().message;
  EXPECT_EQ(picture.error().code, base::ErrorCode::kInvalidInput);
}

TEST_F(SplatSceneTest, refusesInvalidSizesAndOptions) {
  SplatScene& scene = renderer();
  EXPECT_FALSE(scene.render(camera(40000, 90), {}));
  SplatOptions options;
  options.supersampling = 9;
  EXPECT_FALSE(scene.render(camera(120, 90), options));
  options = {};
  options.cutoff_px = -1.0F;
  EXPECT_FALSE(scene.render(camera(120, 90), options));
}

TEST_F(SplatSceneTest, aSceneWithoutSplatsSaysHowToBuildThem) {
  const auto file = openSplats(directory_ / "nowhere", {});
  ASSERT_FALSE(file);
  EXPECT_EQ(file.error().code, base::ErrorCode::kNotFound);
  EXPECT_NE(file.error().message.find("--methods qsplat"), std::string::npos) << file.error().message;
}

}  // namespace
}  // namespace server
