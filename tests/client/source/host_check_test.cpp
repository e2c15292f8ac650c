#include "client/source/host_check.h"

#include <gtest/gtest.h>

#include "client/source/fetch.h"

namespace client {
namespace {

using Grade = HostFinding::Grade;

HostAnswers goodAnswers() {
  HostAnswers answers;
  answers.other_origin = true;
  answers.scene.status = 200;
  answers.scene.headers = {{"cache-control", "no-cache"},
                           {"accept-ranges", "bytes"},
                           {"access-control-allow-origin", "*"},
                           {"access-control-expose-headers", "Content-Length, Content-Range, ETag"},
                           {"etag", "\"a\""}};
  answers.range = answers.scene;
  answers.range.status = 206;
  answers.range.bytes = 16;
  answers.range.headers["cache-control"] = "public, max-age=31536000, immutable";
  answers.range.headers["content-range"] = "bytes 0-15/1234";
  answers.next_range = answers.range;
  answers.next_range.headers["content-range"] = "bytes 16-31/1234";
  answers.preflight.status = 204;
  answers.preflight.headers = {{"access-control-allow-headers", "range, if-range"}};
  return answers;
}

/// Returns the worst grade, and the texts of all findings that are not good.
std::pair<Grade, std::string> worst(const HostAnswers& answers) {
  std::pair<Grade, std::string> out{Grade::kGood, {}};
  for (const HostFinding& finding : judgeHost(answers)) {
    EXPECT_EQ(finding.todo.empty(), finding.grade == Grade::kGood) << finding.message;
    EXPECT_FALSE(finding.header.empty());
    EXPECT_EQ((finding.message + finding.todo + finding.nginx).find_first_of("\n\t"), std::string::npos);
    out.first = std::max(out.first, finding.grade);
    if (finding.grade != Grade::kGood)
      out.second.append(finding.header)
          .append(": ")
          .append(finding.message)
          .append(" ")
          .append(finding.todo)
          .append("\n");
  }
  return out;
}

struct Case {
  const char* words;
  Grade grade;
  void (*change)(HostAnswers&);
};

TEST(HostCheck, eachMissingHeaderIsNamed) {
  EXPECT_EQ(worst(goodAnswers()).first, Grade::kGood) << worst(goodAnswers()).second;
  EXPECT_EQ(judgeHost(goodAnswers()).size(), 9U) << "what is good is said too";
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
      {"Is not there", Grade::kFails, [](HostAnswers& a) { a.scene.status = 404; }},
      {"May not be read", Grade::kFails, [](HostAnswers& a) { a.range.status = 403; }},
      {"could not send", Grade::kFails, [](HostAnswers& a) { a.range.status = 500; }},
      {"Range: Ignored", Grade::kFails, [](HostAnswers& a) { a.range.status = 200; }},
      {"Range: Another number of bytes", Grade::kFails, [](HostAnswers& a) { a.range.bytes = 17; }},
      {"Content-Range: Says another", Grade::kFails,
       [](HostAnswers& a) { a.range.headers["content-range"] = "bytes 16-31/1234"; }},
      {"Content-Range: Missing", Grade::kFails, [](HostAnswers& a) { a.range.headers.erase("content-range"); }},
      {"Access-Control-Expose-Headers", Grade::kSlow,
       [](HostAnswers& a) {
         a.in_browser = true;
         a.range.headers.erase("content-range");
       }},
      {"Access-Control-Expose-Headers", Grade::kSlow,
       [](HostAnswers& a) { a.range.headers["access-control-expose-headers"] = "Content-Length"; }},
      {"Accept-Ranges", Grade::kSlow, [](HostAnswers& a) { a.scene.headers.erase("accept-ranges"); }},
      {"Content-Encoding", Grade::kFails, [](HostAnswers& a) { a.range.headers["content-encoding"] = "gzip"; }},
      {"Access-Control-Allow-Origin: Missing", Grade::kSlow,
       [](HostAnswers& a) { a.scene.headers.erase("access-control-allow-origin"); }},
      {"OPTIONS", Grade::kSlow, [](HostAnswers& a) { a.preflight.status = 405; }},
      {"Access-Control-Allow-Headers", Grade::kSlow, [](HostAnswers& a) { a.preflight.headers.clear(); }},
      {"no-cache", Grade::kSlow, [](HostAnswers& a) { a.scene.headers["cache-control"] = "immutable"; }},
      {"immutable", Grade::kSlow, [](HostAnswers& a) { a.range.headers.erase("cache-control"); }},
      {"weak", Grade::kSlow,
       [](HostAnswers& a) { a.range.headers["etag"] = a.next_range.headers["etag"] = "W/\"a\""; }},
      {"changed", Grade::kFails, [](HostAnswers& a) { a.next_range.headers["etag"] = "\"b\""; }},
      {"by the second", Grade::kSlow,
       [](HostAnswers& a) {
         a.range.headers.erase("etag");
         a.range.headers["last-modified"] = "Thu, 01 Jan 2026 00:00:00 GMT";
       }},
      {"not noticed", Grade::kSlow, [](HostAnswers& a) { a.range.headers.erase("etag"); }}};
  for (const Case& one : cases) {
    HostAnswers answers = goodAnswers();
    one.change(answers);
    const auto [grade, words] = worst(answers);
    EXPECT_EQ(grade, one.grade) << one.words << ": " << words;
    EXPECT_NE(words.find(one.words), std::string::npos) << one.words << ": " << words;
  }
}

TEST(HostCheck, aPageBesideTheSceneNeedsNoCors) {
  HostAnswers answers = goodAnswers();
  answers.in_browser = true;
  answers.other_origin = false;
  for (HostAnswer* one : {&answers.scene, &answers.range, &answers.next_range})
    for (const char* name : {"access-control-allow-origin", "access-control-expose-headers"}) one->headers.erase(name);
  answers.preflight = {};
  EXPECT_EQ(worst(answers).first, Grade::kGood);
}

TEST(HostCheck, aPageOfAnotherHostJudgesWhatItSees) {
  HostAnswers answers = goodAnswers();
  answers.in_browser = true;
  answers.preflight = {};
  // These are the headers that fetch() shows of a host that exposes the three.
  for (HostAnswer* one : {&answers.scene, &answers.range, &answers.next_range})
    for (const char* name : {"access-control-allow-origin", "access-control-expose-headers", "accept-ranges"})
      one->headers.erase(name);
  EXPECT_EQ(worst(answers).first, Grade::kGood) << worst(answers).second;
}

TEST(Fetch, everyOutcomeSaysWhatToDoInOneLine) {
  for (const FetchOutcome outcome :
       {FetchOutcome::kNetwork, FetchOutcome::kNotFound, FetchOutcome::kForbidden, FetchOutcome::kRangeIgnored,
        FetchOutcome::kCompressed, FetchOutcome::kChanged, FetchOutcome::kTooShort, FetchOutcome::kServer}) {
    const std::string text = describeFailure({1, outcome, {}, 418, "teapot"}, "https://host/x");
    EXPECT_EQ(text.rfind("https://host/x: ", 0), 0U);
    EXPECT_EQ(text.find('\n'), std::string::npos);
    EXPECT_TRUE(text.find(';') != std::string::npos || text.find(',') != std::string::npos) << text;
  }
  EXPECT_TRUE(isTransient({1, FetchOutcome::kNetwork, {}, 0, ""}));
  EXPECT_TRUE(isTransient({1, FetchOutcome::kServer, {}, 503, ""}));
  EXPECT_FALSE(isTransient({1, FetchOutcome::kServer, {}, 418, ""}));
  EXPECT_FALSE(isTransient({1, FetchOutcome::kRangeIgnored, {}, 200, ""}));
}

}  // namespace
}  // namespace client
