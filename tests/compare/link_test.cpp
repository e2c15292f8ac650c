// Tests the simulated link: what a connection carries, when, and that seeds decide alone.
#include <gtest/gtest.h>

#include <map>
#include <vector>

#include "compare/sim/fetcher.h"
#include "compare/sim/link.h"

namespace {

using compare::LinkProfile;
using compare::Pipe;
using compare::Wire;

LinkProfile linkOf(const std::string& text) {
  const auto link = compare::parseLink(text);
  EXPECT_TRUE(link) << (link ? "" : link.error().message);
  return link ? *link : LinkProfile{};
}

// Plays until the pipe is quiet or `until`, and returns when each message arrived.
std::vector<double> arrivals(Pipe& pipe, double until = 1000.0) {
  std::vector<double> times;
  for (double now = pipe.nextEvent(); now <= until; now = pipe.nextEvent()) {
    pipe.advance(now);
    while (pipe.take(now)) times.push_back(now);
  }
  return times;
}

double secondsFor(const std::string& link, std::size_t bytes, std::uint64_t seed = 1) {
  Pipe pipe(std::make_shared<Wire>(linkOf(link)), seed);
  pipe.send(base::Bytes(bytes), 0.0);
  const auto times = arrivals(pipe);
  EXPECT_EQ(times.size(), 1U);
  return times.empty() ? 0.0 : times.front();
}

TEST(Link, isReadFromRateRoundTripJitterAndLoss) {
  const LinkProfile link = linkOf("5Mbit/60ms/20ms/1%");
  EXPECT_DOUBLE_EQ(link.bytes_per_second, 625'000.0);
  EXPECT_DOUBLE_EQ(link.round_trip_seconds, 0.06);
  EXPECT_DOUBLE_EQ(link.jitter_seconds, 0.02);
  EXPECT_DOUBLE_EQ(link.loss, 0.01);
  for (const char* wrong : {"", "20Mbit", "20Mbit/40ms/1ms/1%/2", "0Mbit/40ms", "fast/40ms", "20Mbit/x",
                            "20Mbit/40ms/1ms/60%", "20Mbit/40ms/1ms/1"}) {
    const auto refused = compare::parseLink(wrong);
    ASSERT_FALSE(refused) << wrong;
    EXPECT_NE(refused.error().message.find("20Mbit/40ms"), std::string::npos) << refused.error().message;
  }
}

TEST(Link, carriesAMegabyteAtItsRateAndHalfARoundTripLater) {
  const double on_the_wire = 1e6 * (1500.0 / 1460.0) / 1e6;
  EXPECT_NEAR(secondsFor("8Mbit/0ms", 1'000'000), on_the_wire, 0.001);
  EXPECT_NEAR(secondsFor("384kbit/100ms", 1460), 1500.0 / 48'000.0 + 0.05, 1e-9);
}

TEST(Link, startsWithTenSegmentsAndDoublesEachRoundTrip) {
  // On a link that takes no time to fill, rounds of 10, 20 and 40 segments arrive half, one and a half and two and a
  // half round trips after the begin.
  EXPECT_NEAR(secondsFor("100Gbit/100ms", 10 * 1460), 0.05, 1e-4);
  EXPECT_NEAR(secondsFor("100Gbit/100ms", 11 * 1460), 0.15, 1e-4);
  EXPECT_NEAR(secondsFor("100Gbit/100ms", 30 * 1460), 0.15, 1e-4);
  EXPECT_NEAR(secondsFor("100Gbit/100ms", 31 * 1460), 0.25, 1e-4);
}

TEST(Link, deliversWholeMessagesInTheirOrder) {
  Pipe pipe(std::make_shared<Wire>(linkOf("5Mbit/60ms/20ms/5%")), 7);
  for (std::uint8_t i = 0; i < 50; ++i) pipe.send(base::Bytes(5000, i), 0.0);
  std::uint8_t next = 0;
  for (double now = pipe.nextEvent(); now < 1000.0; now = pipe.nextEvent()) {
    pipe.advance(now);
    while (const auto message = pipe.take(now)) EXPECT_EQ(*message, base::Bytes(5000, next++));
  }
  EXPECT_EQ(next, 50);
  EXPECT_EQ(pipe.deliveredBytes(), 250'000U);
  EXPECT_EQ(pipe.unsentBytes(), 0U);
}

TEST(Link, losesTimeToLossAndTheSameTimeForTheSameSeed) {
  const double whole = secondsFor("5Mbit/60ms", 2'000'000);
  const double lossy = secondsFor("5Mbit/60ms/0ms/2%", 2'000'000, 3);
  EXPECT_GT(lossy, 1.2 * whole);
  EXPECT_EQ(lossy, secondsFor("5Mbit/60ms/0ms/2%", 2'000'000, 3));
  EXPECT_NE(lossy, secondsFor("5Mbit/60ms/0ms/2%", 2'000'000, 4));
}

TEST(Link, ofATrainCarriesNothingInATunnel) {
  Pipe pipe(std::make_shared<Wire>(linkOf("train")), 1);
  for (int i = 0; i < 40; ++i) pipe.send(base::Bytes(1'000'000), 0.0);
  const auto times = arrivals(pipe);
  ASSERT_EQ(times.size(), 40U);
  EXPECT_GT(times.back(), 19.0);
  for (const double tunnel : {3.0, 18.0})
    for (const double time : times) EXPECT_FALSE(time > tunnel + 0.05 && time < tunnel + 5.0) << time;
}

TEST(Link, ofTwoConnectionsIsShared) {
  const auto wire = std::make_shared<Wire>(linkOf("8Mbit/10ms"));
  Pipe one(wire, 1), two(wire, 2);
  one.send(base::Bytes(500'000), 0.0);
  two.send(base::Bytes(500'000), 0.0);
  double now = 0.0, last = 0.0;
  while ((now = std::min(one.nextEvent(), two.nextEvent())) < 1000.0) {
    one.advance(now);
    two.advance(now);
    if (one.take(now)) last = now;
    if (two.take(now)) last = now;
  }
  EXPECT_NEAR(last, 1500.0 / 1460.0, 0.05);
}

// Plays until nothing happens any more, and returns each answer's id and size with the time when it came.
std::map<std::uint64_t, std::pair<double, std::size_t>> answersOf(compare::SimulatedFetcher& fetcher) {
  std::map<std::uint64_t, std::pair<double, std::size_t>> answers;
  for (double now = fetcher.nextEvent(); now < 1000.0; now = fetcher.nextEvent()) {
    fetcher.advance(now);
    for (const client::FetchAnswer& answer : fetcher.takeAnswers()) {
      EXPECT_EQ(answer.outcome, client::FetchOutcome::kBytes);
      EXPECT_FALSE(answers.contains(answer.id));
      answers[answer.id] = {now, answer.bytes.size()};
    }
  }
  return answers;
}

/// A host with one object. `file` outlives the function.
compare::ReadObject hostOf(const base::Bytes& file) {
  return [&file](const std::string&, std::uint64_t offset, std::uint64_t length) -> base::Result<base::Bytes> {
    if (offset > file.size() || length > file.size() - offset)
      return base::Error{base::ErrorCode::kInvalidInput, "the file ends before"};
    const base::ByteView range = base::ByteView(file).subspan(offset, length);
    return base::Bytes(range.begin(), range.end());
  };
}

TEST(Fetcher, readsRangesOverSixConnectionsThatOpenWhenTheyAreNeeded) {
  base::Bytes file(1'000'000);
  for (std::size_t i = 0; i < file.size(); ++i) file[i] = static_cast<std::uint8_t>(i % 251);
  compare::SimulatedFetcher fetcher(hostOf(file), linkOf("1Gbit/100ms"), 1);
  for (std::uint64_t id = 0; id < 7; ++id) fetcher.submit(id, "file", 1000 * id, 500);
  const auto answers = answersOf(fetcher);
  ASSERT_EQ(answers.size(), 7U);
  // The first six take a round trip for the handshake and one for the answer, the seventh one more.
  for (std::uint64_t id = 0; id < 6; ++id) EXPECT_NEAR(answers.at(id).first, 0.2, 0.001) << id;
  EXPECT_NEAR(answers.at(6).first, 0.3, 0.001);
  EXPECT_EQ(answers.at(6).second, 500U);
  EXPECT_EQ(fetcher.requests(), 7U);
  EXPECT_EQ(fetcher.deliveredBytes(), 7U * 800U);
}

TEST(Fetcher, answersWithTheBytesOfTheRangeAndNotAfterACancel) {
  base::Bytes file(1000);
  file[700] = 42;
  compare::SimulatedFetcher fetcher(hostOf(file), linkOf("1Gbit/10ms"), 1);
  fetcher.submit(1, "file", 700, 1);
  fetcher.submit(2, "file", 0, 10);
  fetcher.submit(3, "file", 999, 2);
  fetcher.cancel(2);
  std::map<std::uint64_t, client::FetchAnswer> answers;
  for (double now = fetcher.nextEvent(); now < 10.0; now = fetcher.nextEvent()) {
    fetcher.advance(now);
    for (auto& answer : fetcher.takeAnswers()) answers[answer.id] = answer;
  }
  ASSERT_EQ(answers.size(), 2U);
  EXPECT_EQ(answers[1].bytes, base::Bytes{42});
  EXPECT_EQ(answers[3].outcome, client::FetchOutcome::kTooShort);
}

}  // namespace
