// Tests how many samples and pixels pictures are drawn with: a view at rest gets all, as the mean of eight pictures, a
// moving one what the machine affords, which is one sample here, where the GL is software.
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
  /// Lets motion be so slow that the machine counts as one without a GPU.
  void slowDown() {
    for (int i = 0; i < 40; ++i) {
      draw(server.lookDown(300.0 - i));
      viewer->addFrameTime(1.0);
    }
  }
  base::ViewCamera view() const { return server.lookDown(200.0); }
  /// Sums what pixels are covered, those in part too.
  static double cover(const base::Image& image) {
    double sum = 0.0;
    for (std::size_t i = 3; i < image.pixels.size(); i += 4) sum += image.pixels[i] / 255.0;
    return sum;
  }
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
  EXPECT_EQ(viewer->stats().effort.pictures, 8);
  EXPECT_TRUE(viewer->stats().complete);
  EXPECT_FALSE(pixelsInPart(image).empty());
  EXPECT_LT(pixelsInPart(image).size(), covered(image)) << "inside all samples are covered";
}

TEST_F(Antialiasing, withoutItAPixelIsModelOrBackground) {
  start(patches(1));
  EXPECT_TRUE(pixelsInPart(settle(view())).empty());
  EXPECT_EQ(viewer->stats().effort.samples, 1);
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
    EXPECT_GE(int{image.pixels[pixel]} + 10, darkest) << pixel;
    EXPECT_LT(raw.pixels[pixel], image.pixels[pixel]) << "premultiplied";
    EXPECT_EQ(raw.pixels[pixel + 3], image.pixels[pixel + 3]);
  }
}

TEST_F(Antialiasing, whileTheViewMovesThereAreFewerSamplesAndTheLastPictureHasEight) {
  const int moving = base::gl::drawsInSoftware() ? 1 : 4;
  start(patches());
  settle(view());
  for (int i = 0; i < 5; ++i) {
    draw(server.lookDown(190.0 - i));
    EXPECT_EQ(viewer->stats().effort.samples, moving);
  }
  draw(view());
  completeView();
  EXPECT_EQ(viewer->stats().effort.samples, moving);
  EXPECT_TRUE(viewer->stats().busy);
  EXPECT_TRUE(viewer->stats().effort_pending);
  EXPECT_FALSE(viewer->stats().complete);
  draw(view());
  EXPECT_EQ(viewer->stats().effort.pictures, 8);
  EXPECT_FALSE(viewer->stats().busy);
  EXPECT_TRUE(viewer->stats().complete);
}

TEST_F(Antialiasing, aSlowMachineDrawsTheMeanPictureByPicture) {
  start(patches());
  slowDown();
  base::ViewCamera resting = server.lookDown(180.0);
  draw(resting);
  completeView();
  for (int i = 0; i < 100 && viewer->stats().effort.pictures == 1; ++i) draw(resting);
  for (int pictures = 2; pictures <= 8; ++pictures) {
    EXPECT_EQ(viewer->stats().effort.pictures, pictures);
    EXPECT_EQ(viewer->stats().effort_pending, pictures < 8);
    EXPECT_EQ(viewer->stats().complete, pictures == 8);
    draw(resting);
  }
  EXPECT_EQ(viewer->stats().effort.pictures, 8) << "there are no more";
  const base::Image one_by_one = target.read();
  ViewerOptions options = patches();
  options.effort = DrawEffort{.pictures = 8};
  start(options);
  draw(resting);
  EXPECT_EQ(target.read().pixels, one_by_one.pixels);
  resting.section = base::SectionPlane{{0.0, 0.0, 1.0}, server.welcome.origin.z};
  draw(resting);
  EXPECT_NE(target.read().pixels, one_by_one.pixels) << "a mean of before the cut is not shown";
}

TEST_F(Antialiasing, aMeanHasNoPictureInWhichAnImageWasStillFadingIn) {
  ViewerOptions options;
  options.session.setPatchTolerance(0.5F);
  options.lumigraph.tuning.shade_weight = 0.0F;  // the images alone, however far from the model's colours
  options.lumigraph.tuning.outlier = options.lumigraph.tuning.lit_outlier = 1e6F;
  const base::ViewCamera near = server.lookDown(30.0);
  const auto begin = [&] {
    start(options);
    draw(near);
    completeView();
    receive(server.sayFace({1, 1, 2, 5}, 500));
    return settle(near);
  };
  const base::Image without = begin();
  receive(server.sayFace({2, 2, 2, 5}, 500));
  const base::Image late = settle(near);
  EXPECT_NE(without.pixels, late.pixels) << "it must show";
  options.effort = DrawEffort{.pictures = 8};
  begin();
  receive(server.sayFace({2, 2, 2, 5}, 500));
  for (int i = 0; i < 20; ++i) draw(near);
  EXPECT_EQ(target.read().pixels, late.pixels);
}

