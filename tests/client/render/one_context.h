#pragma once
// Tests that draw, of which all of a suite share one GL context.
#include <gtest/gtest.h>

#include <memory>
#include <utility>

#include "base/egl/headless.h"

namespace testing_scene {

class OneContext : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    auto made = base::HeadlessContext::create();
    ASSERT_TRUE(made) << made.error().message;
    context_ = std::move(made.value());
  }
  static void TearDownTestSuite() { context_.reset(); }

 private:
  static inline std::unique_ptr<base::HeadlessContext> context_;
};

}  // namespace testing_scene
