#include "server/session/frame_schedule.h"

#include <gtest/gtest.h>

namespace server {
namespace {

constexpr double kDiagonal = 100.0;
constexpr double kRoundTrip = 0.04;

/// A schedule whose link has the assumed rate, 1 MB/s, and a viewer who moves along x.
struct Driven {
  FrameSchedule schedule{kDiagonal};
  std::uint64_t before = 0;  // bytes that have gone through already
  double now = 0.0;
  std::uint32_t sequence = 0;

  void at(double seconds, std::uint64_t unsent = 0) {
    now = seconds;
    schedule.link().update({seconds, unsent, 0, kRoundTrip}, before + unsent);
    schedule.passTime();
  }
  /// Lets the link be measured at its rate; ends at 0.3 s with nothing under way.
  void measure() {
    constexpr std::uint64_t kWaiting = 100'000;
    for (std::uint64_t i = 0; i <= 20; ++i)
      schedule.link().update({0.01 * static_cast<double>(i), kWaiting, 0, kRoundTrip}, 10'000 * i + kWaiting);
    before = 200'000 + kWaiting;
    at(0.3);
  }
  void view(double x, int quality = 85) {
    protocol::View view;
    view.sequence = ++sequence;
    view.camera.position = {x, 0.0, 5.0};
    view.camera.width = 640;
    view.camera.height = 360;
    view.frame_quality = static_cast<std::uint8_t>(quality);
    view.want_frame = true;
    schedule.accept(std::make_shared<const protocol::View>(view), true);
  }
  /// Renders and answers the request, which takes so long.
  void render(const FrameRequest& request, double seconds, std::size_t bytes) {
    at(now + seconds);
    schedule.rendered(request, bytes);
  }
  /// Views every 1/30 s, `speed` units a second, with a frame of the first view and none of the others; ends at the
  /// last view.
  void move(int views, double speed = 1.0) {
    for (int i = 0; i < views; ++i) {
      at(i / 30.0);
      view(speed * now);
      if (i == 0) schedule.rendered(*schedule.next(false), 20'000);
    }
  }
};

// ---- an eye that stands ----

TEST(FrameSchedule, aFreshViewsFrameIsRequestedAtOnceAndIsTheLastWhenItHasTheWantedQuality) {
  Driven driven;
  driven.view(0.0);
  const auto request = driven.schedule.next(false);
  ASSERT_TRUE(request);
  EXPECT_EQ(request->quality, 85);
  EXPECT_TRUE(request->last);
  driven.render(*request, 0.03, 50'000);
  EXPECT_FALSE(driven.schedule.next(false));
  EXPECT_FALSE(driven.schedule.next(true)) << "nothing is left to improve";
}

TEST(FrameSchedule, aLinkTooSlowForTheWantedQualityGetsAQuickFrameAndTheLastOneAtTheEnd) {
  Driven driven;
  driven.view(0.0, 95);
  driven.schedule.rendered(*driven.schedule.next(false), 500'000);
  driven.at(1.0);
  driven.view(0.0, 95);
  const auto quick = driven.schedule.next(false);
  ASSERT_TRUE(quick);
  EXPECT_LT(quick->quality, 95);
  EXPECT_FALSE(quick->last);
  driven.render(*quick, 0.03, 300'000);
  EXPECT_FALSE(driven.schedule.next(false)) << "other things are unsent";
  EXPECT_TRUE(driven.schedule.owesFrame());
  const auto last = driven.schedule.next(true);
  ASSERT_TRUE(last);
  EXPECT_EQ(last->quality, 95);
  EXPECT_TRUE(last->last);
  driven.render(*last, 0.03, 500'000);
  EXPECT_FALSE(driven.schedule.owesFrame());
}

TEST(FrameSchedule, aLastFrameThatTheLinkCarriesSoonGoesAheadOfTheOthers) {
  for (const bool soon : {true, false}) {
    Driven driven;
    driven.at(0.0);
    driven.view(0.0, 95);
    const auto quick = driven.schedule.next(false);
    ASSERT_TRUE(quick && !quick->last);
    driven.render(*quick, 0.03, soon ? 20'000 : 150'000);
    const auto last = driven.schedule.next(false);
    ASSERT_EQ(last.has_value(), soon);
    EXPECT_TRUE(!last || last->last);
  }
}

TEST(FrameSchedule, aLastFrameThatTakesLongGoesOnceTheEyeHasStoodForAWhile) {
  Driven driven;
  driven.at(0.0);
  driven.view(0.0, 95);
  const auto quick = driven.schedule.next(false);
  ASSERT_TRUE(quick && !quick->last);
  driven.render(*quick, 0.03, 200'000);  // of the link's 1 MB/s; better ones take more
  ASSERT_FALSE(driven.schedule.next(false));
  const auto wake = driven.schedule.wakeAt();
  ASSERT_TRUE(wake);
  EXPECT_GT(*wake, 0.3);
  EXPECT_LT(*wake, 3.0);
  driven.at(*wake - 0.01);
  EXPECT_FALSE(driven.schedule.next(false));
  driven.at(*wake + 0.001);
  const auto better = driven.schedule.next(false);
  ASSERT_TRUE(better) << "though other things are unsent";
  EXPECT_GT(better->quality, quick->quality);
  EXPECT_LT(better->quality, 95) << "not more than twice the bytes";
  EXPECT_FALSE(better->last);
  driven.render(*better, 0.03, 350'000);

  driven.at(3.5);
  const auto last = driven.schedule.next(false);
  ASSERT_TRUE(last);
  EXPECT_TRUE(last->last);
  EXPECT_EQ(last->quality, 95);
}

// A slow link that is taken for a fast one is full for seconds before anybody knows.
TEST(FrameSchedule, untilTheLinkIsKnownNoMoreIsHandedOutThanItTakes) {
  FrameSchedule schedule{kDiagonal};
  const auto link = [&](double seconds, std::uint64_t unsent, std::uint64_t on_the_way, std::uint64_t handed_out) {
    schedule.link().update({seconds, unsent, on_the_way, kRoundTrip}, handed_out);
  };
  link(0.0, 0, 0, 200);
  protocol::View view;
  view.sequence = 1;
  view.camera.position = {0.0, 0.0, 5.0};
  view.camera.width = 640;
  view.camera.height = 360;
  view.want_frame = true;
  schedule.accept(std::make_shared<const protocol::View>(view), true);
  const auto quick = schedule.next(false);
  ASSERT_TRUE(quick);
  link(0.03, 0, 200, 400);
  schedule.rendered(*quick, 10'000);
  link(0.031, 3'000, 14'000, 17'400);
  EXPECT_TRUE(schedule.linkIsFull()) << "something waits";
  EXPECT_FALSE(schedule.next(false)) << "the better frame waits for the rate";
  ASSERT_TRUE(schedule.wakeAt());
  EXPECT_LT(*schedule.wakeAt(), 0.1);
  link(0.1, 0, 12'000, 17'400);
  EXPECT_FALSE(schedule.linkIsFull());
  EXPECT_FALSE(schedule.next(false));
  link(0.2, 0, 0, 40'000);
  EXPECT_TRUE(schedule.next(false)) << "more went through than a slow link would have carried unnoticed";
}

/// How long after the last of six jumps, so many seconds apart, its quick frame is requested.
double quickFrameAfterJumps(double seconds_apart) {
  Driven driven;
  for (int i = 0; i < 6; ++i) {
    driven.at(i * seconds_apart);
    driven.view(100.0 * i);
    if (i == 5) break;
    if (const auto quick = driven.schedule.next(false)) driven.render(*quick, 0.03, 60'000);
  }
  const double jumped = driven.now;
  while (!driven.schedule.next(false) && driven.now < jumped + 5.0) driven.at(driven.now + 0.01);
  return driven.now - jumped;
}

// Where the link takes 0.06 s for a frame, one every quarter of a second would hardly be seen.
TEST(FrameSchedule, anEyeThatJumpsSoonAgainGetsAFrameOnceItHasStayedForLonger) {
  EXPECT_EQ(quickFrameAfterJumps(2.0), 0.0);
  const double after = quickFrameAfterJumps(0.2);
  EXPECT_GE(after, 0.19);
  EXPECT_LE(after, 0.22);
}

TEST(FrameSchedule, aFasterLinkGetsABetterQuickFrame) {
  int quality[2];
  for (const bool fast : {false, true}) {
    Driven driven;
    std::uint64_t handed_out = 0;
    for (int i = 0; i < 100; ++i) {
      handed_out += fast ? 30'000 : 3'000;
      driven.schedule.link().update({0.01 * i, 50'000, 0, kRoundTrip}, handed_out + 50'000);
    }
    driven.now = 1.0;
    driven.view(0.0, 95);
    quality[fast ? 1 : 0] = driven.schedule.next(false)->quality;
  }
  EXPECT_GT(quality[1], quality[0] + 20);
}

TEST(FrameSchedule, oneIsUnderWayAtATimeAndTheNewestViewComesNext) {
  Driven driven;
  driven.view(0.0);
  const auto first = driven.schedule.next(false);
  ASSERT_TRUE(first);
  driven.at(0.3);
  driven.view(0.0);  // after a pause nothing is waited for
  const auto second = driven.schedule.next(false);
  ASSERT_TRUE(second);
  for (int i = 0; i < 5; ++i) driven.view(0.01 * i);
  EXPECT_FALSE(driven.schedule.next(false));
  driven.schedule.rendered(*first, 1000);
  EXPECT_FALSE(driven.schedule.next(false)) << "the second is still being rendered";
  driven.schedule.rendered(*second, 1000);
  EXPECT_EQ(driven.schedule.next(false)->sequence, 7U);
}

TEST(FrameSchedule, aFailedFrameIsNotAskedForAgain) {
  Driven driven;
  driven.view(0.0);
  driven.schedule.rendered(*driven.schedule.next(false), 0);
  EXPECT_FALSE(driven.schedule.next(true));
  EXPECT_FALSE(driven.schedule.owesFrame());
}

TEST(FrameSchedule, withoutFramesNothingWaits) {
  FrameSchedule schedule(kDiagonal);
  protocol::View view;
  view.sequence = 1;
  schedule.accept(std::make_shared<const protocol::View>(view), false);
  EXPECT_FALSE(schedule.next(true));
  EXPECT_FALSE(schedule.owesFrame());
  schedule.countOther(10'000'000);
  EXPECT_FALSE(schedule.holdsOthers());
  EXPECT_FALSE(schedule.wakeAt());
}

TEST(FrameSchedule, othersLeaveTheLinkFreeForTheFrameThatIsBeingRendered) {
  Driven driven;
  driven.measure();
  driven.view(0.0);
  const auto request = driven.schedule.next(false);
  ASSERT_TRUE(request);
  driven.at(0.301);
  EXPECT_FALSE(driven.schedule.holdsOthers()) << "an idle link is used";
  driven.at(0.302, 90'000);
  EXPECT_TRUE(driven.schedule.holdsOthers());
  EXPECT_GT(driven.schedule.wakeAt().value_or(0.0), driven.now);
  driven.schedule.rendered(*request, 50'000);
  EXPECT_FALSE(driven.schedule.holdsOthers());
}

// All that is queued is ahead of a new view's frame.
TEST(FrameSchedule, othersWaitBehindATenthOfASecondOfTheLinkWithAndWithoutFrames) {
  for (const bool frames : {true, false}) {
    Driven driven;
    driven.measure();
    if (frames) {
      driven.view(0.0);
      driven.schedule.rendered(*driven.schedule.next(false), 50'000);
    }
    driven.at(0.31, 80'000);
    EXPECT_FALSE(driven.schedule.linkIsFull());
    EXPECT_FALSE(driven.schedule.holdsOthers());
    driven.at(0.32, 150'000);  // at 1 MB/s
    EXPECT_TRUE(driven.schedule.linkIsFull());
    EXPECT_TRUE(driven.schedule.holdsOthers());
    const auto wake = driven.schedule.wakeAt();
    ASSERT_TRUE(wake);
    EXPECT_GT(*wake, driven.now);
    EXPECT_LT(*wake, driven.now + 0.2);
  }
}

// Its server is not to be woken hundreds of times a second.
TEST(FrameSchedule, aPeerThatTakesNothingIsSeldomLookedAt) {
  FrameSchedule schedule{kDiagonal};
  for (int i = 0; i <= 300; ++i) schedule.link().update({0.01 * i, 50'000, 10'000, 1e-4}, 60'000);
  ASSERT_TRUE(schedule.linkIsFull());
  ASSERT_TRUE(schedule.wakeAt());
  EXPECT_GT(*schedule.wakeAt(), 3.1);
}

// Many viewers on a server with too much to do would each have it look hundreds of times a second.
TEST(FrameSchedule, aPeerOfWhomNothingIsKnownIsLookedAtEverLessOftenWhileItTakesNothing) {
  FrameSchedule schedule{kDiagonal};
  const auto waitAt = [&](double seconds) {
    schedule.link().update({seconds, 20'000, 10'000, 1e-4}, 30'000);
    EXPECT_TRUE(schedule.linkIsFull());
    EXPECT_FALSE(schedule.link().isMeasured());
    return schedule.wakeAt().value_or(0.0) - seconds;
  };
  EXPECT_NEAR(waitAt(0.001), 0.002, 1e-9);
  EXPECT_NEAR(waitAt(0.2), 0.05, 1e-9);
  EXPECT_NEAR(waitAt(0.8), 0.2, 1e-9);
  schedule.link().update({0.81, 20'000, 10'000, 1e-4}, 35'000);  // it took some
  EXPECT_NEAR(schedule.wakeAt().value_or(0.0) - 0.81, 0.002, 1e-9);
}

TEST(FrameSchedule, aTransportThatTellsWhenItHasWrittenIsNotWokenForRoom) {
  FrameSchedule schedule{kDiagonal};
  schedule.link().update({0.1, 20'000, 10'000, 0.04}, 30'000);
  ASSERT_TRUE(schedule.linkIsFull());
  EXPECT_TRUE(schedule.wakeAt());
  EXPECT_FALSE(schedule.wakeAt(true));
}

// Ten segments go in the first round trip: what waits behind them costs the frame another one.
TEST(FrameSchedule, othersThatWouldDelayTheFirstFrameWaitWhileItIsRendered) {
  Driven driven;
  driven.at(0.0);
  driven.view(0.0);
  const auto request = driven.schedule.next(false);
  ASSERT_TRUE(request);
  EXPECT_FALSE(driven.schedule.holdsOthers(10'000.0));
  EXPECT_TRUE(driven.schedule.holdsOthers(20'000.0));
  driven.at(0.3);
  EXPECT_FALSE(driven.schedule.holdsOthers(20'000.0)) << "nothing waits for a frame that is overdue";
  driven.at(0.301, 30'000);
  EXPECT_TRUE(driven.schedule.holdsOthers()) << "a short queue keeps the link busy";
}

// ---- larger frames ----

constexpr std::uint32_t kManyPixels = 4'000'000;

/// The frame of an eye that has moved for a third of a second, whose first frame had so many bytes.
std::optional<FrameRequest> movingFrame(Driven& driven, std::uint32_t most_pixels, std::size_t bytes, int quality = 95,
                                        double render_seconds = 0.03, double speed = 1.0) {
  driven.schedule.setMostPixels(most_pixels);
  for (int i = 0; i < 10; ++i) {
    driven.at(std::max(driven.now, i / 30.0));
    driven.view(speed * driven.now, quality);
    if (i == 0) driven.render(*driven.schedule.next(false), render_seconds, bytes);
  }
  return driven.schedule.next(false);
}

TEST(FrameSchedule, aMovingEyesFrameHasMorePixelsWhereTheLinkCarriesThem) {
  Driven driven;
  const auto frame = movingFrame(driven, kManyPixels, 10'000);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->camera.width, 960);
  EXPECT_EQ(frame->camera.height, 540);
  // Its bytes and its time are not those of one of the view's size.
  driven.render(*frame, 0.06, 18'000);
  for (int i = 10; i < 15; ++i) {
    driven.at(std::max(driven.now, i / 30.0));
    driven.view(driven.now, 95);
  }
  const auto next = driven.schedule.next(false);
  ASSERT_TRUE(next);
  EXPECT_EQ(next->camera.width, 960);
  EXPECT_GE(next->quality, frame->quality);
}

TEST(FrameSchedule, aFrameHasNoMorePixelsThanItsViewWhereThatCostsMoreThanItBrings) {
  const struct {
    const char* why;
    std::uint32_t most_pixels;
    std::size_t bytes;
    int quality;
    double render_seconds;
  } cases[] = {{"the link needs all of it for the view's own", kManyPixels, 60'000, 95, 0.03},
               {"the client has no room", 0, 10'000, 95, 0.03},
               {"the client has room for the view's own", 640 * 360, 10'000, 95, 0.03},
               {"less quality is asked for", kManyPixels, 10'000, 60, 0.03},
               {"the renderer is slow", kManyPixels, 10'000, 95, 0.9}};
  for (const auto& one : cases) {
    Driven driven;
    const auto frame = movingFrame(driven, one.most_pixels, one.bytes, one.quality, one.render_seconds);
    ASSERT_TRUE(frame) << one.why;
    EXPECT_EQ(frame->camera.width, 640) << one.why;
    EXPECT_EQ(frame->camera.height, 360) << one.why;
  }
}

TEST(FrameSchedule, aFastEyesFrameHasTheViewsPixels) {
  for (const double speed : {1.0, 100.0}) {
    Driven driven;
    const auto frame = movingFrame(driven, kManyPixels, 10'000, 95, 0.03, speed);
    ASSERT_TRUE(frame);
    EXPECT_EQ(frame->camera.width > 640, speed < 10.0) << speed;
  }
}

TEST(FrameSchedule, aFrameHasAsManyPixelsAsTheClientHasRoomFor) {
  Driven driven;
  const auto frame = movingFrame(driven, 360'000, 10'000);
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->camera.width, 800);
  EXPECT_LE(frame->camera.width * frame->camera.height, 360'000);
}

TEST(FrameSchedule, aFrameOfAnEyeAtRestHasTheViewsPixels) {
  Driven driven;
  driven.schedule.setMostPixels(kManyPixels);
  driven.at(0.0);
  driven.view(0.0, 95);
  EXPECT_EQ(driven.schedule.next(false)->camera.width, 640);
}

// ---- frames without loss ----

constexpr int kWithoutLoss = base::ViewDefaults::kWithoutLoss;
constexpr int kWanted = base::ViewDefaults::kFrameWebpQuality;

/// A view whose quality the server chooses, for a client that decodes WebP; its quick frame has so many bytes.
void quickOfServersChoice(Driven& driven, std::size_t bytes) {
  driven.schedule.setCodec(protocol::FrameCodec::kWebp);
  driven.at(driven.now);
  driven.view(0.0, protocol::kServersChoice);
  const auto quick = driven.schedule.next(false);
  EXPECT_TRUE(quick && !quick->last);
  EXPECT_LE(quick->quality, kWanted);
  driven.render(*quick, 0.03, bytes);
}

/// Whether the request is for a view's last frame, of this quality.
bool isLast(const std::optional<FrameRequest>& request, int quality) {
  return request && request->last && request->quality == quality;
}

TEST(FrameSchedule, anEyeThatStandsGetsAFrameOfTheWantedQualityAndThenOneWithoutLoss) {
  for (const std::size_t bytes : {5'000, 40'000, 120'000}) {
    Driven driven;
    quickOfServersChoice(driven, bytes);
    const auto wanted = driven.schedule.next(true);
    ASSERT_TRUE(wanted) << bytes;
    EXPECT_EQ(wanted->quality, kWanted);
    EXPECT_FALSE(wanted->last);
    driven.render(*wanted, 0.0, bytes);
    EXPECT_FALSE(driven.schedule.next(true)) << "the eye has stood no longer than the frame takes";
    const auto wake = driven.schedule.wakeAt();
    ASSERT_TRUE(wake);
    EXPECT_LT(*wake, 1.1) << "so that the view is exact within two seconds";
    driven.at(*wake + 0.001);
    const auto last = driven.schedule.next(false);
    EXPECT_TRUE(isLast(last, kWithoutLoss)) << "though other things are unsent";
    driven.render(*last, 0.03, 10 * bytes);
    EXPECT_FALSE(driven.schedule.next(true));
    EXPECT_FALSE(driven.schedule.owesFrame());
  }
}

// As where a renderer is slow.
TEST(FrameSchedule, anEyeThatHasStoodForLongGetsTheFrameWithoutLossAtOnce) {
  Driven driven;
  quickOfServersChoice(driven, 5'000);
  driven.at(1.0);
  EXPECT_TRUE(isLast(driven.schedule.next(false), kWithoutLoss));
}

TEST(FrameSchedule, aLinkThatTakesLongForItGetsNoFrameWithoutLoss) {
  Driven driven;
  quickOfServersChoice(driven, 400'000);
  driven.at(5.0);
  EXPECT_TRUE(isLast(driven.schedule.next(true), kWanted));
}

// A client waits for the last frame of its view, so one must come even where the link's rate was overestimated.
TEST(FrameSchedule, aViewWhoseFrameWithoutLossWouldTakeTooLongAfterAllHasALastFrame) {
  Driven driven;
  driven.schedule.setCodec(protocol::FrameCodec::kWebp);
  driven.at(0.0);
  driven.view(0.0, protocol::kServersChoice);
  driven.schedule.rendered(*driven.schedule.next(false), 4'000);
  driven.at(1.0);
  driven.view(0.0, protocol::kServersChoice);
  const auto quick = driven.schedule.next(false);
  ASSERT_TRUE(quick);
  EXPECT_EQ(quick->quality, kWanted);
  EXPECT_FALSE(quick->last);
  driven.render(*quick, 0.03, 300'000);
  driven.at(9.0);
  EXPECT_TRUE(isLast(driven.schedule.next(true), kWanted));
}

TEST(FrameSchedule, whatFramesWithoutLossTakeIsLearned) {
  Driven driven;
  quickOfServersChoice(driven, 5'000);
  driven.at(1.0);
  driven.render(*driven.schedule.next(false), 0.03, 3'000'000);  // far more than scans have
  driven.at(10.0);
  driven.view(0.0, protocol::kServersChoice);
  EXPECT_TRUE(isLast(driven.schedule.next(true), kWanted));
}

TEST(FrameSchedule, aQualityThatIsAskedForAndJpegHaveNoFrameWithoutLoss) {
  for (const bool webp : {true, false}) {
    Driven driven;
    driven.schedule.setCodec(webp ? protocol::FrameCodec::kWebp : protocol::FrameCodec::kJpeg);
    driven.at(0.0);
    driven.view(0.0, webp ? 95 : protocol::kServersChoice);
    bool last = false;
    while (!last) {
      const auto request = driven.schedule.next(true);
      ASSERT_TRUE(request);
      EXPECT_LE(request->quality, 95);
      driven.render(*request, 0.03, 1'000);
      last = request->last;
    }
  }
}

// ---- an eye that moves ----

TEST(FrameSchedule, aMovingEyesFrameIsAimedAtWhenItArrives) {
  double ahead[2];
  for (const bool slow : {false, true}) {
    Driven driven;
    driven.move(10);
    for (int i = 0; slow && i < 20; ++i) {  // a renderer that takes 0.1 s
      const auto request = driven.schedule.next(false);
      driven.at(driven.now + 0.1);
      if (request) driven.schedule.rendered(*request, 20'000);
      driven.view(driven.now);
    }
    const auto request = driven.schedule.next(false);
    ASSERT_TRUE(request);
    EXPECT_EQ(request->sequence, driven.sequence);
    EXPECT_FALSE(request->last);
    ahead[slow ? 1 : 0] = request->camera.position.x - driven.now;
  }
  EXPECT_GT(ahead[0], kRoundTrip + 0.02) << "a round trip and 20 kB";
  EXPECT_LT(ahead[0], 0.2);
  EXPECT_GT(ahead[1], ahead[0] + 0.07);
  EXPECT_LT(ahead[1], 0.4);
}

TEST(FrameSchedule, aJumpIsNotExtrapolatedAndWaitsForNoFrame) {
  Driven driven;
  driven.move(10);
  ASSERT_TRUE(driven.schedule.next(false));
  driven.at(driven.now + 0.03);
  driven.view(500.0);
  const auto request = driven.schedule.next(false);
  ASSERT_TRUE(request);
  EXPECT_EQ(request->camera.position.x, 500.0);
  EXPECT_FALSE(driven.schedule.isUseful(base::ViewCamera())) << "from where the eye was before";
}

TEST(FrameSchedule, aFrameOfAnotherSectionIsOfNoUse) {
  Driven driven;
  driven.view(0.0);
  base::ViewCamera camera;
  camera.position = {0.0, 0.0, 5.0};
  EXPECT_TRUE(driven.schedule.isUseful(camera));
  camera.section = base::SectionPlane{};
  EXPECT_FALSE(driven.schedule.isUseful(camera));
}

TEST(FrameSchedule, aMovingEyesViewGetsOneFrame) {
  Driven driven;
  driven.move(10);
  const auto request = driven.schedule.next(false);
  driven.render(*request, 0.01, 20'000);
  EXPECT_FALSE(driven.schedule.next(false));
  driven.view(driven.now);
  EXPECT_TRUE(driven.schedule.next(false));
}

TEST(FrameSchedule, aMovingEyesFramesLeaveTheBestQualityToTheEyeThatStands) {
  Driven driven;
  driven.move(10);
  driven.view(driven.now, 95);
  const auto aimed = driven.schedule.next(true);
  ASSERT_TRUE(aimed);
  EXPECT_LE(aimed->quality, 90) << "although the link would carry more";
  driven.render(*aimed, 0.03, 5'000);
  driven.at(driven.now + 1.0);
  EXPECT_EQ(driven.schedule.next(true)->quality, 95);
}

TEST(FrameSchedule, anEyeThatStopsGetsTheFrameOfItsOwnView) {
  Driven driven;
  driven.move(10);
  const double stopped = driven.now;
  const auto aimed = driven.schedule.next(true);
  ASSERT_TRUE(aimed);
  driven.render(*aimed, 0.03, 20'000);
  EXPECT_FALSE(driven.schedule.next(true));
  const auto wake = driven.schedule.wakeAt();
  ASSERT_TRUE(wake);
  driven.at(*wake + 0.2);
  const auto exact = driven.schedule.next(true);
  ASSERT_TRUE(exact);
  EXPECT_EQ(exact->camera.position.x, stopped);
  EXPECT_TRUE(exact->last);
}

TEST(FrameSchedule, anEyeIsFastThatGoesAThirdOfTheDiagonalInASecond) {
  Driven driven;
  driven.move(10, 0.8 * 0.33 * kDiagonal);
  EXPECT_FALSE(driven.schedule.eyeIsFast());
  Driven fast;
  fast.move(10, 1.2 * 0.33 * kDiagonal);
  EXPECT_TRUE(fast.schedule.eyeIsFast());
  fast.at(fast.now + 0.5);
  EXPECT_FALSE(fast.schedule.eyeIsFast()) << "it stands";
}

TEST(FrameSchedule, framesWaitUntilTheLinkHasTakenTheLast) {
  Driven driven;
  driven.measure();
  driven.move(10);
  driven.at(driven.now + 0.001, 500'000);
  EXPECT_FALSE(driven.schedule.next(false));
  ASSERT_TRUE(driven.schedule.wakeAt());
  EXPECT_LT(*driven.schedule.wakeAt(), driven.now + 0.6);
  driven.at(driven.now + 0.01, 10'000);
  EXPECT_TRUE(driven.schedule.next(false));
}

/// The bytes of other messages in two seconds of 1 MB/s while the eye moves and each frame has so many.
std::size_t othersBeside(std::size_t frame_bytes) {
  Driven driven;
  driven.move(10);
  EXPECT_FALSE(driven.schedule.holdsOthers());
  std::size_t others = 0;
  for (int i = 0; i < 60; ++i) {
    driven.at(driven.now + 1.0 / 30.0);
    driven.view(driven.now);
    if (const auto request = driven.schedule.next(false)) driven.schedule.rendered(*request, frame_bytes);
    for (; !driven.schedule.holdsOthers(); others += 10'000) driven.schedule.countOther(10'000);
  }
  return others;
}

TEST(FrameSchedule, whileTheEyeMovesOthersHaveThreeQuartersOfTheLinkAndMoreWhereFramesTakeLong) {
  const std::size_t beside_small = othersBeside(40'000), beside_large = othersBeside(250'000);
  EXPECT_GT(beside_small, 1'400'000U);
  EXPECT_LT(beside_small, 1'700'000U);
  EXPECT_GT(beside_large, beside_small + 200'000U);
  EXPECT_LT(beside_large, 2'000'000U);
}

// A viewer nearby is not asked after each message whether it took that.
TEST(FrameSchedule, aLinkThatTookMuchIsNotFullOfLittle) {
  FrameSchedule schedule(1.0);
  schedule.link().update({1.0, 0, 0, 0.001}, 1'000'000);
  schedule.link().update({1.1, 60'000, 0, 0.001}, 1'060'000);
  EXPECT_FALSE(schedule.linkIsFull());
  schedule.link().update({1.1, 70'000, 0, 0.001}, 1'070'000);
  EXPECT_TRUE(schedule.linkIsFull());
}

}  // namespace
}  // namespace server
