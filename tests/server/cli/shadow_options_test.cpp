#include "server/cli/render_command/shadow_options.h"

#include <gtest/gtest.h>

#include <optional>
#include <string>

#include "server/render/shadow_plans.h"

namespace server::cli {
namespace {

ShadowArguments argumentsOf(const std::string& shadows, const std::string& direction = "",
                            const std::string& position = "", std::optional<double> size = std::nullopt) {
  return {shadows, {direction, position, size}};
}

TEST(ShadowOptions, contradictionsAreNamed) {
  const std::string up = "0,0,1";
  for (const auto& [arguments, named] : {std::pair(argumentsOf("none", up), "--shadows"),
                                         {argumentsOf("", up), "--shadows"},
                                         {argumentsOf("none", "", "", 1.0), "--light-size"},
                                         {argumentsOf("hard", up, up), "two lights"},
                                         {argumentsOf("hard", "0,0,0"), "nowhere"},
                                         {argumentsOf("soft", "inf,0,0"), "three numbers"},
                                         {argumentsOf("soft", "1,2"), "three numbers"},
                                         {argumentsOf("soft", "1,2,3,4"), "three numbers"},
                                         {argumentsOf("hard", "", "1e13,0,0"), "too far away"},
                                         {argumentsOf("hard", up, "", 1.0), "--shadows soft"},
                                         {argumentsOf("soft", "", up), "--light-size"},
                                         {argumentsOf("soft", up, "", 0.0), "above 0"},
                                         {argumentsOf("soft", up, "", 121.0), "120 degrees"},
                                         {argumentsOf("soft", "", up, -1.0), "above 0"}}) {
    const std::string problem = shadowProblem(arguments, true);
    EXPECT_NE(problem.find(named), std::string::npos) << named << ": " << problem;
    EXPECT_EQ(problem.find('\n'), std::string::npos);
  }
  EXPECT_NE(shadowProblem(argumentsOf("hard"), false).find("--method full"), std::string::npos);
  EXPECT_EQ(shadowProblem(argumentsOf("none"), false), "");
}

TEST(ShadowOptions, theLightIsThatOfTheSceneUnlessOneIsGiven) {
  base::Scene scene;
  scene.origin = {1000.0, 2000.0, 30.0};
  scene.box_min = {999.0, 2000.0, 32.0};
  scene.box_max = {1003.0, 2002.0, 34.0};
  scene.light = {base::LightMode::kSoftShadows, {0.0F, 0.6F, 0.8F}, {}, 3.0};
  const auto shadowsFor = [&](const ShadowArguments& arguments) {
    EXPECT_EQ(shadowProblem(arguments, true), "");
    return shadowsOf(*lightOf(arguments, scene), scene.origin);
  };
  EXPECT_EQ(*lightOf(argumentsOf(""), scene), scene.light);
  EXPECT_EQ(*lightOf(argumentsOf("soft"), scene), scene.light);
  EXPECT_EQ(lightOf(argumentsOf("none"), scene)->mode, base::LightMode::kSoft);
  const auto sun = shadowsFor(argumentsOf("soft"));
  EXPECT_EQ(sun.shadows, Shadows::kSoft);
  EXPECT_NEAR(sun.light.place.y, 0.6F, 1e-6F);
  EXPECT_EQ(sun.light.place.w, 0.0F);
  EXPECT_NEAR(sun.light.size, 0.05236F, 1e-4F);
  const auto tilted = shadowsFor(argumentsOf("hard", "3,0,4"));
  EXPECT_EQ(tilted.shadows, Shadows::kHard);
  EXPECT_NEAR(tilted.light.place.x, 0.6F, 1e-6F);
  EXPECT_NEAR(tilted.light.place.z, 0.8F, 1e-6F);
  const auto lamp = argumentsOf("soft", "", "1001,2002,33", 0.5);
  EXPECT_EQ(shadowsFor(lamp).light.place, glm::vec4(1.0F, 2.0F, 3.0F, 1.0F));
  EXPECT_EQ(shadowsFor(lamp).light.size, 0.5F);
  const auto moved = shadowsFor(argumentsOf("soft", "3,0,4"));
  EXPECT_NEAR(moved.light.size, 0.00925F, 1e-4F) << "the sun's";
  // What shades places without images shines from there, too.
  EXPECT_LT(glm::length(lightOf(lamp, scene)->direction - glm::vec3(0.0F, 1.0F, 0.0F)), 1e-6F);
  scene.light = *lightOf(argumentsOf("hard", "", "1001,2002,33"), scene);
  const auto without_size = lightOf(argumentsOf("soft"), scene);
  ASSERT_FALSE(without_size);
  EXPECT_NE(without_size.error().message.find("--light-size"), std::string::npos);
}

}  // namespace
}  // namespace server::cli
