// The nginx configuration of docs/hosting.md does what the document says, with a real nginx.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <filesystem>
#include <thread>

#include "base/file.h"
#include "server/net/page_files.h"
#include "tests/server/net/loopback.h"

namespace server {
namespace {

namespace fs = std::filesystem;

constexpr const char* kNginx = "/usr/sbin/nginx";
const std::string kName = "images/pack-0123456789abcdef0123456789abcdef.lgk";

void write(const std::string& path, const std::string& text) {
  ASSERT_TRUE(base::writeFileAtomically(path, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}));
}

// A port that nobody listens at, as of now.
std::uint16_t freePort() {
  const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t length = sizeof(address);
  EXPECT_EQ(::bind(fd, reinterpret_cast<sockaddr*>(&address), length), 0);
  EXPECT_EQ(::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &length), 0);
  ::close(fd);
  return ntohs(address.sin_port);
}

void replace(std::string& text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  ASSERT_NE(at, std::string::npos) << "docs/hosting.md lacks '" << from << "'";
  text.replace(at, from.size(), to);
}

// The document's snippet in the least that nginx wants around it, on a directory of the test's own.
class HostingTest : public testing::Test {
 protected:
  void SetUp() override {
    if (!fs::exists(kNginx)) GTEST_SKIP() << "no nginx here";
    work_ = (fs::temp_directory_path() / ("lumigrid_hosting_" + std::to_string(::getpid()))).string();
    fs::create_directories(work_ + "/srv/tower/images");
    write(work_ + "/srv/tower/scene.json", "{\"version\": 1}");
    write(work_ + "/srv/tower/" + kName, std::string(100000, 'x') + "end");
    write(work_ + "/srv/tower/index.html", "<!doctype html><title>page</title>");
    write(work_ + "/srv/tower/lumigrid-0123abcd.wasm", std::string("\0asm", 4));
    write(work_ + "/srv/tower/lumigrid-0123abcd.wasm.gz", "wasm as gzip");
    write(work_ + "/srv/tower/lumigrid-0123abcd.js", "program");
    writeConfiguration();
    if (HasFatalFailure()) return;
    pid_ = ::fork();
    if (pid_ == 0) {
      ::execl(kNginx, "nginx", "-p", work_.c_str(), "-c", "nginx.conf", "-e", "error.log", nullptr);
      ::_exit(127);
    }
    for (int i = 0; i < 1000 && httpRequest(port_, "/").status == 0; ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  void TearDown() override {
    if (pid_ > 0) {
      ::kill(pid_, SIGTERM);
      ::waitpid(pid_, nullptr, 0);
    }
    if (!work_.empty()) fs::remove_all(work_);
  }
  void writeConfiguration() {
    const auto bytes = base::readFile(LUMIGRID_SOURCE_DIR "/docs/hosting.md");
    ASSERT_TRUE(bytes);
    const std::string document(bytes->begin(), bytes->end());
    const std::string fence = "```nginx\n";
    const std::size_t begin = document.find(fence);
    ASSERT_NE(begin, std::string::npos);
    const std::size_t end = document.find("```", begin + fence.size());
    std::string snippet = document.substr(begin + fence.size(), end - begin - fence.size());
    port_ = freePort();
    replace(snippet, "listen 8088;", "listen 127.0.0.1:" + std::to_string(port_) + ";");
    replace(snippet, "root /srv/lumigrid;", "root " + work_ + "/srv;");
    std::string around = "daemon off;\nmaster_process off;\npid nginx.pid;\nevents { }\nhttp {\naccess_log off;\n";
    for (const char* module : {"client_body", "proxy", "fastcgi", "uwsgi", "scgi"})
      around += std::string(module) + "_temp_path " + module + ";\n";
    write(work_ + "/nginx.conf", around + snippet + "}\n");
  }

  std::string work_;
  std::uint16_t port_ = 0;
  pid_t pid_ = -1;
};

TEST_F(HostingTest, packsAreReadByRangeAndKeptForever) {
  const HttpAnswer part = httpRequest(port_, "/tower/" + kName, {{"Range", "bytes=99998-100001"}});
  EXPECT_EQ(part.status, 206);
  EXPECT_EQ(part.body, "xxen");
  EXPECT_EQ(part.headers.at("content-range"), "bytes 99998-100001/100003");
  EXPECT_EQ(part.headers.at("cache-control"), "public, max-age=31536000, immutable");
  EXPECT_EQ(part.headers.at("access-control-allow-origin"), "*");
  EXPECT_NE(part.headers.at("access-control-expose-headers").find("Content-Range"), std::string::npos);
  EXPECT_EQ(httpRequest(port_, "/tower/" + kName, {{"Range", "bytes=200000-"}}).status, 416);
  const HttpAnswer whole = httpRequest(port_, "/tower/" + kName, {{"Accept-Encoding", "gzip"}});
  EXPECT_EQ(whole.status, 200);
  EXPECT_EQ(whole.body.size(), 100003U);
  EXPECT_EQ(whole.headers.count("content-encoding"), 0U);
}

TEST_F(HostingTest, theRootIsAskedForAnewAndAnsweredWithNothingWhenItIsTheSame) {
  const HttpAnswer root = httpRequest(port_, "/tower/scene.json");
  EXPECT_EQ(root.status, 200);
  EXPECT_EQ(root.headers.at("cache-control"), "no-cache");
  EXPECT_EQ(root.headers.at("content-type"), "application/json");
  EXPECT_EQ(httpRequest(port_, "/tower/scene.json", {{"If-None-Match", root.headers.at("etag")}}).status, 304);
  write(work_ + "/srv/tower/scene.json", "{\"version\": 1, \"more\": 2}");
  EXPECT_EQ(httpRequest(port_, "/tower/scene.json").body, "{\"version\": 1, \"more\": 2}");
}

TEST_F(HostingTest, thePageComesAsBrowsersWantIt) {
  const HttpAnswer page = httpRequest(port_, "/tower/");
  EXPECT_EQ(page.status, 200);
  EXPECT_EQ(page.body, "<!doctype html><title>page</title>");
  EXPECT_EQ(page.headers.at("content-type"), "text/html; charset=utf-8");
  EXPECT_EQ(page.headers.at("cache-control"), "no-cache");
  EXPECT_EQ(page.headers.at("content-security-policy"), kPagePolicy) << "the document's is not the server's";
  EXPECT_EQ(page.headers.at("x-content-type-options"), "nosniff");
  const HttpAnswer wasm = httpRequest(port_, "/tower/lumigrid-0123abcd.wasm");
  EXPECT_EQ(wasm.headers.at("content-type"), "application/wasm");
  EXPECT_EQ(wasm.headers.at("cache-control"), "public, max-age=31536000, immutable");
  EXPECT_EQ(wasm.headers.count("content-security-policy"), 0U);
  const HttpAnswer gzip = httpRequest(port_, "/tower/lumigrid-0123abcd.wasm", {{"Accept-Encoding", "gzip"}});
  EXPECT_EQ(gzip.body, "wasm as gzip");
  EXPECT_EQ(gzip.headers.at("content-encoding"), "gzip");
  EXPECT_EQ(gzip.headers.at("content-type"), "application/wasm");
  const HttpAnswer program = httpRequest(port_, "/tower/lumigrid-0123abcd.js", {{"Accept-Encoding", "gzip"}});
  EXPECT_EQ(program.headers.at("content-type"), "text/javascript; charset=utf-8");
  EXPECT_EQ(program.headers.count("content-encoding"), 0U);
}

TEST_F(HostingTest, pagesOfOtherHostsMayAskAndSeeWhatIsMissing) {
  const HttpAnswer asked = httpRequest(
      port_, "/tower/" + kName, {{"Origin", "https://other"}, {"Access-Control-Request-Headers", "range"}}, "OPTIONS");
  EXPECT_EQ(asked.status, 204);
  EXPECT_EQ(asked.headers.at("access-control-allow-origin"), "*");
  EXPECT_NE(asked.headers.at("access-control-allow-headers").find("Range"), std::string::npos);
  const HttpAnswer none = httpRequest(port_, "/tower/images/none.lgk");
  EXPECT_EQ(none.status, 404);
  EXPECT_EQ(none.headers.at("access-control-allow-origin"), "*");
  EXPECT_EQ(none.headers.count("cache-control"), 0U);
}

}  // namespace
}  // namespace server
