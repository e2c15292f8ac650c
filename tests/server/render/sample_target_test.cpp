#include "server/render/sample_target.h"

#include <gtest/gtest.h>

#include "base/egl/headless.h"

namespace server {
namespace {

base::Image readPixels(GLuint framebuffer, int width, int height) {
  base::Image image(width, height, 4);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer);
  glReadPixels(0, 0, width, height, GL_RGBA, GL_UNSIGNED_BYTE, image.pixels.data());
  return image;
}

void fill(int x, int y, int width, int height, float red, float green) {
  glEnable(GL_SCISSOR_TEST);
  glScissor(x, y, width, height);
  glClearColor(red, green, 0.0F, 1.0F);
  glClear(GL_COLOR_BUFFER_BIT);
  glDisable(GL_SCISSOR_TEST);
}

// 2 × 1 pixels of 2 × 2 samples (rows from the bottom):   . . | G R
//                                                         R . | R R
TEST(SampleTarget, resolveAveragesCoveredSamplesAndAlphaIsTheCoveredShare) {
  const auto context = base::HeadlessContext::create();
  ASSERT_TRUE(context) << context.error().message;
  const auto pass = ResolvePass::create();
  ASSERT_TRUE(pass) << pass.error().message;
  const auto target = SampleTarget::create(2, 1, 2);
  ASSERT_TRUE(target) << target.error().message;
  target->begin();
  fill(0, 0, 1, 1, 0.8F, 0.4F);
  fill(2, 0, 2, 2, 1.0F, 0.0F);
  fill(2, 1, 1, 1, 0.0F, 1.0F);
  const base::Image image = readPixels(target->resolve(*pass), 2, 1);
  EXPECT_EQ(base::gl::takeError(), "");

  // One sample of four is covered: the pixel has its colour and a quarter of the opacity.
  EXPECT_EQ(image.at(0, 0)[0], 204);
  EXPECT_EQ(image.at(0, 0)[1], 102);
  EXPECT_EQ(image.at(0, 0)[3], 64);
  // All four samples are covered, three in red and one in green.
  EXPECT_EQ(image.at(1, 0)[0], 191);
  EXPECT_EQ(image.at(1, 0)[1], 64);
  EXPECT_EQ(image.at(1, 0)[3], 255);
}

TEST(SampleTarget, pixelWithoutASampleIsTransparentBlack) {
  const auto context = base::HeadlessContext::create();
  ASSERT_TRUE(context);
  const auto pass = ResolvePass::create();
  const auto target = SampleTarget::create(3, 3, 8);
  ASSERT_TRUE(pass);
  ASSERT_TRUE(target);
  target->begin();
  const base::Image image = readPixels(target->resolve(*pass), 3, 3);
  EXPECT_EQ(image.pixels, std::vector<std::uint8_t>(36, 0));
}

}  // namespace
}  // namespace server
