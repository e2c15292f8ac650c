// /render draws pictures in bands, and other requests are answered meanwhile.
#include <gtest/gtest.h>
#include <sys/socket.h>

#include <condition_variable>
#include <future>
#include <thread>

#include "base/egl/headless.h"
#include "base/jpeg/jpeg.h"
#include "base/png/png.h"
#include "server/net/frame_renderer.h"
#include "server/net/picture.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"
#include "tests/support/ws_viewer.h"

namespace server {
namespace {

const std::string kAslant = "/render?position=500016,3999990,125&target=500016,4000016,100&up=0,0,1";

PictureRequest requestOf(const std::string& target) {
  return *parsePictureRequest(*parseQuery(target), 64'000'000);
}

struct Difference {
  double mean = 0.0;  // levels
  int largest = 0;
  double off = 0.0;  // share of values more than one level off
};

Difference compare(const base::Image& a, const base::Image& b) {
  Difference difference;
  std::size_t off = 0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    const int d = std::abs(int{a.pixels[i]} - int{b.pixels[i]});
    difference.mean += d;
    difference.largest = std::max(difference.largest, d);
    if (d > 1) ++off;
  }
  difference.mean /= static_cast<double>(a.pixels.size());
  difference.off = static_cast<double>(off) / static_cast<double>(a.pixels.size());
  return difference;
}

class PictureTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto context = base::HeadlessContext::create();
    ASSERT_TRUE(context) << context.error().message;
    context_ = std::move(*context);
    auto patches = lod::patch::PatchFile::open(scene_.path + "/patch.lgp");
    auto document = base::readScene(scene_.path);
    ASSERT_TRUE(patches && document);
    patches_ = std::move(*patches);
    document_ = std::move(*document);
    auto renderer = SceneRenderer::create(document_, patches_);
    ASSERT_TRUE(renderer);
    renderer_ = std::move(*renderer);
  }
  base::Bytes paint(const PictureRequest& request, std::uint64_t band_pixels, int* steps = nullptr) {
    auto painter = PicturePainter::begin(request, document_, *renderer_, band_pixels);
    EXPECT_TRUE(painter);
    for (int i = 1;; ++i) {
      auto whole = (*painter)->drawNextBand(*renderer_);
      EXPECT_TRUE(whole);
      if (!whole || !*whole) {
        if (!whole) return {};
        continue;
      }
      if (steps != nullptr) *steps = i;
      return (*painter)->takePicture();
    }
  }

  const SceneDirectory scene_{0};
  std::unique_ptr<base::HeadlessContext> context_;
  lod::patch::PatchFile patches_;
  base::Scene document_;
  std::unique_ptr<SceneRenderer> renderer_;
};

TEST_F(PictureTest, bandsMakeThePictureThatOnePieceMakes) {
  for (const std::string more : {"", "&ortho_height=20", "&supersampling=1&fov_y_degrees=90", "&background=204060"}) {
    const PictureRequest request = requestOf(kAslant + "&width=517&height=401" + more);
    int steps = 0;
    const auto bands = base::decodePng(paint(request, 517 * 30, &steps));
    const auto whole = base::decodePng(paint(request, std::uint64_t{1} << 40));
    ASSERT_TRUE(bands && whole);
    EXPECT_EQ(steps, 14);
    EXPECT_EQ(whole->width, 517);
    EXPECT_EQ(whole->height, 401);
    ASSERT_EQ(bands->channels, whole->channels);
    // Off-axis matrices round differently, so a sample at an edge now and then falls on the other side.
    const Difference difference = compare(*bands, *whole);
    EXPECT_LE(difference.mean, 0.01) << more;
    EXPECT_LE(difference.off, 1e-3) << more;
    // The picture shows something, and its border is no straight line.
    std::size_t seen = 0;
    for (std::size_t i = 0; i < whole->pixels.size(); ++i) seen += whole->pixels[i] != whole->pixels[0] ? 1 : 0;
    EXPECT_GT(seen, whole->pixels.size() / 10);
  }
}

