#include "base/egl/headless.h"

#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <thread>

#include "base/gl/gl.h"

namespace base {
namespace {

// A fresh target, cleared to the colour, read back.
Image clearedTo(float red, float green) {
  auto target = gl::RenderTarget::create(8, 8);
  if (!target) return {};
  target->bind();
  glClearColor(red, green, 0.0F, 1.0F);
  glClear(GL_COLOR_BUFFER_BIT);
  return target->read();
}

TEST(HeadlessContext, isGles3AndNamesItsRenderer) {
  const auto context = HeadlessContext::create();
  ASSERT_TRUE(context) << context.error().message;
  GLint major = 0;
  glGetIntegerv(GL_MAJOR_VERSION, &major);
  EXPECT_GE(major, 3);
  EXPECT_FALSE((*context)->renderer().empty());
}

TEST(HeadlessContext, softwareOnRequestIsLlvmpipeOrItsLike) {
  const char* before = std::getenv("LUMIGRID_GL");
  const std::string saved = before != nullptr ? before : "";
  ::setenv("LUMIGRID_GL", "software", 1);
  const auto context = HeadlessContext::create();
  if (before != nullptr) {
    ::setenv("LUMIGRID_GL", saved.c_str(), 1);
  } else {
    ::unsetenv("LUMIGRID_GL");
  }
  if (!context) GTEST_SKIP() << "no software GL here: " << context.error().message;
  const std::string name = (*context)->renderer();
  EXPECT_TRUE(name.find("llvmpipe") != std::string::npos || name.find("softpipe") != std::string::npos) << name;
  EXPECT_TRUE((*context)->isSoftware());
}

TEST(HeadlessContext, releasedContextCanGoOnUnderAnotherThread) {
  auto context = HeadlessContext::create();
  ASSERT_TRUE(context);
  (*context)->release();
  EXPECT_EQ(glGetString(GL_VERSION), nullptr);
  Image image;
  std::thread([&] {
    (*context)->makeCurrent();
    image = clearedTo(0.0F, 1.0F);
    (*context)->release();
  }).join();
  ASSERT_FALSE(image.empty());
  EXPECT_EQ(image.at(0, 0)[1], 255);
}

TEST(HeadlessContext, contextsOnTwoThreadsDrawWithoutDisturbingEachOther) {
  std::array<bool, 2> good{};
  const auto work = [&](std::size_t which) {
    auto context = HeadlessContext::create();
    if (!context) return;
    bool all = true;
    for (int i = 0; i < 50; ++i) {
      const Image image = clearedTo(which == 0 ? 1.0F : 0.0F, which == 1 ? 1.0F : 0.0F);
      all = all && !image.empty() && image.at(7, 7)[which] == 255 && image.at(7, 7)[1 - which] == 0;
    }
    good[which] = all && gl::takeError().empty();
  };
  std::thread first(work, 0);
  std::thread second(work, 1);
  first.join();
  second.join();
  EXPECT_TRUE(good[0]);
  EXPECT_TRUE(good[1]);
}

TEST(HeadlessContext, endOfOneContextLeavesTheOthersAlive) {
  auto first = HeadlessContext::create();
  ASSERT_TRUE(first);
  { ASSERT_TRUE(HeadlessContext::create()); }
  (*first)->makeCurrent();
  const Image image = clearedTo(1.0F, 0.0F);
  ASSERT_FALSE(image.empty());
  EXPECT_EQ(image.at(3, 3)[0], 255);
}

}  // namespace
}  // namespace base
