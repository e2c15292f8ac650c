#include "server/net/page_files.h"

#include <gtest/gtest.h>

namespace server {
namespace {

TEST(PageNames, hashedNamesAreToldFromOthers) {
  EXPECT_TRUE(isHashedName("lumigrid-1f0c2a9b.js"));
  EXPECT_TRUE(isHashedName("lumigrid.0123456789abcdef.wasm"));
  for (const char* other : {"index.html", "style.css", "icon-512.png", "lumigrid-1f0c2a9.js", "lumigrid-1F0C2A9B.js",
                            "deadbeef.js", "a-deadbeef", ".js", ""})
    EXPECT_FALSE(isHashedName(other)) << other;
}

TEST(PageNames, typesAreThoseThatBrowsersWant) {
  EXPECT_STREQ(contentTypeOf("lumigrid-1f0c2a9b.wasm"), "application/wasm");
  EXPECT_STREQ(contentTypeOf("a.js"), "text/javascript; charset=utf-8");
  EXPECT_STREQ(contentTypeOf("index.html"), "text/html; charset=utf-8");
  EXPECT_STREQ(contentTypeOf("unknown.xyz"), "application/octet-stream");
}

}  // namespace
}  // namespace server