// Renders directly, by one call with the viewer's own camera.
TEST_F(PictureTest, picturesEqualTheRenderersOwn) {
  const PictureRequest request = requestOf(kAslant + "&width=300&height=200");
  const auto bands = base::decodePng(paint(request, 300 * 16));
  ASSERT_TRUE(bands);
  const base::Sphere bounds{renderer_->sceneCenter(), renderer_->sceneRadius()};
  const auto direct = renderer_->render(base::cameraForScene(request.camera, document_.origin, bounds), {0.25F, 2});
  ASSERT_TRUE(direct);
  const Difference difference = compare(*bands, direct->rgba);
  EXPECT_LE(difference.mean, 0.01);
  EXPECT_LE(difference.off, 1e-3);
}

// At the target's distance both projections show the same height.
TEST_F(PictureTest, parallelViewHasTheRequestedScale) {
  const auto picture = base::decodePng(paint(
      requestOf("/render?position=500016,4000016,900&direction=0,0,-1&up=0,1,0&ortho_height=64&width=256&height=256"
                "&supersampling=1"),
      1 << 20));
  ASSERT_TRUE(picture);
  // The square of 32 units fills the middle half.
  std::size_t seen = 0;
  for (std::size_t i = 3; i < picture->pixels.size(); i += 4) seen += picture->pixels[i] == 255 ? 1 : 0;
  EXPECT_NEAR(static_cast<double>(seen), 128.0 * 128.0, 300.0);
}

TEST_F(PictureTest, oppositeSectionsShowOppositeSides) {
  const std::string above =
      "/render?position=500016,4000016,900&direction=0,0,-1&up=0,1,0&ortho_height=64&width=256&height=256"
      "&supersampling=1";
  const auto covered = [&](const std::string& more) {
    const auto picture = base::decodePng(paint(requestOf(above + more), 256 * 37));
    EXPECT_TRUE(picture);
    std::size_t seen = 0;
    for (std::size_t i = 3; picture && i < picture->pixels.size(); i += 4) seen += picture->pixels[i] == 255 ? 1 : 0;
    return static_cast<double>(seen);
  };
  const double whole = covered("");
  EXPECT_NEAR(covered("&section=x,500008,b"), 0.25 * whole, 0.02 * whole);
  EXPECT_NEAR(covered("&section=x,500008,a"), 0.75 * whole, 0.02 * whole);
  EXPECT_EQ(covered("&section=x,400000,b"), 0.0);
  EXPECT_EQ(covered("&section=x,600000,b"), whole);
}

TEST_F(PictureTest, resolutionColoursFollowThePatchesErrors) {
  const std::string near = "/render?position=500016,4000008,104&target=500016,4000016,100&up=0,0,1";
  const auto hues = [&](const std::string& more) {
    const auto picture =
        base::decodePng(paint(requestOf(near + "&width=256&height=192&supersampling=1" + more), 256 * 50));
    EXPECT_TRUE(picture);
    int blue = 0;
    int other = 0;
    for (std::size_t i = 0; picture && i < picture->pixels.size(); i += 4) {
      const std::uint8_t* p = &picture->pixels[i];
      if (p[3] == 255) ++(p[2] > p[1] && p[1] > p[0] ? blue : other);
    }
    return std::pair(blue, other);
  };
  const auto fine = hues("&colors=resolution");
  EXPECT_GT(fine.first, 1000);
  EXPECT_EQ(fine.second, 0) << "a quarter of a pixel is the finest colour";
  EXPECT_GT(hues("&colors=resolution&tolerance=500").second, 1000);
}

TEST_F(PictureTest, jpegsAreTheSamePicture) {
  const auto png = base::decodePng(paint(requestOf(kAslant + "&width=333&height=222&background=ffffff"), 333 * 17));
  const auto jpeg =
      base::decodeJpeg(paint(requestOf(kAslant + "&width=333&height=222&format=jpeg&quality=95"), 333 * 17));
  ASSERT_TRUE(png && jpeg);
  EXPECT_LT(compare(*png, *jpeg).mean, 1.0);
}

