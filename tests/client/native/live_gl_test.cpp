// Tests viewer, connection and a real server together.
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <functional>

#include "base/egl/headless.h"
#include "base/gl/gl.h"
#include "base/json/camera_file.h"
#include "base/png/png.h"
#include "client/native/connection.h"
#include "client/native/headless.h"
#include "client/native/native_decoder.h"
#include "tests/server/net/served_scene.h"

namespace client {
namespace {

using server::RunningServer;
using server::SceneDirectory;

std::string urlOf(std::uint16_t port) {
  return "ws://127.0.0.1:" + std::to_string(port) + "/";
}

ViewerOptions patches() {
  ViewerOptions options;
  options.method = Method::kPatches;
  options.lumigraph.fade_seconds = 0.0F;
  return options;
}

/// A server in a process of its own, which can be stopped without its knowing. It is forked before this process has
/// threads.
class ServerProcess {
 public:
  explicit ServerProcess(const std::string& directory) {
    int ends[2];
    LUMIGRID_CHECK(::pipe(ends) == 0);
    pid_ = ::fork();
    if (pid_ == 0) {
      server::ServerOptions options = RunningServer::quiet();
      options.port = 0;
      auto opened = server::Server::open({directory}, options);
      const std::uint16_t number = opened ? (*opened)->port() : 0;
      if (::write(ends[1], &number, sizeof(number)) != sizeof(number) || !opened) ::_exit(1);
      ::_exit((*opened)->run(false) ? 0 : 1);
    }
    LUMIGRID_CHECK(::read(ends[0], &port, sizeof(port)) == sizeof(port));
    ::close(ends[0]);
    ::close(ends[1]);
  }
  ~ServerProcess() {
    ::kill(pid_, SIGKILL);
    int status = 0;
    ::waitpid(pid_, &status, 0);
  }
  void signal(int number) const {
    ::kill(pid_, number);
    if (number != SIGSTOP) return;
    int status = 0;
    ::waitpid(pid_, &status, WUNTRACED);  // waits until it is stopped
  }
  std::uint16_t port = 0;

