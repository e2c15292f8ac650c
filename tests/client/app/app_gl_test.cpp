// Tests the App with pictures: what is drawn, and when nothing is.
#include <gtest/gtest.h>

#include "base/egl/headless.h"
#include "client/app/app.h"
#include "client/native/native_decoder.h"
#include "tests/client/source/scripted_server.h"

namespace client {
namespace {

constexpr int kWidth = 160;
constexpr int kHeight = 120;

class AppGl : public ::testing::Test {
 protected:
  void SetUp() override {
    auto made = base::HeadlessContext::create();
    ASSERT_TRUE(bool(made)) << made.error().message;
    context = std::move(*made);
    auto target_made = base::gl::RenderTarget::create(kWidth, kHeight);
    ASSERT_TRUE(bool(target_made));
    target = std::move(*target_made);
    AppOptions options;
    options.settings.patch_tolerance = options.settings.alone_tolerance = 0.0;
    options.settings.fps = 0.0;  // these frames come 20 times a second, whatever the machine can do
    options.viewer.lumigraph.fade_seconds = 0.0F;
    app = std::make_unique<App>(options, std::make_unique<NativeDecoder>(1));
    app->resize(kWidth, kHeight, 1.0);
    app->session().connected();
    receive(server.sayWelcome());
    for (std::uint32_t g = 0; g < server.hierarchy().groups.size(); ++g) receive(server.sayGroup(g));
    settle();
  }
  void receive(const base::Bytes& message) { ASSERT_TRUE(bool(app->session().receive(message))); }
  /// Runs a platform's loop until nothing more is drawn; returns the number of frames.
  int settle() {
    int frames = 0;
    for (int i = 0; i < 200; ++i) {
      app->advance(now += 0.05);
      if (!app->wantsFrame()) continue;
      target.bind();
      EXPECT_TRUE(bool(app->drawFrame(now)));
      ++frames;
    }
    return frames;
  }
  base::Image picture() {
    settle();
    return target.read();
  }
  static std::size_t covered(const base::Image& image) {
    std::size_t count = 0;
    for (std::size_t i = 3; i < image.pixels.size(); i += 4) count += image.pixels[i] != 0 ? 1 : 0;
    return count;
  }
  /// A pixel in the midst of those that show the model.
  glm::dvec2 onModel() {
    const base::Image image = picture();
    glm::dvec2 sum(0.0);
    for (int y = 0; y < kHeight; ++y)
      for (int x = 0; x < kWidth; ++x)
        if (image.pixels[static_cast<std::size_t>(4 * (y * kWidth + x) + 3)] != 0) sum += glm::dvec2(x, y);
    return glm::floor(sum / static_cast<double>(covered(image))) + 0.5;
  }
  void press(Key key, Modifiers modifiers = {}) {
    app->handleKey(key, true, modifiers, now);
    app->handleKey(key, false, modifiers, now);
  }