// ---- On the renderer's thread

class FrameRendererTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto open = openScene(directory_.path);
    ASSERT_TRUE(open) << open.error().message;
    scene_ = std::move(*open);
    auto started = FrameRenderer::start({scene_});
    ASSERT_TRUE(started) << started.error().message;
    renderer_ = std::move(*started);
  }

  const SceneDirectory directory_{0};
  std::shared_ptr<OpenScene> scene_;
  std::unique_ptr<FrameRenderer> renderer_;
};

/// Notes in which order things happen.
class Order {
 public:
  void note(const std::string& what) {
    const std::lock_guard lock(mutex_);
    order_.push_back(what);
    changed_.notify_all();
  }
  std::vector<std::string> waitFor(std::size_t count) {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [&] { return order_.size() >= count; });
    return order_;
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::string> order_;
};

TEST_F(FrameRendererTest, framesComeBetweenBands) {
  Order order;
  // 20 bands.
  ASSERT_TRUE(renderer_->requestPicture(1, "address", scene_,
                                        requestOf(kAslant + "&width=5000&height=4000&supersampling=1&format=jpeg"),
                                        {0, 1}, [&](const auto& bytes) { order.note(bytes ? "picture" : "failed"); }));
  FrameRequest frame;
  frame.camera = requestOf(kAslant + "&width=64&height=64").camera;
  frame.quality = 80;
  for (std::uint64_t client = 2; client < 5; ++client)
    renderer_->requestFrame(client, "address", scene_, frame, [&](const auto&) { order.note("frame"); });
  EXPECT_EQ(order.waitFor(4), (std::vector<std::string>{"frame", "frame", "frame", "picture"}));
}

TEST_F(FrameRendererTest, aViewIsEncodedAgainInAnotherQualityAndDrawnAgainInAnotherLight) {
  FrameRequest request;
  request.camera = requestOf(kAslant + "&width=320&height=240").camera;
  const auto frameOf = [&](int quality) {
    request.quality = quality;
    std::promise<base::Bytes> promise;
    renderer_->requestFrame(1, "address", scene_, request,
                            [&](protocol::EncodedFrame encoded) { promise.set_value(std::move(encoded.value)); });
    return promise.get_future().get();
  };
  const base::Bytes quick = frameOf(40);
  ASSERT_FALSE(quick.empty());
  const base::Bytes last = frameOf(95);
  EXPECT_GT(last.size(), quick.size());
  EXPECT_EQ(frameOf(40), quick);
  base::Light other = scene_->scene.light;
  other.mode = other.mode == base::LightMode::kSoft ? base::LightMode::kUnlit : base::LightMode::kSoft;
  renderer_->setLight(scene_, other);
  EXPECT_NE(frameOf(40), quick);
}

TEST_F(FrameRendererTest, cancelledPictureIsAbandoned) {
  std::atomic<bool> unwanted{false};
  const auto fail = [&](const auto&) { unwanted = true; };
  // 64 bands are being drawn or wait, and one more picture is in the queue.
  const PictureRequest large = requestOf(kAslant + "&width=8000&height=8000");
  ASSERT_TRUE(renderer_->requestPicture(1, "address", scene_, large, {2, 3}, fail));
  ASSERT_TRUE(renderer_->requestPicture(2, "address", scene_, large, {2, 3}, fail));
  renderer_->cancel(1);
  renderer_->cancel(2);
  std::mutex mutex;
  std::condition_variable changed;
  bool done = false;
  ASSERT_TRUE(renderer_->requestPicture(3, "address", scene_, requestOf(kAslant + "&width=64&height=64"), {2, 3},
                                        [&](const auto& bytes) {
                                          const std::lock_guard lock(mutex);
                                          done = bool(bytes);
                                          changed.notify_all();
                                        }));
  std::unique_lock lock(mutex);
  changed.wait(lock, [&] { return done; });
  EXPECT_FALSE(unwanted);
}

