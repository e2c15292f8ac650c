// The nginx configuration of docs/hosting.md does what the document says, with a real nginx.
#include <gtest/gtest.h>

#include <filesystem>
#include <memory>

#include "base/file.h"
#include "server/net/page_files.h"
#include "tests/server/net/loopback.h"
#include "tests/support/nginx.h"

namespace server {
namespace {

const std::string kName = "images/pack-0123456789abcdef0123456789abcdef.lgk";

void write(const std::string& path, const std::string& text) {
  ASSERT_TRUE(base::writeFileAtomically(path, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}));
}

void replace(std::string& text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  ASSERT_NE(at, std::string::npos) << "docs/hosting.md lacks '" << from << "'";
  text.replace(at, from.size(), to);
}

// The document's snippet with the minimum that nginx needs around it, on a directory of the test's own.
class HostingTest : public testing::Test {
 protected:
  void SetUp() override {
    LUMIGRID_SKIP_WITHOUT_NGINX();
    std::filesystem::create_directories(directory_ / "tower/images");
    write(directory_ / "tower/scene.json", "{\"version\": 1}");
    write(directory_ / ("tower/" + kName), std::string(100000, 'x') + "end");
    write(directory_ / "tower/index.html", "<!doctype html><title>page</title>");
    write(directory_ / "tower/lumigrid-0123abcd.wasm", std::string("\0asm", 4));
    write(directory_ / "tower/lumigrid-0123abcd.wasm.gz", "wasm as gzip");
    write(directory_ / "tower/lumigrid-0123abcd.js", "program");
    std::string snippet;
    readSnippet(snippet);
    if (HasFatalFailure()) return;
    nginx_ = std::make_unique<support::Nginx>(support::Nginx::Configuration{snippet});
    ASSERT_TRUE(nginx_->running());
  }
  void readSnippet(std::string& snippet) {
    const auto bytes = base::readFile(LUMIGRID_SOURCE_DIR "/docs/hosting.md");
    ASSERT_TRUE(bytes);
    const std::string document(bytes->begin(), bytes->end());
    const std::string fence = "```nginx\n";
    const std::size_t begin = document.find(fence);
    ASSERT_NE(begin, std::string::npos);
    const std::size_t end = document.find("```", begin + fence.size());
    snippet = document.substr(begin + fence.size(), end - begin - fence.size());
    replace(snippet, "listen 8088;", "listen 127.0.0.1:$PORT0;");
    replace(snippet, "root /srv/lumigrid;", "root " + directory_.path() + ";");
  }
  HttpAnswer request(const std::string& target, const std::map<std::string, std::string>& headers = {},
                     const std::string& method = "GET") const {
    return httpRequest(nginx_->port(), target, headers, method);
  }

  const support::TemporaryDirectory directory_;
  std::unique_ptr<support::Nginx> nginx_;
};

TEST_F(HostingTest, packsAreReadByRangeAndKeptForever) {
  const HttpAnswer part = request("/tower/" + kName, {{"Range", "bytes=99998-100001"}});
  EXPECT_EQ(part.status, 206);
  EXPECT_EQ(part.body, "xxen");
  EXPECT_EQ(part.headers.at("content-range"), "bytes 99998-100001/100003");
  EXPECT_EQ(part.headers.at("cache-control"), "public, max-age=31536000, immutable");
  EXPECT_EQ(part.headers.at("access-control-allow-origin"), "*");
  EXPECT_NE(part.headers.at("access-control-expose-headers").find("Content-Range"), std::string::npos);
  EXPECT_EQ(request("/tower/" + kName, {{"Range", "bytes=200000-"}}).status, 416);
  const HttpAnswer whole = request("/tower/" + kName, {{"Accept-Encoding", "gzip"}});
  EXPECT_EQ(whole.status, 200);
  EXPECT_EQ(whole.body.size(), 100003U);
  EXPECT_EQ(whole.headers.count("content-encoding"), 0U);
}

TEST_F(HostingTest, unchangedRootIsAnsweredWithoutABody) {
  const HttpAnswer root = request("/tower/scene.json");
  EXPECT_EQ(root.status, 200);
  EXPECT_EQ(root.headers.at("cache-control"), "no-cache");
  EXPECT_EQ(root.headers.at("content-type"), "application/json");
  EXPECT_EQ(request("/tower/scene.json", {{"If-None-Match", root.headers.at("etag")}}).status, 304);
  write(directory_ / "tower/scene.json", "{\"version\": 1, \"more\": 2}");
  EXPECT_EQ(request("/tower/scene.json").body, "{\"version\": 1, \"more\": 2}");
}

TEST_F(HostingTest, pageHasTheHeadersThatBrowsersNeed) {
  const HttpAnswer page = request("/tower/");
  EXPECT_EQ(page.status, 200);
  EXPECT_EQ(page.body, "<!doctype html><title>page</title>");
  EXPECT_EQ(page.headers.at("content-type"), "text/html; charset=utf-8");
  EXPECT_EQ(page.headers.at("cache-control"), "no-cache");
  EXPECT_EQ(page.headers.at("content-security-policy"), kPagePolicy) << "the document's is not the server's";
  EXPECT_EQ(page.headers.at("x-content-type-options"), "nosniff");
  const HttpAnswer wasm = request("/tower/lumigrid-0123abcd.wasm");
  EXPECT_EQ(wasm.headers.at("content-type"), "application/wasm");
  EXPECT_EQ(wasm.headers.at("cache-control"), "public, max-age=31536000, immutable");
  EXPECT_EQ(wasm.headers.count("content-security-policy"), 0U);
  const HttpAnswer gzip = request("/tower/lumigrid-0123abcd.wasm", {{"Accept-Encoding", "gzip"}});
  EXPECT_EQ(gzip.body, "wasm as gzip");
  EXPECT_EQ(gzip.headers.at("content-encoding"), "gzip");
  EXPECT_EQ(gzip.headers.at("content-type"), "application/wasm");
  const HttpAnswer program = request("/tower/lumigrid-0123abcd.js", {{"Accept-Encoding", "gzip"}});
  EXPECT_EQ(program.headers.at("content-type"), "text/javascript; charset=utf-8");
  EXPECT_EQ(program.headers.count("content-encoding"), 0U);
}

TEST_F(HostingTest, pagesOfOtherHostsMayReadAndSeeMissingHeaders) {
  const HttpAnswer asked =
      request("/tower/" + kName, {{"Origin", "https://other"}, {"Access-Control-Request-Headers", "range"}}, "OPTIONS");
  EXPECT_EQ(asked.status, 204);
  EXPECT_EQ(asked.headers.at("access-control-allow-origin"), "*");
  EXPECT_NE(asked.headers.at("access-control-allow-headers").find("Range"), std::string::npos);
  const HttpAnswer none = request("/tower/images/none.lgk");
  EXPECT_EQ(none.status, 404);
  EXPECT_EQ(none.headers.at("access-control-allow-origin"), "*");
  EXPECT_EQ(none.headers.count("cache-control"), 0U);
}

}  // namespace
}  // namespace server
