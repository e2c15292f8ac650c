#include "server/session/link_estimate.h"

#include <gtest/gtest.h>

namespace server {
namespace {

/// A transport that always has more to send, over a link of the given rate.
struct BusyLink {
  LinkEstimate estimate;
  double seconds = 0.0, delivered = 0.0;

  void run(double duration, double bytes_per_second) {
    constexpr double kStep = 0.01;
    constexpr std::uint64_t kWaiting = 100'000;
    for (const double end = seconds + duration; seconds < end; seconds += kStep) {
      delivered += kStep * bytes_per_second;
      estimate.update({seconds, kWaiting, 0, 0.04}, static_cast<std::uint64_t>(delivered) + kWaiting);
    }
  }
};

TEST(LinkEstimate, rateIsThatOfAcknowledgementsWhileMoreWaits) {
  BusyLink link;
  EXPECT_EQ(link.estimate.rate(), LinkEstimate::kAssumedRate);
  link.run(1.0, 3e6);
  EXPECT_NEAR(link.estimate.rate(), 3e6, 1e4);
}

TEST(LinkEstimate, aSlowerLinkIsKnownWithinASecond) {
  BusyLink link;
  link.run(1.0, 4e6);
  link.run(1.0, 5e5);
  EXPECT_NEAR(link.estimate.rate(), 5e5, 5e4);
  link.run(0.2, 2e6);
  EXPECT_NEAR(link.estimate.rate(), 2e6, 2e5);
}

// A message of 100 bytes is acknowledged after a round trip, which says nothing about the rate.
TEST(LinkEstimate, aTransportThatHasNothingToSendTellsNoLowerRate) {
  BusyLink link;
  link.run(1.0, 2e6);
  const auto all = static_cast<std::uint64_t>(link.delivered) + 100'000;
  for (int i = 1; i <= 100; ++i) {
    const double seconds = link.seconds + 0.05 * i;
    link.estimate.update({seconds, 0, 100, 0.04}, all + 100U * static_cast<unsigned>(i));
  }
  EXPECT_GT(link.estimate.rate(), 1.9e6);
  EXPECT_LT(link.estimate.rate(), 9e6) << "more than was ever measured is guessed, but not without a limit";
}

/// A viewer takes so much within each round trip of 40 ms, and nothing waits; returns the estimate after so many.
double rateAfter(int round_trips, double bytes_per_second) {
  LinkEstimate estimate;
  std::uint64_t handed_out = 0;
  for (int i = 0; i < round_trips; ++i) {
    const auto sent = static_cast<std::uint64_t>(0.04 * bytes_per_second);
    estimate.update({0.04 * i, 0, sent, 0.04}, handed_out + sent);
    handed_out += sent;
  }
  return estimate.rate();
}

// The link of a moving eye never fills by itself, as the session holds itself to the estimate.
TEST(LinkEstimate, anUnmeasuredLinkCountsAsFasterWithinRoundTripsAsFarAsItIsUsed) {
  EXPECT_GT(rateAfter(6, 1e6), 3e6);
  EXPECT_LT(rateAfter(50, 1e6), 4.5e6);
  EXPECT_GT(rateAfter(50, 4e6), 1e7);
  EXPECT_LT(rateAfter(6, 1e4), 1.4e6) << "little was sent, which tells little";
}

// A router's queue takes all that the server has, so that nothing waits there.
TEST(LinkEstimate, aQueueOnTheWayTellsTheRateTooWhereNothingWaitsHere) {
  LinkEstimate estimate;  // 1 MB/s is assumed
  EXPECT_FALSE(estimate.isKnown());
  constexpr double kRate = 50'000.0, kStep = 0.01;
  double delivered = 0.0;
  std::uint64_t handed_out = 0;
  for (double seconds = 0.0; seconds < 2.0; seconds += kStep) {
    const double confirmed = std::max(0.0, delivered - 0.1 * kRate);
    if (estimate.queueSeconds() < 0.1) handed_out += 4'000;
    estimate.update({seconds, 0, handed_out - static_cast<std::uint64_t>(confirmed), 0.1}, handed_out);
    delivered = std::min(static_cast<double>(handed_out), delivered + kStep * kRate);
  }
  EXPECT_TRUE(estimate.isKnown());
  EXPECT_NEAR(estimate.rate(), kRate, 0.2 * kRate);
}

TEST(LinkEstimate, theRoundTripBeforeTheFirstAcknowledgementTellsNoLowerRate) {
  BusyLink link;
  link.run(1.0, 5e5);
  const auto all = static_cast<std::uint64_t>(link.delivered) + 100'000;
  link.estimate.update({link.seconds + 0.3, 0, 0, 0.04}, all);
  const double before = link.estimate.rate();
  link.estimate.update({link.seconds + 1.0, 80'000, 20'000, 0.04}, all + 100'000);
  link.estimate.update({link.seconds + 1.06, 80'000, 20'000, 0.04}, all + 100'000);
  EXPECT_GE(link.estimate.rate(), before);
}

// A link that takes each message at once is never measured, as nothing waits for it.
TEST(LinkEstimate, aLinkThatTookMuchUnmeasuredHasRoomForAPartOfThat) {
  LinkEstimate estimate;
  estimate.update({1.0, 1'000, 0, 0.001}, 1'000);
  EXPECT_TRUE(estimate.isFullUnmeasured());
  std::uint64_t handed_out = 1'000;
  for (int i = 1; i <= 100; ++i) {
    handed_out += 10'000;
    estimate.update({1.0 + 0.01 * i, 0, 0, 0.001}, handed_out);
  }
  EXPECT_FALSE(estimate.isMeasured());
  estimate.update({2.1, 60'000, 0, 0.001}, handed_out + 60'000);
  EXPECT_FALSE(estimate.isFullUnmeasured());
  estimate.update({2.1, 65'000, 0, 0.001}, handed_out + 65'000);
  EXPECT_TRUE(estimate.isFullUnmeasured());
}

// A proxy takes 16 kB at once whenever its own link has carried as many.
TEST(LinkEstimate, acknowledgementsInBurstsTellTheirMean) {
  LinkEstimate estimate;
  constexpr double kStep = 0.005, kRate = 50'000.0;
  constexpr std::uint64_t kBurst = 16'000;
  std::uint64_t confirmed = 0, handed_out = 0;
  for (int i = 0; i < 1000; ++i) {
    const double seconds = kStep * i;
    if (static_cast<double>(confirmed + kBurst) <= kRate * seconds) confirmed += kBurst;
    handed_out = confirmed + 20'000;
    estimate.update({seconds, handed_out - confirmed, 0, 0.0001}, handed_out);
    if (seconds > 1.0) {
      EXPECT_NEAR(estimate.rate(), kRate, 0.1 * kRate) << seconds;
    }
  }
}

TEST(LinkEstimate, aLinkIsKnownOnceItsStartIsOver) {
  LinkEstimate estimate;
  EXPECT_TRUE(estimate.isIdle());
  estimate.update({0.0, 0, 20'000, 0.04}, 20'000);
  EXPECT_FALSE(estimate.isIdle());
  EXPECT_FALSE(estimate.isKnown());
  estimate.update({0.05, 0, 0, 0.04}, 20'000);
  EXPECT_FALSE(estimate.isKnown());
  estimate.update({0.1, 0, 0, 0.04}, 40'000);
  EXPECT_TRUE(estimate.isKnown());
}

TEST(LinkEstimate, onlyBytesBeyondThoseOfARoundTripQueue) {
  LinkEstimate estimate;  // 1 MB/s
  estimate.update({0.0, 0, 40'000, 0.06}, 40'000);
  EXPECT_NEAR(estimate.queueSeconds(), 0.0, 1e-9) << "a round trip holds as much";
  estimate.update({0.0, 30'000, 60'000, 0.04}, 90'000);
  EXPECT_NEAR(estimate.queueSeconds(), 0.03 + 0.02, 1e-9);
  estimate.update({0.0, 0, 0, 0.08}, 90'000);
  EXPECT_EQ(estimate.roundTrip(), 0.04) << "the shortest counts";
}

TEST(LinkEstimate, tcpBeginsWithFewBytesARoundTripAndAgainAfterAPause) {
  BusyLink link;
  link.run(1.0, 2.5e6);
  const double busy = link.estimate.transferSeconds(100'000.0);
  EXPECT_NEAR(busy, 0.04, 0.002) << "the rate alone counts";

  const auto all = static_cast<std::uint64_t>(link.delivered) + 100'000;
  link.estimate.update({link.seconds + 0.04, 0, 0, 0.04}, all);
  link.estimate.update({link.seconds + 0.14, 0, 0, 0.04}, all);
  EXPECT_NEAR(link.estimate.transferSeconds(100'000.0), busy, 0.002) << "a short pause changes nothing";
  link.estimate.update({link.seconds + 1.0, 0, 0, 0.04}, all);
  EXPECT_NEAR(link.estimate.transferSeconds(10'000.0), 0.004, 0.001) << "the first window holds them";
  EXPECT_NEAR(link.estimate.transferSeconds(100'000.0), 0.08 + (100'000.0 - 3.0 * LinkEstimate::kFirstWindow) / 2.5e6,
              0.003)
      << "14.6 kB, 29.2 kB, then the rest";
}

// 14.6 kB and 29.2 kB in the first two round trips of 0.1 s are no slow link.
TEST(LinkEstimate, theFirstRoundTripsTellNoLowerRate) {
  LinkEstimate estimate;
  estimate.update({0.0, 85'400, 14'600, 0.1}, 100'000);
  estimate.update({0.1, 56'200, 29'200, 0.1}, 100'000);
  estimate.update({0.2, 0, 56'200, 0.1}, 100'000);
  EXPECT_GE(estimate.rate(), LinkEstimate::kAssumedRate);
}

TEST(LinkEstimate, bytesBeyondTheWindowWait) {
  LinkEstimate estimate;  // 1 MB/s
  EXPECT_EQ(estimate.waitSeconds(1e6), 0.0) << "nothing is known of the link";
  estimate.update({0.0, 0, 9'000, 0.04}, 9'000);
  EXPECT_EQ(estimate.waitSeconds(5'000.0), 0.0);
  EXPECT_NEAR(estimate.waitSeconds(20'000.0), 0.0144, 1e-6) << "all but 5600 bytes";
  estimate.update({0.04, 0, 0, 0.04}, 9'000);
  EXPECT_NEAR(estimate.waitSeconds(24'000.0) * estimate.rate(), 400.0, 1.0) << "what was acknowledged widens it";
  estimate.update({0.05, 3'000, 50'000, 0.04}, 62'000);
  EXPECT_NEAR(estimate.waitSeconds(0.0) * estimate.rate(), 3'000.0, 1.0);
}

}  // namespace
}  // namespace server
