// The order in which vertices leave the queue.
#include "lod/hlod/builder/vertex_queue.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <set>

namespace {

using lod::hlod::builder::VertexQueue;

TEST(HlodVertexQueue, theCheapestLeaveFirstWhateverComesInBetween) {
  constexpr std::uint32_t kVertices = 500;
  std::mt19937 random(4);
  std::uniform_real_distribution<float> exponent(-30.0F, 60.0F);
  std::uniform_int_distribution<std::uint32_t> number(0, kVertices - 1);
  VertexQueue queue(kVertices);
  std::multiset<std::uint32_t> ranks;
  std::size_t popped = 0;
  const auto pop = [&] {
    const VertexQueue::Entry entry = queue.pop();
    if (ranks.empty()) {
      EXPECT_EQ(entry.vertex, VertexQueue::kNone);
      return;
    }
    EXPECT_EQ(entry.rank, *ranks.begin());
    EXPECT_FALSE(queue.has(entry.vertex));
    ranks.erase(ranks.begin());
    ++popped;
  };
  for (int step = 0; step < 20000; ++step) {
    const std::uint32_t vertex = number(random);
    if (step % 3 == 0 || queue.has(vertex)) {
      pop();
      continue;
    }
    const float cost = step % 11 == 0 ? 0.0F : std::exp2(exponent(random));
    queue.push(vertex, cost);
    EXPECT_TRUE(queue.has(vertex));
    ranks.insert(VertexQueue::rankOf(cost));
  }
  while (!ranks.empty()) pop();
  pop();
  EXPECT_GT(popped, 5000U);
}

TEST(HlodVertexQueue, ranksRiseWithCostsAndTellCostsASixteenthApart) {
  EXPECT_EQ(VertexQueue::rankOf(8.0F), VertexQueue::rankOf(4.0F) + VertexQueue::kRanksPerOctave);
  float cost = 1e-20F;
  for (std::uint32_t rank = VertexQueue::rankOf(cost); cost < 1e20F; cost *= 1.0625F) {
    EXPECT_GE(VertexQueue::rankOf(cost), rank);
    rank = VertexQueue::rankOf(cost);
    EXPECT_GT(VertexQueue::rankOf(1.07F * cost), rank);
  }
}

TEST(HlodVertexQueue, equalCostsLeaveInTheirOrder) {
  VertexQueue queue(6);
  for (const std::uint32_t vertex : {3U, 1U, 5U}) queue.push(vertex, 2.0F);
  queue.push(0, 7.0F);
  EXPECT_EQ(queue.pop().vertex, 3U);
  queue.push(4, 2.0F);
  for (const std::uint32_t vertex : {1U, 5U, 4U, 0U}) EXPECT_EQ(queue.pop().vertex, vertex);
}

}  // namespace
