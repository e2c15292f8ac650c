#include "base/annotation.h"

#include <gtest/gtest.h>

#include <limits>

namespace base {
namespace {

Annotation note() {
  Annotation annotation;
  annotation.position = {500'000.0, 4'000'000.0, 100.0};
  annotation.normal = {0.0, 0.0, 3.0};
  annotation.title = "Crack";
  annotation.text = "Two lines,\nwith a \u00B1 sign.";
  return annotation;
}

TEST(Annotation, validNotesGetUnitVectors) {
  Annotation wanted = note();
  wanted.camera.emplace();
  wanted.camera->direction = {0.0, 2.0, 0.0};
  const auto checked = checkedAnnotation(wanted);
  ASSERT_TRUE(bool(checked)) << checked.error().message;
  EXPECT_EQ(checked->normal, glm::dvec3(0.0, 0.0, 1.0));
  EXPECT_EQ(checked->camera->direction, glm::dvec3(0.0, 1.0, 0.0));
  EXPECT_EQ(checked->text, wanted.text);
}

TEST(Annotation, absentNormalStaysZero) {
  Annotation wanted = note();
  wanted.normal = {};
  EXPECT_EQ(checkedAnnotation(wanted)->normal, glm::dvec3(0.0));
}

TEST(Annotation, errorsNameTheWrongMember) {
  const auto says = [](auto change, const std::string& word) {
    Annotation wanted = note();
    change(wanted);
    const auto checked = checkedAnnotation(wanted);
    ASSERT_FALSE(bool(checked)) << word;
    EXPECT_NE(checked.error().message.find(word), std::string::npos) << checked.error().message;
  };
  const double nan = std::numeric_limits<double>::quiet_NaN();
  says([&](Annotation& a) { a.position.x = nan; }, "position");
  says([&](Annotation& a) { a.position.x = 1e13; }, "position");
  says([&](Annotation& a) { a.normal.z = nan; }, "normal");
  says([&](Annotation& a) { a.title.clear(); }, "title");
  says([&](Annotation& a) { a.title = std::string(kMaxAnnotationTitle + 1, 'x'); }, "title");
  says([&](Annotation& a) { a.title = "two\nlines"; }, "title");
  says([&](Annotation& a) { a.text = std::string(kMaxAnnotationText + 1, 'x'); }, "text");
  says([&](Annotation& a) { a.text = "escape \x1B[31m"; }, "text");
  says([&](Annotation& a) { a.camera.emplace().direction = glm::dvec3(0.0); }, "camera");
  says([&](Annotation& a) { a.camera.emplace().fov_y = 4.0; }, "camera");
  says([&](Annotation& a) { a.camera.emplace().position.y = nan; }, "camera");
}

TEST(Annotation, invalidUtf8IsRefused) {
  for (const char* wrong : {"\x80", "\xC0\x80", "\xC3", "\xE2\x82", "\xED\xA0\x80", "\xF4\x90\x80\x80",
                            "\xF8\x88\x80\x80\x80", "\xE0\x80\xAF", "\xF0\x80\x80\xAF", "a\xFF"}) {
    Annotation wanted = note();
    wanted.text = wrong;
    EXPECT_FALSE(bool(checkedAnnotation(wanted)));
  }
  for (const char* right :
       {"", "a", "\xC3\xA9", "\xE2\x82\xAC", "\xF0\x9F\x98\x80", "\xEE\x80\x80", "\xF4\x8F\xBF\xBF"}) {
    Annotation wanted = note();
    wanted.text = right;
    EXPECT_TRUE(bool(checkedAnnotation(wanted))) << right;
  }
}

}  // namespace
}  // namespace base
