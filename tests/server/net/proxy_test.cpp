// The snippets of docs/hosting-server.md do what the document says, with a real nginx and a real Caddy.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <deque>
#include <fstream>
#include <iostream>
#include <memory>
#include <string>
#include <thread>

#include "base/file.h"
#include "lod/patch/format.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/serve_process.h"
#include "tests/server/net/served_scene.h"
#include "tests/server/net/whole_view.h"
#include "tests/support/nginx.h"

namespace server {
namespace {

void replaceOnce(std::string& text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  ASSERT_NE(at, std::string::npos) << "docs/hosting-server.md lacks '" << from << "'";
  text.replace(at, from.size(), to);
}

std::string snippet(const std::string& language) {
  const auto bytes = base::readFile(LUMIGRID_SOURCE_DIR "/docs/hosting-server.md");
  if (!bytes) return "";
  const std::string document(bytes->begin(), bytes->end());
  const std::string fence = "```" + language + "\n";
  const std::size_t begin = document.find(fence);
  if (begin == std::string::npos) return "";
  const std::size_t end = document.find("```", begin + fence.size());
  return document.substr(begin + fence.size(), end - begin - fence.size());
}

// A page, a range, and a viewer with a whole view, through the proxy.
void expectAVisit(std::uint16_t port) {
  EXPECT_EQ(httpRequest(port, "/scene.json").status, 200);
  const HttpAnswer part = httpRequest(port, "/patch.lgp", {{"Range", "bytes=0-15"}});
  EXPECT_EQ(part.status, 206);
  EXPECT_EQ(part.body.size(), 16U);
  expectAView(port, "/ws", "proxied");
}

TEST(Proxy, nginxPassesViewersOn) {
  LUMIGRID_SKIP_WITHOUT_NGINX();
  const SceneDirectory scene;
  const RunningServer server(scene.path);
  std::string http = snippet("nginx");
  replaceOnce(http, "listen 8088;", "listen 127.0.0.1:$PORT0;");
  replaceOnce(http, "server 127.0.0.1:8080;", "server 127.0.0.1:" + std::to_string(server.port()) + ";");
  replaceOnce(http, "allow 127.0.0.1; deny all;", "deny all;");  // this test is on this machine, too
  const support::Nginx nginx(support::Nginx::Configuration{http});
  ASSERT_TRUE(nginx.running());
  expectAVisit(nginx.port());
  EXPECT_EQ(httpRequest(nginx.port(), "/readyz").status, 200);
  EXPECT_EQ(httpRequest(nginx.port(), "/metrics").status, 403);
  EXPECT_EQ(httpRequest(server.port(), "/metrics").status, 200);
}

// The second of two servers goes on when the first one stops.
TEST(Proxy, nginxSendsViewersToTheServerThatIsLeft) {
  LUMIGRID_SKIP_WITHOUT_NGINX();
  const SceneDirectory scene, copy;
  auto first = std::make_unique<RunningServer>(scene.path);
  const RunningServer second(copy.path);
  std::string http = snippet("nginx");
  replaceOnce(http, "listen 8088;", "listen 127.0.0.1:$PORT0;");
  replaceOnce(http, "server 127.0.0.1:8080;",
              "server 127.0.0.1:" + std::to_string(first->port()) +
                  ";\nserver 127.0.0.1:" + std::to_string(second.port()) + ";");
  const support::Nginx nginx(support::Nginx::Configuration{http});
  ASSERT_TRUE(nginx.running());
  expectAVisit(nginx.port());
  first.reset();
  for (int i = 0; i < 4; ++i) expectAVisit(nginx.port());
}

// Goes on from where it is looking, keeps all that comes, and connects again when the connection ends.
class KeepingViewer {
 public:
  explicit KeepingViewer(std::uint16_t port) : port_(port) {}

  /// Looks so many times, a little farther to the side each time. False where it cannot connect again.
  bool look(int times, std::atomic<int>& looked) {
    for (int i = 0; i < times;) {
      if (!client_ && !connect()) return false;
      if (completes(i)) {
        ++i, ++looked;
        continue;
      }
      client_.reset();
      ++connections_ended;
    }
    return true;
  }
  int connections_ended = 0;
  int came_again = 0;  ///< images and groups that it had

 private:
  bool connect() {
    for (int i = 0; i < 500 && !client_; ++i) {
      auto client = LoopbackClient::connect(port_, "/ws");
      std::optional<protocol::ServerMessage> message;
      if (client && client->send(protocol::Hello{protocol::kVersion, "keeps"})) message = client->receive();
      if (message && std::holds_alternative<protocol::Welcome>(*message)) {
        welcome_ = std::get<protocol::Welcome>(*message);
        client_ = std::move(client);
      } else {
        std::this_thread::sleep_for(std::chrono::milliseconds(10));
      }
    }
    return client_ && client_->send(held_);
  }
  bool completes(int step) {
    protocol::View view = viewOf(welcome_, ++sequence_);
    view.camera.position += 0.01 * step * glm::dvec3(welcome_.box_max - welcome_.box_min);
    if (!client_->send(view)) return false;
    while (const auto message = client_->receive()) {
      if (const auto* face = std::get_if<protocol::Face>(&*message)) keep(held_.faces, face->key);
      if (const auto* refinement = std::get_if<protocol::Refinement>(&*message)) {
        base::ByteReader in(refinement->record);
        const auto group = lod::patch::addGroup(in, hierarchy_, welcome_.group_count, welcome_.patch_count);
        EXPECT_TRUE(group) << group.error().message;
        if (group) keep(held_.groups, *group);
      }
      const auto* completion = std::get_if<protocol::Completion>(&*message);
      if (completion != nullptr && completion->sequence == sequence_) return true;
    }
    return false;
  }
  template <class Key>
  void keep(std::vector<Key>& held, const Key& key) {
    came_again += std::find(held.begin(), held.end(), key) != held.end() ? 1 : 0;
    held.push_back(key);
  }

