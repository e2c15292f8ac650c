#include "lod/draw/triangles.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>

#include "base/egl/headless.h"

namespace lod::draw {
namespace {

constexpr int kSize = 8;

constexpr const char* kVertex = R"(
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 color;
out vec3 v_normal;
out vec3 v_color;
void main() {
  v_normal = normal;
  v_color = color.rgb;
  gl_Position = vec4(position, 1.0);
}
)";
// The eye looks from +z, as if from far away.
constexpr const char* kFragment = R"(
in vec3 v_normal;
in vec3 v_color;
layout(location = 0) out vec4 out_color;
void main() { out_color = vec4(shadeSurface(v_color, v_normal, vec3(0.0, 0.0, 1.0)), 1.0); }
)";

// A lattice of step 1/4 from −1 on: coordinates 0..8 cover clip space.
lod::Lattice clipLattice() {
  return {glm::dvec3(-1.0), 0.25};
}

patch::PatchGeometry halfSquare(bool left, const glm::vec3& normal) {
  const int x = left ? 0 : 4;
  patch::PatchGeometry geometry;
  geometry.positions = {{x, 0, 4}, {x + 4, 0, 4}, {x + 4, 8, 4}, {x, 8, 4}};
  geometry.normals.assign(4, normal);
  geometry.indices = {0, 1, 2, 0, 2, 3};
  return geometry;
}

class TrianglesTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
    auto program = base::gl::Program::link("triangles test", kVertex, shadingSource() + kFragment);
    ASSERT_TRUE(program) << program.error().message;
    program_ = std::move(*program);
    auto target = base::gl::RenderTarget::create(kSize, kSize);
    ASSERT_TRUE(target);
    target_ = std::move(*target);
  }
  void TearDown() override {
    EXPECT_EQ(base::gl::takeError(), "");
    program_ = {};
    target_ = {};
  }

  base::Image picture(const PatchMeshes& meshes, std::span<const std::uint32_t> patches, const Shading& shading) {
    setShading(program_, shading);
    target_.bind();
    glDisable(GL_CULL_FACE);
    glClearColor(0, 0, 0, 0);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    meshes.draw(patches);
    return target_.read();
  }
  int shade(const glm::vec3& normal, const Shading& shading) {
    PatchMeshes meshes(clipLattice());
    meshes.upload(0, halfSquare(true, normal));
    return picture(meshes, std::array{0U}, shading).at(1, 1)[0];
  }

  std::unique_ptr<base::HeadlessContext> context_;
  base::gl::Program program_;
  base::gl::RenderTarget target_;
};

TEST_F(TrianglesTest, onlyThePatchesAskedForAreDrawn) {
  PatchMeshes meshes(clipLattice());
  meshes.upload(7, halfSquare(true, {0, 0, 1}));
  meshes.upload(9, halfSquare(false, {0, 0, 1}));
  const base::Image left = picture(meshes, std::array{7U}, {true, {}});
  EXPECT_EQ(left.at(1, 4)[3], 255);
  EXPECT_EQ(left.at(6, 4)[3], 0);
  const base::Image both = picture(meshes, std::array{9U, 7U}, {true, {}});
  EXPECT_EQ(both.at(1, 4)[3], 255);
  EXPECT_EQ(both.at(6, 4)[3], 255);
}

TEST_F(TrianglesTest, unlitShowsColoursExactlyAndWhiteWhereThereAreNone) {
  PatchMeshes meshes(clipLattice());
  patch::PatchGeometry colored = halfSquare(true, {0, 0, 1});
  colored.colors.assign(4, {10, 128, 253, 255});
  meshes.upload(0, colored);
  meshes.upload(1, halfSquare(false, {0, 0, 1}));
  const base::Image image = picture(meshes, std::array{0U, 1U}, {true, {}});
  EXPECT_EQ(image.at(2, 2)[0], 10);
  EXPECT_EQ(image.at(2, 2)[1], 128);
  EXPECT_EQ(image.at(2, 2)[2], 253);
  EXPECT_EQ(image.at(6, 2)[0], 255);
}

