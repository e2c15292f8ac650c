#include "base/http/http.h"

#include <gtest/gtest.h>

namespace {

TEST(HttpHead, lastOfSeveralHeadsCounts) {
  base::HttpHead head;
  for (const char* line :
       {"HTTP/1.1 302 Found\r\n", "Location: /there\r\n", "\r\n", "HTTP/1.1 206 Partial Content\r\n"})
    EXPECT_TRUE(head.addLine(line));
  EXPECT_EQ(head.status, 206);
  EXPECT_EQ(head.header("location"), "");
  EXPECT_FALSE(head.complete);
  EXPECT_TRUE(head.addLine("Content-RANGE:  bytes 0-15/40 \r\n"));
  EXPECT_TRUE(head.addLine("\r\n"));
  EXPECT_EQ(head.header("content-range"), "bytes 0-15/40");
  EXPECT_TRUE(head.complete);
}

TEST(HttpHead, endlessHeadersAreRefused) {
  base::HttpHead head;
  const std::string line = "x: " + std::string(1021, 'y');
  for (int i = 0; i < 64; ++i) EXPECT_TRUE(head.addLine(line));
  EXPECT_FALSE(head.addLine(line));
  EXPECT_TRUE(head.too_long);
}

}  // namespace
