#include "server/net/http_text.h"

#include <gtest/gtest.h>

#include "server/net/page_files.h"

namespace server {
namespace {

TEST(HttpText, codingsAreAcceptedByNameWeightAndStar) {
  EXPECT_TRUE(acceptsCoding("gzip, deflate, br", "br"));
  EXPECT_TRUE(acceptsCoding("GZIP", "gzip"));
  EXPECT_TRUE(acceptsCoding(" br ; q=0.1 ,gzip", "br"));
  EXPECT_TRUE(acceptsCoding("*", "br"));
  EXPECT_FALSE(acceptsCoding("", "br"));
  EXPECT_FALSE(acceptsCoding("gzip", "br"));
  EXPECT_FALSE(acceptsCoding("br;q=0, *", "br"));
  EXPECT_FALSE(acceptsCoding("br;q=0.000", "br"));
  EXPECT_FALSE(acceptsCoding("*;q=0, gzip", "br"));
  EXPECT_FALSE(acceptsCoding("br;q=much", "br"));
  EXPECT_FALSE(acceptsCoding("brotli, xbr", "br"));
}

TEST(HttpText, entityTagsAreFoundInLists) {
  EXPECT_TRUE(namesEntityTag("\"a\"", "\"a\""));
  EXPECT_TRUE(namesEntityTag("\"b\", W/\"a\"", "\"a\""));
  EXPECT_TRUE(namesEntityTag("*", "\"a\""));
  EXPECT_FALSE(namesEntityTag("", "\"a\""));
  EXPECT_FALSE(namesEntityTag("\"ab\"", "\"a\""));
}

TEST(HttpText, queriesAreDecoded) {
  const auto query = parseQuery("/pick?ox=1.5&dy=-2e3&name=a%20b+c&&empty=");
  ASSERT_TRUE(query);
  EXPECT_EQ(query->size(), 4U);
  EXPECT_EQ(query->at("ox"), "1.5");
  EXPECT_EQ(query->at("name"), "a b c");
  EXPECT_EQ(query->at("empty"), "");
  EXPECT_TRUE(parseQuery("/pick")->empty());
  EXPECT_TRUE(parseQuery("/pick?")->empty());
}

TEST(HttpText, malformedQueriesAreErrors) {
  for (const char* bad : {"/?a", "/?=1", "/?a=%", "/?a=%4", "/?a=%zz", "/?a=%00", "/?a=%0d%0a", "/?a=1&a=2"})
    EXPECT_FALSE(parseQuery(bad)) << bad;
  std::string many = "/?";
  for (int i = 0; i < 100; ++i) many.append("a").append(std::to_string(i)).append("=1&");
  EXPECT_FALSE(parseQuery(many));
}

TEST(WebSocketKey, isSixteenBytesInBase64) {
  EXPECT_TRUE(isWebSocketKey("dGhlIHNhbXBsZSBub25jZQ=="));  // RFC 6455, section 1.3
  for (const char* other : {"", "==", "dGhlIHNhbXBsZSBub25jZQ=", "dGhlIHNhbXBsZSBub25jZQ", "dGhlIHNhbXBsZSBub25jZQAA",
                            "dGhlIHNhbXBsZSBub25 ZQ==", "dGhlIHNhbXBsZSBub=5jZQ==", "AAAdGhlIHNhbXBsZSBub25jZQ=="})
    EXPECT_FALSE(isWebSocketKey(other)) << other;
}

TEST(PageNames, hashedNamesAreRecognised) {
  EXPECT_TRUE(isHashedName("lumigrid-1f0c2a9b.js"));
  EXPECT_TRUE(isHashedName("lumigrid.0123456789abcdef.wasm"));
  for (const char* other : {"index.html", "style.css", "icon-512.png", "lumigrid-1f0c2a9.js", "lumigrid-1F0C2A9B.js",
                            "deadbeef.js", "a-deadbeef", ".js", ""})
    EXPECT_FALSE(isHashedName(other)) << other;
}

TEST(PageNames, contentTypesFollowTheEnding) {
  EXPECT_STREQ(contentTypeOf("lumigrid-1f0c2a9b.wasm"), "application/wasm");
  EXPECT_STREQ(contentTypeOf("a.js"), "text/javascript; charset=utf-8");
  EXPECT_STREQ(contentTypeOf("index.html"), "text/html; charset=utf-8");
  EXPECT_STREQ(contentTypeOf("unknown.xyz"), "application/octet-stream");
}

}  // namespace
}  // namespace server
