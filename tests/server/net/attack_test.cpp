// Many kinds of bad peers at once, from one machine, while others look at the scene from another. With
// LUMIGRID_LONG_TESTS they go on for ten minutes, and their figures are printed beside those of a server that nobody
// attacks, on a quiet machine and on one whose cores are as busy.
#include <gtest/gtest.h>
#include <sched.h>
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <mutex>
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
using Clock = std::chrono::steady_clock;

constexpr std::uint8_t kAttackers = 66;  // 127.0.0.66; others come from 127.0.0.1

class Attack : public ::testing::Test {
 protected:
  void SetUp() override {
    std::vector<std::string> words{"serve", scene_.path, "--port", "0", "--json"};
    if (!is_long_) words.emplace_back("--no-frames");  // they need a GL
    pid_ = programs::start("lumigrid", words, logs_.path + "/log");
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

  /// Seconds that each of many answers took.
  struct Answers {
    std::mutex mutex;
    std::vector<double> seconds;

    void add(Clock::time_point begin) {
      const std::lock_guard lock(mutex);
      seconds.push_back(std::chrono::duration<double>(Clock::now() - begin).count());
    }
    std::size_t count() {
      const std::lock_guard lock(mutex);
      return seconds.size();
    }
    /// The time within which such a share of them came.
    double atShare(double share) {
      const std::lock_guard lock(mutex);
      if (seconds.empty()) return 0.0;
      std::sort(seconds.begin(), seconds.end());
      return seconds[static_cast<std::size_t>(share * static_cast<double>(seconds.size() - 1))];
    }
  };

  /// A viewer that opens, looks at two views and leaves, as often as there is time.
  void lookAround(Answers& views, const std::atomic<bool>& stop) {
    for (std::uint32_t visit = 0; !stop; ++visit) {
      auto client = LoopbackClient::connect(port_);
      ASSERT_TRUE(client);
      ASSERT_TRUE(client->send(protocol::Hello{}));
      ASSERT_TRUE(client->receive());
      for (std::uint32_t sequence = 1; sequence <= 2; ++sequence) {
        const auto begin = Clock::now();
        ASSERT_TRUE(client->send(viewOf(welcome_, sequence)));
        for (bool complete = false; !complete;) {
          const auto message = client->receive();
          ASSERT_TRUE(message) << "no message for ten seconds, or the connection ended";
          complete = std::holds_alternative<protocol::Completion>(*message);
        }
        views.add(begin);
      }
      client->close();
    }
  }
  void askForHealth(Answers& answers, const std::atomic<bool>& stop) {
    for (; !stop; std::this_thread::sleep_for(20ms)) {
      const auto begin = Clock::now();
      ASSERT_EQ(httpRequest(port_, "/healthz").status, 200);
      answers.add(begin);
    }
  }

  struct Others {
    Answers views, health;
    std::vector<std::uint64_t> memory;  // once a second
  };
  /// Serves others for so long.
  void serveOthers(std::chrono::seconds duration, Others& others) {
    std::atomic<bool> stop = false;
    std::vector<std::jthread> threads;
    for (int i = 0; i < 2; ++i) threads.emplace_back([&] { lookAround(others.views, stop); });
    threads.emplace_back([&] { askForHealth(others.health, stop); });
    for (auto left = duration; left > 0s && !HasFailure(); left -= 1s) {
      std::this_thread::sleep_for(1s);
      others.memory.push_back(memory());
    }
    stop = true;
  }
  void serveOthersAndPrint(const char* when, std::chrono::seconds duration) {
    Others others;
    serveOthers(duration, others);
    print(when, others);
  }
  static void print(const char* when, Others& others) {
    std::printf(
        "%s: %zu views, p50 %.1f ms, p99 %.1f ms; /healthz p99 %.1f ms, slowest %.1f ms; memory %.0f to %.0f MB\n",
        when, others.views.count(), 1e3 * others.views.atShare(0.5), 1e3 * others.views.atShare(0.99),
        1e3 * others.health.atShare(0.99), 1e3 * others.health.atShare(1.0),
        1e-6 * static_cast<double>(*std::min_element(others.memory.begin(), others.memory.end())),
        1e-6 * static_cast<double>(*std::max_element(others.memory.begin(), others.memory.end())));
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
  /// Looks at this view, and a `step` on at the next as soon as `pause` is over, whatever comes.
  void lookOn(protocol::View view, double step, std::chrono::milliseconds pause) {
    support::WsViewer viewer([](base::ByteView, std::size_t) {});
    while (!stop_) {
      if (!viewer.open(port_, kAttackers)) continue;
      viewer.send(protocol::encode(protocol::ClientMessage(protocol::Hello{})));
      for (bool open = true; open && !stop_; std::this_thread::sleep_for(pause)) {
        view.camera.position.x += step;
        ++view.sequence;
        // A full socket is no reason to leave.
        viewer.send(protocol::encode(protocol::ClientMessage(view)));
        open = viewer.read();
      }
    }
  }
  void flood() {
    protocol::View view = viewOf(welcome_, 1);
    view.max_points = 64;
    lookOn(view, 0.5, 0ms);
  }
  /// Wants exact frames of sixteen megapixels, and of another view before one has come.
  void wantFrames() {
    protocol::View view = viewOf(welcome_, 1);
    view.camera.width = view.camera.height = 4000;
    view.want_frame = true;
    lookOn(view, 0.01, 500ms);
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

  const bool is_long_ = std::getenv("LUMIGRID_LONG_TESTS") != nullptr;
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
  Others attacked;
  std::vector<std::jthread> threads;
  // Attackers on other machines would leave this one's cores to the server and to those who look.
  const auto attack = [&](std::function<void()> how) {
    threads.emplace_back([how = std::move(how)] {
      const sched_param none{};
      EXPECT_EQ(::sched_setscheduler(0, SCHED_IDLE, &none), 0);
      how();
    });
  };
  if (is_long_) {
    serveOthersAndPrint("quiet", 60s);
    for (int i = 0; i < 4; ++i)
      attack([this] {
        while (!stop_) {
        }
      });
    serveOthersAndPrint("busy machine", 60s);
    stop_ = true;
    threads.clear();
    stop_ = false;
  }
  for (int i = 0; i < 4; ++i) attack([this] { flood(); });
  for (int i = 0; i < 4 && is_long_; ++i) attack([this] { wantFrames(); });
  attack([this] { trickle(); });
  attack([this] { claim(); });
  attack([this] { misbehave(); });
  attack([this] { askForMuch(); });
  std::this_thread::sleep_for(500ms);
  serveOthers(is_long_ ? 600s : 5s, attacked);
  stop_ = true;
  threads.clear();

  EXPECT_GT(attacked.views.count(), 10U);
  EXPECT_GT(attacked.health.count(), 10U);
  // 256 connections of one address, each with its buffers and what it claims to hold, and two large frames with what
  // encodes one of them.
  constexpr std::uint64_t kConnections = 256, kLargeFrames = 384;
  EXPECT_LT(attacked.memory.back(), memory_before + ((kConnections + (is_long_ ? kLargeFrames : 0)) << 20U));
  if (is_long_) {
    print("attacked", attacked);
    // A minute in, all of them have done all that they do.
    ASSERT_GT(attacked.memory.size(), 300U);
    const auto most = [&](int from, int to) {
      return *std::max_element(attacked.memory.begin() + from, attacked.memory.begin() + to);
    };
    EXPECT_LT(most(300, static_cast<int>(attacked.memory.size())), most(60, 300) + (std::uint64_t{32} << 20));
  }
  for (int i = 0; i < 1000 && descriptors() > descriptors_before; ++i) std::this_thread::sleep_for(20ms);
  EXPECT_LE(descriptors(), descriptors_before);
}

}  // namespace
}  // namespace server
