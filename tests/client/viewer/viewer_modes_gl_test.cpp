// Tests orthographic views, sections, light, pins, exact frames and lost contexts.
#include <cmath>

#include "tests/client/viewer/viewer_fixture.h"

namespace client {
namespace {

class ViewerModes : public ViewerFixture {
 protected:
  static ViewerOptions patches() {
    ViewerOptions options;
    options.method = Method::kPatches;
    options.session.setPatchTolerance(0.0F);
    return options;
  }
  base::ViewCamera orthoDown(double height) const {
    base::ViewCamera view = server.lookDown(20.0);
    view.ortho_height = height;
    return view;
  }
};

TEST_F(ViewerModes, orthographicPixelsAreAsWideEverywhere) {
  open(patches());
  receiveAllGroups();
  for (const double height : {4.0, 12.0}) {
    const base::ViewCamera view = orthoDown(height);
    settle(view);
    const auto middle = viewer->surfaceAt(view, 32.0, 24.0);
    ASSERT_TRUE(middle.has_value());
    EXPECT_NEAR(middle->x, view.position.x, 1e-3);
    EXPECT_NEAR(middle->y, view.position.y, 1e-3);
    for (const double pixels : {-20.0, 7.0, 20.0}) {
      const auto aside = viewer->surfaceAt(view, 32.0 + pixels, 24.0 - pixels);
      ASSERT_TRUE(aside.has_value());
      EXPECT_NEAR(aside->x - middle->x, pixels * height / 48.0, 1e-3);
      EXPECT_NEAR(aside->y - middle->y, pixels * height / 48.0, 1e-3);
    }
  }
}

TEST_F(ViewerModes, anOrthographicViewerMayStandAnywhereAlongItsAxis) {
  open(patches());
  receiveAllGroups();
  const base::ViewCamera view = orthoDown(12.0);
  const base::Image picture = settle(view);
  EXPECT_GT(covered(picture), 64U * 48U / 2U);
  for (const double by : {-1000.0, -20.0, 19.0, 50.0}) {
    base::ViewCamera moved = view;
    moved.position += by * moved.direction;
    EXPECT_EQ(settle(moved).pixels, picture.pixels) << by;
  }
}

TEST_F(ViewerModes, theErrorOfAnOrthographicCutIsInPixelsOfItsHeight) {
  open(patches());
  receive(server.sayGroup(0));
  settle(orthoDown(10.0));
  const float at_10 = viewer->stats().error_px;
  EXPECT_GT(at_10, 0.0F);
  settle(orthoDown(20.0));
  EXPECT_NEAR(viewer->stats().error_px, 0.5F * at_10, 1e-3F * at_10);
}

TEST_F(ViewerModes, theServerIsAskedForAPerspectiveViewThatCoversTheOrthographicOne) {
  open(ViewerOptions{});
  settle(server.lookDown(20.0));
  sent(viewer->session());
  for (const double height : {0.05, 5.0, 50.0}) {
    base::ViewCamera view = orthoDown(height);
    view.direction = glm::normalize(glm::dvec3(0.3, 0.2, -1.0));
    draw(view);
    const auto views = only<protocol::View>(sent(viewer->session()));
    ASSERT_EQ(views.size(), 1U);
    const base::ViewCamera& asked = views[0].camera;
    EXPECT_EQ(asked.ortho_height, 0.0);
    EXPECT_LT(glm::length(asked.direction - view.direction), 1e-12);
    // It has the same axis, and at the near side of the scene shows at least as much.
    const glm::dvec3 step = asked.position - view.position;
    EXPECT_LT(glm::length(glm::cross(step, view.direction)), 1e-6);
    const double radius = 0.5 * glm::length(glm::dvec3(server.welcome.box_max - server.welcome.box_min));
    const glm::dvec3 center =
        server.welcome.origin + glm::dvec3(0.5F * (server.welcome.box_min + server.welcome.box_max));
    const double nearest = glm::dot(center - asked.position, asked.direction) - radius;
    EXPECT_GT(nearest, 0.0);
    EXPECT_GE(2.0 * nearest * std::tan(0.5 * asked.fov_y), height * 0.999);
  }
}

TEST_F(ViewerModes, onlyTheServersPictureOfTheVeryViewIsExact) {
  server.welcome.can_render_frames = true;
  ViewerOptions options;
  options.session.setPatchTolerance(100.0F);
  open(options);
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kNothing);
  draw(server.lookDown(20.0));
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kNothing);
  receiveAllGroups();
  settle(server.lookDown(20.0));
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kCoarse) << "no image is here yet";
  sent(viewer->session());
  receive(server.sayFrame(1, 100));
  settle(server.lookDown(20.0));
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kExact);
  settle(server.lookDown(20.5));
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kBlended);
  settle(orthoDown(16.5));
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kBlended) << "a perspective picture stands in, and is not exact";
  settle(server.lookDown(20.0));
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kExact);
  base::ViewCamera cut = server.lookDown(20.0);
  cut.section = base::SectionPlane{{0.0, 0.0, 1.0}, server.welcome.origin.z};
  settle(cut);
  EXPECT_NE(viewer->stats().accuracy, Accuracy::kExact) << "it shows what is cut away";
}