FrameRequest frameOf(int width, int height) {
  FrameRequest frame;
  frame.camera = requestOf(kAslant + "&width=64&height=64").camera;
  frame.camera.width = width;
  frame.camera.height = height;
  frame.quality = 60;
  return frame;
}

// Several large frames were asked for first. Small ones that come later are drawn between their bands, one after the
// other, and the large ones come in the end.
TEST_F(FrameRendererTest, smallFramesDoNotWaitForLargeOnes) {
  Order order;
  for (std::uint64_t client = 1; client < 4; ++client)
    renderer_->requestFrame(client, "address", scene_, frameOf(4000, 3000 + static_cast<int>(client)),
                            [&](const auto& encoded) { order.note(encoded.value.empty() ? "failed" : "large"); });
  for (int i = 0; i < 4; ++i) {
    renderer_->requestFrame(9, "address", scene_, frameOf(64 + i, 64),
                            [&](const auto& encoded) { order.note(encoded.value.empty() ? "failed" : "small"); });
    const auto so_far = order.waitFor(static_cast<std::size_t>(i) + 1);
    EXPECT_EQ(so_far.back(), "small") << i;
  }
  const auto all = order.waitFor(7);
  EXPECT_EQ(std::count(all.begin(), all.end(), "large"), 3);
}

// Fifty viewers of one address asked before one of another, who has had no more than each of them.
TEST_F(FrameRendererTest, manyViewersOfAnAddressAreServedAsAFew) {
  Order before;
  for (int i = 0; i < 20; ++i)
    renderer_->requestFrame(static_cast<std::uint64_t>(i), "crowd", scene_, frameOf(64, 64 + i),
                            [&](const auto&) { before.note("crowd"); });
  before.waitFor(20);
  Order order;
  for (int i = 0; i < 50; ++i)
    renderer_->requestFrame(static_cast<std::uint64_t>(100 + i), "crowd", scene_, frameOf(64, 100 + i),
                            [&](const auto&) { order.note("crowd"); });
  renderer_->requestFrame(200, "other", scene_, frameOf(64, 200), [&](const auto&) { order.note("other"); });
  const auto all = order.waitFor(51);
  EXPECT_LT(std::find(all.begin(), all.end(), "other") - all.begin(), 30);
}

// Bands share one cut, so that a frame in bands is the frame in one piece.
TEST(FrameRendererFrames, bandsMakeTheFrameThatOnePieceMakes) {
  const SceneDirectory scene(0);
  auto open = openScene(scene.path);
  ASSERT_TRUE(open);
  const std::shared_ptr<OpenScene> shared = std::move(*open);
  auto context = base::HeadlessContext::create();
  ASSERT_TRUE(context);
  auto renderer = SceneRenderer::create(shared->scene, shared->patches);
  ASSERT_TRUE(renderer);
  const base::ViewCamera view = frameOf(2400, 1500).camera;
  FramePainter painter(view, shared->scene, **renderer);
  int steps = 1;
  for (;; ++steps) {
    const auto whole = painter.drawNextBand(**renderer);
    ASSERT_TRUE(whole);
    if (*whole) break;
  }
  EXPECT_EQ(steps, 2);
  const base::Image bands = painter.takePicture();
  const base::Sphere bounds{(*renderer)->sceneCenter(), (*renderer)->sceneRadius()};
  const auto direct = (*renderer)->render(base::cameraForScene(view, shared->scene.origin, bounds),
                                          exactFrameOptions(view.width, view.height));
  ASSERT_TRUE(direct);
  const Difference difference = compare(bands, direct->rgba);
  EXPECT_LE(difference.mean, 0.01);
  EXPECT_LE(difference.off, 1e-3);
}

