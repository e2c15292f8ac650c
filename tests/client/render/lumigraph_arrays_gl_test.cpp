// How many images of which sizes there is room for.
#include "client/render/pixel_blend.h"
#include "tests/client/render/lumigraph_fixture.h"

namespace {

using namespace testing_scene;  // NOLINT: only these tests use it

class Arrays : public Lumigraph {};

/// Bytes of a layer: colours with all mip levels, and depth.
constexpr std::uint64_t bytesOfLayer(std::uint64_t side) {
  std::uint64_t bytes = 4 * side * side;
  for (; side >= 1; side /= 2) bytes += 4 * side * side;
  return bytes;
}
constexpr std::uint64_t kLayer = bytesOfLayer(kFace);

TEST_F(Arrays, layersBeyondTheBudgetAreRefused) {
  makeBall();
  renderer_ = make(2 * kLayer + 100);
  const base::Image image(kFace, kFace, 4);
  const base::Camera camera = cubeCameras(kEye, kFace)[0];
  EXPECT_TRUE(renderer_->addSample(0, camera, image, 0.0));
  EXPECT_TRUE(renderer_->addSample(1, camera, image, 0.0));
  EXPECT_FALSE(renderer_->addSample(2, camera, image, 0.0));
  renderer_->removeSample(0);
  EXPECT_TRUE(renderer_->addSample(2, camera, image, 0.0));
  cut_.clear();
  draw(lookAt(kEye, glm::vec3(0.0F), 32, 32, 50.0F));
  // Beside the layers: the uniform block, a pixel of colour and of depth that stand where there is no array, and one of
  // what PixelBlend keeps.
  EXPECT_EQ(renderer_->stats().gpu_bytes, 2 * kLayer + 96 * 160 + 8 + client::PixelBlend::bytesOf(1, 1));
}

TEST_F(Arrays, countsWhatGlCountsAndStaysBelowTheBudget) {
  const base::Camera camera = cubeCameras(kEye, kFace)[0];
  const std::uint64_t before = base::gl::heldBytes().textures;
  for (const std::uint64_t layers : {3U, 20U, 50U}) {
    renderer_ = make(layers * kLayer);
    base::gl::resetPeak();
    SampleId added = 0;
    while (renderer_->addSample(added, camera, base::Image(kFace, kFace, 4), 0.0)) ++added;
    EXPECT_GE(added, layers / 2) << "of " << layers;
    EXPECT_LE(base::gl::peakHeldBytes(),
              base::gl::heldBytes().total() - renderer_->heldBytes().textures + layers * kLayer + 8);
    EXPECT_EQ(renderer_->heldBytes().textures, base::gl::heldBytes().textures - before + 8)
        << "the first renderer's two pixels";
  }
}

TEST_F(Arrays, facesLeaveOtherSizesTheirShare) {
  const base::Camera camera = cubeCameras(kEye, kFace)[0];
  auto made = LumigraphRenderer::create(kLattice, kFace, 6 * kLayer, 2 * kLayer);
  ASSERT_TRUE(made);
  renderer_ = std::move(made.value());
  SampleId added = 0;
  while (renderer_->addSample(added, camera, base::Image(kFace, kFace, 4), 0.0)) ++added;
  EXPECT_EQ(added, 4U);
  EXPECT_TRUE(renderer_->addSample(100, camera, base::Image(kFace - 2, kFace - 2, 4), 0.0));
}

TEST_F(Arrays, twoOtherSizesLeaveEachOtherHalf) {
  const base::Camera camera = cubeCameras(kEye, kFace)[0];
  const std::uint64_t share = 12ULL * kFace * kFace * 10;
  auto made = LumigraphRenderer::create(kLattice, kFace, 2 * share, share);
  ASSERT_TRUE(made);
  renderer_ = std::move(made.value());
  SampleId added = 0;
  while (renderer_->addSample(added, camera, base::Image(kFace, kFace, 4), 0.0)) ++added;
  for (const int side : {kFace - 2, kFace - 4}) {
    const SampleId before = added;
    while (renderer_->addSample(added, camera, base::Image(side, side, 4), 0.0)) ++added;
    EXPECT_GE(added, before + 2) << side;
  }
}

TEST_F(Arrays, threeImageSizesFitAndAFourthIsRefusedUntilOneIsEmpty) {
  const base::Camera camera = cubeCameras(kEye, kFace)[0];
  EXPECT_TRUE(renderer_->addSample(0, camera, base::Image(kFace, kFace, 4), 0.0));
  EXPECT_TRUE(renderer_->addSample(1, camera, base::Image(64, 36, 4), 0.0));
  EXPECT_TRUE(renderer_->addSample(2, camera, base::Image(80, 45, 4), 0.0));
  EXPECT_FALSE(renderer_->addSample(3, camera, base::Image(96, 54, 4), 0.0));
  renderer_->removeSample(1);
  EXPECT_TRUE(renderer_->addSample(3, camera, base::Image(96, 54, 4), 0.0));
  EXPECT_FALSE(renderer_->addSample(4, camera, base::Image(96, 54, 3), 0.0)) << "coverage is missing";
}

}  // namespace
