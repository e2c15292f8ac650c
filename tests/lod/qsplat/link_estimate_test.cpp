#include "lod/link_estimate.h"

#include <gtest/gtest.h>

#include <deque>

namespace lod::qsplat {
namespace {

struct Link {
  double bytes_per_second, delay;  // delay: both ways together, seconds
};

/// Requests as much as the estimate allows, at most six requests at a time, until `end`. Returns the most bytes that
/// were under way in the second half.
std::uint64_t keepBusy(LinkEstimate& estimate, const Link& link, double& now, double end) {
  struct Request {
    std::uint64_t bytes;
    double sent, due;
  };
  std::deque<Request> requests;
  const double begin = now;
  double free_at = now;
  std::uint64_t most = 0;
  for (; now < end; now += 0.002) {
    while (!requests.empty() && requests.front().due <= now) {
      estimate.recordAnswer(requests.front().bytes, requests.front().bytes, requests.front().sent, now);
      requests.pop_front();
    }
    while (requests.size() < 6 && estimate.roomForRequest() >= 1024) {
      const std::uint64_t bytes = estimate.roomForRequest() / 1024 * 1024;
      estimate.recordRequest(bytes, now);
      free_at = std::max(free_at, now + 0.5 * link.delay) + static_cast<double>(bytes) / link.bytes_per_second;
      requests.push_back({bytes, now, free_at + 0.5 * link.delay});
    }
    if (now > 0.5 * (begin + end)) most = std::max(most, estimate.bytesUnderWay());
  }
  for (const Request& request : requests)
    estimate.recordAnswer(request.bytes, request.bytes, request.sent, now = request.due);
  return most;
}

TEST(LinkEstimateTest, keepsLinksBusyAndAsksForLittleMoreThanTheyHold) {
  for (const Link& link : {Link{48e3, 0.1}, Link{48e3, 0.3}, Link{6e5, 0.04}, Link{2.5e6, 0.03}, Link{2e4, 0.01}}) {
    LinkEstimate estimate;
    double now = 100.0;
    const std::uint64_t most = keepBusy(estimate, link, now, 130.0);
    EXPECT_NEAR(estimate.bytesPerSecond() / link.bytes_per_second, 1.0, 0.15) << link.bytes_per_second;
    EXPECT_LE(static_cast<double>(most), std::max(link.bytes_per_second * 0.8, 8192.0)) << link.bytes_per_second;
    EXPECT_EQ(estimate.bytesUnderWay(), 0U);
  }
}

TEST(LinkEstimateTest, followsALinkThatChangesAndForgetsSilence) {
  LinkEstimate estimate;
  double now = 0.0;
  keepBusy(estimate, {1e6, 0.02}, now, 10.0);
  now += 60.0;
  EXPECT_NEAR(estimate.bytesPerSecond(), 1e6, 2e5);
  keepBusy(estimate, {5e4, 0.2}, now, 100.0);
  EXPECT_NEAR(estimate.bytesPerSecond(), 5e4, 1e4);
  keepBusy(estimate, {1e6, 0.02}, now, 130.0);
  EXPECT_NEAR(estimate.bytesPerSecond(), 1e6, 2e5);
}

TEST(LinkEstimateTest, aNewLinkIsGivenAFewBlocks) {
  const LinkEstimate estimate;
  EXPECT_EQ(estimate.maxBytesUnderWay(), 8192U);
  EXPECT_EQ(estimate.roomForRequest(), 2048U);
  EXPECT_EQ(estimate.bytesPerSecond(), 0.0);
}

}  // namespace
}  // namespace lod::qsplat