// A connection that goes while its large frame is drawn, or waits, leaves room for others.
TEST_F(FrameRendererTest, cancelledLargeFramesMakeRoom) {
  for (int round = 0; round < 3; ++round) {
    for (std::uint64_t client = 1; client < 6; ++client)
      renderer_->requestFrame(client, "address", scene_, frameOf(4000, 4000), [](const auto&) {});
    for (std::uint64_t client = 1; client < 6; ++client) renderer_->cancel(client);
  }
  Order order;
  renderer_->requestFrame(7, "address", scene_, frameOf(2000, 2000),
                          [&](const auto& encoded) { order.note(encoded.value.empty() ? "failed" : "large"); });
  EXPECT_EQ(order.waitFor(1).front(), "large");
}

TEST_F(FrameRendererTest, oneAddressCannotTakeAllPlaces) {
  const PictureRequest large = requestOf(kAslant + "&width=4000&height=4000");
  const auto ask = [&](std::uint64_t client, const std::string& address) {
    return renderer_->requestPicture(client, address, scene_, large, {4, 2}, [](const auto&) {});
  };
  EXPECT_TRUE(ask(1, "a"));
  EXPECT_TRUE(ask(2, "a"));
  EXPECT_FALSE(ask(3, "a"));
  EXPECT_TRUE(ask(4, "b"));
  renderer_->cancel(2);
  EXPECT_TRUE(ask(5, "a"));
  for (std::uint64_t client = 1; client < 6; ++client) renderer_->cancel(client);
}

// ---- Over HTTP

TEST(Render, pictureIsAnswered) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path, ServerOptions{});
  const HttpAnswer png = httpRequest(server.port(), kAslant + "&width=200&height=100");
  ASSERT_EQ(png.status, 200) << png.body;
  EXPECT_EQ(png.headers.at("content-type"), "image/png");
  EXPECT_EQ(png.headers.at("cache-control"), "no-store");
  const auto picture = base::decodePng({reinterpret_cast<const std::uint8_t*>(png.body.data()), png.body.size()});
  ASSERT_TRUE(picture);
  EXPECT_EQ(picture->width, 200);
  EXPECT_EQ(picture->channels, 4);
  EXPECT_EQ(httpRequest(server.port(), kAslant + "&format=jpeg").headers.at("content-type"), "image/jpeg");
  const HttpAnswer head = httpRequest(server.port(), kAslant, {}, "HEAD");
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(head.headers.at("content-type"), "image/png");
}

TEST(Render, impossibleRequestsAreRefusedInOneLine) {
  const SceneDirectory scene(0);
  ServerOptions options;
  options.max_picture_pixels = 10'000;
  RunningServer server(scene.path, options);
  for (const std::string bad : {"&width=101&height=100", "&width=-1", "&width=nan", "&fov_y_degrees=nan", "&x=1"}) {
    const HttpAnswer answer = httpRequest(server.port(), kAslant + bad);
    EXPECT_EQ(answer.status, 400) << bad;
    EXPECT_EQ(std::count(answer.body.begin(), answer.body.end(), '\n'), 1);
  }
  EXPECT_EQ(httpRequest(server.port(), kAslant + "&width=100&height=100").status, 200);
}

TEST(Render, picturesNeedFramesAndPixels) {
  const SceneDirectory scene(0);
  RunningServer without(scene.path);
  EXPECT_EQ(httpRequest(without.port(), kAslant).status, 501);
  ServerOptions options;
  options.max_picture_pixels = 0;
  RunningServer forbidden(scene.path, options);
  EXPECT_EQ(httpRequest(forbidden.port(), kAslant).status, 501);
}