TEST_F(ViewerModes, aLightOfTheViewersOwnShadesTheModelsColours) {
  server.welcome.unlit = true;
  open(patches());
  receiveAllGroups();
  const base::ViewCamera view = server.lookDown(20.0);
  const base::Image unlit = settle(view);
  const auto brightness = [](const base::Image& image) {
    double sum = 0.0;
    for (std::size_t i = 0; i < image.pixels.size(); i += 4) sum += image.pixels[i];
    return sum;
  };
  viewer->setLight(glm::dvec3(0.0, 0.0, 5.0));
  const base::Image from_above = settle(view);
  viewer->setLight(glm::dvec3(1.0, 0.0, 0.1));
  const base::Image grazing = settle(view);
  viewer->setLight(glm::dvec3(0.0, 0.0, -1.0));
  const base::Image from_below = settle(view);
  EXPECT_LE(brightness(from_above), brightness(unlit));
  EXPECT_LT(brightness(grazing), 0.9 * brightness(from_above));
  EXPECT_NEAR(brightness(from_below), 0.2 * brightness(unlit), 0.01 * brightness(unlit))
      << "what comes from everywhere";
  for (const auto& none : {std::optional<glm::dvec3>(), std::optional(glm::dvec3(0.0)),
                           std::optional(glm::dvec3(std::nan(""), 0.0, 1.0))}) {
    viewer->setLight(none);
    EXPECT_EQ(settle(view).pixels, unlit.pixels);
  }
}

TEST_F(ViewerModes, imagesAndFramesInTheScenesLightAreNotShownInAnother) {
  for (const bool unlit : {false, true}) {
    server.welcome.unlit = unlit;
    server.welcome.can_render_frames = true;
    open(ViewerOptions{});
    const base::ViewCamera view = server.lookDown(20.0);
    draw(view);
    sent(viewer->session());
    receiveAllGroups();
    receive(server.sayFace({1, 1, 2, 5}, 500));
    receive(server.sayFrame(1, 100));
    receive(server.sayComplete(1));
    settle(view);
    EXPECT_EQ(viewer->stats().accuracy, Accuracy::kExact);
    viewer->setLight(glm::dvec3(1.0, 0.0, 1.0));
    settle(view);
    EXPECT_NE(viewer->stats().accuracy, Accuracy::kExact);
    EXPECT_EQ(viewer->stats().lumigraph.samples_used > 0, unlit) << "colours as scanned take any light";
  }
}

TEST_F(ViewerModes, aSectionCutsWorldCoordinatesForPictureAndPickAlike) {
  open(patches());
  receiveAllGroups();
  base::ViewCamera view = orthoDown(12.0);
  const std::size_t whole = covered(settle(view));
  view.section = base::SectionPlane{{1.0, 0.0, 0.0}, view.position.x};  // removes the right half
  const base::Image half = settle(view);
  EXPECT_NEAR(static_cast<double>(covered(half)), 0.5 * static_cast<double>(whole), 0.03 * static_cast<double>(whole));
  EXPECT_EQ(half.at(50, 24)[3], 0);
  EXPECT_EQ(half.at(10, 24)[3], 255);
  EXPECT_FALSE(viewer->surfaceAt(view, 50.0, 24.0).has_value());
  EXPECT_TRUE(viewer->surfaceAt(view, 10.0, 24.0).has_value());

  view.section = base::SectionPlane{{-2.0, 0.0, 0.0}, -2.0 * view.position.x};  // the normal may have any length
  EXPECT_EQ(settle(view).at(10, 24)[3], 0);
  view.section = base::SectionPlane{{0.0, 0.0, 0.0}, -1.0};
  EXPECT_EQ(covered(settle(view)), whole) << "no normal, no plane";
  view.section.reset();
  EXPECT_EQ(covered(settle(view)), whole);
}

