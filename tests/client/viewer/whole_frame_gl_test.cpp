// Tests that the server's frame of the present view is shown as it is: ScriptedServer's frames show lookDown(20).
#include <cstdlib>

#include "tests/client/viewer/viewer_fixture.h"

namespace client {
namespace {

constexpr int kHole = 16;  ///< columns at the left without a model

/// Frames have a pattern and, at the left, background.
class HoledFrames : public PatternDecoder {
 public:
  using PatternDecoder::PatternDecoder;
  std::vector<DecodedImage> takeDecoded() override {
    std::vector<DecodedImage> decoded = PatternDecoder::takeDecoded();
    for (DecodedImage& image : decoded)
      if (image.id >> 63U != 0) image.rgba = frame(image.id);
    return decoded;
  }
  static base::Image frame(std::uint64_t id) {
    base::Image rgba = pattern(id, 64, 48);
    for (int y = 0; y < rgba.height; ++y) std::fill_n(rgba.at(0, y), 4 * kHole, std::uint8_t{0});
    return rgba;
  }
};

class WholeFrameGl : public ViewerFixture {
 protected:
  std::unique_ptr<ImageDecoder> makeDecoder() override {
    return std::make_unique<HoledFrames>(static_cast<int>(server.welcome.grid.face_size), 64, 48);
  }
  void start(float fade_seconds) {
    server.welcome.can_render_frames = true;
    ViewerOptions options;
    options.session.setPatchTolerance(100.0F);
    open(options, fade_seconds);
    draw(view());
    sent(viewer->session());
  }
  base::ViewCamera view() const { return server.lookDown(20.0); }
  base::Image drawAt(double time) {
    now = time - 0.1;
    return draw(view());
  }
  static base::Image expected(std::uint32_t sequence) {
    return HoledFrames::frame((std::uint64_t{1} << 63U) + sequence);
  }
  /// Returns the mean difference of two pictures' values, 0 … 255.
  static double apart(const base::Image& a, const base::Image& b) {
    double sum = 0.0;
    for (std::size_t i = 0; i < a.pixels.size(); ++i) sum += std::abs(int{a.pixels[i]} - int{b.pixels[i]});
    return sum / static_cast<double>(a.pixels.size());
  }
};

TEST_F(WholeFrameGl, thePictureIsTheFrameToTheByte) {
  start(0.0F);
  receiveAllGroups();
  const base::Image blended = settle(view());
  receive(server.sayFrame(1, 100));
  const base::Image shown = settle(view());
  EXPECT_EQ(shown.pixels, expected(1).pixels);
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kExact);
  EXPECT_GT(viewer->stats().lumigraph.triangles, 0U) << "the model is ready for when the view moves";
  EXPECT_NE(blended.at(4, 24)[3], 0) << "the model is drawn where the frame has background";
  EXPECT_TRUE(viewer->surfaceAt(view(), 32.0, 24.0).has_value());
}

TEST_F(WholeFrameGl, itFillsThePictureWhereTheProxyIsMissing) {
  start(0.0F);
  viewer->setBackground({0.0F, 0.0F, 1.0F, 1.0F});
  receive(server.sayFrame(1, 100));
  const base::Image shown = settle(view());
  base::Image wanted = expected(1);
  for (int y = 0; y < wanted.height; ++y)
    for (int x = 0; x < kHole; ++x) wanted.at(x, y)[2] = wanted.at(x, y)[3] = 255;
  EXPECT_EQ(shown.pixels, wanted.pixels) << "over the background";
}

TEST_F(WholeFrameGl, itComesInSteadily) {
  start(0.25F);
  receiveAllGroups();
  const base::Image blended = settle(view());
  const double from = now + 1.0;
  receive(server.sayFrame(1, 100));
  draw(view());
  double left = apart(blended, expected(1));
  for (int i = 0; i < 12 && viewer->stats().accuracy != Accuracy::kExact; ++i) {
    EXPECT_TRUE(viewer->stats().busy);
    EXPECT_FALSE(viewer->stats().complete);
    const double now_left = apart(drawAt(from + 0.02 * i), expected(1));
    EXPECT_LE(now_left, left + 0.01) << i;
    left = now_left;
  }
  EXPECT_EQ(left, 0.0);
  EXPECT_EQ(settle(view()).pixels, expected(1).pixels);
}

// A page at rest draws no picture until something comes, and may be asked in between.
TEST_F(WholeFrameGl, aViewIsNotCompleteBeforeItsLastFrameIsShown) {
  start(0.0F);
  receiveAllGroups();
  receive(server.sayFrame(1, 100, false));
  receive(server.sayComplete(1));
  settle(view());
  ASSERT_FALSE(viewer->stats().complete) << "the last frame is to come";
  receive(server.sayFrame(1, 100));
  EXPECT_FALSE(viewer->stats().complete) << "it came, and the picture is still the one before";
  EXPECT_EQ(settle(view()).pixels, expected(2).pixels);
  EXPECT_TRUE(viewer->stats().complete);
}

TEST_F(WholeFrameGl, aMovedViewAndASectionShowTheModelAgain) {
  start(0.0F);
  receiveAllGroups();
  receive(server.sayFrame(1, 100));
  settle(view());
  EXPECT_NE(draw(server.lookDown(20.5)).pixels, expected(1).pixels);
  EXPECT_EQ(draw(view()).pixels, expected(1).pixels);
  base::ViewCamera cut = view();
  cut.section = base::SectionPlane{{0.0, 0.0, 1.0}, server.welcome.origin.z + 1e3};
  EXPECT_NE(settle(cut).pixels, expected(1).pixels);
  const auto asked = only<protocol::View>(sent(viewer->session()));
  ASSERT_FALSE(asked.empty());
  EXPECT_EQ(asked.back().camera.section, cut.section) << "the server knows what is cut away";
  receive(encode(protocol::ServerMessage(protocol::Frame{asked.back().sequence, cut, true, base::Bytes(50, 0x5A)})));
  EXPECT_EQ(settle(cut).pixels, expected(2).pixels) << "a frame of this very section is shown";
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kExact);
  EXPECT_EQ(settle(view()).pixels, expected(1).pixels);
  viewer->setResolutionColors(true);
  EXPECT_NE(settle(view()).pixels, expected(1).pixels);
  viewer->setResolutionColors(false);
  viewer->setMethod(Method::kPatches);
  EXPECT_NE(settle(view()).pixels, expected(1).pixels);
}

TEST_F(WholeFrameGl, pinsAreTestedBehindIt) {
  start(0.0F);
  receiveAllGroups();
  receive(server.sayFrame(1, 100));
  draw(view());
  const auto surface = viewer->surfaceAt(view(), 32.0, 24.0);
  ASSERT_TRUE(surface.has_value());
  viewer->setPins({*surface, *surface - glm::dvec3(0.0, 0.0, 5.0)});
  EXPECT_EQ(settle(view()).pixels, expected(1).pixels);
  EXPECT_EQ(viewer->pinsVisible(), (std::vector<bool>{true, false}));
}

}  // namespace
}  // namespace client
