// Many kinds of bad peers at once, from one machine, while others look at the scene from another.
#include <gtest/gtest.h>
#include <signal.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>
#include <vector>

#include "tests/programs/run_program.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"
#include "tests/support/ws_viewer.h"

namespace server {
namespace {

using namespace std::chrono_literals;

constexpr std::uint8_t kAttackers = 66;  // 127.0.0.66; others come from 127.0.0.1

class Attack : public ::testing::Test {
 protected:
  void SetUp() override {
    pid_ = programs::start("lumigrid", {"serve", scene_.path, "--port", "0", "--json", "--no-frames"},
                           logs_.path + "/log");
    nlohmann::json said;
    for (int i = 0; i < 6000 && !said.is_object(); ++i) {
      std::this_thread::sleep_for(5ms);
      said = nlohmann::json::parse(programs::readText(logs_.path + "/log.out"), nullptr, false);
    }
    ASSERT_TRUE(said.is_object()) << programs::readText(logs_.path + "/log.err");
    port_ = said["port"];
    auto client = LoopbackClient::connect(port_);
    ASSERT_TRUE(client && client->send(protocol::Hello{}));
    welcome_ = std::get<protocol::Welcome>(*client->receive());
  }
  void TearDown() override {
    if (pid_ <= 0) return;
    ::kill(pid_, SIGTERM);
    EXPECT_EQ(programs::wait(pid_), 0) << programs::readText(logs_.path + "/log.err");
  }

  std::string proc(const std::string& file) const { return "/proc/" + std::to_string(pid_) + "/" + file; }
  std::size_t descriptors() const {
    return static_cast<std::size_t>(std::distance(std::filesystem::directory_iterator(proc("fd")), {}));
  }
  std::uint64_t memory() const {
    std::ifstream in(proc("statm"));
    std::uint64_t pages = 0, resident = 0;
    in >> pages >> resident;
    return resident * static_cast<std::uint64_t>(::sysconf(_SC_PAGESIZE));
  }

  /// A viewer that opens, looks at two views and leaves, as often as there is time.
  void lookAround(std::atomic<int>& views) {
    for (std::uint32_t visit = 0; !stop_; ++visit) {
      auto client = LoopbackClient::connect(port_);
      ASSERT_TRUE(client);
      ASSERT_TRUE(client->send(protocol::Hello{}));
      ASSERT_TRUE(client->receive());
      for (std::uint32_t sequence = 1; sequence <= 2; ++sequence) {
        ASSERT_TRUE(client->send(viewOf(welcome_, sequence)));
        for (bool complete = false; !complete;) {
          const auto message = client->receive();
          ASSERT_TRUE(message) << "no message for ten seconds, or the connection ended";
          complete = std::holds_alternative<protocol::Completion>(*message);
        }
        ++views;
      }
      client->close();
    }
  }
  void askForHealth(std::atomic<int>& answers) {
    for (; !stop_; std::this_thread::sleep_for(20ms)) {
      ASSERT_EQ(httpRequest(port_, "/healthz").status, 200);
      ++answers;
    }
  }

  // The attackers.