TEST_F(ViewerModes, pinsAreSeenOnTheSurfaceAndNotBehindIt) {
  open(patches());
  receiveAllGroups();
  const base::ViewCamera view = server.lookDown(12.0);
  settle(view);
  std::vector<glm::dvec3> points;
  for (int i = 0; i < 300; ++i) {  // more than three frames test
    const auto on = viewer->surfaceAt(view, 4.0 + i % 20 * 2.8, 4.0 + i / 20 * 2.6);
    ASSERT_TRUE(on.has_value());
    points.push_back(*on - glm::dvec3(0.0, 0.0, i % 3 == 1 ? 3.0 : 0.0));
    if (i % 3 == 2) points.back().x += 1000.0;
  }
  viewer->setPins(points);
  EXPECT_EQ(viewer->pinsVisible().size(), points.size());
  settle(view);
  for (std::size_t i = 0; i < points.size(); ++i)
    EXPECT_EQ(viewer->pinsVisible()[i], i % 3 == 0) << i << (i % 3 == 1 ? " lies below" : " lies outside");

  // From below it is the other way round; pins on the surface show from both sides.
  base::ViewCamera below = view;
  below.position.z -= 30.0;
  below.direction.z = 1.0;
  settle(below);
  for (std::size_t i = 1; i < points.size(); i += 3) EXPECT_TRUE(viewer->pinsVisible()[i]) << i;

  base::ViewCamera cut = view;
  cut.section = base::SectionPlane{{0.0, 0.0, 1.0}, server.welcome.origin.z - 1000.0};
  settle(cut);
  for (std::size_t i = 0; i < points.size(); ++i) EXPECT_FALSE(viewer->pinsVisible()[i]) << "cut away";
  viewer->setPins({});
  settle(view);
  EXPECT_TRUE(viewer->pinsVisible().empty());
}

TEST_F(ViewerModes, aSettledPictureAsksForNoPinsAgain) {
  open(patches());
  receiveAllGroups();
  const base::ViewCamera view = server.lookDown(12.0);
  viewer->setPins({view.position});
  settle(view);
  draw(view);
  EXPECT_FALSE(viewer->stats().busy);
  draw(server.lookDown(12.5));
  EXPECT_TRUE(viewer->stats().busy) << "the answer for the new view is on its way";
}

TEST_F(ViewerModes, afterALostContextThePictureIsTheSame) {
  server.welcome.can_render_frames = true;
  ViewerOptions options;
  options.session.setPatchTolerance(0.5F);
  open(options);
  receiveAllGroups();
  for (std::uint32_t x = 0; x < 4; ++x) receive(server.sayFace({x, 1, 2, 5}, 100));
  const base::ViewCamera view = server.lookDown(30.0);
  const auto on = [&] { return viewer->surfaceAt(view, 32.0, 24.0); };
  settle(view);
  viewer->setPins({*on()});
  const base::Image before = settle(view);
  ASSERT_GT(viewer->stats().lumigraph.samples_used, 0U);
  ASSERT_TRUE(viewer->pinsVisible()[0]);
  const glm::dvec3 picked = *on();

  viewer->contextLost();
  viewer->contextLost();
  EXPECT_EQ(base::gl::heldBytes().total(), 0U);
  context.reset();
  EXPECT_TRUE(bool(viewer->draw(view, 0.0))) << "there is no context at all: nothing of GL may be called";
  EXPECT_FALSE(on().has_value());
  EXPECT_EQ(viewer->stats().memory.gpu(), 0U);
  EXPECT_EQ(viewer->stats().accuracy, Accuracy::kNothing);
  receive(server.sayFace({2, 2, 2, 5}, 100));

  makeContext();
  ASSERT_TRUE(bool(viewer->contextRestored()));
  settle(view);
  EXPECT_TRUE(viewer->pinsVisible()[0]);
  EXPECT_EQ(*on(), picked);
  // The picture also shows what arrived while there was no context, and equals one drawn without the loss.
  viewer->contextLost();
  context.reset();
  makeContext();
  ASSERT_TRUE(bool(viewer->contextRestored()));
  const base::Image after = settle(view);

  open(options);
  receiveAllGroups();
  for (std::uint32_t x = 0; x < 4; ++x) receive(server.sayFace({x, 1, 2, 5}, 100));
  EXPECT_EQ(settle(view).pixels, before.pixels) << "the way there does not matter";
  receive(server.sayFace({2, 2, 2, 5}, 100));
  EXPECT_EQ(settle(view).pixels, after.pixels);
}

}  // namespace
}  // namespace client