TEST_F(TrianglesTest, softLightIsFullTowardsTheLightAndNeverBlack) {
  const Shading from_front{false, {0, 0, 1}};
  const Shading from_behind{false, {0, 0, -1}};
  EXPECT_EQ(shade({0, 0, 1}, from_front), 255);
  EXPECT_NEAR(shade({0, 0, 1}, from_behind), 0.15 * 255, 1);
  // Across the light: half-Lambert gives 0.15 + 0.85 / 4.
  EXPECT_NEAR(shade({0, 0, 1}, {false, {1, 0, 0}}), (0.15 + 0.85 * 0.25) * 255, 1);
}

TEST_F(TrianglesTest, normalThatPointsAwayFromTheEyeIsTurned) {
  const Shading shading{false, {0.6F, 0.0F, 0.8F}};
  EXPECT_EQ(shade({0, 0, -1}, shading), shade({0, 0, 1}, shading));
  EXPECT_NE(shade({0, 0, -1}, shading), shade({0, 0, -1}, {false, {0.6F, 0.0F, -0.8F}}));
}

TEST_F(TrianglesTest, lengthOfTheLightDirectionDoesNotMatter) {
  EXPECT_EQ(shade({0, 0, 1}, {false, {0, 0, 5}}), shade({0, 0, 1}, {false, {0, 0, 1}}));
}

TEST_F(TrianglesTest, normalOfLengthZeroIsShadedLikeOneTowardsTheEye) {
  EXPECT_EQ(shade({0, 0, 0}, {false, {0, 0, 1}}), 255);
}

TEST_F(TrianglesTest, gpuBytesCountWhatIsUploadedAndComeBackOnRemoval) {
  PatchMeshes meshes(clipLattice());
  EXPECT_EQ(meshes.gpuBytes(), 0U);
  meshes.upload(3, halfSquare(true, {0, 0, 1}));
  EXPECT_EQ(meshes.gpuBytes(), 4U * 20U + 6U * 2U);
  EXPECT_EQ(meshes.gpuBytes(), PatchMeshes::bytesFor(4, 2));
  EXPECT_TRUE(meshes.contains(3));
  EXPECT_EQ(meshes.triangles(3), 2U);

  meshes.upload(3, halfSquare(false, {0, 0, 1}));  // again: replaces
  EXPECT_EQ(meshes.gpuBytes(), 4U * 20U + 6U * 2U);
  EXPECT_EQ(meshes.size(), 1U);
  meshes.remove(3);
  meshes.remove(3);
  EXPECT_EQ(meshes.gpuBytes(), 0U);
  EXPECT_FALSE(meshes.contains(3));
}

TEST_F(TrianglesTest, boxIsThatOfTheLatticePoints) {
  PatchMeshes meshes(clipLattice());
  meshes.upload(0, halfSquare(false, {0, 0, 1}));
  EXPECT_EQ(meshes.box(0).min, glm::vec3(0, -1, 0));
  EXPECT_EQ(meshes.box(0).max, glm::vec3(1, 1, 0));
}

// Two patches share the edge x = 0: every pixel is drawn once, by one of them or the other.
TEST_F(TrianglesTest, sharedBordersNeitherGapNorOverlap) {
  PatchMeshes meshes(clipLattice());
  meshes.upload(0, halfSquare(true, {0, 0, 1}));
  meshes.upload(1, halfSquare(false, {0, 0, 1}));
  setShading(program_, {true, {}});
  target_.bind();
  glClearColor(0, 0, 0, 0);
  glClear(GL_COLOR_BUFFER_BIT);
  glEnable(GL_BLEND);
  glBlendFunc(GL_CONSTANT_ALPHA, GL_ONE);  // each layer adds 1/4 of white
  glBlendColor(0, 0, 0, 0.25F);
  meshes.draw(std::array{0U, 1U});
  glDisable(GL_BLEND);
  const base::Image image = target_.read();
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) EXPECT_NEAR(image.at(x, y)[0], 64, 1) << x << ", " << y;
}

}  // namespace
}  // namespace lod::draw
