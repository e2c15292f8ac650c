// Two scenes are served, and the disk of one stops answering, as that of a network file system whose server is gone:
// calls to its files do not return. The other scene, the server's health and its end go on.
#include <future>
#include <memory>
#include <vector>

#include "tests/server/net/serve_process.h"
#include "tests/server/net/served_scene.h"
#include "tests/server/net/whole_view.h"

namespace server {
namespace {

constexpr int kViewers = 8;  // of the scene that hangs: more than there are threads for

class HungDisk : public ::testing::Test {
 protected:
  ~HungDisk() override { letGo(); }

  std::unique_ptr<ServeProcess> serve(const std::vector<std::string>& more = {}) const {
    std::vector<std::string> arguments{hung_.path, other_.path, "--web", "off", "--drain", "1"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    // The environment is the child's alone; threads of this process read none of these.
    const std::vector<std::pair<std::string, std::string>> environment{{"LD_PRELOAD", LUMIGRID_FAULT_LIBRARY},
                                                                       {"LUMIGRID_FAULT_FOLDER", hung_.path},
                                                                       {"ASAN_OPTIONS", "verify_asan_link_order=0"}};
    for (const auto& [name, value] : environment) ::setenv(name.c_str(), value.c_str(), 1);
    auto server = std::make_unique<ServeProcess>(arguments);
    for (const auto& [name, value] : environment) ::unsetenv(name.c_str());
    return server;
  }
  void hang() const { programs::writeText(marker(), ""); }
  void letGo() const { std::filesystem::remove(marker()); }
  /// One token, which opens all scenes.
  static void writeTokens(const std::string& path, const std::string& token) {
    programs::writeText(path, R"([{"token": ")" + token + R"(", "scenes": "all"}])");
  }
  static std::string addressOf(const SceneDirectory& scene) {
    return "/" + std::filesystem::path(scene.path).filename().string() + "/";
  }
  void expectOthersAreServed(std::uint16_t port) const {
    for (const char* path : {"/healthz", "/readyz", "/metrics"}) EXPECT_EQ(httpRequest(port, path).status, 200) << path;
    expectAView(port, addressOf(other_));
    EXPECT_EQ(httpRequest(port, addressOf(other_) + "scene.json").status, 200);
    EXPECT_EQ(httpRequest(port, addressOf(other_) + "patch.lgp").status, 200);
  }

  const SceneDirectory hung_, other_;

 private:
  std::string marker() const { return hung_.path + ".hangs"; }
};

TEST_F(HungDisk, keepsItsOwnViewersAlone) {
  const auto server = serve();
  ASSERT_NE(server->port(), 0);
  protocol::Welcome welcome;
  std::vector<std::unique_ptr<LoopbackClient>> viewers;
  for (int i = 0; i < kViewers; ++i) {
    viewers.push_back(viewerAt(server->port(), addressOf(hung_), welcome));
    ASSERT_TRUE(viewers.back());
  }
  hang();
  for (const auto& viewer : viewers) ASSERT_TRUE(viewer->send(viewOf(welcome, 1)));
  for (int i = 0; i < 3; ++i) expectOthersAreServed(server->port());

  // When the disk answers again, so does the scene: all that its viewers asked for comes.
  letGo();
  for (const auto& viewer : viewers) {
    bool completed = false;
    while (const auto message = completed ? std::nullopt : viewer->receive())
      completed = std::holds_alternative<protocol::Completion>(*message);
    EXPECT_TRUE(completed);
  }
  expectAView(server->port(), addressOf(hung_));
  server->send(SIGTERM);
  EXPECT_EQ(server->wait(), 0);
  EXPECT_EQ(server->log().find("ends without"), std::string::npos) << server->log();
}

// Whoever asks for a scene's documents, connects to it or reloads the server waits for a disk, and nobody else does.
TEST_F(HungDisk, keepsNoRequestOfOthers) {
  const auto server = serve();
  ASSERT_NE(server->port(), 0);
  hang();
  std::vector<std::future<HttpAnswer>> documents;
  for (const char* file : {"scene.json", "annotations.json"})
    documents.push_back(std::async(
        std::launch::async, [this, &server, file] { return httpRequest(server->port(), addressOf(hung_) + file); }));
  askAndLeave(server->port(), addressOf(hung_) + "patch.lgp");
  server->send(SIGHUP);
  for (int i = 0; i < 3; ++i) expectOthersAreServed(server->port());
  // After a while the documents are served as they were, and viewers are welcomed by them.
  for (auto& answer : documents) EXPECT_EQ(answer.get().status, 200);
  protocol::Welcome welcome;
  EXPECT_TRUE(viewerAt(server->port(), addressOf(hung_), welcome));
  EXPECT_NE(server->log().find("does not answer"), std::string::npos);
  expectOthersAreServed(server->port());

  letGo();
  EXPECT_TRUE(waitFor([&] { return server->log().find("reloaded: 2 scenes") != std::string::npos; }));
  server->send(SIGTERM);
  EXPECT_EQ(server->wait(), 0);
}

TEST_F(HungDisk, withTheTokensOnItKeepsTheOldOnes) {
  const std::string tokens = hung_.path + "/tokens.json", token = "0123456789abcdef0123456789abcdef";
  writeTokens(tokens, token);
  const auto server = serve({"--tokens", tokens});
  ASSERT_NE(server->port(), 0);
  hang();
  server->send(SIGHUP);
  for (int i = 0; i < 3; ++i) {
    EXPECT_EQ(httpRequest(server->port(), "/healthz").status, 200);
    const std::string document = addressOf(other_) + "scene.json";
    EXPECT_EQ(httpRequest(server->port(), document).status, 401);
    EXPECT_EQ(httpRequest(server->port(), document, {{"Authorization", "Bearer " + token}}).status, 200);
  }
  letGo();
  EXPECT_TRUE(waitFor([&] { return server->log().find("reloaded: 2 scenes") != std::string::npos; }));
}

// A request may wait for seconds, and its token may be withdrawn meanwhile.
TEST_F(HungDisk, opensNothingToWhoseTokenIsWithdrawnMeanwhile) {
  const std::string tokens = other_.path + "/tokens.json", token = "0123456789abcdef0123456789abcdef";
  writeTokens(tokens, token);
  const auto server = serve({"--tokens", tokens});
  ASSERT_NE(server->port(), 0);
  hang();
  auto waiting = std::async(std::launch::async, [&] {
    return httpRequest(server->port(), addressOf(hung_) + "scene.json", {{"Authorization", "Bearer " + token}});
  });
  ASSERT_EQ(waiting.wait_for(std::chrono::milliseconds(500)), std::future_status::timeout);
  writeTokens(tokens, "fedcba9876543210fedcba9876543210");
  server->send(SIGHUP);
  ASSERT_TRUE(waitFor([&] { return server->log().find("tokens are read again") != std::string::npos; }));
  EXPECT_EQ(waiting.get().status, 401);
  letGo();
}

TEST_F(HungDisk, isNotWaitedForAtTheEnd) {
  for (const int signal : {SIGTERM, SIGINT}) {
    const auto server = serve();
    ASSERT_NE(server->port(), 0);
    protocol::Welcome welcome;
    const auto viewer = viewerAt(server->port(), addressOf(hung_), welcome);
    ASSERT_TRUE(viewer);
    hang();
    ASSERT_TRUE(viewer->send(viewOf(welcome, 1)));
    expectAView(server->port(), addressOf(other_));
    server->send(signal);
    EXPECT_EQ(server->wait(), 0);
    const std::string log = server->log();
    EXPECT_NE(log.find("a disk does not answer; the server ends without: viewers' turns"), std::string::npos) << log;
    EXPECT_NE(log.find("the server ends without: access counts of " + hung_.path), std::string::npos) << log;
    EXPECT_EQ(log.find("the server ends without: access counts of " + other_.path), std::string::npos) << log;
    letGo();
  }
}

}  // namespace
}  // namespace server
