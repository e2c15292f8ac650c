#pragma once
// A viewer with a scripted server, a GL context and a decoder that needs no JPEG.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "base/egl/headless.h"
#include "base/gl/gl.h"
#include "client/viewer/viewer.h"
#include "tests/client/source/scripted_server.h"

namespace client {

/// Decodes every face to an image of this size with a pattern of its own, fully covered; ready at the next
/// takeDecoded().
class PatternDecoder : public ImageDecoder {
 public:
  PatternDecoder(int face_size, int frame_width, int frame_height)
      : face_size_(face_size), frame_width_(frame_width), frame_height_(frame_height) {}
  void submit(std::uint64_t id, base::ByteView) override {
    const bool frame = id >> 63U != 0;
    done_.push_back({id, pattern(id, frame ? frame_width_ : face_size_, frame ? frame_height_ : face_size_), {}});
  }
  static base::Image pattern(std::uint64_t id, int width, int height) {
    base::Image rgba(width, height, 4);
    for (std::size_t i = 0; i < rgba.pixels.size(); ++i)
      rgba.pixels[i] = i % 4 == 3 ? 255 : static_cast<std::uint8_t>(40 * (id % 5) + i / 64 % 50);
    return rgba;
  }
  std::vector<DecodedImage> takeDecoded() override { return std::exchange(done_, {}); }
  std::size_t pending() const override { return done_.size(); }

 private:
  int face_size_, frame_width_, frame_height_;
  std::vector<DecodedImage> done_;
};

class ViewerFixture : public ::testing::Test {
 protected:
  explicit ViewerFixture(int leaves = 8) : server(leaves) {}
  void SetUp() override { makeContext(); }
  void TearDown() override {
    if (context) {
      EXPECT_EQ(base::gl::takeError(), "");
    }
  }
  void makeContext() {
    auto made = base::HeadlessContext::create();
    ASSERT_TRUE(bool(made)) << made.error().message;
    context = std::move(*made);
    auto target_made = base::gl::RenderTarget::create(64, 48);
    ASSERT_TRUE(bool(target_made));
    target = std::move(*target_made);
  }
  virtual std::unique_ptr<ImageDecoder> makeDecoder() {
    return std::make_unique<PatternDecoder>(static_cast<int>(server.welcome.grid.face_size), 64, 48);
  }
  void open(ViewerOptions options, float fade_seconds = 0.0F) {
    options.lumigraph.fade_seconds = fade_seconds;
    options.upload_milliseconds = 0.0;
    viewer = std::make_unique<Viewer>(options, makeDecoder());
    viewer->session().connected();
    receive(server.sayWelcome());
  }
  void receive(const base::Bytes& message) {
    auto taken = viewer->session().receive(message);
    ASSERT_TRUE(bool(taken)) << taken.error().message;
  }
  void receiveAllGroups() {
    for (std::uint32_t g = 0; g < server.hierarchy().groups.size(); ++g) receive(server.sayGroup(g));
  }
  base::Image draw(const base::ViewCamera& camera) {
    target.bind();
    auto drawn = viewer->draw(camera, now += 0.1);
    EXPECT_TRUE(bool(drawn)) << drawn.error().message;
    return target.read();
  }
  /// Draws until nothing changes any more.
  base::Image settle(const base::ViewCamera& camera) {
    base::Image image = draw(camera);
    for (int i = 0; i < 200 && viewer->stats().busy; ++i) image = draw(camera);
    EXPECT_FALSE(viewer->stats().busy);
    return image;
  }
  static std::size_t covered(const base::Image& image) {
    std::size_t count = 0;
    for (std::size_t i = 3; i < image.pixels.size(); i += 4) count += image.pixels[i] != 0 ? 1 : 0;
    return count;
  }

  ScriptedServer server;
  std::unique_ptr<base::HeadlessContext> context;
  base::gl::RenderTarget target;
  std::unique_ptr<Viewer> viewer;
  double now = 0.0;
};

}  // namespace client
