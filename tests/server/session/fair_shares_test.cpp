#include "server/session/fair_shares.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

namespace server {
namespace {

struct Asker {
  std::uint64_t client;
  std::string address;
  double amount;  // of each of its pieces
};

/// Deals out so many pieces among those who ask all the time, and returns the amounts by client. Of several who were
/// given as little, who waits longest comes next.
std::map<std::uint64_t, double> deal(FairShares& shares, std::vector<Asker> askers, int pieces) {
  std::map<std::uint64_t, double> given;
  for (int i = 0; i < pieces; ++i) {
    auto next = askers.begin();
    for (auto one = askers.begin(); one != askers.end(); ++one)
      if (shares.usedBy(one->client, one->address) < shares.usedBy(next->client, next->address)) next = one;
    shares.charge(next->client, next->address, next->amount);
    given[next->client] += next->amount;
    std::rotate(next, next + 1, askers.end());
  }
  return given;
}

std::vector<Asker> crowdOf(std::uint64_t count) {
  std::vector<Asker> askers;
  for (std::uint64_t client = 1; client <= count; ++client) askers.push_back({client, "crowd", 1.0});
  return askers;
}

TEST(FairShares, clientsGetTheSameAmountsHoweverLargeTheirPiecesAre) {
  FairShares shares;
  const auto given = deal(shares, {{1, "a", 1.0}, {2, "b", 10.0}}, 1100);
  EXPECT_NEAR(given.at(1), given.at(2), 10.0);
}

TEST(FairShares, manyClientsOfAnAddressAreServedAsAFew) {
  FairShares shares;
  auto askers = crowdOf(200);
  askers.push_back({1000, "other", 1.0});
  const auto given = deal(shares, askers, 3400);
  // By clients alone it would be 3400 / 201.
  EXPECT_NEAR(given.at(1000), 3400.0 / (FairQueue::kClientsOfAddress + 1), 10.0);
  for (std::uint64_t client = 1; client <= 200; ++client) EXPECT_NEAR(given.at(client), 16.0, 3.0) << client;
}

TEST(FairShares, fewClientsOfAnAddressAreServedEach) {
  FairShares shares;
  auto askers = crowdOf(4);
  askers.push_back({1000, "other", 1.0});
  EXPECT_NEAR(deal(shares, askers, 1000).at(1000), 200.0, 2.0);
}

TEST(FairShares, idleAddressesSaveUpNothing) {
  FairShares shares;
  deal(shares, {{1, "a", 1.0}, {2, "b", 1.0}}, 20);
  deal(shares, {{1, "a", 1.0}}, 1000);
  const auto given = deal(shares, {{1, "a", 1.0}, {2, "b", 1.0}, {3, "b", 1.0}}, 300);
  EXPECT_NEAR(given.at(1), 100.0, 2.0);
}

TEST(FairShares, remembersABoundedNumber) {
  FairShares shares;
  shares.charge(0, "a0", 1e9);
  for (std::uint64_t client = 1; client < 100'000; ++client) shares.charge(client, "a" + std::to_string(client), 1.0);
  EXPECT_GT(shares.usedBy(0, "a0"), 1e8) << "who was given much is remembered";
}

}  // namespace
}  // namespace server
