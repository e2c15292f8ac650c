// Tests the App by scripted events, without GL: the surface is a plane that the test knows.
#include "client/app/app.h"

#include "client/app/permalink.h"
#include "tests/client/app/scripted_app.h"

namespace client {
namespace {

constexpr Modifiers kShiftDown{true, false, false};
constexpr Modifiers kCtrlDown{false, true, false};

// ---- before and after the scene is known ----

// An interior's first view: the whole of it, wherever that is from in a window of this shape, without its ceilings.
TEST_F(AppTest, aFirstViewWithoutAPlaceLeavesTheWholeModelInView) {
  server.welcome.start_direction = {0.48F, 0.6F, 0.64F};
  welcome();
  const std::string whole = app->permalink();
  SetUp();
  server.welcome.start_view = "v=1&x=z," + std::to_string(middle().z) + ",b";
  welcome();
  const std::string cut = app->permalink();
  ASSERT_NE(cut.find("&x=z,"), std::string::npos) << cut;
  EXPECT_EQ(cut.substr(0, cut.find("&x=")), whole);
}

TEST_F(AppTest, eventsBeforeTheSceneIsKnownAreHarmless) {
  drag(mouse(100, 100), 50, 50);
  app->turnWheel(1.0, 10, 10, now);
  for (int k = 0; k <= static_cast<int>(Key::k9); ++k) press(static_cast<Key>(k));
  EXPECT_TRUE(app->labels().empty());
  EXPECT_EQ(app->sceneName(), "");
  EXPECT_EQ(app->status().kind, Status::Kind::kConnecting);
}

TEST_F(AppTest, theFirstViewLooksAtTheMiddleOfTheScene) {
  welcome();
  EXPECT_LT(glm::length(pivot() - middle()), 0.2 * glm::length(extent()));
  EXPECT_EQ(app->sceneName(), "synthetic");
  EXPECT_TRUE(app->wantsFrame());
}

// Six axes, two norths each.
TEST_F(AppTest, theFirstViewStandsUprightAndTheCompassPointsNorth) {
  server.welcome.start_direction = {0.48F, 0.6F, 0.64F};  // along no axis
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {1.0F, -1.0F})
      for (const double degrees : {0.0, 130.0}) {
        server.welcome.up = glm::vec3(0.0F);
        server.welcome.up[axis] = sign;
        server.welcome.north = glm::vec3(base::northDirection(glm::dvec3(server.welcome.up), degrees));
        open({});
        welcome();
        const base::ViewCamera camera = app->camera();
        const glm::dvec3 up(server.welcome.up);
        EXPECT_GT(glm::dot(camera.up, up), 0.5);
        const glm::dvec3 right = glm::normalize(glm::cross(camera.direction, up));
        ASSERT_TRUE(app->northTurn());
        const glm::dvec3 pointed =
            std::sin(*app->northTurn()) * right + std::cos(*app->northTurn()) * glm::cross(up, right);
        EXPECT_LT(glm::length(pointed - glm::dvec3(server.welcome.north)), 1e-5) << axis << sign << degrees;
      }
}

TEST_F(AppTest, whatASceneDoesNotSayOfItselfIsNotShown) {
  EXPECT_FALSE(app->northTurn() || app->sceneBackground());
  welcome();
  EXPECT_FALSE(app->northTurn() || app->sceneBackground());
  EXPECT_EQ(app->attribution(), "");
  server.welcome.scene_name = "another";
  server.welcome.attribution = "A. Nonymous";
  server.welcome.background = base::Rgb{1, 2, 3};
  welcome();
  EXPECT_EQ(app->attribution(), "A. Nonymous");
  EXPECT_EQ(app->sceneBackground(), (base::Rgb{1, 2, 3}));
}

TEST_F(AppTest, aWindowWithoutPixelsOrOutOfSightIsNotDrawn) {
  welcome();
  app->setHidden(true);
  EXPECT_FALSE(app->wantsFrame());
  app->setHidden(false);
  EXPECT_TRUE(app->wantsFrame());
  app->resize(0, 0, 1.0);
  EXPECT_FALSE(app->wantsFrame());
  EXPECT_TRUE(bool(app->drawFrame(now))) << "and asking for it all the same does nothing";
}

// ---- mouse and fingers ----

TEST_F(AppTest, leftDragOrbitsAroundThePivot) {
  welcome();
  const glm::dvec3 before = position();
  const glm::dvec3 around = pivot();
  drag(mouse(400, 300), 120, 40);
  EXPECT_GT(glm::length(position() - before), 0.1);
  EXPECT_LT(glm::length(pivot() - around), 1e-6);
}

TEST_F(AppTest, rightMiddleAndShiftDragMoveTheSurfaceWithThePointer) {
  for (const PointerEvent& from : {mouse(400, 300, PointerButton::kRight), mouse(400, 300, PointerButton::kMiddle),
                                   mouse(400, 300, PointerButton::kLeft, kShiftDown)}) {
    open({});
    welcome();
    const glm::dvec3 direction = app->view().direction;
    const base::ViewCamera camera = app->camera();
    const glm::dvec3 held = *plane(camera, 410, 300);  // the pan begins at the edge of the pointer's circle
    drag(from, 100, 0);
    EXPECT_EQ(app->view().direction, direction);
    EXPECT_LT(glm::length(*plane(app->camera(), 500, 300) - held), 1e-6 * app->view().pivot_distance);
  }
}

TEST_F(AppTest, theWheelKeepsWhatIsUnderTheCursorAndAsksForItOnce) {
  welcome();
  const glm::dvec3 under = *plane(app->camera(), 500, 350);
  surface_asked = 0;
  for (int i = 0; i < 5; ++i) app->turnWheel(1.0, 500, 350, now += 0.05);
  EXPECT_EQ(surface_asked, 1);
  EXPECT_LT(glm::length(*plane(app->camera(), 500, 350) - under), 1e-6 * app->view().pivot_distance);
  app->turnWheel(1.0, 100, 350, now += 0.05);
  EXPECT_EQ(surface_asked, 3) << "elsewhere, and once by this test";
}

TEST_F(AppTest, twoFingersPanAndZoomAtOnce) {
  welcome();
  const auto finger = [this](int id, double x, double y) {
    return PointerEvent{id, PointerKind::kTouch, PointerButton::kLeft, {}, x, y, now += 0.02};
  };
  app->pointerDown(finger(1, 350, 300));
  app->pointerDown(finger(2, 450, 300));
  app->pointerMove(finger(1, 350, 300));
  const glm::dvec3 held = *plane(app->camera(), 400, 300);
  const double distance = glm::length(held - position());
  app->pointerMove(finger(2, 550, 340));
  EXPECT_LT(glm::length(*plane(app->camera(), 450, 320) - held), 1e-5 * distance);
  EXPECT_NEAR(glm::length(held - position()), distance * 100.0 / std::hypot(200.0, 40.0), 0.2 * distance);
  EXPECT_LT(glm::length(held - position()), 0.6 * distance);
}

TEST_F(AppTest, aDoubleClickBringsThatPlaceToTheMiddleInAShortFlight) {
  welcome();
  const glm::dvec3 place = *plane(app->camera(), 600, 350);
  const glm::dvec3 before = position();
  click(600, 350);
  EXPECT_EQ(position(), before) << "one click does nothing";
  click(600, 350);
  pass(0.1);
  EXPECT_GT(glm::length(position() - before), 0.0);
  EXPECT_GT(glm::length(pivot() - place), 1e-3) << "on its way";
  pass(1.0);
  EXPECT_LT(glm::length(pivot() - place), 1e-6);
  EXPECT_FALSE(requests(RequestKind::kLinkChanged).empty()) << "and at rest the link is told";
}

TEST_F(AppTest, reducedMotionJumps) {
  welcome();
  app->setReducedMotion(true);
  const glm::dvec3 place = *plane(app->camera(), 600, 350);
  click(600, 350);
  click(600, 350);
  EXPECT_LT(glm::length(pivot() - place), 1e-6);
  ASSERT_TRUE(bool(app->changeSetting("reduced_motion", 2.0))) << "settings overrule the system";
  press(Key::kR);
  EXPECT_GT(glm::length(pivot() - middle()), 1e-3);
}

TEST_F(AppTest, aPressEndsAFlight) {
  welcome();
  drag(mouse(400, 300), 200, 0);
  press(Key::kR);
  pass(0.1);
  drag(mouse(400, 300), 20, 0);
  const glm::dvec3 here = position();
  pass(1.0);
  EXPECT_EQ(position(), here);
}

TEST_F(AppTest, overBackgroundNothingIsFound) {
  welcome();
  background = true;
  const glm::dvec3 before = position();
  click(400, 300);
  click(400, 300);
  pass(1.0);
  EXPECT_EQ(position(), before);
}

// ---- keys ----

TEST_F(AppTest, everyFlyingKeyGoesItsWay) {
  struct Way {
    Key key;
    int axis;  // axis of the camera: right, up, forward
    double sign;
  };
  for (const Way& way : {Way{Key::kW, 2, 1.0}, Way{Key::kS, 2, -1.0}, Way{Key::kA, 0, -1.0}, Way{Key::kD, 0, 1.0},
                         Way{Key::kQ, 1, -1.0}, Way{Key::kE, 1, 1.0}, Way{Key::kUp, 2, 1.0}, Way{Key::kDown, 2, -1.0},
                         Way{Key::kLeft, 0, -1.0}, Way{Key::kRight, 0, 1.0}}) {
    open({});
    welcome();
    const base::ViewCamera camera = app->camera();
    const glm::dvec3 right = glm::normalize(glm::cross(camera.direction, camera.up));
    const glm::dvec3 axes[3] = {right, glm::cross(right, camera.direction), camera.direction};
    const glm::dvec3 from = position();
    hold(way.key, 0.5);
    const glm::dvec3 moved = position() - from;
    EXPECT_GT(way.sign * glm::dot(moved, axes[way.axis]), 0.99 * glm::length(moved));
    EXPECT_GT(glm::length(moved), 0.1 * app->view().pivot_distance);
    const glm::dvec3 here = position();
    pass(0.5);
    EXPECT_EQ(position(), here) << "and stops when it is let go";
  }
}

TEST_F(AppTest, shiftFliesFaster) {
  welcome();
  const glm::dvec3 a = position();
  hold(Key::kD, 0.5);
  const glm::dvec3 b = position();
  hold(Key::kD, 0.5, kShiftDown);
  EXPECT_GT(glm::length(position() - b), 3.0 * glm::length(b - a));
}

TEST_F(AppTest, keysThatAreHeldWhenTheWindowLosesThemStop) {
  welcome();
  app->handleKey(Key::kD, true, {}, now);
  app->blur();
  const glm::dvec3 here = position();
  pass(0.5);
  EXPECT_EQ(position(), here);
}

TEST_F(AppTest, ctrlArrowsTurnAndPlusMinusZoom) {
  welcome();
  const glm::dvec3 around = pivot();
  const glm::dvec3 direction = app->view().direction;
  hold(Key::kLeft, 0.3, kCtrlDown);
  EXPECT_LT(glm::length(pivot() - around), 1e-6);
  EXPECT_GT(glm::length(app->view().direction - direction), 0.05);
  const double distance = app->view().pivot_distance;
  hold(Key::kPlus, 0.3);
  EXPECT_LT(app->view().pivot_distance, 0.9 * distance);
  hold(Key::kMinus, 0.3);
  EXPECT_NEAR(app->view().pivot_distance, distance, 0.05 * distance);
}

TEST_F(AppTest, keyFFramesTheModelFromHereAndKeyRGoesBackToTheFirstView) {
  welcome();
  const ViewState first = app->view();
  drag(mouse(400, 300), 150, 20);
  hold(Key::kD, 1.0);
  const glm::dvec3 direction = app->view().direction;
  press(Key::kF);
  pass(1.0);
  EXPECT_LT(glm::length(app->view().direction - direction), 1e-9) << "from this side";
  EXPECT_LT(glm::length(pivot() - middle()), 0.2 * glm::length(extent()));
  for (const Key key : {Key::kR, Key::kHome, Key::k0}) {
    drag(mouse(400, 300), 150, 20);
    press(key);
    pass(1.0);
    EXPECT_LT(glm::length(position() - first.position), 1e-9 * first.pivot_distance);
    EXPECT_LT(glm::length(app->view().direction - first.direction), 1e-12);
  }
}

TEST_F(AppTest, lettersToggleTheirModes) {
  welcome();
  const struct {
    Key key;
    bool ViewState::*flag;
  } kToggles[] = {{Key::kI, &ViewState::statistics},
                  {Key::kC, &ViewState::colors_by_resolution},
                  {Key::kO, &ViewState::orthographic}};
  for (const auto& toggle : kToggles) {
    const std::uint64_t version = app->overlayVersion();
    EXPECT_TRUE(press(toggle.key));
    EXPECT_TRUE(app->view().*(toggle.flag));
    EXPECT_GT(app->overlayVersion(), version);
    press(toggle.key);
    EXPECT_FALSE(app->view().*(toggle.flag));
  }
  press(Key::kH);
  EXPECT_TRUE(app->helpShown());
  EXPECT_TRUE(press(Key::kEscape));
  EXPECT_FALSE(app->helpShown());
  EXPECT_FALSE(press(Key::kEscape)) << "nothing is open";
}

TEST_F(AppTest, aKeyThatRepeatsItselfTogglesOnce) {
  welcome();
  for (int i = 0; i < 5; ++i) app->handleKey(Key::kI, true, {}, now);
  EXPECT_TRUE(app->view().statistics);
}

TEST_F(AppTest, keysOfTheSystemAreLeftToIt) {
  welcome();
  for (const Key key : {Key::kC, Key::kP, Key::kR, Key::kV, Key::kF, Key::kS, Key::kD})
    EXPECT_FALSE(press(key, kCtrlDown));
  EXPECT_FALSE(app->view().colors_by_resolution);
  EXPECT_TRUE(app->takeRequests().empty());
  EXPECT_FALSE(press(Key::kNone));
}

TEST_F(AppTest, everyKeyInTheHelpHasAnEffect) {
  welcome();
  app->setAnnotations({note(middle())});
  press(Key::kX);  // page up and down need a plane
  press(Key::kM);  // backspace needs a point
  for (int k = static_cast<int>(Key::kW); k <= static_cast<int>(Key::k9); ++k) {
    const Key key = static_cast<Key>(k);
    if (key == Key::kShift) continue;
    if (app->mode() == Mode::kLook) press(Key::kM);
    if (!app->view().section.on) press(Key::kX);
    EXPECT_TRUE(press(key)) << k;
  }
}

// ---- bookmarks and links ----

TEST_F(AppTest, aBookmarkBringsBackTheViewAndIsKept) {
  welcome();
  drag(mouse(400, 300), 150, 20);
  press(Key::kO);
  pass(1.0);
  const ViewState there = app->view();
  press(Key::k4, kShiftDown);
  EXPECT_EQ(requests(RequestKind::kKeepBookmarks).size(), 1U);
  EXPECT_EQ(app->bookmark(4), formatPermalink(there));
  press(Key::kO);
  press(Key::kR);
  press(Key::kI);
  pass(1.0);
  press(Key::k4);
  pass(1.0);
  EXPECT_LT(glm::length(position() - there.position), 1e-6 * there.pivot_distance);
  EXPECT_TRUE(app->view().orthographic);
  EXPECT_TRUE(app->view().statistics) << "is no part of a viewpoint";
  press(Key::k5, kCtrlDown);
  EXPECT_FALSE(app->bookmark(5).empty()) << "ctrl stores, too";
}

TEST_F(AppTest, anEmptyBookmarkSaysHowToSetItAndZeroCannotBeSet) {
  welcome();
  press(Key::k7);
  ASSERT_EQ(app->toasts().size(), 1U);
  EXPECT_NE(app->toasts()[0].text.find("shift + 7"), std::string::npos);
  press(Key::k0, kShiftDown);
  EXPECT_TRUE(app->bookmark(0).empty());
  EXPECT_TRUE(requests(RequestKind::kKeepBookmarks).empty());
}

TEST_F(AppTest, bookmarksFromStorageAreChecked) {
  EXPECT_TRUE(bool(app->setBookmark(3, "v=1&p=1,2,3&a=0,0&r=1")));
  EXPECT_FALSE(bool(app->setBookmark(3, "nonsense")));
  EXPECT_FALSE(bool(app->setBookmark(0, "")));
  EXPECT_FALSE(bool(app->setBookmark(10, "")));
  EXPECT_EQ(app->bookmark(3), "v=1&p=1,2,3&a=0,0&r=1");
}

TEST_F(AppTest, aLinkThatCameBeforeTheSceneIsTheFirstView) {
  welcome();
  drag(mouse(400, 300), 150, 20);
  press(Key::kX);
  press(Key::kO);
  const std::string link = app->permalink();
  open({});
  ASSERT_TRUE(bool(app->openPermalink(link)));
  welcome();
  EXPECT_EQ(app->permalink(), link);
  EXPECT_TRUE(app->view().orthographic && app->view().section.on);
  pass(1.0);
  EXPECT_TRUE(requests(RequestKind::kLinkChanged).empty()) << "the address has it already";
  press(Key::kR);
  pass(2.0);
  EXPECT_EQ(requests(RequestKind::kLinkChanged).size(), 1U) << "once per rest";
  EXPECT_EQ(formatPermalink(*parsePermalink(link)), link);
}

TEST_F(AppTest, aBadLinkChangesNothingAndSaysSo) {
  welcome();
  const ViewState before = app->view();
  EXPECT_FALSE(bool(app->openPermalink("v=1&p=0,0,nan&a=0,0&r=1")));
  EXPECT_EQ(app->view(), before);
  ASSERT_EQ(app->toasts().size(), 1U);
  EXPECT_TRUE(app->toasts()[0].error);
}

TEST_F(AppTest, keyVRequestsTheLinksCopyAndKeyPAPicture) {
  welcome();
  press(Key::kV);
  const auto copies = requests(RequestKind::kCopyLink);
  ASSERT_EQ(copies.size(), 1U);
  EXPECT_EQ(copies[0].text, app->permalink());
  press(Key::kP);
  const auto pictures = requests(RequestKind::kSavePicture);
  ASSERT_EQ(pictures.size(), 1U);
  EXPECT_EQ(pictures[0].camera.width, 800);
  EXPECT_EQ(pictures[0].text.rfind("position=", 0), 0U);
  for (const char* name : {"section", "colors", "ortho_height"})
    EXPECT_EQ(pictures[0].text.find(name), std::string::npos) << pictures[0].text;

  // The picture may have all overlays that a viewer can show.
  for (const Key key : {Key::kX, Key::kC, Key::kO}) press(key);
  press(Key::kP);
  const auto more = requests(RequestKind::kSavePicture);
  ASSERT_EQ(more.size(), 1U);
  for (const char* name : {"&section=", "&colors=resolution&tolerance=1&measure=shape", "&ortho_height="})
    EXPECT_NE(more[0].text.find(name), std::string::npos) << more[0].text;
}

TEST_F(AppTest, keyGRequestsTheSettings) {
  welcome();
  press(Key::kG);
  EXPECT_EQ(requests(RequestKind::kShowSettings).size(), 1U);
}

TEST_F(AppTest, anotherSceneBeginsAnew) {
  welcome();
  press(Key::k1, kShiftDown);
  press(Key::kX);
  app->session().disconnected("gone");
  EXPECT_EQ(app->status().kind, Status::Kind::kLost);
  ScriptedServer other;
  other.welcome.scene_name = "another";
  other.welcome.origin += glm::dvec3(1000.0, 0.0, 0.0);
  app->session().connected();
  ASSERT_TRUE(bool(app->session().receive(other.sayWelcome())));
  pass(0.1);
  EXPECT_LT(glm::length(pivot() - middle() - glm::dvec3(1000.0, 0.0, 0.0)), 0.2 * glm::length(extent()));
  EXPECT_TRUE(app->bookmark(1).empty());
  EXPECT_FALSE(app->view().section.on);
}

// ---- measuring ----

TEST_F(AppTest, aDistanceIsMeasuredRoughlyAtOnceAndThenExactly) {
  server.welcome.units = "m";
  welcome();
  press(Key::kM);
  EXPECT_EQ(app->mode(), Mode::kDistance);
  EXPECT_FALSE(app->modeHint().empty());
  const glm::dvec3 a = *plane(app->camera(), 300, 320);
  const glm::dvec3 b = *plane(app->camera(), 500, 330);
  click(300, 320);
  click(500, 330);
  auto values = labels(LabelKind::kValue);
  ASSERT_EQ(values.size(), 1U);
  EXPECT_TRUE(values[0].approximate);
  EXPECT_EQ(values[0].text.substr(0, 5), "about");
  EXPECT_EQ(app->lines().size(), 1U);

  // Answer with points on the requested rays.
  const auto picks = requests(RequestKind::kPick);
  ASSERT_EQ(picks.size(), 2U);
  for (const auto& [pick, place] : {std::pair(picks[0], a), std::pair(picks[1], b)}) {
    EXPECT_LT(glm::length(glm::cross(place - pick.origin, pick.direction)), 1e-6);
    app->answerPick(pick.id, {PickAnswer::Kind::kHit, place, {0.0, 0.0, 1.0}, 0.001});
  }
  pass(0.05);
  values = labels(LabelKind::kValue);
  EXPECT_FALSE(values[0].approximate);
  EXPECT_EQ(values[0].text, formatLength(glm::length(b - a), 0.002, false, "m"));
  const auto points = labels(LabelKind::kPoint);
  ASSERT_EQ(points.size(), 2U);
  EXPECT_NEAR(points[0].x, 300.0, 1e-6);
  EXPECT_NEAR(points[1].y, 330.0, 1e-6);

  // A double click ends the chain; Escape leaves the mode.
  now += 1.0;
  click(600, 350);
  click(600, 350);
  EXPECT_EQ(app->measurements()[0].points.size(), 3U);
  EXPECT_TRUE(app->measurements()[0].finished);
  EXPECT_TRUE(press(Key::kEscape));
  EXPECT_EQ(app->mode(), Mode::kLook);
  EXPECT_TRUE(labels(LabelKind::kPoint).empty());
}

TEST_F(AppTest, keyMGoesOnToAnglesAndThenLeaves) {
  welcome();
  press(Key::kM);
  press(Key::kM);
  EXPECT_EQ(app->mode(), Mode::kAngle);
  for (const double x : {300.0, 400.0, 550.0}) {
    now += 1.0;
    click(x, 300.0 + 0.1 * x);
  }
  const auto values = labels(LabelKind::kValue);
  ASSERT_EQ(values.size(), 1U);
  EXPECT_NE(values[0].text.find("\u00B0"), std::string::npos);
  press(Key::kBackspace);
  EXPECT_TRUE(labels(LabelKind::kValue).empty());
  press(Key::kM);
  EXPECT_EQ(app->mode(), Mode::kLook);
}

TEST_F(AppTest, orbitingWhileMeasuringAddsNoPoint) {
  welcome();
  press(Key::kM);
  drag(mouse(400, 300), 100, 0);
  EXPECT_TRUE(app->measurements().empty());
  background = true;
  click(400, 300);
  EXPECT_TRUE(app->measurements().empty());
  EXPECT_FALSE(app->toasts().empty());
  background = false;
  press(Key::kEnter);
  EXPECT_EQ(app->measurements().size(), 1U) << "by keyboard: the middle of the picture";
}

TEST_F(AppTest, anAnswerThatNobodyCanGiveLeavesThePointApproximate) {
  welcome();
  press(Key::kM);
  click(400, 300);
  const auto picks = requests(RequestKind::kPick);
  ASSERT_EQ(picks.size(), 1U);
  app->answerPick(picks[0].id, {});
  EXPECT_TRUE(app->measurements()[0].points[0].approximate);
  app->answerPick(picks[0].id, {PickAnswer::Kind::kHit, middle(), {}, 0.0});
  EXPECT_TRUE(app->measurements()[0].points[0].approximate) << "too late";
}

// ---- the section plane ----

TEST_F(AppTest, keyXGoesThroughTheAxesFromUpAndThenOff) {
  welcome();
  std::vector<int> axes;
  while (press(Key::kX) && app->view().section.on) axes.push_back(app->view().section.axis);
  EXPECT_EQ(axes, (std::vector<int>{2, 0, 1}));
}

TEST_F(AppTest, thePlaneCutsTheNearHalfOffAndShiftXTheFarHalf) {
  welcome();
  press(Key::kX);
  EXPECT_TRUE(app->view().section.keep_below) << "seen from above";
  EXPECT_NEAR(app->view().section.offset, middle().z, 1e-9);
  press(Key::kX, kShiftDown);
  EXPECT_FALSE(app->view().section.keep_below);
  EXPECT_TRUE(press(Key::kEscape));
  EXPECT_FALSE(app->view().section.on);
}

TEST_F(AppTest, keysAndItsHandleMoveThePlaneWithinTheModel) {
  welcome();
  press(Key::kX);
  hold(Key::kPageUp, 0.5);
  const double raised = app->view().section.offset;
  EXPECT_GT(raised, middle().z);
  hold(Key::kPageDown, 60.0);
  EXPECT_NEAR(app->view().section.offset, middle().z - 0.5 * extent().z, 1e-6);

  press(Key::kX);  // the x axis, along which the model is wide
  const auto handle = labels(LabelKind::kSectionHandle);
  ASSERT_EQ(handle.size(), 1U);
  const glm::dvec3 before = position();
  const double offset = app->view().section.offset;
  drag(mouse(handle[0].x, handle[0].y), 40, 0);
  EXPECT_GT(std::abs(app->view().section.offset - offset), 1e-3);
  EXPECT_EQ(position(), before) << "the camera stays";
  EXPECT_GT(labels(LabelKind::kSectionHandle)[0].x, handle[0].x + 10.0) << "it goes along with the pointer";
}

TEST_F(AppTest, aPickBeginsBehindWhatIsCutOffAndNeverEndsInIt) {
  welcome();
  press(Key::kX);
  press(Key::kM);
  click(300, 350);
  const auto picks = requests(RequestKind::kPick);
  ASSERT_EQ(picks.size(), 1U);
  EXPECT_NEAR(picks[0].origin.z, app->view().section.offset, 1e-6);
  app->answerPick(picks[0].id, {PickAnswer::Kind::kHit, middle() + glm::dvec3(0.0, 0.0, 1.0), {}, 0.001});
  EXPECT_TRUE(app->measurements()[0].points[0].approximate);
}

// ---- notes ----

TEST_F(AppTest, aClickOnAPinShowsItsCardAndGoesToItsCamera) {
  welcome();
  Annotation one = note(middle(), {0.0, 0.0, 1.0});
  one.camera.emplace();
  one.camera->position = middle() + glm::dvec3(0.0, -20.0, 5.0);
  one.camera->direction = glm::normalize(middle() - one.camera->position);
  app->setAnnotations({one, note(middle() + glm::dvec3(extent().x * 0.3, 0.0, 0.0))});
  pass(0.05);
  const auto pins = labels(LabelKind::kPin);
  ASSERT_EQ(pins.size(), 2U);
  ASSERT_TRUE(pins[0].visible);
  click(pins[0].x + 3.0, pins[0].y);
  EXPECT_EQ(app->openAnnotation(), std::optional<std::size_t>(0));
  pass(1.0);
  EXPECT_LT(glm::length(position() - one.camera->position), 1e-6);
  press(Key::kN);
  EXPECT_EQ(app->openAnnotation(), std::optional<std::size_t>(1));
  press(Key::kN);
  EXPECT_EQ(app->openAnnotation(), std::optional<std::size_t>(0)) << "around";
  press(Key::kN, kShiftDown);
  EXPECT_EQ(app->openAnnotation(), std::optional<std::size_t>(1));
  press(Key::kEscape);
  EXPECT_FALSE(app->openAnnotation());
}

TEST_F(AppTest, pinsThatLookAwayOrAreCutOffAreHidden) {
  welcome();
  app->setAnnotations({note(middle(), app->view().direction), note(middle(), -app->view().direction),
                       note(middle() + glm::dvec3(0.0, 0.0, 0.4 * extent().z))});
  pass(0.05);
  EXPECT_FALSE(labels(LabelKind::kPin)[0].visible);
  EXPECT_TRUE(labels(LabelKind::kPin)[1].visible);
  EXPECT_TRUE(labels(LabelKind::kPin)[2].visible);
  press(Key::kX);
  EXPECT_FALSE(labels(LabelKind::kPin)[2].visible);
}

TEST_F(AppTest, tooManyNotesAreCutWithAToast) {
  std::vector<Annotation> many(kMaxAnnotations + 5, note({}));
  app->setAnnotations(std::move(many));
  EXPECT_EQ(app->annotations().size(), kMaxAnnotations);
  EXPECT_EQ(app->toasts().size(), 1U);
}

// ---- words ----

TEST_F(AppTest, toastsGoByTimeAndThereAreAtMostThree) {
  for (const char* text : {"a", "b", "c", "d", "d"}) app->showToast(text);
  ASSERT_EQ(app->toasts().size(), 3U);
  EXPECT_EQ(app->toasts()[2].text, "d");
  EXPECT_EQ(app->toasts()[0].text, "b") << "the same again replaces itself";
  const std::uint64_t version = app->overlayVersion();
  pass(10.0);
  EXPECT_TRUE(app->toasts().empty());
  EXPECT_GT(app->overlayVersion(), version);
}

TEST_F(AppTest, aLostServerIsToldInPlainWords) {
  app->session().disconnected("cannot reach 127.0.0.1:1");
  EXPECT_EQ(app->status().kind, Status::Kind::kLost);
  EXPECT_EQ(app->status().text, "cannot reach 127.0.0.1:1");
  EXPECT_FALSE(app->status().advice.empty());
  app->session().connected();
  ASSERT_TRUE(bool(app->session().receive(server.sayRefusal(9, "too old"))));
  EXPECT_EQ(app->status().kind, Status::Kind::kRefused);
}

TEST_F(AppTest, theProgressBarComesOnlyWhenItTakesAWhile) {
  welcome();
  EXPECT_FALSE(app->progress().active);
  pass(1.0);
  EXPECT_TRUE(app->progress().active);
  EXPECT_GE(app->progress().share, 0.0);
}

TEST_F(AppTest, eventsWithoutFiniteNumbersAreIgnored) {
  welcome();
  const ViewState before = app->view();
  const double nan = std::nan("");
  app->turnWheel(nan, 1, 1, now);
  app->turnWheel(1.0, nan, 1, now);
  app->pointerDown(mouse(nan, 10));
  app->pointerMove(mouse(50, 10));
  app->pointerUp(mouse(50, 10));
  app->resize(800, 600, nan);
  app->advance(nan);
  EXPECT_EQ(app->view(), before);
}

// ---- splats ----

TEST_F(AppTest, theMagnifyingGlassFollowsItsPointerAndTheViewStandsStill) {
  open({}, Method::kQsplat);
  welcome();
  EXPECT_TRUE(app->lines().empty());
  press(Key::kL);
  pass(0.1);
  ASSERT_EQ(app->lines().size(), 64U);
  const auto middleOfRim = [this] {
    glm::dvec2 sum(0.0);
    for (const LabelLine& line : app->lines()) sum += glm::dvec2(line.x0, line.y0);
    return sum / 64.0;
  };
  EXPECT_LT(glm::length(middleOfRim() - glm::dvec2(400.0, 300.0)), 1e-6);

  // A press inside drags the glass; a press beside it turns the view as usual.
  const std::string before = app->permalink();
  drag(mouse(420.0, 310.0), -300.0, -110.0);
  EXPECT_TRUE(app->wantsFrame());
  EXPECT_LT(glm::length(middleOfRim() - glm::dvec2(120.0, 200.0)), 1e-6);
  EXPECT_EQ(app->permalink(), before);
  drag(mouse(600.0, 200.0), 50.0, 0.0);
  EXPECT_NE(app->permalink(), before);

  press(Key::kEscape);
  pass(0.1);
  EXPECT_TRUE(app->lines().empty());
}

// The window has 800 x 600 pixels, so the handle moves within 240 of the middle.
TEST_F(AppTest, theLightsHandleIsWhereTheLightComesFrom) {
  welcome();
  press(Key::kL);
  pass(0.1);
  EXPECT_FALSE(app->lines().empty());
  const auto inEye = [this] {
    const base::ViewCamera view = app->camera();
    const glm::dvec3 right = glm::normalize(glm::cross(view.direction, view.up));
    const glm::dvec3 light = app->view().light.direction();
    return glm::dvec3(glm::dot(light, right), glm::dot(light, glm::cross(right, view.direction)),
                      -glm::dot(light, view.direction));
  };
  EXPECT_LT(glm::length(inEye() - glm::dvec3(-0.5, 0.5, std::sqrt(0.5))), 1e-9);

  // A press on the handle drags it, one beside it turns the view, and the light stays where it is in the world.
  const std::string before = app->permalink();
  drag(mouse(282.0, 178.0), 262.0, 122.0);
  EXPECT_LT(glm::length(inEye() - glm::dvec3(0.6, 0.0, 0.8)), 0.02);
  EXPECT_EQ(app->permalink().substr(0, app->permalink().find("&l=")), before.substr(0, before.find("&l=")));
  const glm::dvec3 world = app->view().light.direction();
  drag(mouse(100.0, 500.0), 150.0, 0.0);
  EXPECT_EQ(app->view().light.direction(), world);
  EXPECT_GT(glm::length(inEye() - glm::dvec3(0.6, 0.0, 0.8)), 0.1);

  // Beyond the rim it grazes what faces the eye.
  for (int i = 0; i < 2; ++i) press(Key::kL);
  drag(mouse(280.0, 180.0), -2000.0, 0.0);
  EXPECT_NEAR(inEye().z, 0.03, 0.01);
}

TEST_F(AppTest, withoutSplatsLinksToThemAreForAnotherPlace) {
  welcome();
  const std::string before = app->permalink();
  const auto opened = app->openPermalink(before + "&m=qsplat");
  ASSERT_FALSE(opened);
  EXPECT_NE(opened.error().message.find("another method"), std::string::npos);
  EXPECT_EQ(app->permalink(), before);
}

}  // namespace
}  // namespace client
