// lumigrid serve with private scenes, and lumigrid sign, as a user runs them.
#include <signal.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "tests/programs/run_program.h"
#include "tests/server/net/loopback.h"

namespace {

using nlohmann::json;
using programs::run;

class Private : public programs::ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    programs::writeText(path("link.key"), std::string(32, 'k') + "\n");
    programs::writeText(path("tokens.json"), R"([{"token": "token-of-the-only-scene", "scenes": ["tower"]}])");
    const auto built = run("lumigrid", {"build", smallMesh(), "-o", path("tower"), "--methods", "qsplat", "--quiet"});
    ASSERT_EQ(built.status, 0) << built.err;
  }
  void TearDown() override {
    if (server_ > 0) {
      ::kill(server_, SIGKILL);
      programs::wait(server_);
    }
    ProgramTest::TearDown();
  }
  void serve(std::vector<std::string> options) {
    options.insert(options.begin(), {"serve", path("tower"), "--port", "0", "--json", "--no-frames", "--no-access"});
    server_ = programs::start("lumigrid", options, path("serve"));
    for (int i = 0; i < 2000 && port_ == 0; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
      const json j = json::parse(programs::readText(path("serve.out")), nullptr, false);
      if (j.is_object()) port_ = j["port"];
    }
    ASSERT_NE(port_, 0) << programs::readText(path("serve.err"));
  }
  int statusOf(const std::string& target, const std::string& token = "") const {
    std::map<std::string, std::string> fields;
    if (!token.empty()) fields["Authorization"] = "Bearer " + token;
    return server::httpRequest(port_, target, fields).status;
  }
  std::string signedTarget(const std::string& scene, const std::string& expires) const {
    const auto made = run("lumigrid", {"sign", "--key", path("link.key"), "--scene", scene, "--expires", expires,
                                       "https://example.org/scene.json"});
    EXPECT_EQ(made.status, 0) << made.err;
    const std::string url = made.out.substr(0, made.out.find('\n'));
    return url.substr(url.find("/scene.json"));
  }
  bool logSays(const std::string& text) const {
    for (int i = 0; i < 1000; ++i) {
      if (programs::readText(path("serve.err")).find(text) != std::string::npos) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    return false;
  }

  pid_t server_ = -1;
  std::uint16_t port_ = 0;
};

TEST_F(Private, aPublicAddressIsRefusedInOneLine) {
  const auto serveAt = [&](std::vector<std::string> options) {
    options.insert(options.begin(), {"serve", path("tower"), "--port", "0", "--address", "0.0.0.0"});
    return run("lumigrid", options);
  };
  const std::vector<std::string> named{"0.0.0.0", "--public", "--tokens FILE", "--signing-key FILE", "--open"};
  programs::expectOneLineError(serveAt({}), 1, named);
  programs::expectOneLineError(serveAt({"--public"}), 1, named);
  programs::expectOneLineError(serveAt({"--open"}), 1, named);
  programs::expectOneLineError(serveAt({"--public", "--open", "--tokens", path("tokens.json")}), 1, {"--open"});
  programs::expectOneLineError(serveAt({"--public", "--tokens", path("none")}), 1, {path("none")});
  programs::expectOneLineError(serveAt({"--public", "--open", "--certificate", path("none"), "--key", path("none")}), 1,
                               {path("none"), "certificate"});
}

TEST_F(Private, linksOpenTheSceneTheyAreSignedFor) {
  serve({"--signing-key", path("link.key")});
  EXPECT_EQ(statusOf("/scene.json"), 401);
  EXPECT_EQ(statusOf(signedTarget("tower", "1h")), 303);
  EXPECT_EQ(statusOf(signedTarget("hall", "1h")), 401);
  std::string changed = signedTarget("tower", "1h");
  changed.back() = changed.back() == '0' ? '1' : '0';
  EXPECT_EQ(statusOf(changed), 401);
  EXPECT_EQ(programs::readText(path("serve.err")).find("signature"), std::string::npos);
}

TEST_F(Private, tokensAreReadAgainOnSighup) {
  serve({"--tokens", path("tokens.json")});
  EXPECT_EQ(statusOf("/scene.json", "token-of-the-only-scene"), 200);
  programs::writeText(path("tokens.json"), R"([{"token": "token-that-came-later", "scenes": ["tower"]}])");
  ::kill(server_, SIGHUP);
  ASSERT_TRUE(logSays("are read again"));
  EXPECT_EQ(statusOf("/scene.json", "token-of-the-only-scene"), 401);
  EXPECT_EQ(statusOf("/scene.json", "token-that-came-later"), 200);
  programs::writeText(path("tokens.json"), "[");
  ::kill(server_, SIGHUP);
  ASSERT_TRUE(logSays("stay as they were"));
  EXPECT_EQ(statusOf("/scene.json", "token-that-came-later"), 200);
  EXPECT_EQ(programs::readText(path("serve.err")).find("token-"), std::string::npos);
  ::kill(server_, SIGTERM);
  EXPECT_EQ(programs::wait(std::exchange(server_, -1)), 0);
}

TEST_F(Private, signNamesWhatIsWrong) {
  const auto sign = [&](const std::string& key, const std::string& expires, const std::string& url) {
    return run("lumigrid", {"sign", "--key", key, "--scene", "tower", "--expires", expires, url});
  };
  const std::string url = "https://example.org/tower/";
  for (const char* bad : {"", "24", "h", "0h", "1y", "-1h", "3651d", "1.5h"})
    programs::expectOneLineError(sign(path("link.key"), bad, url), 1, {"--expires", "24h"});
  programs::expectOneLineError(sign(path("link.key"), "1h", "example.org"), 1, {"'example.org'"});
  programs::expectOneLineError(sign(path("none"), "1h", url), 1, {path("none")});
  programs::expectOneLineError(sign(path("tokens.json"), "1h", url), 1, {path("tokens.json"), "openssl rand"});
  EXPECT_EQ(run("lumigrid", {"sign", url}).status, 2);
}

}  // namespace
