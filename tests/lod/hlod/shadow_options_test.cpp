#include "lod/hlod/shadow_options.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace lod::hlod {
namespace {

ShadowArguments argumentsOf(const std::string& shadows, std::vector<double> direction = {},
                            std::vector<double> position = {}, std::optional<double> size = std::nullopt) {
  return {{std::move(direction), std::move(position), size}, shadows};
}

TEST(ShadowOptions, contradictionsAreNamed) {
  const std::vector<double> up{0.0, 0.0, 1.0}, zero{0.0, 0.0, 0.0};
  const std::vector<double> endless{std::numeric_limits<double>::infinity(), 0.0, 0.0};
  for (const auto& [arguments, named] : {std::pair(argumentsOf("none", up), "--shadows"),
                                         {argumentsOf("none", {}, {}, 1.0), "--light-size"},
                                         {argumentsOf("hard", up, up), "two lights"},
                                         {argumentsOf("hard", zero), "nowhere"},
                                         {argumentsOf("hard", {}, {0.0, 2e12, 0.0}), "too far away"},
                                         {argumentsOf("soft", endless), "finite"},
                                         {argumentsOf("hard", up, {}, 1.0), "--shadows soft"},
                                         {argumentsOf("soft", {}, up), "--light-size"},
                                         {argumentsOf("soft", up, {}, 0.0), "above 0"},
                                         {argumentsOf("soft", up, {}, 121.0), "120 degrees"},
                                         {argumentsOf("soft", {}, up, -1.0), "above 0"},
                                         {argumentsOf("mild"), "none, hard or soft"}}) {
    const std::string problem = shadowProblem(arguments, true);
    EXPECT_NE(problem.find(named), std::string::npos) << named << ": " << problem;
    EXPECT_EQ(problem.find('\n'), std::string::npos);
  }
  EXPECT_NE(shadowProblem(argumentsOf("hard"), false).find("--method hlod"), std::string::npos);
  EXPECT_EQ(shadowProblem(argumentsOf("none"), false), "");
  const ShadowWords words{"--light any", "--light soft", "a and b"};
  EXPECT_NE(lightProblem(argumentsOf("none", up), Shadows::kNone, words).find("--light any"), std::string::npos);
  EXPECT_NE(lightProblem(argumentsOf("hard", up, {}, 1.0), Shadows::kHard, words).find("--light soft"),
            std::string::npos);
}

TEST(ShadowOptions, theLightIsThatOfTheSceneUnlessOneIsGiven) {
  const auto lightOf = [&](const ShadowArguments& arguments) {
    EXPECT_EQ(shadowProblem(arguments, true), "");
    return hlod::lightOf(arguments, {0.0F, 0.6F, 0.8F}, {1000.0, 2000.0, 30.0});
  };
  const auto sun = lightOf(argumentsOf("soft"));
  EXPECT_NEAR(sun.place.y, 0.6F, 1e-6F);
  EXPECT_EQ(sun.place.w, 0.0F);
  EXPECT_NEAR(sun.size, 0.00925F, 1e-4F);
  const auto tilted = lightOf(argumentsOf("hard", {3.0, 0.0, 4.0}));
  EXPECT_NEAR(tilted.place.x, 0.6F, 1e-6F);
  EXPECT_NEAR(tilted.place.z, 0.8F, 1e-6F);
  const auto lamp = lightOf(argumentsOf("soft", {}, {1001.0, 2002.0, 33.0}, 0.5));
  EXPECT_EQ(lamp.place, glm::vec4(1.0F, 2.0F, 3.0F, 1.0F));
  EXPECT_EQ(lamp.size, 0.5F);
}

}  // namespace
}  // namespace lod::hlod
