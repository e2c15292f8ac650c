#include "client/viewer/viewer.h"

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <thread>

#include "base/egl/headless.h"
#include "client/native/native_decoder.h"
#include "tests/client/source/scripted_server.h"

namespace client {
namespace {

class ViewerGl : public ::testing::Test {
 protected:
  void SetUp() override {
    auto made = base::HeadlessContext::create();
    ASSERT_TRUE(bool(made)) << made.error().message;
    context = std::move(*made);
    auto target_made = base::gl::RenderTarget::create(64, 48);
    ASSERT_TRUE(bool(target_made));
    target = std::move(*target_made);
  }
  void open(ViewerOptions options, double upload_milliseconds = 0.0) {
    options.lumigraph.fade_seconds = 0.0F;
    options.upload_milliseconds = upload_milliseconds;
    options.session.setPatchTolerance(0.0F);
    viewer = std::make_unique<Viewer>(options, std::make_unique<NativeDecoder>(1));
    viewer->session().connected();
    receive(server.sayWelcome());
  }
  void receive(const base::Bytes& message) {
    auto taken = viewer->session().receive(message);
    EXPECT_TRUE(bool(taken)) << taken.error().message;
  }
  base::Image draw(const base::ViewCamera& camera) {
    target.bind();
    auto drawn = viewer->draw(camera, 0.0);
    EXPECT_TRUE(bool(drawn)) << drawn.error().message;
    return target.read();
  }
  static std::size_t covered(const base::Image& image) {
    std::size_t count = 0;
    for (std::size_t i = 3; i < image.pixels.size(); i += 4) count += image.pixels[i] != 0 ? 1 : 0;
    return count;
  }
  static ViewerOptions patches() {
    ViewerOptions options;
    options.method = Method::kPatches;
    return options;
  }

