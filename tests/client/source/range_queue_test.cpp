#include "client/source/range_queue.h"

#include <gtest/gtest.h>

#include <map>

namespace client {
namespace {

/// Records the requests, and answers with bytes that encode their offsets.
class Recorder final : public RangeFetcher {
 public:
  struct RecordedRequest {
    std::uint64_t id;
    std::string name;
    std::uint64_t offset, length;
  };
  void submit(std::uint64_t id, const std::string& name, std::uint64_t offset, std::uint64_t length) override {
    asked.push_back({id, name, offset, length});
  }
  std::vector<FetchAnswer> takeAnswers() override { return std::exchange(answers, {}); }
  void cancel(std::uint64_t id) override { cancelled.push_back(id); }
  void answer(std::size_t i, std::size_t short_by = 0) {
    FetchAnswer fetched{asked[i].id, FetchOutcome::kBytes, {}, 206, ""};
    for (std::uint64_t k = 0; k + short_by < asked[i].length; ++k)
      fetched.bytes.push_back(static_cast<std::uint8_t>(asked[i].offset + k));
    answers.push_back(fetched);
  }
  std::vector<RecordedRequest> asked;
  std::vector<FetchAnswer> answers;
  std::vector<std::uint64_t> cancelled;
};

RangeWish wish(std::uint64_t key, std::uint64_t offset, std::uint64_t length, const std::string& object = "a") {
  return {1, key, object, offset, length};
}

TEST(RangeQueue, neighboursAreReadInOneRequestAndHandedOutApart) {
  Recorder fetcher;
  RangeQueue queue(fetcher, {.max_requests = 6, .max_bytes = 1000, .max_gap = 10});
  queue.request({wish(1, 100, 20), wish(2, 500, 10), wish(3, 120, 30), wish(4, 85, 10), wish(5, 100, 20, "b")});
  ASSERT_EQ(fetcher.asked.size(), 3U);
  EXPECT_EQ(fetcher.asked[0].offset, 85U);
  EXPECT_EQ(fetcher.asked[0].length, 65U);
  EXPECT_EQ(fetcher.asked[1].offset, 500U);
  EXPECT_EQ(fetcher.asked[2].name, "b");
  fetcher.answer(0);
  const auto arrivals = queue.takeArrivals();
  ASSERT_EQ(arrivals.size(), 3U);
  for (const RangeArrival& arrival : arrivals) {
    ASSERT_EQ(arrival.answer.bytes.size(), arrival.wish.length);
    EXPECT_EQ(arrival.answer.bytes[0], static_cast<std::uint8_t>(arrival.wish.offset));
    EXPECT_FALSE(queue.underWay(1, arrival.wish.key));
  }
}

TEST(RangeQueue, aRequestStaysWithinItsBytes) {
  Recorder fetcher;
  RangeQueue queue(fetcher, {.max_requests = 6, .max_bytes = 100, .max_gap = 0});
  queue.request({wish(1, 0, 60), wish(2, 60, 60), wish(3, 120, 40), wish(4, 1000, 500)});
  ASSERT_EQ(fetcher.asked.size(), 3U);
  EXPECT_EQ(fetcher.asked[0].length, 60U);
  EXPECT_EQ(fetcher.asked[1].length, 100U);
  EXPECT_EQ(fetcher.asked[2].length, 500U) << "one value alone may be larger";
}

TEST(RangeQueue, aRangeUnderWayIsNotRequestedAgain) {
  Recorder fetcher;
  RangeQueue queue(fetcher, {});
  const std::vector<RangeWish> wishes{wish(1, 0, 10), wish(2, 5000, 10)};
  queue.request(wishes);
  queue.request(wishes);
  EXPECT_EQ(fetcher.asked.size(), 2U);
  EXPECT_TRUE(queue.underWay(1, 1));
}

TEST(RangeQueue, theMostUrgentGoFirstAndOnlyAFew) {
  Recorder fetcher;
  RangeQueue queue(fetcher, {.max_requests = 2, .max_bytes = 100, .max_gap = 0});
  queue.request({wish(1, 900, 10), wish(2, 500, 10), wish(3, 100, 10)});
  ASSERT_EQ(fetcher.asked.size(), 2U);
  EXPECT_EQ(fetcher.asked[0].offset, 900U);
  EXPECT_EQ(fetcher.asked[1].offset, 500U);
  fetcher.answer(0);
  queue.takeArrivals();
  queue.request({wish(4, 300, 10), wish(3, 100, 10)});
  ASSERT_EQ(fetcher.asked.size(), 3U);
  EXPECT_EQ(fetcher.asked[2].offset, 300U) << "the list is always the newest";
}

TEST(RangeQueue, aLoneWishHasARequestOfItsOwn) {
  Recorder fetcher;
  RangeQueue queue(fetcher, {});
  RangeWish first = wish(1, 0, 10);
  first.alone = true;
  queue.request({first, wish(2, 10, 10), wish(3, 20, 10)});
  ASSERT_EQ(fetcher.asked.size(), 2U);
  EXPECT_EQ(fetcher.asked[0].length, 10U);
  EXPECT_EQ(fetcher.asked[1].length, 20U);
}

TEST(RangeQueue, aShortAnswerFailsTheWishesThatItLacks) {
  Recorder fetcher;
  RangeQueue queue(fetcher, {});
  queue.request({wish(1, 0, 10), wish(2, 10, 10)});
  fetcher.answer(0, 5);
  const auto arrivals = queue.takeArrivals();
  ASSERT_EQ(arrivals.size(), 2U);
  EXPECT_EQ(arrivals[0].answer.outcome, FetchOutcome::kBytes);
  EXPECT_EQ(arrivals[1].answer.outcome, FetchOutcome::kNetwork);
  EXPECT_TRUE(arrivals[1].answer.bytes.empty());
}

TEST(RangeQueue, anItemThatIsNamedTwiceArrivesOnce) {
  Recorder fetcher;
  RangeQueue queue(fetcher, {});
  queue.request({wish(1, 0, 10), wish(2, 10, 10), wish(1, 0, 10), wish(2, 10, 10)});
  ASSERT_EQ(fetcher.asked.size(), 1U);
  fetcher.answer(0);
  EXPECT_EQ(queue.takeArrivals().size(), 2U);
}

// A request that is under way cannot be overtaken by a more urgent one.
TEST(RangeQueue, noMoreBytesAreUnderWayThanKeepTheLinkBusy) {
  Recorder fetcher;
  RangeQueue queue(fetcher, {});
  std::vector<RangeWish> wishes;
  for (std::uint64_t i = 0; i < 20; ++i) wishes.push_back(wish(i, 100'000 * i, 20'000));
  queue.request(wishes);
  EXPECT_EQ(fetcher.asked.size(), 4U) << "the first three are below 64 KiB";
  // Answers that take 0.1 s each, one by one: 200 kB a second, and 40 kB in twice the time of the first.
  double now = 0.0;
  for (std::size_t i = 0; i < 4; ++i) {
    queue.setTime(now += 0.1);
    fetcher.answer(i);
    queue.takeArrivals();
  }
  queue.request(wishes);
  EXPECT_EQ(fetcher.asked.size(), 6U);
  // Both at once after 0.01 s: 4 MB a second, and 80 kB in twice that time.
  queue.setTime(now += 0.01);
  for (std::size_t i = 4; i < 6; ++i) fetcher.answer(i);
  queue.takeArrivals();
  wishes.clear();
  for (std::uint64_t i = 20; i < 40; ++i) wishes.push_back(wish(i, 100'000 * i, 20'000));
  queue.request(wishes);
  EXPECT_EQ(fetcher.asked.size(), 10U);
}

// Pages say what to ask for next. Behind a full window the link would idle before anything more is known.
TEST(RangeQueue, wishesThatLeadDoNotWaitForOthers) {
  Recorder fetcher;
  RangeQueue queue(fetcher, {});
  std::vector<RangeWish> wishes{wish(0, 0, 70'000), wish(1, 200'000, 1'000)};
  for (std::uint64_t page = 2; page < 12; ++page) {
    wishes.push_back(wish(page, 300'000 + 10'000 * page, 4'096));
    wishes.back().leads = true;
  }
  queue.request(wishes);
  ASSERT_EQ(fetcher.asked.size(), 3U) << "70 kB fill the window; of those that lead 8 KiB are under way";
  EXPECT_EQ(fetcher.asked[1].offset, 320'000U);
  EXPECT_EQ(fetcher.asked[2].offset, 330'000U);
  wishes[1].offset = 324'096;  // a neighbour that does not lead
  fetcher.answer(1);
  queue.takeArrivals();
  queue.request(wishes);
  ASSERT_EQ(fetcher.asked.size(), 4U);
  EXPECT_EQ(fetcher.asked[3].length, 4'096U) << "none joins them";
}

TEST(FetchWindow, isTwiceWhatTheLinkDeliversInTheShortestAnswer) {
  FetchWindow window;
  EXPECT_EQ(window.bytes(), FetchWindow::kFirstBytes);
  window.answered({0.0, 0, true}, {0.05, 50'000});  // 1 MB a second
  EXPECT_EQ(window.bytes(), 100'000U);
  window.answered({0.05, 50'000}, {0.25, 450'000});  // twice as fast, but the answer took longer
  EXPECT_EQ(window.bytes(), 200'000U);
  window.answered({0.25, 450'000}, {0.35, 450'000});  // nothing came
  window.answered({0.35, 450'000}, {0.35, 500'000});  // in no time: the clock was not told
  EXPECT_EQ(window.bytes(), 200'000U);
  window.answered({9.9, 500'000}, {10.0, 501'000});
  EXPECT_EQ(window.bytes(), FetchWindow::kLeastBytes) << "what the link did before is forgotten";
}

// Else the window would grow with the time that answers wait for each other, and that time with the window.
TEST(FetchWindow, answersThatWaitForOthersAddNothing) {
  constexpr double kRate = 100'000.0, kRoundTrip = 0.1;  // bytes a second, seconds
  FetchWindow window;
  double now = 0.3;
  std::uint64_t received = 20'000;
  window.answered({0.0, 0, true}, {now, received});
  for (int i = 0; i < 100; ++i) {
    const std::uint64_t under_way = window.bytes();
    const FetchWindow::Mark sent{now, received};
    now += std::max(kRoundTrip, static_cast<double>(under_way) / kRate);
    window.answered(sent, {now, received += under_way});
    EXPECT_LE(window.bytes(), 50'000U) << "0.15 s more than the first answer took";
  }
  window.answered({now, received, true}, {now + kRoundTrip, received + 1'000});
  EXPECT_LE(window.bytes(), 25'000U) << "an idle link answers sooner";
}

TEST(FetchWindow, aLinkThatAnswersLaterThanBeforeIsKeptBusy) {
  FetchWindow window;
  window.answered({0.0, 0, true}, {0.05, 50'000});
  // Half a minute later the link has the same rate, and takes a second for each answer.
  window.answered({40.0, 50'000, true}, {41.0, 1'050'000});
  EXPECT_EQ(window.bytes(), 1'150'000U);
}

TEST(FetchWindow, tellsHowFastAnswersComeOnceTheyBegin) {
  FetchWindow window;
  EXPECT_EQ(window.rateOnceBegun(), 0.0);
  window.answered({0.0, 0, true}, {0.1, 1'000});
  EXPECT_EQ(window.rateOnceBegun(), 0.0) << "one answer does not tell round trip and rate apart";
  window.answered({0.0, 0, true}, {0.12, 21'000});
  EXPECT_NEAR(window.rateOnceBegun(), 1'050'000.0, 1.0);
  EXPECT_NEAR(window.rate(), 175'000.0, 1.0);
  window.answered({0.12, 21'000, false}, {0.13, 121'000});  // it may have waited for others, or they for it
  EXPECT_NEAR(window.rateOnceBegun(), 1'050'000.0, 1.0);
  window.answered({0.2, 121'000, true}, {0.301, 221'000});
  EXPECT_NEAR(window.rateOnceBegun(), 20'000'000.0, 1.0) << "a millisecond counts as five";
}

TEST(RangeQueue, destructionCancelsRequestsUnderWay) {
  Recorder fetcher;
  { RangeQueue(fetcher, {}).request({wish(1, 0, 10)}); }
  EXPECT_EQ(fetcher.cancelled.size(), 1U);
}

}  // namespace
}  // namespace client
