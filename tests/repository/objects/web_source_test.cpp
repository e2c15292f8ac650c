#include "repository/objects/web_source.h"

#include <gtest/gtest.h>

#include <limits>
#include <thread>

#include "base/byte_range.h"
#include "repository/objects/open_objects.h"
#include "tests/repository/objects/scripted_server.h"

namespace repository {
namespace {

using base::Bytes;
using base::ErrorCode;
using test::Answer;
using test::answer;
using test::headerOf;
using test::part;
using test::ScriptedServer;
using namespace std::chrono_literals;

const std::string kObject = "abcdefghijklmnopqrstuvwxyz";

HttpOptions quick() {
  HttpOptions options;
  options.retries = 2;
  options.first_pause = 1ms;
  options.longest_pause = 2ms;
  options.stall_timeout = 1s;
  return options;
}

std::unique_ptr<ObjectSource> mustOpen(const std::string& place, const HttpOptions& options = quick()) {
  auto source = openHttpSource(place, options);
  if (source) return std::move(*source);
  ADD_FAILURE() << source.error().message;
  return nullptr;
}

std::string text(const Bytes& bytes) {
  return {bytes.begin(), bytes.end()};
}

// Expects an error of one line that names the object and contains `piece`.
void expectError(const base::Error& error, ErrorCode code, const std::string& piece) {
  EXPECT_EQ(error.code, code) << error.message;
  EXPECT_NE(error.message.find(piece), std::string::npos) << error.message;
  EXPECT_NE(error.message.find("/scene/a.bin: "), std::string::npos) << error.message;
  EXPECT_EQ(error.message.find('\n'), std::string::npos) << error.message;
}

// The error of reading bytes 2 … 5 of an object from a server that always gives this answer.
base::Error errorOf(const Answer& said) {
  const ScriptedServer server([&](const std::string&, int) { return said; });
  const auto bytes = mustOpen(server.url())->read("a.bin", 2, 4);
  if (!bytes) return bytes.error();
  ADD_FAILURE() << "read " << text(*bytes);
  return {};
}

TEST(WebSource, readsARangeAndKeepsTheConnection) {
  const ScriptedServer server([](const std::string& request, int) {
    return headerOf(request, "Range") == "bytes=2-5" ? part(kObject, 2, 5) : part(kObject, 25, 25);
  });
  const auto source = mustOpen(server.url("/my%20scene/"));
  EXPECT_EQ(text(*source->read("packs/a b.lgk", 2, 4)), "cdef");
  EXPECT_EQ(text(*source->read("packs/a b.lgk", 25, 1)), "z");
  EXPECT_EQ(server.requests()[0].rfind("GET /my%20scene/packs/a%20b.lgk HTTP/1.1", 0), 0U) << server.requests()[0];
  EXPECT_EQ(server.connections(), 1U);
}

TEST(WebSource, severalThreadsReadAtOnce) {
  const ScriptedServer server([](const std::string& request, int) {
    const std::size_t first = std::stoul(headerOf(request, "Range").substr(6));
    return part(kObject, first, first);
  });
  const auto source = mustOpen(server.url());
  std::vector<std::thread> threads;
  for (std::size_t t = 0; t < 8; ++t)
    threads.emplace_back([&, t] {
      for (std::size_t i = 0; i < 20; ++i)
        EXPECT_EQ(text(*source->read("a.bin", t + i % 10, 1)), kObject.substr(t + i % 10, 1));
    });
  for (std::thread& thread : threads) thread.join();
}

TEST(WebSource, sizeIsAskedByHead) {
  const ScriptedServer server([](const std::string& request, int) {
    EXPECT_EQ(request.rfind("HEAD ", 0), 0U);
    return Answer{"HTTP/1.1 200 OK\r\nContent-Length: 12345678901\r\n\r\n"};
  });
  EXPECT_EQ(*mustOpen(server.url())->size("a.bin"), 12345678901U);
}

TEST(WebSource, nothingIsReadWithoutAskingForARange) {
  const ScriptedServer server(
      [](const std::string&, int) { return Answer{"HTTP/1.1 200 OK\r\nContent-Length: 26\r\n\r\n"}; });
  const auto source = mustOpen(server.url());
  EXPECT_TRUE(source->read("a.bin", 26, 0)->empty());
  EXPECT_EQ(source->read("a.bin", 27, 0).error().code, ErrorCode::kInvalidInput);
}

TEST(WebSource, refusalsAreNamedAndNotRetried) {
  const auto refused = [](const std::string& status) { return errorOf(answer(status, "", "<html>no</html>")); };
  expectError(refused("403 Forbidden"), ErrorCode::kIo, "403 (not allowed)");
  expectError(refused("401 Unauthorized"), ErrorCode::kIo, "401 (not allowed)");
  expectError(refused("404 Not Found"), ErrorCode::kNotFound, "404 (not there)");
  expectError(refused("410 Gone"), ErrorCode::kNotFound, "410");
  expectError(refused("418 Teapot"), ErrorCode::kNetwork, "418");
  expectError(refused("501 Not Implemented"), ErrorCode::kUnsupported, "501");

  const ScriptedServer server([](const std::string&, int) { return answer("404 Not Found", "", ""); });
  EXPECT_EQ(mustOpen(server.url())->read("a.bin", 0, 1).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(server.requests().size(), 1U);
}

TEST(WebSource, aServerThatIgnoresRangeIsToldApartFromAWholeObject) {
  expectError(errorOf(answer("200 OK", "", kObject)), ErrorCode::kUnsupported, "ignores Range");
  expectError(errorOf(answer("200 OK", "", "abc")), ErrorCode::kInvalidInput, "has 3 bytes");

  const ScriptedServer server([](const std::string&, int) { return answer("200 OK", "", kObject); });
  const auto source = mustOpen(server.url());
  EXPECT_EQ(text(*source->read("a.bin", 0, 26)), kObject);
  expectError(source->read("a.bin", 0, 25).error(), ErrorCode::kUnsupported, "ignores Range");
  expectError(source->read("a.bin", 0, 27).error(), ErrorCode::kInvalidInput, "has 26 bytes");
}

TEST(WebSource, anotherRangeThanAskedIsAnError) {
  const auto says = [](const std::string& range, const std::string& body) {
    return errorOf(answer("206 Partial Content", range, body));
  };
  expectError(says("Content-Range: bytes 3-6/26\r\n", "defg"), ErrorCode::kNetwork, "'bytes 3-6/26'");
  expectError(says("Content-Range: bytes 2-4/26\r\n", "cde"), ErrorCode::kNetwork, "'bytes 2-4/26'");
  expectError(says("Content-Range: bytes 2-9/26\r\n", "cdefghij"), ErrorCode::kNetwork, "'bytes 2-9/26'");
  expectError(says("Content-Range: bytes */26\r\n", "cdef"), ErrorCode::kNetwork, "'bytes */26'");
  expectError(says("Content-Range: \x01\x7f\r\n", "cdef"), ErrorCode::kNetwork, "bytes 2-5 were asked for");
  expectError(says("", "cdef"), ErrorCode::kNetwork, "bytes 2-5 were asked for");
  expectError(says("Content-Type: multipart/byteranges; boundary=x\r\n", "--x"), ErrorCode::kNetwork, "were asked for");
}

TEST(WebSource, aShorterObjectIsNamedWithItsSize) {
  expectError(errorOf(answer("416 Range Not Satisfiable", "Content-Range: bytes */2\r\n", "")),
              ErrorCode::kInvalidInput, "has 2 bytes, 4 are wanted from byte 2 on");
  expectError(errorOf(answer("416 Range Not Satisfiable", "", "")), ErrorCode::kInvalidInput, "is too short");
  expectError(errorOf(part("abcde", 2, 4)), ErrorCode::kInvalidInput, "has 5 bytes");
}

TEST(WebSource, aTruncatedBodyIsAnError) {
  // The connection ends early, at every attempt.
  const ScriptedServer server([](const std::string&, int) {
    Answer cut = part(kObject, 2, 5);
    cut.bytes.resize(cut.bytes.size() - 1);
    cut.close = true;
    return cut;
  });
  expectError(mustOpen(server.url())->read("a.bin", 2, 4).error(), ErrorCode::kNetwork, "truncated");
  EXPECT_EQ(server.requests().size(), 3U);
  // The Content-Length fits the short body, so that it looks whole.
  expectError(errorOf(answer("206 Partial Content", "Content-Range: bytes 2-5/26\r\n", "cde")), ErrorCode::kNetwork,
              "truncated: 3 bytes came");
}

TEST(WebSource, receivesNoMoreThanItAskedFor) {
  const std::string flood(std::size_t{8} << 20, 'x');
  expectError(errorOf(answer("206 Partial Content", "Content-Range: bytes 2-5/26\r\n", flood)), ErrorCode::kNetwork,
              "more bytes came");
  // The answer has no length and chunks that never end.
  std::string chunks =
      "HTTP/1.1 206 Partial Content\r\nContent-Range: bytes 2-5/26\r\nTransfer-Encoding: chunked\r\n\r\n";
  for (int i = 0; i < 1000; ++i) chunks += "10\r\n0123456789abcdef\r\n";
  expectError(errorOf({chunks, false, true}), ErrorCode::kNetwork, "more bytes came");
  // The page of an error is cut off too, and so are endless headers.
  expectError(errorOf(answer("404 Not Found", "", flood)), ErrorCode::kNotFound, "404");
  std::string headers = "HTTP/1.1 206 Partial Content\r\n";
  for (int i = 0; i < 5000; ++i) headers += "X-Header-" + std::to_string(i) + ": 0123456789abcdef\r\n";
  expectError(errorOf({headers, false, true}), ErrorCode::kNetwork, "endless headers");
}

TEST(WebSource, aHugeLengthTakesNoMemory) {
  const ScriptedServer server([](const std::string&, int) { return part(kObject, 2, 25); });
  const auto source = mustOpen(server.url());
  for (const std::uint64_t length : {std::uint64_t{1} << 60, std::numeric_limits<std::uint64_t>::max()})
    expectError(source->read("a.bin", 2, length).error(), ErrorCode::kInvalidInput, "wanted from byte 2");
  expectError(source->read("a.bin", std::numeric_limits<std::uint64_t>::max(), 2).error(), ErrorCode::kInvalidInput,
              "2 are wanted");
}

TEST(WebSource, compressedAnswersAreRefused) {
  expectError(
      errorOf(answer("206 Partial Content", "Content-Encoding: gzip\r\nContent-Range: bytes 2-5/26\r\n", "cdef")),
      ErrorCode::kUnsupported, "Content-Encoding: gzip");
}

TEST(WebSource, transientErrorsAreRetried) {
  for (const char* status : {"429 Too Many", "500 Oops", "502 Bad Gateway", "503 Busy", "504 Timeout"}) {
    const ScriptedServer server(
        [&](const std::string&, int number) { return number < 2 ? answer(status, "", "later") : part(kObject, 2, 5); });
    EXPECT_EQ(text(*mustOpen(server.url())->read("a.bin", 2, 4)), "cdef");
    EXPECT_EQ(server.requests().size(), 3U);
  }
  expectError(errorOf(answer("503 Busy", "", "")), ErrorCode::kNetwork, "503 (overloaded)");
  expectError(errorOf(answer("500 Oops", "", "")), ErrorCode::kNetwork, "500 (its own fault)");
}

TEST(WebSource, brokenConnectionsAreRetried) {
  const ScriptedServer server([](const std::string&, int number) {
    Answer said = part(kObject, 2, 5);
    if (number == 0) said = {"", true};                        // nothing
    if (number == 1) said = {said.bytes.substr(0, 30), true};  // half of the headers
    return said;
  });
  EXPECT_EQ(text(*mustOpen(server.url())->read("a.bin", 2, 4)), "cdef");
  EXPECT_GE(server.requests().size(), 3U);
}

TEST(WebSource, retryAfterIsHonouredUpToALimit) {
  const ScriptedServer server([](const std::string&, int number) {
    return number == 0 ? answer("503 Busy", "Retry-After: 1\r\n", "") : part(kObject, 2, 5);
  });
  HttpOptions patient = quick();
  patient.longest_pause = 1500ms;
  const auto begin = std::chrono::steady_clock::now();
  EXPECT_EQ(text(*mustOpen(server.url(), patient)->read("a.bin", 2, 4)), "cdef");
  EXPECT_GE(std::chrono::steady_clock::now() - begin, 1s);

  const ScriptedServer closed([](const std::string&, int) { return answer("503 Busy", "Retry-After: 3600\r\n", ""); });
  expectError(mustOpen(closed.url())->read("a.bin", 2, 4).error(), ErrorCode::kNetwork, "503");
  EXPECT_EQ(closed.requests().size(), 1U);
}

TEST(WebSource, redirectsAreFollowedButNotInCircles) {
  const ScriptedServer server([](const std::string& request, int) {
    if (request.rfind("GET /scene/", 0) == 0) return answer("302 Found", "Location: /moved/a.bin\r\n", "there");
    return part(kObject, 2, 5);
  });
  EXPECT_EQ(text(*mustOpen(server.url())->read("a.bin", 2, 4)), "cdef");
  expectError(errorOf(answer("302 Found", "Location: /scene/a.bin\r\n", "")), ErrorCode::kNetwork,
              "redirected more than 4 times");
  expectError(errorOf(answer("302 Found", "", "")), ErrorCode::kNetwork, "302");
  // A redirect to a file of this machine is refused too.
  expectError(errorOf(answer("302 Found", "Location: file:///etc/hostname\r\n", "")), ErrorCode::kNetwork,
              "redirected");
}

TEST(WebSource, aStalledServerIsGivenUp) {
  HttpOptions once = quick();
  once.retries = 0;
  for (const std::string& begin : {std::string(), part(kObject, 2, 5).bytes}) {
    const ScriptedServer server([&](const std::string&, int) {
      return Answer{begin.substr(0, begin.empty() ? 0 : begin.size() - 2), false, true};
    });
    expectError(mustOpen(server.url(), once)->read("a.bin", 2, 4).error(), ErrorCode::kNetwork, "too slow");
  }
}

TEST(WebSource, anUnreachableServerIsNamed) {
  ScriptedServer server([](const std::string&, int) { return Answer{}; });
  server.stop();
  expectError(mustOpen(server.url())->read("a.bin", 0, 1).error(), ErrorCode::kNetwork, "no connection");
  // This name never resolves (RFC 6761).
  expectError(mustOpen("http://nowhere.invalid/scene")->read("a.bin", 0, 1).error(), ErrorCode::kNetwork,
              "no such host");
}

TEST(WebSource, anObjectThatChangesIsAnErrorNotAMix) {
  for (const bool by_tag : {true, false}) {
    const ScriptedServer server([&](const std::string& request, int number) {
      const std::string object = number < 2 ? kObject : kObject + "!";
      const std::string tag = by_tag ? std::string("ETag: \"") + (number < 2 ? "one" : "two") + "\"\r\n" : "";
      EXPECT_EQ(headerOf(request, "If-Match"), by_tag && number > 0 ? "\"one\"" : "");
      return part(object, 2, 5, tag);
    });
    const auto source = mustOpen(server.url());
    EXPECT_TRUE(source->read("a.bin", 2, 4));
    EXPECT_TRUE(source->read("a.bin", 2, 4));
    expectError(source->read("a.bin", 2, 4).error(), ErrorCode::kInvalidInput, "changed while it was read");
  }
  // The server itself may notice the change (412).
  expectError(errorOf(answer("412 Precondition Failed", "", "")), ErrorCode::kInvalidInput,
              "changed while it was read");
}

TEST(WebSource, onlyFieldsInBothAnswersAreCompared) {
  // Several servers behind one address may state different fields about the same object.
  const std::vector<std::string> told{"ETag: \"a\"\r\nLast-Modified: Sat, 01 Jan 2000 00:00:00 GMT\r\n",
                                      "Last-Modified: Sat, 01 Jan 2000 00:00:00 GMT\r\n", "ETag: W/\"a\"\r\n",
                                      "ETag: \"a\"\r\nLast-Modified: Sun, 02 Jan 2000 00:00:00 GMT\r\n", ""};
  const ScriptedServer server([&](const std::string&, int number) {
    return part(kObject, 2, 5, told[static_cast<std::size_t>(number) % told.size()]);
  });
  const auto source = mustOpen(server.url());
  for (std::size_t i = 0; i < told.size(); ++i) EXPECT_TRUE(source->read("a.bin", 2, 4)) << i;
}

TEST(WebSource, aHangingServerIsGivenUpWithinPatience) {
  const ScriptedServer server([](const std::string&, int) { return Answer{"", false, true}; });
  HttpOptions options = quick();
  options.retries = 1000;
  options.patience = 1s;
  expectError(mustOpen(server.url(), options)->read("a.bin", 2, 4).error(), ErrorCode::kNetwork, "too slow");
  EXPECT_LE(server.requests().size(), 2U);
}

TEST(WebSource, sizeFixesTheVersionAnew) {
  const ScriptedServer server([](const std::string& request, int number) {
    const std::string tag = "ETag: W/\"" + std::to_string(number / 2) + "\"\r\n";
    if (request.rfind("HEAD", 0) == 0) return Answer{"HTTP/1.1 200 OK\r\n" + tag + "Content-Length: 26\r\n\r\n"};
    return part(kObject, 2, 5, tag);
  });
  const auto source = mustOpen(server.url());
  for (int i = 0; i < 2; ++i) {
    EXPECT_TRUE(source->size("a.bin"));
    EXPECT_TRUE(source->read("a.bin", 2, 4));
  }
  expectError(source->read("a.bin", 2, 4).error(), ErrorCode::kInvalidInput, "changed");
}

TEST(WebSource, namesStayBelowTheFolder) {
  const ScriptedServer server([](const std::string&, int) { return part(kObject, 0, 0); });
  const auto source = mustOpen(server.url());
  EXPECT_EQ(source->read("../a.bin", 0, 1).error().code, ErrorCode::kInvalidInput);
  EXPECT_EQ(source->size("/a.bin").error().code, ErrorCode::kInvalidInput);
  EXPECT_TRUE(server.requests().empty());
}

TEST(OpenObjects, eachPlaceIsKnownByItsName) {
  EXPECT_TRUE(openObjectSource("file:///tmp"));
  EXPECT_TRUE(openObjectSource("file://localhost/%74mp"));
  EXPECT_TRUE(openObjectSource("https://example.org/scene"));
  EXPECT_TRUE(isRemotePlace("https://example.org/scene"));
  EXPECT_TRUE(isRemotePlace("s3://bucket"));
  EXPECT_FALSE(isRemotePlace("some/scene"));
  EXPECT_FALSE(isRemotePlace("file:///scene"));
  for (const char* wrong : {"file://other/tmp", "file:///%2", "ftp://example.org/x", "https:///x",
                            "https://example.org/x?y", "https://me:secret@example.org/x"}) {
    const auto source = openObjectSource(wrong);
    ASSERT_FALSE(source) << wrong;
    EXPECT_EQ(source.error().code, ErrorCode::kInvalidInput) << wrong;
    EXPECT_EQ(source.error().message.find("secret"), std::string::npos);
  }
  EXPECT_EQ(openObjectSource("/nowhere/at/all").error().code, ErrorCode::kNotFound);
  EXPECT_EQ(openObjectSink("https://example.org/scene").error().code, ErrorCode::kUnsupported);
}

}  // namespace
}  // namespace repository