TEST_F(Antialiasing, aViewAtRestIsRefinedAndItsPictureStaysUntilTheFinerOneIsWhole) {
  ViewerOptions options;
  options.session.patch_tolerance_px = 100.0F;
  options.session.alone_tolerance_px = 0.01F;
  const base::ViewCamera near = server.lookDown(30.0);
  open(options, 0.25F);
  draw(near);
  receive(server.sayGroup(0));
  receive(server.sayFace({1, 1, 2, 5}, 500));
  ASSERT_EQ(only<protocol::View>(sent(viewer->session())).size(), 1U);
  receive(server.sayComplete(1));
  base::Image coarse;
  for (int i = 0; i < 100 && !viewer->session().refined(); ++i) coarse = draw(near);
  ASSERT_TRUE(viewer->session().refined());
  EXPECT_FALSE(viewer->stats().complete);
  for (int i = 0; i < 20; ++i) coarse = draw(near);
  EXPECT_EQ(viewer->stats().effort.pictures, 8) << "finer patches are still on their way";
  const auto views = only<protocol::View>(sent(viewer->session()));
  ASSERT_EQ(views.size(), 1U);
  EXPECT_EQ(views[0].measure, base::ErrorMeasure::kVisible);
  const std::uint64_t triangles = viewer->stats().lumigraph.triangles;

  receiveAllGroups();
  receive(server.sayComplete(2));
  base::Image last = coarse;
  int changes = 0;
  for (int i = 0; i < 100 && (i == 0 || viewer->stats().busy); ++i) {
    const base::Image next = draw(near);
    changes += next.pixels != last.pixels ? 1 : 0;
    EXPECT_EQ(viewer->stats().effort.pictures, 8);
    last = next;
  }
  EXPECT_EQ(changes, 1) << "there is no picture in between";
  EXPECT_NE(last.pixels, coarse.pixels);
  EXPECT_TRUE(viewer->stats().complete);
  EXPECT_GT(viewer->stats().lumigraph.triangles, triangles);
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kBlended);
  options.effort = DrawEffort{.pictures = 8};
  open(options);
  draw(near);
  receiveAllGroups();
  receive(server.sayFace({1, 1, 2, 5}, 500));
  completeView();
  draw(near);
  ASSERT_TRUE(viewer->session().refined()) << "at once, where a picture is to be final";
  completeView();
  EXPECT_EQ(settle(near).pixels, last.pixels);
}

TEST_F(Antialiasing, aFrameOverAKeptPictureIsTheLastPicture) {
  server.welcome.can_render_frames = true;
  ViewerOptions options;
  options.session.setPatchTolerance(0.5F);
  const base::ViewCamera near = server.lookDown(20.0);
  open(options, 0.25F);
  draw(near);
  sent(viewer->session());
  receiveAllGroups();
  slowDown();
  draw(near);
  const auto views = only<protocol::View>(sent(viewer->session()));
  ASSERT_FALSE(views.empty());
  receive(server.sayFrame(views.back().sequence, 100));
  receive(server.sayComplete(views.back().sequence));
  settle(near);
  viewer->setResolutionColors(true);  // no frame is shown
  settle(near);
  ASSERT_EQ(viewer->stats().effort.pictures, 8);
  receive(server.sayFace({1, 1, 2, 5}, 500));
  for (int i = 0; i < 20 && viewer->stats().complete; ++i) draw(near);
  ASSERT_FALSE(viewer->stats().complete) << "the image is to be shown, too";
  viewer->setResolutionColors(false);
  settle(near);
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kExact);
  EXPECT_TRUE(viewer->stats().complete);
}

TEST_F(Antialiasing, picturesThatMustBeFinalAtOnceAreDrawnOnce) {
  start(patches(), 0.0F);
  draw(view());
  EXPECT_EQ(viewer->stats().effort.pictures, 8);
  EXPECT_TRUE(viewer->stats().complete);
}

TEST_F(Antialiasing, everyPictureHasAllWhereNothingIsToBeAdapted) {
  ViewerOptions options = patches();
  options.effort = DrawEffort{.samples = 4};
  start(options);
  draw(server.lookDown(190.0));
  EXPECT_EQ(viewer->stats().effort.samples, 4);
  EXPECT_FALSE(viewer->stats().effort_pending);
}

TEST_F(Antialiasing, theMeanOfPicturesIsNearerToManySamplesThanThoseOfTheGl) {
  const auto rowsOf = [this](const DrawEffort& effort, int size) {
    ViewerOptions options = patches();
    options.effort = effort;
    start(options);
    base::ViewCamera large = view();
    large.width *= size, large.height *= size;
    auto made = base::gl::RenderTarget::create(large.width, large.height);
    EXPECT_TRUE(bool(made));
    target = std::move(*made);
    draw(large);
    return target.read();
  };
  const base::Image truth = rowsOf({.samples = 1}, 16);
  const auto offTruth = [&](const base::Image& image) {
    double sum = 0.0;
    for (int y = 0; y < image.height; ++y)
      for (int x = 0; x < image.width; ++x) {
        double mean = 0.0;
        for (int i = 0; i < 256; ++i) mean += truth.at(16 * x + i % 16, 16 * y + i / 16)[3] / 256.0;
        sum += std::abs(mean - image.at(x, y)[3]);
      }
    return sum;
  };
  const double one = offTruth(rowsOf({.samples = 1}, 1));
  const double gl = offTruth(rowsOf({.samples = 4}, 1));
  const double mean = offTruth(rowsOf({.pictures = 8}, 1));
  EXPECT_LT(gl, 0.7 * one);
  EXPECT_LT(mean, 0.7 * gl);
}