TEST(Render, picturesBeyondTheQueueAreAskedToComeAgain) {
  const SceneDirectory scene(0);
  ServerOptions options;
  options.picture_limits = {1, 10};
  RunningServer server(scene.path, options);
  std::mutex mutex;
  std::map<int, int> statuses;
  std::vector<std::thread> visitors;
  for (int i = 0; i < 12; ++i)
    visitors.emplace_back([&] {
      const HttpAnswer answer = httpRequest(server.port(), kAslant + "&width=1500&height=1000");
      const std::lock_guard lock(mutex);
      ++statuses[answer.status];
      if (answer.status == 503) {
        EXPECT_EQ(answer.headers.at("retry-after"), "5");
      }
    });
  // Meanwhile the server answers others.
  EXPECT_EQ(httpRequest(server.port(), "/healthz").status, 200);
  for (std::thread& visitor : visitors) visitor.join();
  EXPECT_GE(statuses[200], 2);
  EXPECT_EQ(statuses[200] + statuses[503], 12);
  EXPECT_EQ(httpRequest(server.port(), kAslant).status, 200);
}

// A picture that its visitor does not take counts among those of its address, and others get theirs.
TEST(Render, picturesThatAreNotTakenCountForTheirAddress) {
  const SceneDirectory scene(0);
  ServerOptions options;
  options.picture_limits = {4, 1};
  RunningServer server(scene.path, options);
  constexpr std::uint8_t kSlow = 66;
  const auto ask = [&](const base::FileDescriptor& socket, const std::string& target) {
    const std::string text = "GET " + target + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
    EXPECT_EQ(::send(socket.get(), text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
  };
  const auto statusFor = [&](std::uint8_t last_byte) {
    const base::FileDescriptor socket = support::connectTo(server.port(), last_byte);
    ask(socket, kAslant + "&width=32&height=32");
    std::string head(12, ' ');
    EXPECT_EQ(::recv(socket.get(), head.data(), head.size(), MSG_WAITALL), static_cast<ssize_t>(head.size()));
    return head;
  };
  base::FileDescriptor slow = support::connectTo(server.port(), kSlow);
  // The picture has 4.9 MB, of which the system's buffers take 4.
  ask(slow, kAslant + "&width=7900&height=7900&supersampling=1&format=jpeg&quality=100");
  const std::string drawn = "lumigrid_pictures_total{outcome=\"drawn\"} 1\n";
  while (httpRequest(server.port(), "/metrics").body.find(drawn) == std::string::npos)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  EXPECT_EQ(statusFor(kSlow), "HTTP/1.1 503");
  EXPECT_EQ(statusFor(1), "HTTP/1.1 200");
  slow = base::FileDescriptor();
  std::string status;
  for (int attempt = 0; attempt < 1000 && status != "HTTP/1.1 200"; ++attempt) status = statusFor(kSlow);
  EXPECT_EQ(status, "HTTP/1.1 200");
}

// When a visitor closes the connection while the picture is drawn, the next picture gets its turn.
TEST(Render, visitorsThatLeaveFreeTheirPlaceInTheQueue) {
  const SceneDirectory scene(0);
  ServerOptions options;
  options.picture_limits = {0, 10};
  RunningServer server(scene.path, options);
  for (int i = 0; i < 3; ++i) {
    const HttpAnswer gone = askAndLeave(server.port(), kAslant + "&width=8000&height=8000");
    EXPECT_EQ(gone.status, 0);
    int status = 503;
    for (int attempt = 0; attempt < 5000 && status == 503; ++attempt) {
      status = httpRequest(server.port(), kAslant + "&width=32&height=32").status;
      std::this_thread::sleep_for(std::chrono::milliseconds(2));  // a band takes as long as the machine is busy
    }
    EXPECT_EQ(status, 200);
  }
}

TEST(Render, serverStopsInTheMiddleOfAPicture) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path, ServerOptions{});
  std::thread visitor([&] { EXPECT_EQ(httpRequest(server.port(), kAslant + "&width=8000&height=8000").status, 0); });
  while (httpRequest(server.port(), kAslant + "&width=8000&height=8000", {}, "HEAD").status != 200) {
  }
  server.stop();
  visitor.join();
}

}  // namespace
}  // namespace server
