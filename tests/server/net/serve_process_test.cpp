// `lumigrid serve` as a process: its signals, its log with readers of every kind, its options from a file.
#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <thread>

#include "tests/programs/run_program.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/page_folder.h"
#include "tests/server/net/serve_process.h"
#include "tests/server/net/served_scene.h"
#include "tests/server/net/whole_view.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

using nlohmann::json;
using programs::readText;

void expectItServes(ServeProcess& server) {
  for (int i = 0; i < 320; ++i) {
    auto client = LoopbackClient::connect(server.port());
    ASSERT_TRUE(client) << "viewer " << i;
    client->close();
  }
  EXPECT_EQ(httpRequest(server.port(), "/healthz").status, 200);
  expectAView(server.port());
}

// One HTTP connection that reads when the test says so.
class SlowReader {
 public:
  explicit SlowReader(std::uint16_t port) : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    const int small = 16 << 10;
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
    const timeval patience{20, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    connected_ = ::connect(fd_, reinterpret_cast<sockaddr*>(&address), sizeof address) == 0;
  }
  ~SlowReader() { ::close(fd_); }
  bool isConnected() const { return connected_; }
  void ask(const std::string& path) const {
    const std::string text = "GET " + path + " HTTP/1.1\r\nHost: localhost\r\n\r\n";
    EXPECT_EQ(::send(fd_, text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
  }
  // Reads at least so many bytes more, or to the end; false at the end.
  bool read(std::size_t bytes) {
    const std::size_t wanted = text.size() + bytes;
    std::array<char, 65536> piece;
    while (text.size() < wanted) {
      const ssize_t n = ::recv(fd_, piece.data(), piece.size(), 0);
      if (n <= 0) return false;
      text.append(piece.data(), static_cast<std::size_t>(n));
    }
    return true;
  }
  std::string text;

 private:
  const int fd_;
  bool connected_ = false;
};

// ---- The log ----

// A pipe that has no room, and that somebody has open to read from; the end to write to.
class FullPipe {
 public:
  FullPipe() {
    EXPECT_EQ(::pipe2(ends_.data(), O_CLOEXEC | O_NONBLOCK), 0);
    const std::string filler(65536, 'x');
    while (::write(ends_[1], filler.data(), filler.size()) > 0) {
    }
    EXPECT_EQ(::fcntl(ends_[1], F_SETFL, 0), 0);  // the server's end blocks, as a shell's does
  }
  ~FullPipe() { ::close(ends_[0]); }
  FullPipe(const FullPipe&) = delete;
  FullPipe& operator=(const FullPipe&) = delete;
  int end() const { return ends_[1]; }

 private:
  std::array<int, 2> ends_{};
};

TEST(ServeProcess, aFullPipeThatNobodyReadsStopsNothing) {
  const SceneDirectory scene;
  const FullPipe full;
  ServeProcess server({scene.path, "--no-access"}, full.end());
  ASSERT_NE(server.port(), 0);
  expectItServes(server);
  server.send(SIGTERM);
  EXPECT_EQ(server.wait(), 0);
}

TEST(ServeProcess, aReaderThatGoesAwayEndsNothing) {
  const SceneDirectory scene;
  std::array<int, 2> ends{};
  ASSERT_EQ(::pipe2(ends.data(), O_CLOEXEC), 0);
  ServeProcess server({scene.path, "--no-access"}, ends[1]);
  ASSERT_NE(server.port(), 0);
  ::close(ends[0]);
  expectItServes(server);
  EXPECT_NE(httpRequest(server.port(), "/metrics").body.find("lumigrid_log_lines_total{outcome=\"failed\"}"),
            std::string::npos);
  server.send(SIGTERM);
  EXPECT_EQ(server.wait(), 0);
}

// Whoever comes back with a full cache says so in messages of 64 KB, and is then as quiet as others.
TEST(ServeProcess, aViewerThatSaidMuchKeepsAsLittleAsOthers) {
  const SceneDirectory scene;
  ServeProcess server({scene.path, "--no-access"});
  const auto memory = [&] {
    std::ifstream in("/proc/" + std::to_string(server.pid()) + "/statm");
    std::uint64_t pages = 0, resident = 0;
    in >> pages >> resident;
    return resident * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  };
  // One key again and again, so that what is remembered of it is small.
  const protocol::Holdings much{std::vector<repository::FaceKey>(protocol::kMaxKeysPerMessage), {}};
  constexpr std::uint64_t kViewers = 80;
  std::vector<std::unique_ptr<LoopbackClient>> viewers;
  const auto come = [&](std::uint64_t count) {
    for (std::uint64_t i = 0; i < count; ++i) {
      protocol::Welcome welcome;
      viewers.push_back(viewerAt(server.port(), "/", welcome));
      ASSERT_TRUE(viewers.back() && viewers.back()->send(much));
      EXPECT_TRUE(completes(*viewers.back(), welcome, 1));
    }
  };
  ASSERT_NO_FATAL_FAILURE(come(20));  // what is made once is made by them
  const std::uint64_t before = memory();
  ASSERT_NO_FATAL_FAILURE(come(kViewers));
  EXPECT_LT(memory() - before, kViewers * 32'000);
}

TEST(ServeProcess, namesOfViewersAreEscapedInEachJsonLine) {
  const SceneDirectory scene;
  ServeProcess server({scene.path, "--no-access", "--log-json"});
  ASSERT_NE(server.port(), 0);
  const std::string name =
      "x\" client=99 peer=\"\xC2\x9B"
      "31m\xE2\x80\xAE";
  expectAView(server.port(), "/", name);
  server.send(SIGTERM);
  EXPECT_EQ(server.wait(), 0);
  std::istringstream lines(server.log());
  int hellos = 0;
  bool has_disconnected = false;
  for (std::string line; std::getline(lines, line);) {
    const json object = json::parse(line, nullptr, false);
    ASSERT_TRUE(object.is_object()) << line;
    EXPECT_EQ(object["time"].get<std::string>().size(), 24U);
    if (object["message"] == "hello") {
      ++hellos;
      EXPECT_EQ(object["program"], "x\" client=99 peer=\"\\xc2\\x9b31m\\xe2\\x80\\xae");
      EXPECT_NE(object["client"], 99);
    }
    if (object["message"] == "disconnect") has_disconnected = object["views"] == 1;
  }
  EXPECT_EQ(hellos, 1) << server.log();
  EXPECT_TRUE(has_disconnected) << server.log();
}

TEST(ServeProcess, sighupOpensTheLogAnewAndEndsNothing) {
  const SceneDirectory scene;
  const support::TemporaryDirectory directory;
  const std::string log = directory / "serve.log";
  ServeProcess server({scene.path, "--no-access", "--log", log});
  ASSERT_NE(server.port(), 0);
  expectAView(server.port());
  ASSERT_TRUE(waitFor([&] { return readText(log).find("disconnect") != std::string::npos; }));
  std::filesystem::rename(log, log + ".1");
  server.send(SIGHUP);
  ASSERT_TRUE(waitFor([&] { return std::filesystem::exists(log); }));
  expectAView(server.port());
  EXPECT_TRUE(waitFor([&] { return readText(log).find("disconnect") != std::string::npos; }));
  EXPECT_EQ(httpRequest(server.port(), "/healthz").status, 200);
  EXPECT_EQ(server.log(), "");
  server.send(SIGTERM);
  EXPECT_EQ(server.wait(), 0);
}

// ---- Limits of the system ----

TEST(ServeProcess, theFilesOfScenesAreNoConnections) {
  struct Measured {
    std::size_t connections = 0, files = 0;
  };
  const auto measure = [](const std::vector<std::string>& places) {
    std::vector<std::string> arguments = places;
    arguments.emplace_back("--no-access");
    ServeProcess server(arguments, -1, 900);
    const std::string before = "at most ";
    EXPECT_TRUE(waitFor([&] { return server.log().find(before) != std::string::npos; }));
    const std::string log = server.log();
    const std::filesystem::directory_iterator files("/proc/" + std::to_string(server.pid()) + "/fd");
    return Measured{std::stoul(log.substr(log.find(before) + before.size())),
                    static_cast<std::size_t>(std::distance(files, {}))};
  };
  std::vector<std::unique_ptr<SceneDirectory>> scenes;
  std::vector<std::string> places;
  for (int i = 0; i < 16; ++i) places.push_back(scenes.emplace_back(std::make_unique<SceneDirectory>())->path);
  const Measured one = measure({places.front()}), all = measure(places);
  EXPECT_GE(all.files, one.files + 15) << "scenes keep no files open";
  EXPECT_LE(all.connections + all.files, one.connections + one.files);
}

// ---- Metrics ----

// The value behind `sample`; -1 where it is not there.
double valueOf(const std::string& text, const std::string& sample) {
  const std::size_t at = text.find("\n" + sample + " ");
  return at == std::string::npos ? -1.0 : std::stod(text.substr(at + 1 + sample.size()));
}

TEST(ServeProcess, metricsTellWhatAViewerGot) {
  const SceneDirectory scene;
  const std::string name = std::filesystem::path(scene.path).filename().string();
  ServeProcess server({scene.path, "--no-access"});
  ASSERT_NE(server.port(), 0);
  expectAView(server.port());
  EXPECT_EQ(httpRequest(server.port(), "/patch.lgp").status, 200);
  const std::string label = "scene=\"" + name + "\"}";
  std::string text;
  ASSERT_TRUE(waitFor([&] {
    const HttpAnswer answer = httpRequest(server.port(), "/metrics");
    EXPECT_EQ(answer.headers.at("content-type"), "text/plain; version=0.0.4; charset=utf-8");
    text = answer.body;
    // An answer is counted when it was written, a line of the log likewise.
    return valueOf(text, "lumigrid_connections_open{kind=\"viewer\"}") == 0.0 &&
           valueOf(text, "lumigrid_sent_bytes_total{kind=\"http\"}") > 1000.0 &&
           valueOf(text, "lumigrid_log_lines_total{outcome=\"written\"}") >= 3.0;
  })) << text;
  EXPECT_EQ(valueOf(text, "lumigrid_connections_total{kind=\"viewer\"}"), 1.0);
  EXPECT_EQ(valueOf(text, "lumigrid_views_received_total{" + label), 1.0) << text;
  EXPECT_EQ(valueOf(text, "lumigrid_views_planned_total{" + label), 1.0);
  EXPECT_GE(valueOf(text, "lumigrid_messages_received_total{" + label), 2.0);
  EXPECT_GT(valueOf(text, "lumigrid_sent_bytes_total{kind=\"group\"," + label), 1000.0);
  EXPECT_GT(valueOf(text, "lumigrid_sent_bytes_total{kind=\"face\"," + label), 1000.0);
  EXPECT_EQ(valueOf(text, "lumigrid_ready"), 1.0);
}

// ---- The end ----

TEST(ServeProcess, drainingFinishesDownloadsAndSendsViewersAway) {
  const SceneDirectory scene;
  const PageFolder page;
  const std::size_t bytes = std::size_t{48} << 20;
  page.write("large.bin", std::string(bytes, 'x'));
  ServeProcess server({scene.path, "--no-access", "--web", page.path, "--drain", "60s"});
  ASSERT_NE(server.port(), 0);
  EXPECT_EQ(httpRequest(server.port(), "/readyz").status, 200);
  auto viewer = LoopbackClient::connect(server.port());
  ASSERT_TRUE(viewer);
  SlowReader idle(server.port()), download(server.port());
  idle.ask("/healthz");
  ASSERT_TRUE(idle.read(1));
  download.ask("/large.bin");
  ASSERT_TRUE(download.read(1 << 20));

  server.send(SIGTERM);
  EXPECT_FALSE(viewer->receive());
  EXPECT_EQ(viewer->closeCode(), 1001);
  EXPECT_EQ(viewer->closeReason(), "the server stops");
  EXPECT_FALSE(idle.read(1 << 20)) << "a connection that waits for another request is closed";
  // Whoever watches over the server is told, and new visitors likewise.
  const HttpAnswer ready = httpRequest(server.port(), "/readyz");
  EXPECT_EQ(ready.status, 503);
  EXPECT_EQ(ready.headers.count("retry-after"), 1U);
  EXPECT_EQ(httpRequest(server.port(), "/healthz").status, 200);
  const HttpAnswer late = httpRequest(server.port(), "/scene.json");
  EXPECT_EQ(late.status, 503);
  EXPECT_EQ(late.headers.count("retry-after"), 1U);
  EXPECT_FALSE(LoopbackClient::connect(server.port()));
  EXPECT_TRUE(server.isRunning());
  EXPECT_FALSE(download.read(2 * bytes)) << "the connection ends behind the answer";
  EXPECT_EQ(download.text.size(), download.text.find("\r\n\r\n") + 4 + bytes);
  EXPECT_EQ(server.wait(), 0);
}

TEST(ServeProcess, aDownloadThatTakesLongerThanTheDrainIsCut) {
  const SceneDirectory scene;
  const PageFolder page;
  page.write("large.bin", std::string(std::size_t{48} << 20, 'x'));
  ServeProcess server({scene.path, "--no-access", "--web", page.path, "--drain", "0.2"});
  ASSERT_NE(server.port(), 0);
  SlowReader download(server.port());
  download.ask("/large.bin");
  ASSERT_TRUE(download.read(1));
  server.send(SIGTERM);
  EXPECT_EQ(server.wait(), 0);
}

TEST(ServeProcess, aSecondSignalEndsTheDrain) {
  for (const int second : {SIGTERM, SIGINT}) {
    const SceneDirectory scene;
    const PageFolder page;
    page.write("large.bin", std::string(std::size_t{48} << 20, 'x'));
    ServeProcess server({scene.path, "--no-access", "--web", page.path, "--drain", "3600"});
    ASSERT_NE(server.port(), 0);
    SlowReader download(server.port());
    download.ask("/large.bin");
    ASSERT_TRUE(download.read(1));
    server.send(SIGTERM);
    ASSERT_TRUE(waitFor([&] { return server.log().find("draining") != std::string::npos; }));
    EXPECT_TRUE(server.isRunning());
    server.send(second);
    EXPECT_EQ(server.wait(), 0);
  }
}

// ---- Options from a file ----

TEST(ServeProcess, aFileHasTheScenesAndOptions) {
  const SceneDirectory tower, yard;
  const support::TemporaryDirectory directory;
  const std::string config = directory / "serve.json";
  programs::writeText(config, json{{"scenes", {tower.path, yard.path}}, {"no-access", true}, {"port", 1}}.dump());
  ServeProcess server({"--config", config});  // the command line's --port 0 wins
  ASSERT_NE(server.port(), 0);
  EXPECT_EQ(
      httpRequest(server.port(), "/" + std::filesystem::path(yard.path).filename().string() + "/scene.json").status,
      200);
  for (const char* path : {"/healthz", "/readyz", "/metrics"}) EXPECT_EQ(httpRequest(server.port(), path).status, 200);
}

TEST(ServeProcess, limitsOfViewersAreOptions) {
  const SceneDirectory scene, large(2'000'000);
  const support::TemporaryDirectory directory;
  const std::string config = directory / "serve.json";
  programs::writeText(config, json{{"hello", 0.2}}.dump());
  ServeProcess server({scene.path, "--no-access", "--config", config, "--messages-per-second", "1"});
  ASSERT_NE(server.port(), 0);
  const auto mute = LoopbackClient::connect(server.port());
  ASSERT_TRUE(mute);
  EXPECT_FALSE(mute->receive());
  EXPECT_EQ(mute->closeReason(), "no Hello came in time");

  // Two messages may be sent at once; the hundredth would be read a minute and a half later.
  const auto figure = [](const ServeProcess& of, const std::string& name) {
    return valueOf(httpRequest(of.port(), "/metrics").body, name);
  };
  const std::string received =
      "lumigrid_messages_received_total{scene=\"" + std::filesystem::path(scene.path).filename().string() + "\"}";
  protocol::Welcome welcome;
  const auto talker = viewerAt(server.port(), "/", welcome);
  ASSERT_TRUE(talker);
  for (std::uint32_t sequence = 1; sequence < 100; ++sequence) ASSERT_TRUE(talker->send(viewOf(welcome, sequence)));
  EXPECT_TRUE(waitFor([&] { return figure(server, received) >= 3.0; }));
  EXPECT_LT(figure(server, received), 50.0);

  ServeProcess impatient({large.path, "--no-access", "--stall", "0.3"});
  const auto stalled = LoopbackClient::connect(impatient.port(), "/", 4096);
  ASSERT_TRUE(stalled);
  ASSERT_TRUE(stalled->send(protocol::Hello{protocol::kVersion, "stalled"}));
  ASSERT_TRUE(stalled->send(viewOf(welcome, 1)));
  EXPECT_TRUE(waitFor([&] { return figure(impatient, "lumigrid_refused_total{reason=\"stall\"}") >= 1.0; }));

  // The memory for a viewer's images is counted as long as it is there.
  ServeProcess forgetful({scene.path, "--no-access", "--held-memory", "0", "--views-per-second", "5"});
  const auto viewer = viewerAt(forgetful.port(), "/", welcome);
  ASSERT_TRUE(viewer);
  EXPECT_TRUE(completes(*viewer, welcome, 1));
  EXPECT_GT(figure(forgetful, "lumigrid_held_bytes"), 0.0);
  EXPECT_EQ(figure(forgetful, "lumigrid_held_forgotten_total"), 0.0) << "it holds less than is always remembered";
  viewer->close();
  EXPECT_TRUE(waitFor([&] { return figure(forgetful, "lumigrid_held_bytes") == 0.0; }));

  for (const char* option : {"--hello", "--stall", "--messages-per-second", "--views-per-second"})
    EXPECT_EQ(programs::run("lumigrid", {"serve", scene.path, option, "0"}).status, 2) << option;
}

TEST(ServeProcess, theExampleOfThePackagingIsUnderstood) {
  programs::expectOneLineError(
      programs::run("lumigrid", {"serve", "--config", LUMIGRID_SOURCE_DIR "/packaging/serve.json"}), 1,
      {"/srv/lumigrid/tower"});
}

TEST(ServeProcess, mistakesInAFileAreOneLineAndWrongUsage) {
  const support::TemporaryDirectory directory;
  const std::string config = directory / "serve.json";
  programs::writeText(config, R"({"scenes": ["x"], "prot": 8080})");
  programs::expectOneLineError(programs::run("lumigrid", {"serve", "--config", config}), 2, {config, "\"prot\""});
  programs::writeText(config, R"({"scenes": ["x"], "port": "many"})");
  programs::expectOneLineError(programs::run("lumigrid", {"serve", "--config", config}), 2, {config, "\"port\""});
  programs::expectOneLineError(programs::run("lumigrid", {"serve"}), 2, {"SCENE", "--config"});
  programs::expectOneLineError(programs::run("lumigrid", {"serve", "--config", directory / "none"}), 2,
                               {directory / "none"});
}

// ---- Scenes that change while they are served

bool logSays(const ServeProcess& server, const std::string& text) {
  return waitFor([&] { return server.log().find(text) != std::string::npos; });
}

/// The server says that the viewer may connect again.
void expectSentAway(LoopbackClient& client) {
  while (client.receive()) {
  }
  EXPECT_EQ(client.closeCode(), 1012);
}

class Reload : public ::testing::Test {
 protected:
  std::string nameOf(const SceneDirectory& scene) const { return std::filesystem::path(scene.path).filename(); }
  void configure(const std::vector<std::string>& places) const {
    std::ofstream(config()) << json{{"scenes", places}, {"no-access", true}}.dump();
  }
  std::string config() const { return files_ / "serve.json"; }

  const support::TemporaryDirectory files_;
  const SceneDirectory tower_, yard_, barn_{5'000};  // the barn's images are larger
};

TEST_F(Reload, viewersOfOtherScenesNoticeNothing) {
  configure({tower_.path, yard_.path});
  ServeProcess server({"--config", config()});
  protocol::Welcome welcome;
  const auto in_tower = viewerAt(server.port(), "/" + nameOf(tower_) + "/", welcome);
  const auto in_yard = viewerAt(server.port(), "/" + nameOf(yard_) + "/", welcome);
  ASSERT_TRUE(in_tower && in_yard);
  ASSERT_TRUE(completes(*in_tower, welcome, 1));

  configure({tower_.path, barn_.path});
  server.send(SIGHUP);
  expectSentAway(*in_yard);
  EXPECT_TRUE(completes(*in_tower, welcome, 2));
  EXPECT_EQ(httpRequest(server.port(), "/" + nameOf(barn_) + "/scene.json").status, 200);
  EXPECT_EQ(httpRequest(server.port(), "/" + nameOf(yard_) + "/scene.json").status, 404);
  const auto in_barn = viewerAt(server.port(), "/" + nameOf(barn_) + "/", welcome);
  ASSERT_TRUE(in_barn);
  EXPECT_TRUE(completes(*in_barn, welcome, 1));
}

TEST_F(Reload, aSceneThatWasBuiltAnewIsServedAnew) {
  configure({tower_.path, yard_.path});
  ServeProcess server({"--config", config()});
  protocol::Welcome welcome;
  const auto in_tower = viewerAt(server.port(), "/" + nameOf(tower_) + "/", welcome);
  const auto in_yard = viewerAt(server.port(), "/" + nameOf(yard_) + "/", welcome);
  ASSERT_TRUE(in_tower && in_yard);

  ASSERT_TRUE(completes(*in_yard, welcome, 1));
  const std::string misses = "lumigrid_cache_lookups_total{cache=\"messages\",outcome=\"miss\"}";
  const double misses_before = valueOf(httpRequest(server.port(), "/metrics").body, misses);
  EXPECT_GT(misses_before, 0.0);

  // The barn moves into the yard.
  std::filesystem::rename(yard_.path, yard_.path + ".old");
  std::filesystem::copy(barn_.path, yard_.path, std::filesystem::copy_options::recursive);
  server.send(SIGHUP);
  expectSentAway(*in_yard);
  EXPECT_TRUE(completes(*in_tower, welcome, 1));
  const auto again = viewerAt(server.port(), "/" + nameOf(yard_) + "/", welcome);
  ASSERT_TRUE(again);
  std::size_t largest_face = 0;
  EXPECT_TRUE(completes(*again, welcome, 1, &largest_face));
  EXPECT_GT(largest_face, 5'000U) << "images of the scene that is gone";
  const std::string figures = httpRequest(server.port(), "/metrics").body;
  EXPECT_GT(valueOf(figures, misses), misses_before) << "counters only grow";
  EXPECT_EQ(valueOf(figures, "lumigrid_read_errors_total{scene=\"" + nameOf(yard_) + "\"}"), 0.0) << figures;
  std::filesystem::remove_all(yard_.path + ".old");

  // A scene that has not changed is left alone.
  server.send(SIGHUP);
  EXPECT_TRUE(logSays(server, "reloaded: 2 scenes"));
  EXPECT_TRUE(completes(*again, welcome, 2));
}

TEST_F(Reload, openPagesOfAnOnlySceneGoOnWhenAnotherComes) {
  const PageFolder page;
  configure({tower_.path});
  ServeProcess server({"--config", config(), "--web", page.path});
  const std::uint16_t port = server.port();
  const std::string tower = "/" + nameOf(tower_);
  protocol::Welcome welcome;
  const auto viewer = viewerAt(port, "/", welcome);
  ASSERT_TRUE(viewer);
  ASSERT_TRUE(completes(*viewer, welcome, 1));
  EXPECT_EQ(httpRequest(port, tower).headers["location"], tower + "/");
  EXPECT_EQ(httpRequest(port, tower + "/scene.json").status, 200);
  EXPECT_EQ(httpRequest(port, "/scene.json").status, 200);
  EXPECT_EQ(httpRequest(port, "/nobody/scene.json").status, 404);
  expectAView(port, tower + "/ws");

  configure({barn_.path, tower_.path});
  server.send(SIGHUP);
  ASSERT_TRUE(logSays(server, "reloaded: 2 scenes"));
  EXPECT_TRUE(completes(*viewer, welcome, 2));
  for (const char* path : {"/", "/ws"}) {
    const auto again = viewerAt(port, path, welcome);
    ASSERT_TRUE(again);
    EXPECT_EQ(welcome.scene_name, nameOf(tower_));
    EXPECT_TRUE(completes(*again, welcome, 1));
  }
  EXPECT_EQ(httpRequest(port, "/patch.lgp", {{"Range", "bytes=0-3"}}).status, 206);
  EXPECT_EQ(httpRequest(port, "/pick?ox=500016.3&oy=4000016.2&oz=600&dx=0&dy=0&dz=-1").status, 200);
  EXPECT_EQ(httpRequest(port, "/render?x=1").status, 501) << "its answer without frames";
  for (const char* path : {"/scene.json", "/annotations.json", "/lumigrid-0123abcd.js", "/icons/32.png"})
    EXPECT_EQ(httpRequest(port, path).status, 200) << path;
  EXPECT_NE(httpRequest(port, "/").body.find(nameOf(barn_) + "/"), std::string::npos);
  EXPECT_EQ(httpRequest(port, "/nothing").status, 404);

  // The barn is alone, then the tower comes: open pages are the barn's by now.
  configure({barn_.path});
  server.send(SIGHUP);
  ASSERT_TRUE(logSays(server, "reloaded: 1 scenes"));
  EXPECT_EQ(httpRequest(port, tower + "/scene.json").status, 404);
  ASSERT_TRUE(viewerAt(port, "/", welcome));
  EXPECT_EQ(welcome.scene_name, nameOf(barn_));
  configure({tower_.path, yard_.path});
  server.send(SIGHUP);
  ASSERT_TRUE(waitFor([&] { return httpRequest(port, tower + "/scene.json").status == 200; }));
  EXPECT_EQ(httpRequest(port, "/scene.json").status, 404) << "the barn is gone";
  EXPECT_FALSE(LoopbackClient::connect(port, "/"));
}

TEST_F(Reload, noPrivateSceneBecomesReadableWhenAnotherComes) {
  const std::string tokens = files_ / "tokens.json";
  std::ofstream(tokens) << json{{{"token", "token-of-the-tower"}, {"scenes", {nameOf(tower_)}}},
                                {{"token", "token-of-the-barn-"}, {"scenes", {nameOf(barn_)}}}}
                               .dump();
  configure({tower_.path});
  ServeProcess server({"--config", config(), "--tokens", tokens});
  const auto statusOf = [&](const std::string& path, const std::string& token) {
    return httpRequest(server.port(), path, {{"Authorization", "Bearer token-of-the-" + token}}).status;
  };
  configure({barn_.path, tower_.path});
  server.send(SIGHUP);
  ASSERT_TRUE(logSays(server, "reloaded: 2 scenes"));
  const std::string tower = "/" + nameOf(tower_), barn = "/" + nameOf(barn_);
  EXPECT_EQ(statusOf("/scene.json", "tower"), 200);
  for (const char* path : {"/scene.json", "/patch.lgp", "/annotations.json", "/pick?ox=1", "/render?x=1"}) {
    EXPECT_EQ(statusOf(path, "barn-"), 403) << path;
    EXPECT_EQ(httpRequest(server.port(), path).status, 401) << path;
  }
  EXPECT_FALSE(LoopbackClient::connect(server.port(), "/"));
  EXPECT_EQ(statusOf(tower + "/scene.json", "barn-"), 403);
  EXPECT_EQ(statusOf(barn + "/scene.json", "barn-"), 200);
  // A name that is not there is answered like one that may not be seen.
  for (const std::string end : {"", "/", "/scene.json"}) {
    EXPECT_EQ(statusOf(barn + end, "tower"), 403);
    EXPECT_EQ(statusOf("/nobody" + end, "tower"), 403);
  }
}

TEST_F(Reload, wrongListsLeaveAllAsItIs) {
  configure({tower_.path});
  ServeProcess server({"--config", config()});
  protocol::Welcome welcome;
  const auto viewer = viewerAt(server.port(), "/", welcome);
  ASSERT_TRUE(viewer);
  configure({tower_.path, files_ / "nowhere"});
  server.send(SIGHUP);
  EXPECT_TRUE(logSays(server, "the scenes stay as they were"));
  std::ofstream(config()) << "{\"scenes\": 7}";
  server.send(SIGHUP);
  EXPECT_TRUE(logSays(server, "must be a text, or a list of texts"));
  EXPECT_TRUE(completes(*viewer, welcome, 1));
  EXPECT_EQ(httpRequest(server.port(), "/scene.json").status, 200);
}

// ---- Several processes

std::vector<pid_t> childrenOf(pid_t pid) {
  std::ifstream in("/proc/" + std::to_string(pid) + "/task/" + std::to_string(pid) + "/children");
  std::vector<pid_t> children;
  for (pid_t child = 0; in >> child;) children.push_back(child);
  return children;
}

TEST(Workers, aKilledOneIsReplacedWhileOthersServe) {
  const SceneDirectory scene;
  ServeProcess server({scene.path, "--workers", "2", "--no-access"});
  ASSERT_EQ(childrenOf(server.pid()).size(), 2U);
  for (int i = 0; i < 8; ++i) expectAView(server.port());
  const pid_t killed = childrenOf(server.pid()).front();
  ::kill(killed, SIGKILL);
  EXPECT_TRUE(logSays(server, "ended by signal 9"));
  // The other one has the port for itself.
  for (int i = 0; i < 8; ++i) EXPECT_EQ(httpRequest(server.port(), "/healthz").status, 200);
  EXPECT_TRUE(waitFor([&] { return childrenOf(server.pid()).size() == 2; }));
  const auto children = childrenOf(server.pid());
  EXPECT_EQ(std::count(children.begin(), children.end(), killed), 0);
  server.send(SIGTERM);
  EXPECT_EQ(server.wait(), 0);
}

TEST(Workers, aFullPipeThatNobodyReadsStopsNoRestart) {
  const SceneDirectory scene;
  const FullPipe full;
  ServeProcess server({scene.path, "--workers", "2", "--no-access"}, full.end());
  ASSERT_EQ(childrenOf(server.pid()).size(), 2U);
  const pid_t killed = childrenOf(server.pid()).front();
  ::kill(killed, SIGKILL);
  EXPECT_TRUE(waitFor([&] {
    const auto children = childrenOf(server.pid());
    return children.size() == 2 && std::count(children.begin(), children.end(), killed) == 0;
  }));
  server.send(SIGTERM);
  EXPECT_EQ(server.wait(), 0);
}

TEST(Workers, theEndOfOneIsInTheLogThatIsNamed) {
  const SceneDirectory scene;
  const support::TemporaryDirectory directory;
  const std::string log = directory / "serve.log";
  ServeProcess server({scene.path, "--workers", "2", "--no-access", "--log", log, "--log-json"});
  const auto endIsLogged = [&] {
    ::kill(childrenOf(server.pid()).front(), SIGKILL);
    return waitFor([&] { return readText(log).find("ended by signal 9") != std::string::npos; });
  };
  EXPECT_TRUE(endIsLogged());
  ASSERT_TRUE(waitFor([&] { return childrenOf(server.pid()).size() == 2; }));
  std::filesystem::rename(log, log + ".1");
  server.send(SIGHUP);
  ASSERT_TRUE(waitFor([&] { return std::filesystem::exists(log); }));
  EXPECT_TRUE(endIsLogged()) << "the supervisor has not opened it anew";
  server.send(SIGTERM);
  EXPECT_EQ(server.wait(), 0);
  EXPECT_EQ(server.log(), "");
  std::istringstream lines(readText(log + ".1"));
  for (std::string line; std::getline(lines, line);) EXPECT_TRUE(json::parse(line, nullptr, false).is_object()) << line;
}

// Otherwise the system would deal new connections to processes that end, in place of those that follow.
TEST(Workers, aSharedPortIsClosedWhileTheServerDrains) {
  const SceneDirectory scene;
  const PageFolder page;
  page.write("large.bin", std::string(std::size_t{48} << 20, 'x'));
  ServeProcess server({scene.path, "--no-access", "--web", page.path, "--workers", "2", "--drain", "3600"});
  SlowReader download(server.port());
  download.ask("/large.bin");
  ASSERT_TRUE(download.read(1));
  server.send(SIGTERM);
  EXPECT_TRUE(waitFor([&] { return !SlowReader(server.port()).isConnected(); }));
  EXPECT_TRUE(server.isRunning());
  EXPECT_FALSE(download.read(std::size_t{96} << 20)) << "the connection ends behind the answer";
  EXPECT_EQ(server.wait(), 0);
}

TEST(Workers, metricsNameTheWorkerThatAnswers) {
  const SceneDirectory scene;
  ServeProcess server({scene.path, "--workers", "2", "--no-access"});
  std::set<std::string> seen;
  EXPECT_TRUE(waitFor([&] {
    std::istringstream lines(httpRequest(server.port(), "/metrics").body);
    for (std::string line; std::getline(lines, line);) {
      if (line.starts_with('#')) continue;
      const std::size_t at = line.find("{worker=\"");
      EXPECT_NE(at, std::string::npos) << line;
      if (at != std::string::npos) seen.insert(line.substr(at, std::string("{worker=\"0\"").size()));
    }
    return seen.size() >= 2;
  }));
  // A connection that could be kept is closed all the same, so that the next one may lead to another worker.
  const std::string answer = rawExchange(server.port(), "GET /metrics HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_NE(answer.find("Connection: close\r\n"), std::string::npos) << answer.substr(0, 500);
  EXPECT_EQ(seen, (std::set<std::string>{"{worker=\"0\"", "{worker=\"1\""}));
}

TEST(Workers, aSceneThatCannotBeOpenedIsOneErrorOfAll) {
  const auto outcome = programs::run("lumigrid", {"serve", "/nowhere", "--port", "0", "--workers", "3"});
  EXPECT_EQ(outcome.status, 1);
  EXPECT_EQ(std::count(outcome.err.begin(), outcome.err.end(), '\n'), 1) << outcome.err;
}

}  // namespace
}  // namespace server