 private:
  pid_t pid_ = -1;
};

TEST(Live, theRenderLoopGoesOnWhileTheServerStandsStill) {
  const SceneDirectory scene;
  const ServerProcess server(scene.path);
  ASSERT_NE(server.port, 0);
  auto context = base::HeadlessContext::create();
  ASSERT_TRUE(bool(context)) << context.error().message;
  auto target = base::gl::RenderTarget::create(64, 48);
  ASSERT_TRUE(bool(target));
  Viewer viewer(patches(), std::make_unique<NativeDecoder>(1));
  Connection connection(*parseServerUrl(urlOf(server.port)));
  Session& session = viewer.session();

  // Draws one frame of a render loop; the view moves a little each time.
  int frames = 0;
  base::ViewCamera camera;
  const auto frame = [&] {
    connection.pump(session);
    if (session.welcome() != nullptr) {
      camera = server::viewOf(*session.welcome(), 1).camera;
      camera.width = 64;
      camera.height = 48;
      camera.position.x += 0.001 * frames;
    }
    target->bind();
    ASSERT_TRUE(bool(viewer.draw(camera, 0.01 * frames)));
    ++frames;
  };
  const auto until = [&](const std::function<bool()>& condition) {
    for (int i = 0; i < 3000 && !condition(); ++i) {
      frame();
      connection.waitForArrival(0.01);
    }
    return condition();
  };
  ASSERT_TRUE(until([&] { return viewer.stats().lumigraph.triangles > 0; }));

  // While the server is stopped no byte arrives, but frames are drawn.
  server.signal(SIGSTOP);
  while (connection.pump(session)) connection.waitForArrival(0.05);
  const std::uint64_t bytes = session.stats().bytes_received;
  const int before = frames;
  for (int i = 0; i < 200; ++i) frame();
  EXPECT_EQ(frames, before + 200);
  EXPECT_EQ(session.stats().bytes_received, bytes) << "it did stand still";
  EXPECT_GT(viewer.stats().lumigraph.triangles, 0U);

  // After it continues, the newest view is answered.
  server.signal(SIGCONT);
  EXPECT_TRUE(until([&] { return session.stats().bytes_received > bytes; }));
}

TEST(Live, aHeadlessRunWritesAPictureAndALineForEachFrame) {
  const SceneDirectory scene;
  const RunningServer server(scene.path);
  const std::string out = scene.path + "/out";
  HeadlessOptions options;
  options.url = urlOf(server.port());
  options.viewer = patches();
  options.out_dir = out;
  options.path = base::orbitPath({500'000.0, 4'000'000.0, 100.0}, {500'032.0, 4'000'032.0, 101.0}, {0.0, 0.0, 1.0}, 3,
                                 1.0, 0.6, 1.2, 64, 48);
  std::vector<HeadlessFrame> frames;
  options.on_frame = [&](const HeadlessFrame& frame) { frames.push_back(frame); };
  auto run = runHeadless(options);
  ASSERT_TRUE(bool(run)) << run.error().message;

  EXPECT_EQ(run->frames, 3U);
  EXPECT_EQ(run->incomplete, 0U);
  ASSERT_EQ(frames.size(), 3U);
  std::uint64_t bytes = 0;
  for (const HeadlessFrame& frame : frames) {
    EXPECT_TRUE(frame.stats.complete);
    EXPECT_GE(frame.stats.session.bytes_received, bytes);
    bytes = frame.stats.session.bytes_received;
    const auto written = base::readPng(out + "/frame_000" + std::to_string(frame.index) + ".png");
    ASSERT_TRUE(bool(written));
    EXPECT_EQ(written->pixels, frame.image.pixels);
    std::size_t covered = 0;
    for (std::size_t i = 3; i < written->pixels.size(); i += 4) covered += written->pixels[i] != 0 ? 1 : 0;
    EXPECT_GT(covered, 50U) << "the model is in the picture";
  }
  std::ifstream lines(out + "/frames.jsonl");
  std::string line;
  for (const HeadlessFrame& frame : frames) {
    ASSERT_TRUE(bool(std::getline(lines, line)));
    EXPECT_EQ(line, formatHeadlessFrame(frame));
  }
  EXPECT_FALSE(bool(std::getline(lines, line)));
}

TEST(Live, inRealTimeEveryFrameIsDrawnWhetherOrNotItIsComplete) {
  const SceneDirectory scene(50'000);
  const RunningServer server(scene.path);
  HeadlessOptions options;
  options.url = urlOf(server.port());
  options.viewer = patches();
  options.realtime_fps = 100.0;
  options.link = {2'000.0, 0.0};  // too slow for any view to be complete
  options.path.assign(5, base::orbitPath({500'000.0, 4'000'000.0, 100.0}, {500'032.0, 4'000'032.0, 101.0},
                                         {0.0, 0.0, 1.0}, 1, 1.0, 0.6, 1.2, 64, 48)[0]);
  auto run = runHeadless(options);
  ASSERT_TRUE(bool(run)) << run.error().message;
  EXPECT_EQ(run->frames, 5U);
  EXPECT_EQ(run->incomplete, 5U);
}

TEST(Live, aRunStopsOnRequest) {
  const SceneDirectory scene;
  const RunningServer server(scene.path);
  HeadlessOptions options;
  options.url = urlOf(server.port());
  options.viewer = patches();
  options.path.resize(100);
  int drawn = 0;
  options.on_frame = [&](const HeadlessFrame&) { ++drawn; };
  options.cancelled = [&] { return drawn >= 2; };
  auto run = runHeadless(options);
  ASSERT_FALSE(bool(run));
  EXPECT_EQ(run.error().code, base::ErrorCode::kCancelled);
  EXPECT_EQ(drawn, 2);
}

}  // namespace
}  // namespace client
