// Tests ranges from a web server, right and wrong ones.
#include "client/native/curl_fetcher.h"

#include <gtest/gtest.h>

#include "client/native/published_scene.h"
#include "tests/repository/objects/scripted_server.h"

namespace client {
namespace {

using repository::test::Answer;
using repository::test::answer;
using repository::test::headerOf;
using repository::test::part;
using repository::test::ScriptedServer;

const std::string kObject(100'000, 'x');

std::string place(const ScriptedServer& server) {
  return "http://127.0.0.1:" + std::to_string(server.port()) + "/folder";
}

FetchAnswer waitFor(CurlFetcher& fetcher) {
  for (int i = 0; i < 600; ++i) {
    auto answers = fetcher.takeAnswers();
    if (!answers.empty()) return answers.front();
    fetcher.wait(0.05);
  }
  ADD_FAILURE() << "no answer";
  return {};
}

FetchAnswer fetchOne(const ScriptedServer& server) {
  CurlFetcher fetcher(place(server));
  fetcher.submit(7, "images/a.lgk", 100, 50);
  return waitFor(fetcher);
}

TEST(CurlFetcher, bringsTheBytesThatWereAskedFor) {
  std::string seen;
  const ScriptedServer server([&](const std::string& request, int) {
    seen = request;
    return part(std::string(100, 'a') + "bcd" + kObject, 100, 149);
  });
  const FetchAnswer fetched = fetchOne(server);
  EXPECT_EQ(fetched.id, 7U);
  EXPECT_EQ(fetched.outcome, FetchOutcome::kBytes);
  ASSERT_EQ(fetched.bytes.size(), 50U);
  EXPECT_EQ(fetched.bytes[0], 'b');
  EXPECT_EQ(headerOf(seen, "Range"), "bytes=100-149");
  EXPECT_EQ(seen.rfind("GET /folder/images/a.lgk ", 0), 0U);
}

TEST(CurlFetcher, aServerWithoutRangesIsFoundOutAtTheHead) {
  // The host would send 10 GB.
  const ScriptedServer server([](const std::string&, int) {
    return Answer{"HTTP/1.1 200 OK\r\nContent-Length: 10000000000\r\n\r\n" + kObject, false, true};
  });
  const FetchAnswer fetched = fetchOne(server);
  EXPECT_EQ(fetched.outcome, FetchOutcome::kRangeIgnored);
  EXPECT_EQ(fetched.status, 200);
  EXPECT_TRUE(fetched.bytes.empty());
}

TEST(CurlFetcher, everyFaultHasItsName) {
  struct Case {
    FetchOutcome outcome;
    Answer reply;
  };
  const Case cases[] = {
      {FetchOutcome::kNotFound, answer("404 Not Found", "", "no")},
      {FetchOutcome::kNotFound, answer("410 Gone", "", "")},
      {FetchOutcome::kForbidden, answer("403 Forbidden", "", "no")},
      {FetchOutcome::kForbidden, answer("401 Unauthorized", "", "")},
      {FetchOutcome::kTooShort, answer("416 Range Not Satisfiable", "Content-Range: bytes */10\r\n", "")},
      {FetchOutcome::kTooShort, part(std::string(120, 'a'), 100, 119)},
      {FetchOutcome::kChanged, answer("412 Precondition Failed", "", "")},
      {FetchOutcome::kServer, answer("503 Service Unavailable", "", "later")},
      {FetchOutcome::kServer, answer("204 No Content", "", "")},
      {FetchOutcome::kCompressed, part(kObject, 100, 149, "Content-Encoding: gzip\r\n")},
      {FetchOutcome::kRangeIgnored, part(kObject, 0, 49)},
      {FetchOutcome::kRangeIgnored, part(kObject, 100, 199)},
      {FetchOutcome::kRangeIgnored, answer("206 Partial Content", "", kObject.substr(0, 50))},
      {FetchOutcome::kNetwork,
       Answer{"HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 100-149/100000\r\nContent-Length: 50\r\n\r\nshort",
              true, false}},
      {FetchOutcome::kNetwork, Answer{"", true, false}},
      {FetchOutcome::kNetwork, Answer{"gibberish", true, false}}};
  for (const Case& one : cases) {
    const ScriptedServer server([&](const std::string&, int) { return one.reply; });
    const FetchAnswer fetched = fetchOne(server);
    EXPECT_EQ(fetched.outcome, one.outcome) << one.reply.bytes.substr(0, 200);
    EXPECT_TRUE(fetched.bytes.empty());
  }
}

TEST(CurlFetcher, nobodyThereIsANetworkFault) {
  ScriptedServer server([](const std::string&, int) { return Answer{}; });
  const std::string where = place(server);
  server.stop();
  CurlFetcher fetcher(where);
  fetcher.submit(1, "a", 0, 1);
  EXPECT_EQ(waitFor(fetcher).outcome, FetchOutcome::kNetwork);
}

TEST(CurlFetcher, anotherVersionIsNoticed) {
  const ScriptedServer server([](const std::string&, int number) {
    return part(kObject, 100, 149, number < 2 ? "ETag: \"one\"\r\n" : "ETag: \"two\"\r\n");
  });
  CurlFetcher fetcher(place(server));
  for (const FetchOutcome expected : {FetchOutcome::kBytes, FetchOutcome::kBytes, FetchOutcome::kChanged}) {
    fetcher.submit(1, "a", 100, 50);
    EXPECT_EQ(waitFor(fetcher).outcome, expected);
  }
}

TEST(CurlFetcher, aCancelledRequestHasNoAnswer) {
  const ScriptedServer server([](const std::string& request, int) {
    if (request.rfind("GET /folder/slow", 0) == 0) return Answer{"HTTP/1.1 206 Partial Content\r\n", false, true};
    return part(kObject, 100, 149);
  });
  CurlFetcher fetcher(place(server));
  fetcher.submit(1, "slow", 100, 50);
  fetcher.wait(0.1);
  fetcher.cancel(1);
  fetcher.submit(2, "a", 100, 50);
  EXPECT_EQ(waitFor(fetcher).id, 2U);
  fetcher.wait(0.05);
  EXPECT_TRUE(fetcher.takeAnswers().empty());
}

TEST(CurlFetcher, wholeObjectsHaveALimit) {
  const ScriptedServer server([](const std::string&, int) { return answer("200 OK", "", kObject); });
  CurlFetcher fetcher(place(server));
  fetcher.submitWhole(1, "scene.json", kObject.size());
  const FetchAnswer fetched = waitFor(fetcher);
  EXPECT_EQ(fetched.outcome, FetchOutcome::kBytes);
  EXPECT_EQ(fetched.bytes.size(), kObject.size());
  fetcher.submitWhole(2, "scene.json", kObject.size() - 1);
  EXPECT_EQ(waitFor(fetcher).outcome, FetchOutcome::kServer);
}

TEST(PublishedScene, addressesOfScenesAreToldFromServers) {
  for (const char* url :
       {"https://host", "https://host/", "http://host/tower/", "http://host:81/a/scene.json", "http://host/scene.json"})
    EXPECT_TRUE(isPublishedScene(url)) << url;
  for (const char* url : {"http://host", "http://host:8080/", "http://host/ws", "ws://host/x", "host:8080"})
    EXPECT_FALSE(isPublishedScene(url)) << url;
  EXPECT_EQ(placeOfScene("http://host:81/a/scene.json"), "http://host:81/a");
  EXPECT_EQ(placeOfScene("http://host/a//"), "http://host/a");
  EXPECT_EQ(placeOfScene("http://host/myscene.json/?x=1#y"), "http://host/myscene.json");
  EXPECT_EQ(placeOfScene("http://host/myscene.json"), "http://host/myscene.json");
  EXPECT_TRUE(checkUrl("https://host/tower"));
  EXPECT_FALSE(checkUrl("https://"));
  EXPECT_FALSE(checkUrl("https:///x"));
  EXPECT_FALSE(checkUrl("https://a b/"));
  EXPECT_FALSE(checkUrl("ftp://host/"));
}

}  // namespace
}  // namespace client
