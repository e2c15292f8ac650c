// The counts that a server keeps equal what its clients received.
#include "server/scene/access_log.h"

#include <gtest/gtest.h>
#include <sys/mount.h>

#include <chrono>
#include <csignal>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "server/scene/open_scene.h"
#include "tests/programs/run_program.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"

namespace server {
namespace {

using FaceCounts = std::map<std::uint64_t, std::uint64_t>;  // by key code

/// Counts of the faces and groups that clients received.
struct ReceivedCounts {
  FaceCounts faces;
  std::uint64_t groups = 0;
  void countMessage(const protocol::ServerMessage& message) {
    if (const auto* face = std::get_if<protocol::Face>(&message)) ++faces[face->key.code()];
    if (std::holds_alternative<protocol::Refinement>(message)) ++groups;
  }
  std::uint64_t faceTotal() const {
    std::uint64_t sum = 0;
    for (const auto& [code, count] : faces) sum += count;
    return sum;
  }
};

std::unique_ptr<LoopbackClient> greeted(std::uint16_t port, protocol::Welcome& welcome) {
  auto client = LoopbackClient::connect(port);
  if (!client || !client->send(protocol::Hello{protocol::kVersion, "counting"})) return nullptr;
  const auto message = client->receive();
  if (!message || !std::holds_alternative<protocol::Welcome>(*message)) return nullptr;
  welcome = std::get<protocol::Welcome>(*message);
  return client;
}

/// Looks until the view is complete, then breaks the rules: what the server had handed to the connection comes before
/// its refusal, so all of it is received.
void lookAndBeRefused(std::uint16_t port, ReceivedCounts& received) {
  protocol::Welcome welcome;
  auto client = greeted(port, welcome);
  ASSERT_TRUE(client);
  ASSERT_TRUE(client->send(viewOf(welcome, 1)));
  bool complete = false, refused = false;
  while (auto message = client->receive()) {
    received.countMessage(*message);
    if (std::holds_alternative<protocol::Completion>(*message)) {
      complete = true;
      ASSERT_TRUE(client->send(protocol::Hello{protocol::kVersion, "again"}));
    }
    refused = refused || std::holds_alternative<protocol::Refusal>(*message);
  }
  EXPECT_TRUE(complete);
  EXPECT_TRUE(refused);
}

repository::AccessIdentity identityOf(const std::string& scene) {
  const auto open = openScene(scene);
  EXPECT_TRUE(open);
  return accessIdentityOf(**open);
}

repository::AccessCounts loaded(const std::string& file, const repository::AccessIdentity& identity) {
  auto counts = repository::loadAccess({file}, identity);
  if (counts) return *counts;
  ADD_FAILURE() << counts.error().message;
  return {};
}

FaceCounts byCode(const repository::AccessCounts& counts) {
  FaceCounts faces;
  for (const auto& [key, count] : counts.faces) faces[key.code()] = count;
  return faces;
}

TEST(AccessLog, countsEqualWhatClientsReceived) {
  const SceneDirectory scene;
  const auto identity = identityOf(scene.path);
  const std::string file = repository::accessFileOf(scene.path);
  ReceivedCounts received;
  for (int servers = 0; servers < 2; ++servers) {  // the second adds to what the first has left
    RunningServer server(scene.path);
    for (int viewers = 0; viewers < 3; ++viewers) lookAndBeRefused(server.port(), received);
    server.stop();
    const auto counts = loaded(file, identity);
    EXPECT_EQ(byCode(counts), received.faces);
    EXPECT_EQ(counts.groupsSent(), received.groups);
    EXPECT_EQ(counts.uncounted, 0U);
    EXPECT_GT(counts.since, 1'700'000'000);
    EXPECT_LE(counts.since, counts.until);
  }
  EXPECT_GE(received.faceTotal(), 24U);
}

TEST(AccessLog, twoServersOfOneSceneAddUp) {
  const SceneDirectory scene;
  const auto identity = identityOf(scene.path);
  ServerOptions options = RunningServer::quiet();
  options.access_interval_seconds = 0.01;
  options.access_file = scene.path + "/counts";
  ReceivedCounts received;
  {
    RunningServer first(scene.path, options), second(scene.path, options);
    for (int viewers = 0; viewers < 3; ++viewers) {
      lookAndBeRefused(first.port(), received);
      lookAndBeRefused(second.port(), received);
    }
  }
  EXPECT_EQ(byCode(loaded(options.access_file, identity)), received.faces);
  EXPECT_FALSE(std::filesystem::exists(repository::accessFileOf(scene.path)));
}

TEST(AccessLog, nothingIsWrittenWhenTurnedOff) {
  const SceneDirectory scene;
  ServerOptions options = RunningServer::quiet();
  options.count_access = false;
  ReceivedCounts received;
  {
    RunningServer server(scene.path, options);
    lookAndBeRefused(server.port(), received);
  }
  EXPECT_FALSE(std::filesystem::exists(repository::accessFileOf(scene.path)));
  EXPECT_FALSE(std::filesystem::exists(repository::accessFileOf(scene.path) + ".lock"));
}

TEST(AccessLog, unwritableFileStopsNoServer) {
  const SceneDirectory scene;
  ServerOptions options = RunningServer::quiet();
  options.access_file = scene.path + "/nowhere/access.lga";
  ReceivedCounts received;
  RunningServer server(scene.path, options);
  lookAndBeRefused(server.port(), received);
  EXPECT_GE(received.faceTotal(), 4U);
}

TEST(AccessLog, unwrittenCountsAreWrittenLater) {
  const SceneDirectory scene;
  const auto identity = identityOf(scene.path);
  const std::string file = repository::accessFileOf(scene.path);
  std::ofstream(file) << "no counts";
  ReceivedCounts received;
  {
    RunningServer server(scene.path);
    lookAndBeRefused(server.port(), received);
    EXPECT_EQ(base::readFile(file)->size(), 9U) << "what is there is not overwritten";
    std::filesystem::remove(file);
  }
  EXPECT_EQ(byCode(loaded(file, identity)), received.faces);
}

/// Puts another scene in the place of the one that is there: all is as it was but for the hierarchy's digest.
void replaceScene(const std::string& directory) {
  auto scene = base::readScene(directory);
  ASSERT_TRUE(scene);
  scene->parts.push_back({"patch.lgp", std::filesystem::file_size(directory + "/patch.lgp"), std::string(64, 'e')});
  ASSERT_TRUE(base::writeSceneFile(*scene, directory + "/scene.json"));
}

TEST(AccessLog, countsOfAReplacedSceneAreKeptApart) {
  const SceneDirectory scene;
  const auto before = identityOf(scene.path);
  const std::string file = repository::accessFileOf(scene.path);
  ReceivedCounts of_old, of_new;
  RunningServer holds_old(scene.path);
  replaceScene(scene.path);
  const auto after = identityOf(scene.path);
  RunningServer holds_new(scene.path);
  lookAndBeRefused(holds_old.port(), of_old);
  lookAndBeRefused(holds_old.port(), of_old);
  lookAndBeRefused(holds_new.port(), of_new);
  holds_old.stop();
  holds_new.stop();
  EXPECT_EQ(byCode(loaded(file, before)), of_old.faces);
  EXPECT_EQ(byCode(loaded(repository::accessFileBeside(file, after.hierarchy), after)), of_new.faces);

  const auto info = programs::run("lumigrid", {"info", scene.path, "--json"});
  EXPECT_EQ(nlohmann::json::parse(info.out)["access"]["faces_sent"], of_new.faceTotal()) << info.out;
}

TEST(AccessLog, fullCounterWritesAtOnce) {
  const SceneDirectory scene;
  const auto identity = identityOf(scene.path);
  const std::string file = repository::accessFileOf(scene.path);
  AccessLog log(file, identity, 1e6, 5);
  for (std::uint32_t d = 0; d < 5; ++d) log.counter().addFace({0, 0, 0, d});
  while (!std::filesystem::exists(file)) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  EXPECT_EQ(loaded(file, identity).facesSent(), 5U);
}

// ---- the program ----

class ServeProgram : public ::testing::Test {
 protected:
  void start(const std::vector<std::string>& more) {
    std::vector<std::string> words{"serve", scene.path, "--port", "0", "--json", "--no-frames"};
    words.insert(words.end(), more.begin(), more.end());
    std::filesystem::remove(logs.path + "/log.out");
    pid = programs::start("lumigrid", words, logs.path + "/log");
    nlohmann::json said;
    for (int i = 0; i < 6000 && !said.is_object(); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      said = nlohmann::json::parse(programs::readText(logs.path + "/log.out"), nullptr, false);
    }
    ASSERT_TRUE(said.is_object()) << programs::readText(logs.path + "/log.err");
    port = said["port"];
  }
  int end(int signal) {
    ::kill(pid, signal);
    return programs::wait(std::exchange(pid, 0));
  }
  void TearDown() override {
    if (pid > 0) end(SIGKILL);
  }

  const SceneDirectory scene;
  const SceneDirectory logs{0};  // aside: the scene may be read-only
  const repository::AccessIdentity identity = identityOf(scene.path);
  const std::string file = repository::accessFileOf(scene.path);
  ReceivedCounts received;
  pid_t pid = 0;
  std::uint16_t port = 0;
};

TEST_F(ServeProgram, countsSurviveSigterm) {
  ASSERT_NO_FATAL_FAILURE(start({"--access-interval", "86400"}));
  lookAndBeRefused(port, received);

  // The second viewer is in the middle of its view.
  protocol::Welcome welcome;
  auto client = greeted(port, welcome);
  ASSERT_TRUE(client);
  ASSERT_TRUE(client->send(viewOf(welcome, 1)));
  received.countMessage(*client->receive());
  ::kill(pid, SIGTERM);
  while (auto message = client->receive()) received.countMessage(*message);
  EXPECT_EQ(end(0), 0);  // it ends by itself

  const auto counts = loaded(file, identity);
  // Messages that were made for the second viewer count, though a few of them no longer reached it.
  const auto sent = byCode(counts);
  for (const auto& [code, times] : received.faces) EXPECT_GE(sent.at(code), times);
  EXPECT_GE(counts.groupsSent(), received.groups);
  EXPECT_LE(counts.groupsSent(), 2 * received.groups);

  const auto info = programs::run("lumigrid", {"info", scene.path, "--json"});
  ASSERT_EQ(info.status, 0) << info.err;
  const auto access = nlohmann::json::parse(info.out)["access"];
  EXPECT_EQ(access["faces_sent"], counts.facesSent());
  EXPECT_EQ(access["groups_sent"], counts.groupsSent());
  EXPECT_GE(access["points"].size(), 1U);
  EXPECT_GE(access["points"][0]["sent"], access["points"].back()["sent"]);
  EXPECT_NE(programs::run("lumigrid", {"info", scene.path}).out.find("sent to viewers from 20"), std::string::npos);
}

TEST_F(ServeProgram, killedServerLosesAtMostTheLastInterval) {
  ASSERT_NO_FATAL_FAILURE(start({"--access-interval", "0.02"}));
  lookAndBeRefused(port, received);
  std::uint64_t written = 0;
  while (written < received.faceTotal()) {  // soon: an interval later
    if (std::filesystem::exists(file)) written = loaded(file, identity).facesSent();
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  EXPECT_EQ(byCode(loaded(file, identity)), received.faces);
  const ReceivedCounts before = received;
  lookAndBeRefused(port, received);
  EXPECT_EQ(end(SIGKILL), 128 + SIGKILL);

  // Everything that the first viewer received was counted, of the second what was written by then, and nothing twice.
  const FaceCounts kept = byCode(loaded(file, identity));
  for (const auto& [code, count] : kept) EXPECT_LE(count, received.faces[code]);
  for (const auto& [code, count] : before.faces) EXPECT_GE(kept.at(code), count);

  // Another server continues from these counts.
  ASSERT_NO_FATAL_FAILURE(start({}));
  ReceivedCounts third;
  lookAndBeRefused(port, third);
  EXPECT_EQ(end(SIGTERM), 0);
  FaceCounts expected = kept;
  for (const auto& [code, count] : third.faces) expected[code] += count;
  EXPECT_EQ(byCode(loaded(file, identity)), expected);
}

/// Makes a directory read-only, even for root, as long as the object lives.
class ReadOnly {
 public:
  explicit ReadOnly(std::string path) : path_(std::move(path)) {
    mounted_ = ::mount(path_.c_str(), path_.c_str(), nullptr, MS_BIND, nullptr) == 0;
    holds_ = mounted_ && ::mount(nullptr, path_.c_str(), nullptr, MS_BIND | MS_REMOUNT | MS_RDONLY, nullptr) == 0;
  }
  ~ReadOnly() {
    if (mounted_) ::umount2(path_.c_str(), MNT_DETACH);
  }
  ReadOnly(const ReadOnly&) = delete;
  ReadOnly& operator=(const ReadOnly&) = delete;
  bool holds() const { return holds_; }

 private:
  const std::string path_;
  bool mounted_ = false, holds_ = false;
};

TEST_F(ServeProgram, readOnlySceneIsServedWithOneWarning) {
  const ReadOnly read_only(scene.path);
  if (!read_only.holds()) GTEST_SKIP() << "this user may not mount";
  ASSERT_NO_FATAL_FAILURE(start({"--access-interval", "0.02"}));
  lookAndBeRefused(port, received);
  EXPECT_GE(received.faceTotal(), 4U);
  EXPECT_EQ(end(SIGTERM), 0);

  const std::string log = programs::readText(logs.path + "/log.err") + programs::readText(logs.path + "/log.out");
  const auto first = log.find("access counts are not kept");
  ASSERT_NE(first, std::string::npos) << log;
  EXPECT_NE(log.find("--no-access", first), std::string::npos) << log;
  EXPECT_EQ(log.find("access counts are not kept", first + 1), std::string::npos) << log;
}

}  // namespace
}  // namespace server
