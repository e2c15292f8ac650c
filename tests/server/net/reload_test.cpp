// SIGHUP with a new certificate and a scene that was built anew, while many viewers fly: nobody notices but the viewers
// of that scene.
#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <deque>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "tests/server/net/loopback.h"
#include "tests/server/net/serve_process.h"
#include "tests/server/net/served_scene.h"
#include "tests/server/net/tls_tunnel.h"
#include "tests/server/net/whole_view.h"
#include "tests/support/certificates.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

namespace fs = std::filesystem;

/// Looks at one view after another until it is told to stop, or until its connection ends.
class FlyingViewer {
 public:
  FlyingViewer(std::uint16_t port, const std::string& path) : client_(viewerAt(port, path, welcome_)) {}

  void fly(const std::atomic<bool>& stop) {
    while (client_ && !stop && completes(*client_, welcome_, views_ + 1)) ++views_;
    has_ended_ = !stop;
  }
  std::uint32_t views() const { return views_; }
  bool hasEnded() const { return has_ended_; }
  int closeCode() const { return client_ ? client_->closeCode() : 0; }

 private:
  protocol::Welcome welcome_;
  std::unique_ptr<LoopbackClient> client_;
  std::atomic<std::uint32_t> views_ = 0;
  std::atomic<bool> has_ended_ = false;
};

class TlsReload : public ::testing::Test {
 protected:
  std::string path(const std::string& name) const { return files_ / name; }
  std::string nameOf(const SceneDirectory& scene) const { return fs::path(scene.path).filename(); }
  void issue(const support::Authority& authority) const {
    authority.issue("IP:127.0.0.1", -60, 3600, path("certificate.pem"), path("key.pem"));
  }

  const support::TemporaryDirectory files_;
  const SceneDirectory tower_, yard_, barn_{5'000};
};

TEST_F(TlsReload, nobodyNoticesButTheViewersOfTheSceneThatChanged) {
  const support::Authority former("former"), newer("newer");
  former.write(path("former.pem"));
  newer.write(path("newer.pem"));
  issue(former);
  ServeProcess server({tower_.path, yard_.path, "--no-access", "--certificate", path("certificate.pem"), "--key",
                       path("key.pem"), "--views-per-second", "1000"});
  const TlsTunnel tunnel(server.port(), {path("former.pem"), path("newer.pem")});

  constexpr int kViewers = 32, kInYard = 8;
  std::deque<FlyingViewer> viewers;
  for (int i = 0; i < kViewers; ++i)
    viewers.emplace_back(tunnel.port(), "/" + nameOf(i < kInYard ? yard_ : tower_) + "/ws");
  const long former_serial = tunnel.lastSerial();
  EXPECT_NE(former_serial, 0);

  const auto haveAll = [&](const std::function<bool(const FlyingViewer&)>& condition, int from) {
    return waitFor([&] { return std::all_of(viewers.begin() + from, viewers.end(), condition); });
  };
  std::atomic<bool> stop = false;
  std::vector<std::jthread> threads;
  for (FlyingViewer& viewer : viewers) threads.emplace_back([&] { viewer.fly(stop); });
  EXPECT_TRUE(haveAll([](const FlyingViewer& viewer) { return viewer.views() >= 2; }, 0));

  issue(newer);
  fs::rename(yard_.path, yard_.path + ".old");
  fs::copy(barn_.path, yard_.path, fs::copy_options::recursive);
  server.send(SIGHUP);
  EXPECT_TRUE(waitFor([&] {
    return std::all_of(viewers.begin(), viewers.begin() + kInYard, [](const auto& one) { return one.hasEnded(); });
  })) << "the scene that was built anew is not told of";

  std::vector<std::uint32_t> then;
  for (const FlyingViewer& viewer : viewers) then.push_back(viewer.views());
  for (int i = kInYard; i < kViewers; ++i) {
    const auto at = static_cast<std::size_t>(i);
    EXPECT_TRUE(waitFor([&] { return viewers[at].views() >= then[at] + 3; })) << "viewer " << i;
    EXPECT_FALSE(viewers[at].hasEnded()) << "viewer " << i;
  }
  expectAView(tunnel.port(), "/" + nameOf(yard_) + "/ws");
  EXPECT_NE(tunnel.lastSerial(), 0) << "the new certificate goes with its key";
  EXPECT_NE(tunnel.lastSerial(), former_serial) << "new connections still get the former certificate";
  stop = true;
  threads.clear();
  for (int i = 0; i < kInYard; ++i) EXPECT_EQ(viewers[static_cast<std::size_t>(i)].closeCode(), 1012) << "viewer " << i;
  fs::remove_all(yard_.path + ".old");
}

TEST_F(TlsReload, aCertificateWithoutItsKeyLeavesTheFormerOne) {
  const support::Authority authority("authority");
  authority.write(path("authority.pem"));
  issue(authority);
  ServeProcess server({tower_.path, "--no-access", "--certificate", path("certificate.pem"), "--key", path("key.pem")});
  const TlsTunnel tunnel(server.port(), {path("authority.pem")});
  expectAView(tunnel.port(), "/ws");
  const long serial = tunnel.lastSerial();
  EXPECT_NE(serial, 0);

  fs::copy_file(path("key.pem"), path("former-key.pem"));
  issue(authority);
  fs::rename(path("former-key.pem"), path("key.pem"));
  server.send(SIGHUP);
  EXPECT_TRUE(waitFor([&] {
    return server.log().find("certificate and tokens stay as they were") != std::string::npos;
  })) << server.log();
  expectAView(tunnel.port(), "/ws");
  EXPECT_EQ(tunnel.lastSerial(), serial);
}

}  // namespace
}  // namespace server