  ScriptedServer server;
  std::unique_ptr<base::HeadlessContext> context;
  base::gl::RenderTarget target;
  std::unique_ptr<App> app;
  double now = 0.0;
};

TEST_F(AppGl, atRestNothingIsDrawn) {
  EXPECT_GT(covered(picture()), 100U);
  EXPECT_EQ(settle(), 0);
  sent(app->session());
  receive(server.sayComplete(1));
  EXPECT_EQ(settle(), 1) << "news from the server is looked at once";
  EXPECT_EQ(settle(), 0);
}

TEST_F(AppGl, everyModeIsDrawnWithoutAnErrorOfGl) {
  for (const Key key : {Key::kI, Key::kC, Key::kO, Key::kX, Key::kX, Key::kX, Key::kX, Key::kO, Key::kC, Key::kM,
                        Key::kM, Key::kM, Key::kF, Key::kR, Key::kH, Key::kEscape}) {
    press(key);
    EXPECT_GT(covered(picture()), 100U) << static_cast<int>(key);
    EXPECT_EQ(base::gl::takeError(), "") << static_cast<int>(key);
  }
}

TEST_F(AppGl, modesThatChangeThePictureDo) {
  for (const Key key : {Key::kC, Key::kO, Key::kX}) {
    const base::Image before = picture();
    press(key);
    const base::Image in_mode = picture();
    EXPECT_NE(in_mode.pixels, before.pixels) << static_cast<int>(key);
    if (key == Key::kX)
      press(Key::kEscape);
    else
      press(key);
    EXPECT_EQ(picture().pixels, before.pixels) << static_cast<int>(key);
  }
}

TEST_F(AppGl, aLostContextComesBackWithTheSamePicture) {
  const base::Image before = picture();
  app->contextLost();
  settle();
  ASSERT_TRUE(bool(app->contextRestored()));
  EXPECT_TRUE(app->wantsFrame());
  EXPECT_EQ(picture().pixels, before.pixels);
}

TEST_F(AppGl, anOrthographicClickIsWhereItIsSeen) {
  press(Key::kO);
  const glm::dvec2 at = onModel() + glm::dvec2(0.05 * kWidth, 0.0);
  const auto surface = app->viewer().surfaceAt(app->camera(), at.x, at.y);
  ASSERT_TRUE(surface.has_value());
  Annotation note;
  note.title = "here";
  note.position = *surface;
  app->setAnnotations({note});
  settle();
  EXPECT_NEAR(app->labels()[0].x, at.x, 0.01);
  EXPECT_NEAR(app->labels()[0].y, at.y, 0.01);
  EXPECT_TRUE(app->labels()[0].visible);
}

TEST_F(AppGl, measuringTakesThePointThatIsDrawnUnderTheClick) {
  press(Key::kM);
  PointerEvent event;
  const glm::dvec2 at = onModel();
  event.x = at.x;
  event.y = at.y;
  event.now = now;
  app->pointerDown(event);
  app->pointerUp(event);
  settle();
  ASSERT_EQ(app->measurements().size(), 1U);
  const MeasuredPoint& point = app->measurements()[0].points[0];
  EXPECT_GT(point.accuracy, 0.0);
  std::size_t found = 0;
  for (const Label& label : app->labels()) {
    if (label.kind != LabelKind::kPoint) continue;
    ++found;
    EXPECT_NEAR(label.x, event.x, 0.01);
    EXPECT_NEAR(label.y, event.y, 0.01);
  }
  EXPECT_EQ(found, 1U);
  EXPECT_EQ(app->takeRequests().back().kind, RequestKind::kPick);
}

TEST_F(AppGl, aPinBehindTheSurfaceIsHidden) {
  const glm::dvec3 eye = app->view().position;
  const glm::dvec2 at = onModel();
  const auto surface = app->viewer().surfaceAt(app->camera(), at.x, at.y);
  ASSERT_TRUE(surface.has_value());
  Annotation before;
  before.title = "before";
  before.position = *surface + 0.05 * (eye - *surface);
  Annotation behind;
  behind.title = "behind";
  behind.position = *surface - 0.2 * (eye - *surface);
  app->setAnnotations({before, behind});
  settle();
  ASSERT_EQ(app->labels().size(), 2U);
  EXPECT_TRUE(app->labels()[0].visible);
  EXPECT_FALSE(app->labels()[1].visible);
}

TEST_F(AppGl, theStatisticsAreThoseOfThePicture) {
  picture();
  const ViewerStats stats = app->statistics().viewer;
  EXPECT_EQ(stats.accuracy, Accuracy::kCoarse);
  EXPECT_GT(stats.lumigraph.triangles, 0U);
  EXPECT_GT(stats.lumigraph.patches, 0U);
  EXPECT_GT(stats.memory.gpu(), 0U);
  EXPECT_GT(stats.memory.total(), 0U);
  EXPECT_EQ(stats.session.bytes_received, app->session().stats().bytes_received);
}

TEST_F(AppGl, aLinkShowsTheSamePictureAgain) {
  app->handleKey(Key::kLeft, true, {false, true, false}, now);
  for (int i = 0; i < 10; ++i) app->advance(now += 0.05);
  app->handleKey(Key::kLeft, false, {}, now);
  const base::Image there = picture();
  const std::string link = app->permalink();
  press(Key::kR);
  EXPECT_NE(picture().pixels, there.pixels);
  ASSERT_TRUE(bool(app->openPermalink(link)));
  EXPECT_EQ(app->permalink(), link);
  const base::Image again = picture();
  std::size_t different = 0;
  for (std::size_t i = 0; i < there.pixels.size(); ++i) different += there.pixels[i] != again.pixels[i] ? 1 : 0;
  EXPECT_LE(different, there.pixels.size() / 1000);
}

}  // namespace
}  // namespace client