  const std::uint16_t port_;
  std::unique_ptr<LoopbackClient> client_;
  protocol::Welcome welcome_;
  protocol::Holdings held_;
  lod::patch::Hierarchy hierarchy_;
  std::uint32_t sequence_ = 0;
};

TEST(Proxy, viewersOfAKilledServerGoOnAtTheOtherAndNothingComesAgain) {
  LUMIGRID_SKIP_WITHOUT_NGINX();
  const SceneDirectory scene, copy;
  ServeProcess first({scene.path, "--no-access"}), second({copy.path, "--no-access"});
  std::string http = snippet("nginx");
  replaceOnce(http, "listen 8088;", "listen 127.0.0.1:$PORT0;");
  replaceOnce(http, "server 127.0.0.1:8080;",
              "server 127.0.0.1:" + std::to_string(first.port()) +
                  ";\nserver 127.0.0.1:" + std::to_string(second.port()) + ";");
  const support::Nginx nginx(support::Nginx::Configuration{http});
  ASSERT_TRUE(nginx.running());

  constexpr int kViewers = 32, kLooks = 40;
  std::deque<KeepingViewer> viewers;
  for (int i = 0; i < kViewers; ++i) viewers.emplace_back(nginx.port());
  std::atomic<int> looked{0}, through{0};
  {
    std::vector<std::jthread> threads;
    for (KeepingViewer& viewer : viewers) threads.emplace_back([&] { through += viewer.look(kLooks, looked) ? 1 : 0; });
    EXPECT_TRUE(waitFor([&] { return looked > kViewers * kLooks / 4; }));
    first.send(SIGKILL);
  }
  EXPECT_EQ(through, kViewers);
  int ended = 0;
  for (const KeepingViewer& viewer : viewers) {
    EXPECT_EQ(viewer.came_again, 0);
    EXPECT_LE(viewer.connections_ended, 1);
    ended += viewer.connections_ended;
  }
  EXPECT_GT(ended, 0) << "nobody was at the server that was killed";
  EXPECT_LT(ended, kViewers) << "nobody was at the other";
}

// Caddy with the snippet's site at a port of its own, for as long as the object lives.
class Caddy {
 public:
  explicit Caddy(std::uint16_t server) {
    // Another process may take a port between the search and the start of Caddy, which listens at all addresses.
    for (int attempt = 0; attempt < 5 && !running(); ++attempt) start(server);
    EXPECT_TRUE(running()) << "Caddy does not start: " << log();
  }
  ~Caddy() { stop(); }
  Caddy(const Caddy&) = delete;
  Caddy& operator=(const Caddy&) = delete;

  bool running() const { return pid_ > 0; }
  std::uint16_t port() const { return port_; }
  std::string log() const {
    const auto bytes = base::readFile(directory_ / "log");
    return bytes ? std::string(bytes->begin(), bytes->end()) : "";
  }

 private:
  void start(std::uint16_t server) {
    port_ = support::freePort();
    std::string sites = snippet("caddy");
    replaceOnce(sites, ":8088", "http://127.0.0.1:" + std::to_string(port_));
    replaceOnce(sites, "127.0.0.1:8080", "127.0.0.1:" + std::to_string(server));
    const std::string file = directory_ / "Caddyfile", log_file = directory_ / "log";
    std::ofstream(file) << "{\nadmin off\n}\n" << sites;
    pid_ = ::fork();
    if (pid_ == 0) {
      ::prctl(PR_SET_PDEATHSIG, SIGTERM);
      ::dup2(::open(log_file.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600), STDERR_FILENO);
      ::close_range(3, ~0U, 0);
      for (const char* variable : {"HOME", "XDG_DATA_HOME", "XDG_CONFIG_HOME"})
        ::setenv(variable, directory_.path().c_str(), 1);
      ::execl("/usr/bin/caddy", "caddy", "run", "--adapter", "caddyfile", "--config", file.c_str(), nullptr);
      ::_exit(127);
    }
    // Caddy says so when it listens at all ports. An answer at the port might be another process's.
    const bool serves = waitFor([&] {
      if (::waitpid(pid_, nullptr, WNOHANG) == pid_) pid_ = -1;
      return !running() || log().find("serving initial configuration") != std::string::npos;
    });
    if (!serves) stop();
  }
  void stop() {
    if (!running()) return;
    ::kill(pid_, SIGTERM);
    ::waitpid(pid_, nullptr, 0);
    pid_ = -1;
  }

  const support::TemporaryDirectory directory_;
  pid_t pid_ = -1;
  std::uint16_t port_ = 0;
};

TEST(Proxy, caddyPassesViewersOn) {
  if (::access("/usr/bin/caddy", X_OK) != 0) GTEST_SKIP() << "caddy is not installed (Debian: caddy)";
  const SceneDirectory scene;
  const RunningServer server(scene.path);
  const Caddy caddy(server.port());
  ASSERT_TRUE(caddy.running());
  expectAVisit(caddy.port());
  EXPECT_EQ(httpRequest(caddy.port(), "/healthz").status, 200);
  EXPECT_EQ(httpRequest(caddy.port(), "/metrics").status, 403);
  if (HasFailure()) std::cerr << caddy.log();
}

}  // namespace
}  // namespace server