TEST_F(Antialiasing, aPictureHasNoMoreThanTheGlHas) {
  ViewerOptions options = patches();
  options.effort = DrawEffort{.samples = 256};
  start(options);
  GLint most = 0;
  glGetIntegerv(GL_MAX_SAMPLES, &most);
  settle(view());
  EXPECT_EQ(viewer->stats().effort.samples, most);
  EXPECT_FALSE(viewer->stats().effort_pending);
  EXPECT_EQ(viewer->stats().last_fault, "");
}

TEST_F(Antialiasing, atRestThereAreTwiceAsManyAsInMotion) {
  start(patches(2));
  settle(view());
  EXPECT_EQ(viewer->stats().effort.pictures, 4);
  ViewerOptions options = patches(2);
  options.effort = DrawEffort{.samples = 2};
  start(options);
  settle(view());
  EXPECT_EQ(viewer->stats().effort.samples, 2);
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

TEST_F(Antialiasing, aViewThatMovesTooSlowlyIsDrawnWithFewerPixelsAndSharpAgainAtRest) {
  start(patches());
  const base::Image sharp = settle(view());
  for (int i = 0; i < 8; ++i) {
    draw(server.lookDown(190.0 - i));
    viewer->addFrameTime(0.045);
  }
  const base::Image moving = draw(server.lookDown(199.0));
  EXPECT_LT(viewer->stats().effort.scale, 0.8F);
  EXPECT_NEAR(cover(moving), cover(sharp), 0.25 * cover(sharp)) << "it fills the same part of the target";
  EXPECT_LE(viewer->stats().memory.renderbuffers, 8U * 64U * 48U);
  draw(view());
  completeView();
  EXPECT_LT(viewer->stats().effort.scale, 0.8F) << "of the last picture that moved";
  EXPECT_TRUE(viewer->stats().effort_pending);
  EXPECT_FALSE(viewer->stats().complete);
  EXPECT_EQ(settle(view()).pixels, sharp.pixels);
  EXPECT_EQ(viewer->stats().effort.scale, 1.0F);
  EXPECT_TRUE(viewer->stats().complete);
}

TEST_F(Antialiasing, aViewThatRestsWhileDataComeIsDrawnWithAllPixels) {
  start(patches());
  for (int i = 0; i < 12; ++i) {
    draw(server.lookDown(190.0 - i));
    viewer->addFrameTime(0.045);
  }
  draw(view());
  ASSERT_LT(viewer->stats().effort.scale, 0.8F);
  now += 1.0;
  EXPECT_TRUE(viewer->stats().effort_pending) << "though the server has not said that the view is complete";
  draw(view());
  EXPECT_EQ(viewer->stats().effort.scale, 1.0F);
  EXPECT_FALSE(viewer->stats().complete);
}

TEST_F(Antialiasing, aSmallMemorysMovingViewHasFewerPixelsTooAsManyAsFit) {
  ViewerOptions options = patches();
  options.memory_budget_bytes = kMinMemory;
  start(options);
  base::ViewCamera large = view();
  large.width = large.height = 1000;
  auto made = base::gl::RenderTarget::create(large.width, large.height);
  ASSERT_TRUE(bool(made));
  target = std::move(*made);
  for (int i = 0; i < 12; ++i) {
    large.position.z += 1.0;
    draw(large);
    EXPECT_EQ(viewer->stats().effort.samples, 1) << "there is no room for more";
    viewer->addFrameTime(1.0);
    EXPECT_LE(viewer->stats().memory.total(), kMinMemory);
  }
  EXPECT_LT(viewer->stats().effort.scale, 0.5F);
  EXPECT_GT(viewer->stats().effort.scale, 0.3F);
}

TEST_F(Antialiasing, withoutARateAMovingViewHasAllPixels) {
  ViewerOptions options = patches();
  options.fps = 0.0;
  start(options);
  for (int i = 0; i < 12; ++i) {
    draw(server.lookDown(190.0 - i));
    viewer->addFrameTime(1.0);
    EXPECT_EQ(viewer->stats().effort.scale, 1.0F);
  }
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
  EXPECT_EQ(viewer->stats().effort.pictures, 1);
  EXPECT_TRUE(viewer->stats().complete);
  viewer->setResolutionColors(true);
  settle(server.lookDown(20.0));
  EXPECT_EQ(viewer->stats().effort.pictures, 8) << "the blended picture is shown again";
}

}  // namespace
}  // namespace client
