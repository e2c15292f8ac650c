#include "client/viewer/whole_frame.h"

#include <gtest/gtest.h>

#include <vector>

namespace client {
namespace {

using Frames = std::vector<std::uint64_t>;

TEST(WholeFrame, comesInWithinItsTimeAndThenStays) {
  WholeFrame frame;
  frame.update(Frames{}, true, true, true, 0.0);
  EXPECT_FALSE(frame.shown().has_value());
  float before = 0.0F;
  for (int i = 0; i <= 10; ++i) {
    frame.update(Frames{7}, false, true, true, 1.0 + 0.1 * i * WholeFrame::kFadeSeconds);
    EXPECT_EQ(frame.shown(), 7U);
    EXPECT_GE(frame.opacity(), before);
    before = frame.opacity();
    EXPECT_NE(frame.whole(), frame.fading());
  }
  frame.update(Frames{7}, false, true, true, 1.001 + WholeFrame::kFadeSeconds);
  EXPECT_TRUE(frame.whole());
}

TEST(WholeFrame, isShownAtOnceWhereNothingFades) {
  WholeFrame frame;
  frame.update(Frames{7}, true, true, false, 3.0);
  EXPECT_TRUE(frame.whole());
}

TEST(WholeFrame, takesThePlaceOfACoarsePictureAtOnceAndStays) {
  WholeFrame frame;
  frame.update(Frames{7}, true, false, true, 3.0);
  EXPECT_TRUE(frame.whole());
  frame.update(Frames{7}, false, true, true, 3.01);
  EXPECT_TRUE(frame.whole()) << "the blended picture became good below it";
  frame.update(Frames{7, 8}, false, false, true, 4.0);
  EXPECT_TRUE(frame.fading()) << "the older frame is worth to come in over";
}

TEST(WholeFrame, goesAtOnceWhenTheViewMovesAndComesBackFromTheStart) {
  WholeFrame frame;
  frame.update(Frames{7}, true, true, false, 3.0);
  frame.update(Frames{}, true, true, true, 3.1);
  EXPECT_FALSE(frame.shown().has_value());
  frame.update(Frames{7}, true, true, true, 3.2);
  EXPECT_FLOAT_EQ(frame.opacity(), 0.0F);
  EXPECT_FALSE(frame.under().has_value()) << "the blended picture lies below it";
}

TEST(WholeFrame, aNewerOneComesInOverTheOlder) {
  WholeFrame frame;
  frame.update(Frames{7}, true, true, false, 3.0);
  frame.update(Frames{7, 8}, false, true, true, 4.0);
  EXPECT_EQ(frame.shown(), 8U);
  EXPECT_EQ(frame.under(), 7U);
  EXPECT_TRUE(frame.fading());
  frame.update(Frames{7, 8}, false, true, true, 4.0 + 2.0 * WholeFrame::kFadeSeconds);
  EXPECT_TRUE(frame.whole());
  EXPECT_FALSE(frame.under().has_value());
}

TEST(WholeFrame, aNewerOneWaitsForAFadeThatRuns) {
  WholeFrame frame;
  frame.update(Frames{7}, true, true, true, 3.0);
  frame.update(Frames{7, 8}, false, true, true, 3.0 + 0.5 * WholeFrame::kFadeSeconds);
  EXPECT_EQ(frame.shown(), 7U);
  frame.update(Frames{7, 8}, false, true, true, 3.0 + 1.5 * WholeFrame::kFadeSeconds);
  EXPECT_EQ(frame.shown(), 7U) << "the fade ends with a picture of its own";
  frame.update(Frames{7, 8}, false, true, true, 3.0 + 1.6 * WholeFrame::kFadeSeconds);
  EXPECT_EQ(frame.shown(), 8U);
}

// Nobody draws a picture once nothing fades.
TEST(WholeFrame, atTheEndOfAFadeThereIsMoreWhereANewerOneWaits) {
  WholeFrame frame;
  frame.update(Frames{7}, false, true, true, 3.0);
  frame.update(Frames{7, 8}, false, true, true, 3.0 + 2.0 * WholeFrame::kFadeSeconds);
  ASSERT_EQ(frame.shown(), 7U);
  ASSERT_TRUE(frame.whole());
  EXPECT_TRUE(frame.fading());
  frame.update(Frames{7, 8}, false, true, true, 4.0);
  frame.update(Frames{7, 8}, false, true, true, 5.0);
  EXPECT_EQ(frame.shown(), 8U);
  EXPECT_FALSE(frame.fading());
}

TEST(WholeFrame, anOlderOneThatIsEvictedLetsNoBlendedPictureThrough) {
  WholeFrame frame;
  frame.update(Frames{7}, true, true, false, 3.0);
  frame.update(Frames{8}, false, true, true, 4.0);
  EXPECT_EQ(frame.shown(), 8U);
  EXPECT_TRUE(frame.whole()) << "evicted before the newer one was here";

  frame.update(Frames{8, 9}, false, true, true, 5.0);
  ASSERT_TRUE(frame.fading());
  frame.update(Frames{9}, false, true, true, 5.0 + 0.5 * WholeFrame::kFadeSeconds);
  EXPECT_EQ(frame.shown(), 9U);
  EXPECT_TRUE(frame.whole()) << "evicted while the newer one came in";
}

}  // namespace
}  // namespace client
