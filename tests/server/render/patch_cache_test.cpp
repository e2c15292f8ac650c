#include "server/render/patch_cache.h"

#include <gtest/gtest.h>

#include <initializer_list>
#include <vector>

#include "base/egl/headless.h"
#include "tests/server/render/two_level_scene.h"

namespace server {
namespace {

constexpr const char* kVertex =
    "layout(location = 0) in vec3 position; void main() { gl_Position = vec4(position, 1.0); }";
constexpr const char* kFragment = "layout(location = 0) out vec4 out_color; void main() { out_color = vec4(1.0); }";

// Four leaves of one triangle each (patches 1 to 4): all take the same bytes.
class PatchCacheTest : public testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
    auto program = base::gl::Program::link("cache test", kVertex, kFragment);
    ASSERT_TRUE(program) << program.error().message;
    program_ = std::move(*program);
    program_.use();
  }
  void TearDown() override { program_ = {}; }

  static std::vector<test::Triangle> one(float x) { return {{{x, 0, 0}, {x + 1, 0, 0}, {x, 1, 0}}}; }

  bool draw(PatchCache& cache, std::initializer_list<std::uint32_t> patches) {
    std::vector<DrawnPatch> drawn;
    for (const std::uint32_t patch : patches) drawn.push_back({patch});
    return static_cast<bool>(
        cache.draw(drawn, [this](SurfaceKind, std::uint32_t) -> const base::gl::Program& { return program_; }));
  }

  std::unique_ptr<base::HeadlessContext> context_;
  base::gl::Program program_;
  test::TwoLevelScene scene_{one(0), {one(1), one(2), one(3), one(4)}, 0.5F};
  std::uint64_t patch_bytes_ = lod::draw::PatchMeshes::bytesFor(3, 1);
};

TEST_F(PatchCacheTest, doesNotUploadCachedPatchesAgain) {
  PatchCache cache(scene_.file(), nullptr, 100 * patch_bytes_);
  ASSERT_TRUE(draw(cache, {1U, 2U, 3U}));
  ASSERT_TRUE(draw(cache, {2U, 3U, 4U}));
  EXPECT_EQ(cache.uploads(), 4U);
  EXPECT_EQ(cache.gpuBytes(), 4 * patch_bytes_);
}

TEST_F(PatchCacheTest, leastRecentlyUsedGoesFirst) {
  PatchCache cache(scene_.file(), nullptr, 2 * patch_bytes_);
  ASSERT_TRUE(draw(cache, {1U}));
  ASSERT_TRUE(draw(cache, {2U}));
  ASSERT_TRUE(draw(cache, {1U}));  // 2 is the oldest now
  ASSERT_TRUE(draw(cache, {3U}));
  EXPECT_EQ(cache.uploads(), 3U);
  ASSERT_TRUE(draw(cache, {1U}));
  EXPECT_EQ(cache.uploads(), 3U);
  ASSERT_TRUE(draw(cache, {2U}));
  EXPECT_EQ(cache.uploads(), 4U);
}

TEST_F(PatchCacheTest, budgetHoldsWhateverIsDrawn) {
  PatchCache cache(scene_.file(), nullptr, 3 * patch_bytes_ - 1);
  for (int round = 0; round < 3; ++round) {
    ASSERT_TRUE(draw(cache, {1U, 2U, 3U, 4U, 0U}));
    EXPECT_LE(cache.gpuBytes(), 3 * patch_bytes_ - 1);
  }
}

TEST_F(PatchCacheTest, onePatchIsDrawnEvenWithoutAnyBudget) {
  PatchCache cache(scene_.file(), nullptr, 0);
  ASSERT_TRUE(draw(cache, {1U, 2U}));
  ASSERT_TRUE(draw(cache, {2U}));  // still there: it is the one that may stay
  EXPECT_EQ(cache.uploads(), 2U);
  EXPECT_EQ(cache.gpuBytes(), patch_bytes_);
}

TEST_F(PatchCacheTest, residentPatchOfALaterBatchMayHaveToReturn) {
  PatchCache cache(scene_.file(), nullptr, 2 * patch_bytes_);
  ASSERT_TRUE(draw(cache, {3U, 4U}));
  ASSERT_TRUE(draw(cache, {1U, 2U, 3U, 4U}));
  EXPECT_LE(cache.gpuBytes(), 2 * patch_bytes_);
}

}  // namespace
}  // namespace server
