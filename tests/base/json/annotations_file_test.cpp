#include "base/json/annotations_file.h"

#include <gtest/gtest.h>

#include <string>

namespace base {
namespace {

Result<std::vector<Annotation>> parse(const std::string& text) {
  return parseAnnotations({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}, "notes");
}

/// How many notes the text holds.
Result<std::size_t> check(const std::string& text) {
  const auto notes = parse(text);
  return notes ? Result<std::size_t>(notes->size()) : notes.error();
}

std::string listOf(const std::string& notes) {
  return "{\"version\": 1, \"annotations\": [" + notes + "]}";
}

const std::string kMin = R"({"position": [1, 2, 3], "title": "t"})";

TEST(Annotations, exampleOfTheDocumentIsAccepted) {
  const auto notes = check(
      R"({"version": 1, "annotations": [
      {"position": [500004.1, 4000007.3, 103.2], "normal": [0, 0, 1],
       "title": "Crack", "text": "4 mm wide.\nSeen first in May.",
       "camera": {"position": [500006, 4000005, 105], "target": [500004.1, 4000007.3, 103.2], "up": [0, 0, 1]}}]})");
  ASSERT_TRUE(notes) << notes.error().message;
  EXPECT_EQ(*notes, 1U);
  EXPECT_EQ(*check(listOf("")), 0U);
  EXPECT_EQ(*check(listOf(kMin + ", " + kMin)), 2U);
  EXPECT_TRUE(
      check(R"({"version": 1, "annotations": [{"position": [1, 2, 3], "title": "Säule ☂", "more": 1}], "x": 2})"));
}

TEST(Annotations, notesAreReadAsWritten) {
  const auto notes = parse(R"({"version": 1, "annotations": [
      {"position": [500004.1, 4000007.3, 103.2], "normal": [0, 0, 2],
       "title": "Crack", "text": "4 mm wide.\nSeen first in May.",
       "camera": {"position": [500006, 4000005, 105], "target": [500004.1, 4000007.3, 103.2], "up": [0, 0, 1]}},
      {"position": [1, 2, 3], "title": "Only a title", "author": "passed over"}]})");
  ASSERT_TRUE(notes) << notes.error().message;
  ASSERT_EQ(notes->size(), 2U);
  EXPECT_EQ((*notes)[0].position.x, 500004.1);
  EXPECT_EQ((*notes)[0].normal, glm::dvec3(0.0, 0.0, 1.0));
  EXPECT_EQ((*notes)[0].text, "4 mm wide.\nSeen first in May.");
  ASSERT_TRUE((*notes)[0].camera);
  EXPECT_NEAR(glm::length((*notes)[0].camera->direction), 1.0, 1e-12);
  EXPECT_FALSE((*notes)[1].camera);
}

TEST(Annotations, errorsNameTheWrongValueInOneLine) {
  const std::pair<std::string, std::string> cases[] = {
      {"", "JSON"},
      {"[]", "JSON"},
      {"{\"version\": 1", "JSON"},
      {"{\"version\": 2, \"annotations\": []}", "version"},
      {"{\"annotations\": []}", "version"},
      {"{\"version\": 1}", "annotations"},
      {"{\"version\": 1, \"annotations\": {}}", "annotations"},
      {listOf("3"), "annotation 0"},
      {listOf(kMin + ", {}"), "annotation 1: position"},
      {listOf(R"({"position": [1, 2], "title": "t"})"), "position"},
      {listOf(R"({"position": [1, 2, "3"], "title": "t"})"), "position"},
      {listOf(R"({"position": [1, 2, 1e13], "title": "t"})"), "position"},
      {listOf(R"({"position": [1, 2, 1e999], "title": "t"})"), "JSON"},
      {listOf(R"({"position": [1, 2, 3]})"), "title"},
      {listOf(R"({"position": [1, 2, 3], "title": ""})"), "title"},
      {listOf(R"({"position": [1, 2, 3], "title": "two\nlines"})"), "title"},
      {listOf(R"({"position": [1, 2, 3], "title": ")" + std::string(201, 'a') + "\"}"), "title"},
      {listOf(R"({"position": [1, 2, 3], "title": 7})"), "title"},
      {listOf(R"({"position": [1, 2, 3], "title": "t", "text": 4})"), "text"},
      {listOf(R"({"position": [1, 2, 3], "title": "t", "normal": [0, 1]})"), "normal"},
      {listOf(R"({"position": [1, 2, 3], "title": "t", "text": "\u0007"})"), "text"},
      {listOf(R"({"position": [1, 2, 3], "title": "t", "text": ")" + std::string(10'001, 'a') + "\"}"), "text"},
      {listOf(R"({"position": [1, 2, 3], "title": "t", "normal": "up"})"), "normal"},
      {listOf(R"({"position": [1, 2, 3], "title": "t", "camera": {}})"), "camera"},
      {listOf(R"({"position": [1, 2, 3], "title": "t", "camera": {"position": [1, 2, 1e13], "direction": [1, 0, 0]}})"),
       "camera"},
      {listOf("{\"position\": [1, 2, 3], \"title\": \"\xff\"}"), "JSON"},
  };
  for (const auto& [text, piece] : cases) {
    const auto notes = check(text);
    ASSERT_FALSE(notes) << text;
    EXPECT_NE(notes.error().message.find(piece), std::string::npos) << text << ": " << notes.error().message;
    EXPECT_TRUE(notes.error().message.starts_with("notes"));
    EXPECT_EQ(notes.error().message.find('\n'), std::string::npos);
  }
}

TEST(Annotations, limitsAreEnforced) {
  std::string most = kMin;
  for (int i = 1; i < 500; ++i) most += "," + kMin;
  EXPECT_EQ(*check(listOf(most)), 500U);
  EXPECT_FALSE(check(listOf(most + "," + kMin)));
  EXPECT_FALSE(check(listOf("") + std::string(kMaxAnnotationsBytes, ' ')));
  EXPECT_FALSE(check(std::string(1 << 20, '[')));
}

}  // namespace
}  // namespace base
