#include "client/app/gesture.h"

#include <gtest/gtest.h>

#include <cmath>

namespace client {
namespace {

PointerEvent mouse(double x, double y, double now, PointerButton button = PointerButton::kLeft, bool shift = false) {
  return {0, PointerKind::kMouse, button, {shift, false, false}, x, y, now};
}
PointerEvent finger(int id, double x, double y, double now) {
  return {id, PointerKind::kTouch, PointerButton::kLeft, {}, x, y, now};
}

std::vector<GestureKind> kinds(const std::vector<Gesture>& gestures) {
  std::vector<GestureKind> all;
  for (const Gesture& gesture : gestures) all.push_back(gesture.kind);
  return all;
}
using Kinds = std::vector<GestureKind>;

std::vector<Gesture> click(GestureReader& reader, const PointerEvent& down) {
  reader.down(down);
  PointerEvent up = down;
  up.now += 0.1;
  return reader.up(up);
}

TEST(Gesture, aLeftDragOrbitsByWhatThePointerMoves) {
  GestureReader reader;
  reader.down(mouse(100, 100, 0.0));
  EXPECT_TRUE(reader.move(mouse(102, 100, 0.1)).empty()) << "it may tremble";
  EXPECT_TRUE(reader.move(mouse(110, 100, 0.2)).empty()) << "the drag begins here, without a jump";
  const auto moved = reader.move(mouse(115, 93, 0.3));
  ASSERT_EQ(kinds(moved), Kinds{GestureKind::kOrbit});
  EXPECT_EQ(moved[0].dx, 5.0);
  EXPECT_EQ(moved[0].dy, -7.0);
  EXPECT_TRUE(reader.up(mouse(115, 93, 0.35)).empty()) << "no click";
  EXPECT_TRUE(reader.move(mouse(300, 300, 0.4)).empty()) << "it is up";
}

TEST(Gesture, rightMiddleAndShiftDragsPan) {
  for (const auto& [button, shift] : {std::pair{PointerButton::kRight, false}, std::pair{PointerButton::kMiddle, false},
                                      std::pair{PointerButton::kLeft, true}}) {
    GestureReader reader;
    reader.down(mouse(100, 100, 0.0, button, shift));
    EXPECT_EQ(kinds(reader.move(mouse(110, 100, 0.1))), Kinds{GestureKind::kGrab});
    EXPECT_EQ(kinds(reader.move(mouse(120, 100, 0.2))), Kinds{GestureKind::kPan});
  }
}

TEST(Gesture, aShortStillPressIsAClickAndASecondOneADoubleClick) {
  GestureReader reader;
  EXPECT_EQ(kinds(click(reader, mouse(100, 100, 0.0))), Kinds{GestureKind::kClick});
  EXPECT_EQ(kinds(click(reader, mouse(101, 100, 0.2))), Kinds{GestureKind::kDoubleClick});
  EXPECT_EQ(kinds(click(reader, mouse(101, 100, 0.4))), Kinds{GestureKind::kClick}) << "a third begins anew";
  EXPECT_EQ(kinds(click(reader, mouse(300, 100, 0.6))), Kinds{GestureKind::kClick}) << "elsewhere";
  EXPECT_EQ(kinds(click(reader, mouse(300, 100, 2.0))), Kinds{GestureKind::kClick}) << "later";
  EXPECT_TRUE(click(reader, mouse(100, 100, 5.0, PointerButton::kRight)).empty());
}

TEST(Gesture, aLongPressHasNoEffect) {
  GestureReader reader;
  reader.down(finger(1, 100, 100, 0.0));
  EXPECT_TRUE(reader.up(finger(1, 101, 100, 1.5)).empty());
}

TEST(Gesture, twoFingersPanAndPinchAtOnce) {
  GestureReader reader;
  reader.down(finger(1, 100, 100, 0.0));
  reader.down(finger(2, 200, 100, 0.1));
  const auto grabbed = reader.move(finger(1, 100, 100, 0.2));
  ASSERT_EQ(kinds(grabbed), Kinds{GestureKind::kGrab});
  EXPECT_EQ(grabbed[0].x, 150.0);
  const auto moved = reader.move(finger(2, 300, 120, 0.3));
  ASSERT_EQ(kinds(moved), (Kinds{GestureKind::kPan, GestureKind::kPinch}));
  EXPECT_EQ(moved[0].x, 200.0);
  EXPECT_EQ(moved[0].y, 110.0);
  EXPECT_NEAR(moved[1].factor, std::hypot(200.0, 20.0) / 100.0, 1e-12);

  // When one finger goes, the other may orbit, from where it is and after leaving its circle.
  EXPECT_TRUE(reader.up(finger(2, 300, 120, 0.4)).empty()) << "no click";
  EXPECT_TRUE(reader.move(finger(1, 104, 100, 0.5)).empty());
  EXPECT_TRUE(reader.move(finger(1, 120, 100, 0.6)).empty());
  EXPECT_EQ(kinds(reader.move(finger(1, 125, 100, 0.7))), Kinds{GestureKind::kOrbit});
  EXPECT_TRUE(reader.up(finger(1, 125, 100, 0.8)).empty());
  EXPECT_FALSE(reader.anyDown());
}

TEST(Gesture, fingersOnOneSpotMagnifyWithinReason) {
  GestureReader reader;
  reader.down(finger(1, 100, 100, 0.0));
  reader.down(finger(2, 100, 100, 0.1));
  reader.move(finger(1, 100, 100, 0.2));
  for (const Gesture& gesture : reader.move(finger(2, 140, 100, 0.3)))
    EXPECT_TRUE(gesture.kind != GestureKind::kPinch || gesture.factor <= 10.0);
}

TEST(Gesture, aThirdFingerChangesNothing) {
  GestureReader reader;
  reader.down(finger(1, 100, 100, 0.0));
  reader.down(finger(2, 200, 100, 0.1));
  reader.move(finger(1, 100, 100, 0.2));
  reader.down(finger(3, 500, 500, 0.3));
  const auto moved = reader.move(finger(3, 600, 600, 0.4));
  for (const Gesture& gesture : moved) {
    EXPECT_NE(gesture.kind, GestureKind::kPinch);
    EXPECT_EQ(gesture.x, 150.0);
  }
}

TEST(Gesture, aCancelledPointerIsNoClick) {
  GestureReader reader;
  reader.down(finger(1, 100, 100, 0.0));
  reader.cancel(1);
  EXPECT_TRUE(reader.up(finger(1, 100, 100, 0.1)).empty());
  reader.down(finger(1, 100, 100, 0.2));
  reader.cancelAll();
  EXPECT_FALSE(reader.anyDown());
}

TEST(Gesture, onDenseScreensTheCircleIsAsLargeForTheHand) {
  GestureReader reader;
  reader.setPixelRatio(3.0);
  reader.down(mouse(100, 100, 0.0));
  EXPECT_TRUE(reader.move(mouse(108, 100, 0.1)).empty());
  EXPECT_EQ(kinds(reader.up(mouse(108, 100, 0.2))), Kinds{GestureKind::kClick});
}

// ---- keys by name ----

TEST(Input, flyingKeysAndDigitsGoByPlaceAndLettersByWhatIsPrinted) {
  EXPECT_EQ(keyFromNames("KeyW", "w"), Key::kW);
  EXPECT_EQ(keyFromNames("KeyW", "z"), Key::kW) << "French keyboard";
  EXPECT_EQ(keyFromNames("KeyQ", "a"), Key::kQ);
  EXPECT_EQ(keyFromNames("Semicolon", "m"), Key::kM) << "French keyboard";
  EXPECT_EQ(keyFromNames("KeyM", ","), Key::kPageDown);
  EXPECT_EQ(keyFromNames("KeyF", "F"), Key::kF) << "with shift";
  EXPECT_EQ(keyFromNames("Digit3", "#"), Key::k3) << "with shift";
  EXPECT_EQ(keyFromNames("Digit6", "-"), Key::k6) << "French keyboard";
  EXPECT_EQ(keyFromNames("Numpad0", "0"), Key::k0);
  EXPECT_EQ(keyFromNames("Slash", "?"), Key::kH);
  EXPECT_EQ(keyFromNames("BracketRight", "+"), Key::kPlus) << "German keyboard";
  EXPECT_EQ(keyFromNames("ArrowLeft", "ArrowLeft"), Key::kLeft);
  EXPECT_EQ(keyFromNames("Home", "Home"), Key::kHome);
  EXPECT_EQ(keyFromNames("Tab", "Tab"), Key::kNone);
  EXPECT_EQ(keyFromNames("DigitX", "1x"), Key::kNone);
  EXPECT_EQ(keyFromNames("", ""), Key::kNone);
}

}  // namespace
}  // namespace client