  /// Opens connections and sends a header letter by letter, and again when they are closed.
  void trickle() {
    std::vector<base::FileDescriptor> sockets(320);
    while (!stop_) {
      for (auto& socket : sockets) {
        if (!socket) socket = support::connectTo(port_, kAttackers);
        if (socket && ::send(socket.get(), "G", 1, MSG_NOSIGNAL | MSG_DONTWAIT) != 1) socket = base::FileDescriptor();
      }
      std::this_thread::sleep_for(100ms);
    }
  }
  void flood() {
    support::WsViewer viewer([](base::ByteView, std::size_t) {});
    while (!stop_) {
      if (!viewer.open(port_, kAttackers)) continue;
      viewer.send(protocol::encode(protocol::ClientMessage(protocol::Hello{})));
      protocol::View view = viewOf(welcome_, 1);
      view.max_points = 64;
      for (bool open = true; open && !stop_;) {
        view.camera.position.x += 0.5;
        ++view.sequence;
        // A full socket is no reason to leave.
        viewer.send(protocol::encode(protocol::ClientMessage(view)));
        open = viewer.read();
      }
    }
  }
  /// Claims to hold all faces that there can be.
  void claim() {
    protocol::Holdings have;
    while (!stop_) {
      support::WsViewer viewer([](base::ByteView, std::size_t) {});
      if (!viewer.open(port_, kAttackers)) continue;
      viewer.send(protocol::encode(protocol::ClientMessage(protocol::Hello{})));
      for (std::uint32_t i = 0; i < 40 && viewer.read() && !stop_; ++i) {
        have.faces.clear();
        for (std::uint32_t k = 0; k < protocol::kMaxKeysPerMessage; ++k)
          have.faces.push_back({k % 4, k / 4 % 4, k / 16 % 4, k % 6, i * 1000 + k});
        viewer.send(protocol::encode(protocol::ClientMessage(have)));
        std::this_thread::sleep_for(10ms);
      }
    }
  }
  /// Opens WebSockets and says nothing, or asks and reads nothing, or sends what is no message.
  void misbehave() {
    for (int round = 0; !stop_; ++round) {
      std::vector<std::unique_ptr<support::WsViewer>> viewers;
      for (int i = 0; i < 30; ++i) {
        viewers.push_back(std::make_unique<support::WsViewer>([](base::ByteView, std::size_t) {}));
        if (!viewers.back()->open(port_, kAttackers)) continue;
        if (i % 3 == 0) continue;
        viewers.back()->send(protocol::encode(protocol::ClientMessage(protocol::Hello{})));
        if (i % 3 == 1)
          viewers.back()->send(protocol::encode(protocol::ClientMessage(viewOf(welcome_, 1))));
        else
          viewers.back()->send(base::Bytes(1000, static_cast<std::uint8_t>(round)));
      }
      std::this_thread::sleep_for(200ms);
    }
  }
  void askForMuch() {
    while (!stop_) {
      for (const char* target : {"/patch.lgp", "/pick?ox=1", "/render?width=9999&height=9999", "/scene.json"})
        askAndLeave(port_, target);
      rawExchange(port_, std::string("GET / HTTP/1.1\r\nHost: a\r\n") + std::string(20'000, 'x') + "\r\n\r\n");
    }
  }

  const SceneDirectory scene_{20'000};
  const SceneDirectory logs_{0};
  pid_t pid_ = 0;
  std::uint16_t port_ = 0;
  protocol::Welcome welcome_;
  std::atomic<bool> stop_{false};
};

TEST_F(Attack, othersAreServedMeanwhile) {
  const std::size_t descriptors_before = descriptors();
  const std::uint64_t memory_before = memory();
  std::atomic<int> views{0}, answers{0};
  std::vector<std::thread> threads;
  threads.emplace_back([this] { trickle(); });
  for (int i = 0; i < 4; ++i) threads.emplace_back([this] { flood(); });
  threads.emplace_back([this] { claim(); });
  threads.emplace_back([this] { misbehave(); });
  threads.emplace_back([this] { askForMuch(); });
  std::this_thread::sleep_for(500ms);
  for (int i = 0; i < 2; ++i) threads.emplace_back([&] { lookAround(views); });
  threads.emplace_back([&] { askForHealth(answers); });
  std::this_thread::sleep_for(5s);
  const std::uint64_t memory_after = memory();
  stop_ = true;
  for (std::thread& thread : threads) thread.join();

  EXPECT_GT(views, 10);
  EXPECT_GT(answers, 10);
  // 256 connections of one address, each with its buffers and what it claims to hold.
  EXPECT_LT(memory_after, memory_before + (std::uint64_t{256} << 20));
  for (int i = 0; i < 1000 && descriptors() > descriptors_before; ++i) std::this_thread::sleep_for(20ms);
  EXPECT_LE(descriptors(), descriptors_before);
}

}  // namespace
}  // namespace server
