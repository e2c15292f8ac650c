#include "client/viewer/statistics.h"

#include <gtest/gtest.h>

#include "client/app/meters.h"
#include "client/source/streamed_hlod.h"
#include "client/source/streamed_splats.h"
#include "client/source/streamed_umbrellas.h"

namespace client {
namespace {

std::string lineOf(const Statistics& statistics, const std::string& name) {
  for (const StatisticsLine& line : statisticsLines(statistics))
    if (line.name == name) return line.value;
  return "";
}

TEST(Statistics, withSplatsBlocksAreCounted) {
  Statistics s;
  s.viewer.streamed.describe = describeSplats;
  s.viewer.streamed.drawn = 123'456;
  s.viewer.streamed.error_px = 1.0F;
  s.viewer.streamed.splats.stream.blocks = 4'000;
  s.viewer.streamed.splats.stream.present = 1'200;
  s.viewer.streamed.splats.stream.requested = 6;
  s.viewer.streamed.splats.stream.wanted = 77;
  s.viewer.accuracy = Accuracy::kFine;
  s.viewer.complete = true;
  EXPECT_EQ(lineOf(s, "picture"), "fine, complete");
  EXPECT_EQ(lineOf(s, "splats"), "123 456, down to 1.0 px");
  s.viewer.streamed.splats.reduction = 2.5F;
  EXPECT_EQ(lineOf(s, "splats"), "123 456, down to 1.0 px, one sample for 2.5 px");
  s.viewer.streamed.splats.reduction = 1.0F;
  s.viewer.streamed.splats.lens_px = 0.5F;
  EXPECT_EQ(lineOf(s, "splats"), "123 456, down to 1.0 px, 0.5 in the glass");
  EXPECT_EQ(lineOf(s, "memory").find("finer"), std::string::npos);
  s.viewer.streamed.limited = true;
  EXPECT_NE(lineOf(s, "memory").find(": a finer picture needs more"), std::string::npos);
  EXPECT_EQ(lineOf(s, "blocks"), "1 200 of 4 000 here, 6 requested, 77 wanted");
  EXPECT_EQ(lineOf(s, "images"), "");
  EXPECT_EQ(lineOf(s, "broken"), "");
  s.viewer.broken = 1;
  s.viewer.last_fault = "block 7 is damaged";
  EXPECT_EQ(lineOf(s, "broken"), "block 7 is damaged");
}

TEST(Statistics, withUmbrellasLeavesAreCounted) {
  Statistics s;
  s.viewer.streamed.describe = describeUmbrellas;
  s.viewer.streamed.error_px = 1.0F;
  s.viewer.streamed.umbrellas.points = 1'234;
  s.viewer.streamed.umbrellas.triangles = 56'789;
  s.viewer.streamed.umbrellas.leaves = 30;
  s.viewer.streamed.umbrellas.stream.leaves = 400;
  s.viewer.streamed.umbrellas.stream.present = 120;
  s.viewer.streamed.umbrellas.stream.lacking = 6;
  EXPECT_EQ(lineOf(s, "umbrellas"), "56 789 triangles, 1 234 points, of 1.0 px");
  EXPECT_EQ(lineOf(s, "leaves"), "30 in view, 120 of 400 here, 6 to be refined");
  EXPECT_EQ(lineOf(s, "blocks"), "");
  s.viewer.streamed.limited = true;
  EXPECT_NE(lineOf(s, "memory").find(": a finer picture needs more"), std::string::npos);
}

TEST(Statistics, withTrianglesAndPointsNodesAreCounted) {
  Statistics s;
  s.viewer.streamed.describe = describeHlod;
  s.viewer.streamed.error_px = 0.5F;
  s.viewer.streamed.hlod.triangles = 56'789;
  s.viewer.streamed.hlod.points = 1'234;
  s.viewer.streamed.hlod.stream.drawn = 30;
  s.viewer.streamed.hlod.stream.nodes = 400;
  s.viewer.streamed.hlod.stream.present = 120;
  s.viewer.streamed.hlod.stream.lacking = 6;
  EXPECT_EQ(lineOf(s, "drawn"), "56 789 triangles, 1 234 points");
  EXPECT_EQ(lineOf(s, "screen error"), "down to 0.50 px");
  EXPECT_EQ(lineOf(s, "nodes"), "30 in view, 120 of 400 here, 6 to be refined");
  EXPECT_EQ(lineOf(s, "leaves"), "");
}

TEST(Statistics, everyFigureStandsInALine) {
  Statistics s;
  s.frames_per_second = 58.0;
  s.frame_milliseconds = 3.25;
  s.viewer.lumigraph.samples_used = 11;
  s.viewer.lumigraph.samples_resident = 22;
  s.viewer.images_requested = 33;
  s.viewer.lumigraph.patches = 44;
  s.viewer.lumigraph.triangles = 1'234'567;
  s.viewer.memory.cache = 3'300'000;
  s.viewer.memory.textures = 9'000'000;
  s.viewer.memory_budget = 50'000'000;
  s.viewer.session.bytes_received = 2'000'000;
  s.megabits_per_second = 4.5;
  s.round_trip_milliseconds = 31.0;
  s.viewer.error_px = 1.75F;
  s.viewer.bound_px = 9.5F;
  s.hit_rate = 0.92;
  s.viewer.accuracy = Accuracy::kBlended;
  EXPECT_EQ(lineOf(s, "picture"), "blended, more on its way");
  EXPECT_EQ(lineOf(s, "frames"), "58 per second, 3.2 ms each");
  EXPECT_EQ(lineOf(s, "images"), "11 in use, 22 resident, 33 requested");
  EXPECT_EQ(lineOf(s, "found here"), "92 % of images");
  EXPECT_EQ(lineOf(s, "patches"), "44, 1 234 567 triangles");
  EXPECT_EQ(lineOf(s, "screen error"), "1.75 px, nowhere above 9.5");
  EXPECT_EQ(lineOf(s, "memory"), "12.3 MB of 50.0 MB");
  EXPECT_EQ(lineOf(s, "graphics"), "9.0 MB of these");
  EXPECT_EQ(lineOf(s, "link"), "4.5 Mbit/s, 31 ms round trip");
  EXPECT_EQ(lineOf(s, "broken"), "") << "only when something is";
  s.viewer.broken = 2;
  s.viewer.last_fault = "patch 3";
  s.viewer.accuracy = Accuracy::kExact;
  s.viewer.complete = true;
  EXPECT_EQ(lineOf(s, "broken"), "2, the last: patch 3");
  EXPECT_EQ(lineOf(s, "picture"), "exact, complete");
}

TEST(RateMeter, countsTheLastSecond) {
  RateMeter meter;
  EXPECT_EQ(meter.perSecond(0.0), 0.0);
  for (int i = 0; i < 30; ++i) meter.add(0.1 * i, 5.0);
  EXPECT_NEAR(meter.perSecond(2.9), 50.0, 5.0);
  EXPECT_EQ(meter.perSecond(4.0), 0.0) << "nothing for a second";
}

TEST(RoundTrip, isTakenFromAViewToTheFirstAnswerOnAQuietLink) {
  RoundTripMeter meter;
  meter.update(1.0, 0, 1);
  meter.update(1.1, 0, 1);
  EXPECT_EQ(meter.seconds(), 0.0);
  meter.update(1.2, 3, 1);
  EXPECT_NEAR(meter.seconds(), 0.2, 1e-12);
}

TEST(RoundTrip, answersToAnOlderViewDoNotCount) {
  RoundTripMeter meter;
  meter.update(1.0, 5, 0);
  meter.update(1.1, 6, 1);  // a message arrived at this time, and one just before
  meter.update(1.15, 7, 1);
  EXPECT_EQ(meter.seconds(), 0.0);
  meter.update(3.0, 7, 2);
  meter.update(3.05, 8, 2);
  EXPECT_NEAR(meter.seconds(), 0.05, 1e-12);
}

}  // namespace
}  // namespace client
