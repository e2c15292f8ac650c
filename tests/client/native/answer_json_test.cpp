#include "client/native/answer_json.h"

#include <gtest/gtest.h>

namespace client {
namespace {

base::Bytes bytes(const std::string& text) {
  return {text.begin(), text.end()};
}

TEST(PickAnswer, aHitHasPointNormalAndAccuracy) {
  const auto answer = parsePickAnswer(
      bytes(R"({"hit":true,"point":[500000.25,1,2],"normal":[0,0,1],"distance":3.5,"accuracy":0.001})"));
  ASSERT_TRUE(bool(answer)) << answer.error().message;
  EXPECT_EQ(answer->kind, PickAnswer::Kind::kHit);
  EXPECT_EQ(answer->point, glm::dvec3(500000.25, 1.0, 2.0));
  EXPECT_EQ(answer->accuracy, 0.001);
  EXPECT_EQ(parsePickAnswer(bytes(R"({"hit":false})"))->kind, PickAnswer::Kind::kNone);
}

TEST(PickAnswer, nonsenseIsAnError) {
  for (const char* text : {"", "[]", "{}", R"({"hit":1})", R"({"hit":true})",
                           R"({"hit":true,"point":[1,2],"normal":[0,0,1],"accuracy":0})",
                           R"({"hit":true,"point":[1,2,1e999],"normal":[0,0,1],"accuracy":0})",
                           R"({"hit":true,"point":[1,2,3],"normal":[0,0,1],"accuracy":-1})"})
    EXPECT_FALSE(bool(parsePickAnswer(bytes(text)))) << text;
  EXPECT_FALSE(bool(parsePickAnswer(bytes("{\"hit\":false}" + std::string(kMaxPickAnswer, ' ')))));
}

TEST(PickTarget, saysTheRayExactly) {
  EXPECT_EQ(pickTarget({500000.125, -2.0, 0.1}, {0.0, 0.0, -1.0}),
            "/pick?ox=500000.125&oy=-2&oz=0.10000000000000001&dx=0&dy=0&dz=-1");
}

}  // namespace
}  // namespace client
