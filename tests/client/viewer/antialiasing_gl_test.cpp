// Tests how many samples a pixel pictures have: a view at rest gets four, a moving one what the machine affords, which
// is one here, where the GL is software.
#include "tests/client/viewer/viewer_fixture.h"

namespace client {
namespace {

class Antialiasing : public ViewerFixture {
 protected:
  static ViewerOptions patches(int samples = 4) {
    ViewerOptions options;
    options.method = Method::kPatches;
    options.samples = samples;
    options.session.setPatchTolerance(100.0F);
    return options;
  }
  /// Opens the viewer with the whole model, which lies in the middle of view().
  void start(const ViewerOptions& options, float fade_seconds = 0.25F) {
    open(options, fade_seconds);
    draw(view());
    receiveAllGroups();
    completeView();
  }
  /// The server says that the newest view has all that it needs.
  void completeView() {
    const auto views = only<protocol::View>(sent(viewer->session()));
    ASSERT_FALSE(views.empty());
    receive(server.sayComplete(views.back().sequence));
  }
  base::ViewCamera view() const { return server.lookDown(200.0); }
  static std::vector<std::size_t> pixelsInPart(const base::Image& image) {
    std::vector<std::size_t> found;
    for (std::size_t i = 3; i < image.pixels.size(); i += 4)
      if (image.pixels[i] != 0 && image.pixels[i] != 255) found.push_back(i - 3);
    return found;
  }
};

TEST_F(Antialiasing, aViewAtRestHasAveragedEdges) {
  start(patches());
  const base::Image image = settle(view());
  EXPECT_EQ(viewer->stats().samples_per_pixel, 4);
  EXPECT_TRUE(viewer->stats().complete);
  EXPECT_FALSE(pixelsInPart(image).empty());
  EXPECT_LT(pixelsInPart(image).size(), covered(image)) << "inside all samples are covered";
}

TEST_F(Antialiasing, withoutItAPixelIsModelOrBackground) {
  start(patches(1));
  EXPECT_TRUE(pixelsInPart(settle(view())).empty());
  EXPECT_EQ(viewer->stats().samples_per_pixel, 1);
  EXPECT_EQ(viewer->stats().memory.renderbuffers, 0U);
}

TEST_F(Antialiasing, aPictureThatIsReadHasTheModelsColourAtItsEdge) {
  start(patches());
  const std::vector<std::size_t> edge = pixelsInPart(settle(view()));
  ASSERT_FALSE(edge.empty());
  const base::Image raw = target.read();
  const base::Image image = readPicture(target, *viewer);
  int darkest = 255;
  for (std::size_t i = 0; i < raw.pixels.size(); i += 4)
    if (raw.pixels[i + 3] == 255) darkest = std::min(darkest, int{raw.pixels[i]});
  for (const std::size_t pixel : edge) {
    EXPECT_GE(int{image.pixels[pixel]} + 8, darkest) << pixel;
    EXPECT_LT(raw.pixels[pixel], image.pixels[pixel]) << "premultiplied";
    EXPECT_EQ(raw.pixels[pixel + 3], image.pixels[pixel + 3]);
  }
}

TEST_F(Antialiasing, whileTheViewMovesSoftwareDrawsOneAndTheLastPictureHasFour) {
  start(patches());
  settle(view());
  for (int i = 0; i < 5; ++i) {
    draw(server.lookDown(190.0 - i));
    EXPECT_EQ(viewer->stats().samples_per_pixel, 1);
  }
  draw(view());
  completeView();
  EXPECT_EQ(viewer->stats().samples_per_pixel, 1);
  EXPECT_TRUE(viewer->stats().busy);
  EXPECT_TRUE(viewer->stats().samples_pending);
  EXPECT_FALSE(viewer->stats().complete);
  draw(view());
  EXPECT_EQ(viewer->stats().samples_per_pixel, 4);
  EXPECT_FALSE(viewer->stats().busy);
  EXPECT_TRUE(viewer->stats().complete);
}

TEST_F(Antialiasing, picturesThatMustBeFinalAtOnceAreDrawnOnce) {
  start(patches(), 0.0F);
  draw(view());
  EXPECT_EQ(viewer->stats().samples_per_pixel, 4);
  EXPECT_TRUE(viewer->stats().complete);
}

TEST_F(Antialiasing, everyPictureHasAllWhereNothingIsToBeAdapted) {
  ViewerOptions options = patches();
  options.adapt_samples = false;
  start(options);
  draw(server.lookDown(190.0));
  EXPECT_EQ(viewer->stats().samples_per_pixel, 4);
  EXPECT_FALSE(viewer->stats().samples_pending);
}

TEST_F(Antialiasing, aPictureHasNoMoreThanTheGlHas) {
  start(patches(256));
  GLint most = 0;
  glGetIntegerv(GL_MAX_SAMPLES, &most);
  settle(view());
  EXPECT_EQ(viewer->stats().samples_per_pixel, most);
  EXPECT_FALSE(viewer->stats().samples_pending);
  EXPECT_EQ(viewer->stats().last_fault, "");
}

TEST_F(Antialiasing, atRestThereAreTwiceAsManyAsInMotion) {
  start(patches(2));
  settle(view());
  EXPECT_EQ(viewer->stats().samples_per_pixel, 4);
  ViewerOptions options = patches(2);
  options.adapt_samples = false;
  start(options);
  settle(view());
  EXPECT_EQ(viewer->stats().samples_per_pixel, 2);
}

TEST_F(Antialiasing, aSmallMemoryHasNoSamples) {
  ViewerOptions options = patches();
  options.memory_budget_bytes = 64'000'000;
  start(options);
  EXPECT_TRUE(pixelsInPart(settle(view())).empty());
  EXPECT_TRUE(viewer->stats().complete);
}

TEST_F(Antialiasing, aLostContextTakesTheSamplesAndANewOneHasThemAgain) {
  start(patches());
  const base::Image before = settle(view());
  EXPECT_EQ(viewer->stats().memory.renderbuffers, base::gl::heldBytes().renderbuffers - 2U * 4U * 64U * 48U)
      << "all but the target's";
  viewer->contextLost();
  EXPECT_EQ(viewer->stats().memory.renderbuffers, 0U);
  target = {};
  context.reset();
  makeContext();
  ASSERT_TRUE(bool(viewer->contextRestored()));
  EXPECT_EQ(settle(view()).pixels, before.pixels);
}

TEST_F(Antialiasing, aFrameShownWholeNeedsNone) {
  server.welcome.can_render_frames = true;
  ViewerOptions options;
  options.session.setPatchTolerance(100.0F);
  open(options, 0.25F);
  draw(server.lookDown(20.0));
  sent(viewer->session());
  receiveAllGroups();
  receive(server.sayFrame(1, 100));
  receive(server.sayComplete(1));
  settle(server.lookDown(20.0));
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kExact);
  EXPECT_EQ(viewer->stats().samples_per_pixel, 1);
  EXPECT_TRUE(viewer->stats().complete);
  viewer->setSection(base::SectionPlane{{0.0, 0.0, 1.0}, server.welcome.origin.z});
  settle(server.lookDown(20.0));
  EXPECT_EQ(viewer->stats().samples_per_pixel, 4) << "the blended picture is shown again";
}

}  // namespace
}  // namespace client
