// Checks the viewer's byte budget, by counted bytes, at every frame of a tour.
#include <cmath>

#include "tests/client/viewer/viewer_fixture.h"

namespace client {
namespace {

/// The scene has more patches than the smallest budget holds, and images for many times that budget.
class ViewerBudget : public ViewerFixture {
 protected:
  ViewerBudget() : ViewerFixture(96) { server.welcome.grid.face_size = 256; }
  void SetUp() override {
    ViewerFixture::SetUp();
    outside_ = base::gl::heldBytes();
  }
  void openSmall(std::uint64_t budget = kMinMemory, float tolerance_px = 0.1F) {
    ViewerOptions options;
    options.memory_budget_bytes = budget;
    options.session.setPatchTolerance(tolerance_px);
    options.session.max_triangles = 10'000'000;
    open(options);
  }
  /// Checks that the viewer's count equals GL's, and that everything together is below the budget.
  void expectWithinBudget(const std::string& when) {
    const ViewerStats stats = viewer->stats();
    const base::gl::HeldBytes& held = base::gl::heldBytes();
    EXPECT_EQ(stats.memory.textures, held.textures - outside_.textures) << when;
    EXPECT_EQ(stats.memory.buffers, held.buffers - outside_.buffers) << when;
    EXPECT_EQ(stats.memory.renderbuffers, held.renderbuffers - outside_.renderbuffers) << when;
    EXPECT_LE(stats.memory.total(), stats.memory_budget) << when;
    most_ = std::max(most_, stats.memory.total());
  }
  base::gl::HeldBytes outside_;
  std::uint64_t most_ = 0;
};

TEST_F(ViewerBudget, aTourNeverExceedsItAndAlwaysShowsSomething) {
  openSmall();
  const std::size_t groups = server.hierarchy().groups.size();
  const glm::dvec3 middle = server.lookDown(0.0).position;
  std::uint32_t group = 0, face = 0;
  receive(server.sayGroup(group++));
  base::gl::resetPeak();
  constexpr int kFrames = 60;
  for (int frame = 0; frame < kFrames; ++frame) {
    // The view spirals down to the surface and up again while data arrive.
    const double share = static_cast<double>(frame) / kFrames;
    base::ViewCamera view = server.lookDown(10.0 + 240.0 * std::abs(1.0 - 2.0 * share));
    view.position += 80.0 * glm::dvec3(std::cos(9.0 * share), std::sin(9.0 * share), 0.0);
    view.direction = glm::normalize(middle - view.position);
    for (std::size_t i = 0; i < groups / kFrames + 1 && group < groups; ++i) receive(server.sayGroup(group++));
    for (int i = 0; i < 6; ++i, ++face)
      receive(server.sayFace({face % 4, face / 4 % 4, face / 16 % 3, face / 48 % 6}, 9'000));
    EXPECT_GT(covered(draw(view)), 0U) << frame;
    if (frame % 7 == 0) viewer->surfaceAt(view, 30.0, 20.0);
    expectWithinBudget("frame " + std::to_string(frame));
  }
  EXPECT_LE(base::gl::peakHeldBytes() - outside_.total(), kMinMemory) << "nor in between, while arrays grow";
  EXPECT_GE(most_, kMinMemory / 2) << "the test must come near the budget to say anything";
  EXPECT_GT(viewer->stats().lumigraph.samples_used, 0U);
  EXPECT_EQ(viewer->stats().broken, 0U) << viewer->stats().last_fault;
}

TEST_F(ViewerBudget, drawsCoarserBeyondTheBudgetAndReportsIt) {
  openSmall(40'000'000, 0.0F);
  receiveAllGroups();
  settle(server.lookDown(200.0));
  expectWithinBudget("far");
  const ViewerStats far = viewer->stats();
  EXPECT_GT(far.error_px, 0.0F);
  EXPECT_EQ(far.tolerance_px, far.error_px);
  EXPECT_EQ(far.accuracy, Accuracy::kCoarse);

  // Close to the surface less is in view, so all of it fits.
  settle(server.lookDown(8.0));
  expectWithinBudget("near");
  EXPECT_EQ(viewer->stats().error_px, 0.0F);
  EXPECT_EQ(viewer->stats().tolerance_px, 0.0F);
}

TEST_F(ViewerBudget, atTheLimitNothingFlickers) {
  openSmall();
  receiveAllGroups();
  for (std::uint32_t i = 0; i < 96; ++i) receive(server.sayFace({i % 4, i / 4 % 4, i / 16 % 3, 4 + i / 48}, 9'000));
  const base::ViewCamera view = server.lookDown(150.0);
  const base::Image there = settle(view);
  for (int i = 0; i < 5; ++i) EXPECT_EQ(draw(view).pixels, there.pixels) << i;
  EXPECT_FALSE(viewer->stats().busy);

  // Going away and coming back gives the same cut.
  const ViewerStats before = viewer->stats();
  settle(server.lookDown(12.0));
  settle(view);
  EXPECT_EQ(viewer->stats().lumigraph.triangles, before.lumigraph.triangles);
  EXPECT_EQ(viewer->stats().error_px, before.error_px);
}

TEST_F(ViewerBudget, theServerIsAskedForNoMoreThanFits) {
  openSmall();
  draw(server.lookDown(50.0));
  const auto views = only<protocol::View>(sent(viewer->session()));
  ASSERT_FALSE(views.empty());
  EXPECT_LT(views[0].max_triangles, 100'000U);
}

TEST_F(ViewerBudget, anExactFrameLargerThanItsShareIsLeftOutForGood) {
  server.welcome.can_render_frames = true;
  openSmall();
  receive(server.sayGroup(0));
  base::ViewCamera view = server.lookDown(20.0);
  draw(view);
  sent(viewer->session());
  protocol::Frame frame{1, view, true, base::Bytes(100, 0x5A)};
  frame.camera.width = 2000;
  frame.camera.height = 1500;
  receive(protocol::encode(protocol::ServerMessage(frame)));
  settle(view);
  expectWithinBudget("with the frame");
  EXPECT_NE(viewer->stats().accuracy, Accuracy::kExact);
  EXPECT_TRUE(viewer->session().complete() || viewer->stats().session.frames_received == 1);
}

TEST_F(ViewerBudget, littleMemoryAsksForNoLargerFrames) {
  for (const std::uint64_t budget : {kMinMemory, std::uint64_t{1'000'000'000}}) {
    ViewerOptions options;
    options.memory_budget_bytes = budget;
    Viewer asking(options, makeDecoder());
    asking.session().connected();
    const auto hellos = only<protocol::Hello>(sent(asking.session()));
    ASSERT_EQ(hellos.size(), 1U);
    if (budget == kMinMemory)
      EXPECT_LT(hellos[0].frame_pixels, 640U * 360U);
    else
      EXPECT_GE(hellos[0].frame_pixels, 1920U * 1080U);
  }
}

/// Faces have 256 × 256 pixels, and frames so many times 64 and 48 as their first byte says.
class ScaledDecoder : public ImageDecoder {
 public:
  void submit(std::uint64_t id, base::ByteView coded) override {
    const bool frame = id >> 63U != 0;
    done_.push_back({id, PatternDecoder::pattern(id, frame ? 64 * coded[0] : 256, frame ? 48 * coded[0] : 256), {}});
  }
  std::vector<DecodedImage> takeDecoded() override { return std::exchange(done_, {}); }
  std::size_t pending() const override { return done_.size(); }

 private:
  std::vector<DecodedImage> done_;
};

class FramesOfSizes : public ViewerBudget {
 protected:
  std::unique_ptr<ImageDecoder> makeDecoder() override { return std::make_unique<ScaledDecoder>(); }
  void openWithFrames() {
    server.welcome.can_render_frames = true;
    openSmall();
    receive(server.sayGroup(0));
    for (std::uint32_t i = 0; i < 8; ++i) receive(server.sayFace({i % 4, i / 4, 2, 4}, 9'000));
  }
  /// Draws the view and then, with a frame of it of so many times its size, once more.
  void showWithFrame(const base::ViewCamera& view, int scale, bool last = false) {
    draw(view);
    sent(viewer->session());
    protocol::Frame frame{1, view, last, base::Bytes(100, static_cast<std::uint8_t>(scale))};
    frame.camera.width = scale * view.width;
    frame.camera.height = scale * view.height;
    receive(protocol::encode(protocol::ServerMessage(frame)));
    settle(view);
    expectWithinBudget("with a frame");
  }
};

// A window that had two other sizes before.
TEST_F(FramesOfSizes, thoseOfOtherSizesGiveWayToTheViewsOwn) {
  openWithFrames();
  for (const int scale : {2, 3}) showWithFrame(server.lookDown(30.0), scale);
  showWithFrame(server.lookDown(20.0), 1, true);
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kExact);
}

TEST_F(FramesOfSizes, thoseOfAnEarlierSizeOfTheWindowGiveWayToAMovingEyes) {
  openWithFrames();
  showWithFrame(server.lookDown(30.0), 2);
  showWithFrame(server.lookDown(30.2), 1);
  const ViewerStats before = viewer->stats();
  showWithFrame(server.lookDown(30.4), 4);
  EXPECT_EQ(viewer->stats().lumigraph.samples_resident, before.lumigraph.samples_resident) << "one came, one went";
  EXPECT_GT(viewer->stats().memory.textures, before.memory.textures) << "the new one is larger";
  showWithFrame(server.lookDown(30.6), 1, true);
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kExact);
}

/// Takes images and never finishes one.
class EndlessDecoder : public ImageDecoder {
 public:
  void submit(std::uint64_t, base::ByteView) override { ++pending_; }
  std::vector<DecodedImage> takeDecoded() override { return {}; }
  std::size_t pending() const override { return pending_; }

 private:
  std::size_t pending_ = 0;
};

class ViewerDecoding : public ViewerFixture {
 protected:
  std::unique_ptr<ImageDecoder> makeDecoder() override {
    auto decoder = std::make_unique<EndlessDecoder>();
    decoder_ = decoder.get();
    return decoder;
  }
  /// Returns the images handed to the decoder when 96 faces of this size have arrived.
  std::size_t handedOver(std::uint32_t face_size) {
    server.welcome.grid.face_size = face_size;
    open({});
    receive(server.sayGroup(0));
    for (std::uint32_t i = 0; i < 96; ++i) receive(server.sayFace({i % 4, i / 4 % 4, i / 16 % 3, 4 + i / 48}, 1'000));
    draw(server.lookDown(150.0));
    return decoder_->pending();
  }
  EndlessDecoder* decoder_ = nullptr;
};

TEST_F(ViewerDecoding, imagesAreHandedToTheDecoderByTheirPixels) {
  EXPECT_EQ(handedOver(1024), 16U);
  EXPECT_EQ(handedOver(512), 16U);
  EXPECT_EQ(handedOver(256), 64U);
  EXPECT_EQ(handedOver(64), 96U) << "all";
}

}  // namespace
}  // namespace client
