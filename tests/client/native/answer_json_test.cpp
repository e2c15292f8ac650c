#include "client/native/answer_json.h"

#include <gtest/gtest.h>

namespace client {
namespace {

base::Bytes bytes(const std::string& text) {
  return {text.begin(), text.end()};
}

std::string complaint(const std::string& text) {
  const auto parsed = parseAnnotations(bytes(text), "annotations.json");
  return parsed ? "" : parsed.error().message;
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

TEST(Annotations, theDocumentsRowIsRead) {
  const auto notes = parseAnnotations(bytes(R"({"version": 1, "annotations": [
      {"position": [500004.1, 4000007.3, 103.2], "normal": [0, 0, 2], "title": "Crack", "text": "4 mm wide.\nSeen first in May.",
       "camera": {"position": [500006, 4000005, 105], "target": [500004.1, 4000007.3, 103.2], "up": [0, 0, 1]}},
      {"position": [1, 2, 3], "title": "Only a title", "author": "passed over"}]})"),
                                      "annotations.json");
  ASSERT_TRUE(bool(notes)) << notes.error().message;
  ASSERT_EQ(notes->size(), 2U);
  EXPECT_EQ((*notes)[0].position.x, 500004.1);
  EXPECT_EQ((*notes)[0].normal, glm::dvec3(0.0, 0.0, 1.0));
  EXPECT_EQ((*notes)[0].text, "4 mm wide.\nSeen first in May.");
  ASSERT_TRUE((*notes)[0].camera);
  EXPECT_NEAR(glm::length((*notes)[0].camera->direction), 1.0, 1e-12);
  EXPECT_FALSE((*notes)[1].camera);
}

TEST(Annotations, whatIsWrongIsNamedByNumberAndMember) {
  const auto one = [](const std::string& members) {
    return complaint(R"({"version":1,"annotations":[{"position":[1,2,3],"title":"fine"},{)" + members + "}]}");
  };
  EXPECT_NE(one(R"("title":"x")").find("annotation 1: position"), std::string::npos);
  EXPECT_NE(one(R"("position":[1,2,3])").find("annotation 1: title"), std::string::npos);
  EXPECT_NE(one(R"("position":[1,2,3],"title":7)").find("title"), std::string::npos);
  EXPECT_NE(one(R"("position":[1,2,3],"title":"x","text":[])").find("text"), std::string::npos);
  EXPECT_NE(one(R"("position":[1,2,3],"title":"x","normal":[0,1])").find("normal"), std::string::npos);
  EXPECT_NE(one(R"("position":[1,2,3],"title":"x","camera":{"position":[0,0,0]})").find("annotation 1: camera"),
            std::string::npos);
  EXPECT_NE(one(R"("position":[1,2,3],"title":"x\u0007")").find("title"), std::string::npos);
  for (const char* text : {"", "{}", "[]", R"({"version":2,"annotations":[]})", R"({"version":1})",
                           R"({"version":1,"annotations":{}})", R"({"version":1,"annotations":[7]})"})
    EXPECT_FALSE(complaint(text).empty()) << text;
}

TEST(Annotations, depthAndNumberAreBounded) {
  EXPECT_FALSE(complaint(R"({"version":1,"annotations":)" + std::string(100'000, '[')).empty());
  std::string many;
  for (std::size_t i = 0; i <= kMaxAnnotations; ++i)
    many += std::string(i == 0 ? "" : ",") + R"({"position":[1,2,3],"title":"x"})";
  EXPECT_NE(complaint(R"({"version":1,"annotations":[)" + many + "]}").find("500"), std::string::npos);
}

}  // namespace
}  // namespace client