  ScriptedServer server;
  std::unique_ptr<base::HeadlessContext> context;
  base::gl::RenderTarget target;
  std::unique_ptr<Viewer> viewer;
};

TEST_F(ViewerGl, beforeAnythingArrivesThePictureIsBackground) {
  open(patches());
  EXPECT_EQ(covered(draw(server.lookDown(20.0))), 0U);
  EXPECT_FALSE(viewer->stats().complete);
}

TEST_F(ViewerGl, everyGroupThatArrivesMakesThePictureFiner) {
  open(patches());
  std::uint64_t triangles = 0;
  const auto view = server.lookDown(40.0);
  for (std::uint32_t g = 0; g < server.hierarchy().groups.size(); ++g) {
    receive(server.sayGroup(g));
    EXPECT_GT(covered(draw(view)), 0U) << "after group " << g;
    EXPECT_GE(viewer->stats().lumigraph.triangles, triangles) << "after group " << g;
    triangles = viewer->stats().lumigraph.triangles;
  }
  EXPECT_EQ(viewer->stats().error_px, 0.0F);
  EXPECT_EQ(viewer->stats().broken, 0U);
}

TEST_F(ViewerGl, aViewIsCompleteOnlyWhenAllIsDecodedAndDrawn) {
  open(patches());
  const auto view = server.lookDown(40.0);
  draw(view);
  sent(viewer->session());
  receive(server.sayGroup(0));
  receive(server.sayComplete(1));
  EXPECT_TRUE(viewer->session().complete());
  for (int i = 0; i < 50 && !viewer->stats().complete; ++i) draw(view);
  EXPECT_TRUE(viewer->stats().complete);
  draw(server.lookDown(41.0));
  EXPECT_FALSE(viewer->stats().complete);
}

TEST_F(ViewerGl, aSmallUploadShareSpreadsTheWorkOverFrames) {
  open(patches(), 1e-6);  // 2 bytes, so one group a frame
  for (std::uint32_t g = 0; g < 4; ++g) receive(server.sayGroup(g));
  const auto view = server.lookDown(40.0);
  auto more = viewer->update(view, 0.0);
  ASSERT_TRUE(bool(more));
  EXPECT_TRUE(*more);
  for (int i = 0; i < 4; ++i) more = viewer->update(view, 0.0);
  EXPECT_FALSE(*more);
}

TEST_F(ViewerGl, aBrokenGroupIsCountedAndLeftOut) {
  open(patches());
  receive(server.sayGroup(0));
  protocol::Refinement refine = server.refine(1);
  refine.block[refine.block.size() / 2] ^= 0xFFU;
  receive(protocol::encode(protocol::ServerMessage(refine)));
  EXPECT_GT(covered(draw(server.lookDown(40.0))), 0U) << "the coarser form is drawn";
  EXPECT_EQ(viewer->stats().broken, 1U);
  EXPECT_FALSE(viewer->stats().last_fault.empty());
}

TEST_F(ViewerGl, brokenImagesAreCountedAndThePictureStays) {
  ViewerOptions options;
  open(options);
  receive(server.sayGroup(0));
  receive(server.sayFace({1, 1, 1, 5}, 100));
  const auto view = server.lookDown(40.0);
  base::Image image;
  for (int i = 0; i < 2000 && viewer->stats().broken == 0; ++i) {
    image = draw(view);
    if (viewer->stats().broken == 0) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  EXPECT_EQ(viewer->stats().broken, 1U);
  EXPECT_GT(covered(image), 0U);
}

TEST_F(ViewerGl, anotherSceneAfterAReconnectStartsFromNothing) {
  open(patches());
  receive(server.sayGroup(0));
  const auto view = server.lookDown(40.0);
  EXPECT_GT(covered(draw(view)), 0U);
  viewer->session().disconnected("gone");
  EXPECT_GT(covered(draw(view)), 0U) << "what is here is shown without a server";

  ScriptedServer other;
  other.welcome.scene_name = "another";
  viewer->session().connected();
  receive(other.sayWelcome());
  EXPECT_EQ(covered(draw(view)), 0U);
  receive(other.sayGroup(0));
  EXPECT_GT(covered(draw(view)), 0U);
}

TEST_F(ViewerGl, aGroupThatIsEvictedLeavesAPictureThatStillCovers) {
  ViewerOptions options = patches();
  options.session.cache_bytes = 6'000;
  open(options);
  const auto view = server.lookDown(40.0);
  receive(server.sayGroup(0));
  const std::size_t whole = covered(draw(view));
  for (std::uint32_t g = 1; g < server.hierarchy().groups.size(); ++g) {
    receive(server.sayGroup(g));
    // The bumps move the silhouette by a pixel in places.
    EXPECT_NEAR(static_cast<double>(covered(draw(view))), static_cast<double>(whole),
                0.05 * static_cast<double>(whole));
  }
  EXPECT_LE(viewer->stats().session.cache_bytes, 6'000U);
}

TEST_F(ViewerGl, theSurfaceUnderThePixelIsFoundInWorldCoordinates) {
  open(patches());
  receive(server.sayGroup(0));
  const auto view = server.lookDown(20.0);
  draw(view);
  const auto middle = viewer->surfaceAt(view, 32.0, 24.0);
  ASSERT_TRUE(middle.has_value());
  EXPECT_NEAR(middle->x, view.position.x, 1e-3);
  EXPECT_NEAR(middle->y, view.position.y, 1e-3);
  EXPECT_GT(middle->z, server.welcome.origin.z + static_cast<double>(server.welcome.box_min.z) - 1e-3);
  EXPECT_LT(middle->z, server.welcome.origin.z + static_cast<double>(server.welcome.box_max.z) + 1e-3);

  // The view is 45 degrees high, so a pixel at depth z is 2 z tan(22.5°) / 48 units wide.
  const double depth = view.position.z - middle->z;
  const auto right = viewer->surfaceAt(view, 42.0, 24.0);
  ASSERT_TRUE(right.has_value());
  EXPECT_NEAR(right->x - middle->x, 10.0 * 2.0 * depth * std::tan(0.5 * view.fov_y) / 48.0, 0.2);

  base::ViewCamera up = view;
  up.direction = {0.0, 0.0, 1.0};
  draw(up);
  EXPECT_FALSE(viewer->surfaceAt(up, 32.0, 24.0).has_value()) << "nothing is above";
}

}  // namespace
}  // namespace client
