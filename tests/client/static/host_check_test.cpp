#include "client/host_check.h"

#include <gtest/gtest.h>

#include "client/fetch.h"

namespace client {
namespace {

using Grade = HostFinding::Grade;

HostAnswers goodAnswers() {
  HostAnswers answers;
  answers.other_origin = true;
  answers.scene.status = 200;
  answers.scene.cache_control = std::string("no-cache");
  answers.scene.allow_origin = std::string("*");
  answers.scene.has_version = true;
  answers.range = answers.scene;
  answers.range.status = 206;
  answers.range.cache_control = std::string("public, max-age=31536000, immutable");
  answers.range.content_range = std::string("bytes 0-15/1234");
  answers.range_bytes = 16;
  return answers;
}

/// The worst grade, and the words of what is not good.
std::pair<Grade, std::string> worst(const HostAnswers& answers) {
  std::pair<Grade, std::string> out{Grade::kGood, {}};
  for (const HostFinding& finding : judgeHost(answers)) {
    EXPECT_EQ(finding.todo.empty(), finding.grade == Grade::kGood) << finding.what;
    out.first = std::max(out.first, finding.grade);
    if (finding.grade != Grade::kGood) out.second.append(finding.what).append(" ").append(finding.todo).append("\n");
  }
  return out;
}

struct Case {
  const char* words;
  Grade grade;
  void (*change)(HostAnswers&);
};

TEST(HostCheck, eachThingThatIsMissingIsNamed) {
  EXPECT_EQ(worst(goodAnswers()).first, Grade::kGood);
  EXPECT_FALSE(judgeHost(goodAnswers()).empty()) << "what is good is said too";
  const Case cases[] = {
      {"No answer", Grade::kFails, [](HostAnswers& a) { a.scene = {}; }},
      {"Access-Control-Allow-Origin", Grade::kFails,
       [](HostAnswers& a) {
         a.in_browser = true;
         a.scene = {};
       }},
      {"may not read it", Grade::kFails,
       [](HostAnswers& a) {
         a.in_browser = true;
         a.scene = {};
         a.scene.there_without_cors = true;
       }},
      {"is not there", Grade::kFails, [](HostAnswers& a) { a.scene.status = 404; }},
      {"may not be read", Grade::kFails, [](HostAnswers& a) { a.range.status = 403; }},
      {"could not send", Grade::kFails, [](HostAnswers& a) { a.range.status = 500; }},
      {"are ignored", Grade::kFails,
       [](HostAnswers& a) {
         a.range.status = 200;
         a.range_bytes = 17;
       }},
      {"another number of bytes", Grade::kFails, [](HostAnswers& a) { a.range_bytes = 17; }},
      {"another range", Grade::kFails, [](HostAnswers& a) { a.range.content_range = std::string("bytes 16-31/1234"); }},
      {"Access-Control-Expose-Headers", Grade::kSlow,
       [](HostAnswers& a) {
         a.in_browser = true;
         a.range.content_range.clear();
       }},
      {"Content-Encoding", Grade::kFails, [](HostAnswers& a) { a.range.content_encoding = std::string("gzip"); }},
      {"only pages of the same host", Grade::kSlow, [](HostAnswers& a) { a.scene.allow_origin.clear(); }},
      {"no-cache", Grade::kSlow, [](HostAnswers& a) { a.scene.cache_control = std::string("immutable"); }},
      {"immutable", Grade::kSlow, [](HostAnswers& a) { a.range.cache_control.clear(); }},
      {"ETag", Grade::kSlow, [](HostAnswers& a) { a.range.has_version = false; }}};
  for (const Case& one : cases) {
    HostAnswers answers = goodAnswers();
    one.change(answers);
    const auto [grade, words] = worst(answers);
    EXPECT_EQ(grade, one.grade) << one.words << ": " << words;
    EXPECT_NE(words.find(one.words), std::string::npos) << words;
  }
}

TEST(HostCheck, aPageBesideTheSceneNeedsNoCors) {
  HostAnswers answers = goodAnswers();
  answers.in_browser = true;
  answers.other_origin = false;
  answers.scene.allow_origin.clear();
  answers.range.allow_origin.clear();
  EXPECT_EQ(worst(answers).first, Grade::kGood);
}

TEST(Fetch, everyOutcomeSaysWhatToDoInOneLine) {
  for (const FetchOutcome outcome :
       {FetchOutcome::kNetwork, FetchOutcome::kNotFound, FetchOutcome::kForbidden, FetchOutcome::kRangeIgnored,
        FetchOutcome::kCompressed, FetchOutcome::kChanged, FetchOutcome::kTooShort, FetchOutcome::kServer}) {
    const std::string text = explain({1, outcome, {}, 418, "teapot"}, "https://host/x");
    EXPECT_EQ(text.rfind("https://host/x: ", 0), 0U);
    EXPECT_EQ(text.find('\n'), std::string::npos);
    EXPECT_TRUE(text.find(';') != std::string::npos || text.find(',') != std::string::npos) << text;
  }
  EXPECT_TRUE(mayPass({1, FetchOutcome::kNetwork, {}, 0, ""}));
  EXPECT_TRUE(mayPass({1, FetchOutcome::kServer, {}, 503, ""}));
  EXPECT_FALSE(mayPass({1, FetchOutcome::kServer, {}, 418, ""}));
  EXPECT_FALSE(mayPass({1, FetchOutcome::kRangeIgnored, {}, 200, ""}));
}

}  // namespace
}  // namespace client
