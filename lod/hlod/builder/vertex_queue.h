#pragma once
// Vertices by the cost of their collapse, cheapest first.
#include <algorithm>
#include <array>
#include <bit>
#include <cstdint>
#include <limits>
#include <vector>

namespace lod::hlod::builder {

/// Costs count up to a sixteenth of an octave. Vertices that are as dear in that sense leave in the order in which they
/// came, so a queue that was filled in the order of vertices goes through memory mostly in order.
class VertexQueue {
 public:
  static constexpr std::uint32_t kNone = std::numeric_limits<std::uint32_t>::max();
  /// Costs of one octave have so many different ranks.
  static constexpr std::uint32_t kRanksPerOctave = 16;

  struct Entry {
    std::uint32_t vertex = kNone;  ///< kNone: the queue is empty
    std::uint32_t rank = 0;
  };

  explicit VertexQueue(std::size_t vertices) : next_(vertices, kNotQueued) { waiting_.fill({kNone, kNone}); }

  bool has(std::uint32_t vertex) const { return next_[vertex] != kNotQueued; }

  /// The vertex must not be in the queue. `cost`: not negative.
  void push(std::uint32_t vertex, float cost) {
    const std::uint32_t rank = rankOf(cost);
    Waiting& waiting = waiting_[rank];
    next_[vertex] = kNone;
    (waiting.first == kNone ? waiting.first : next_[waiting.last]) = vertex;
    waiting.last = vertex;
    least_ = std::min(least_, rank);
  }

  Entry pop() {
    while (least_ < kRanks && waiting_[least_].first == kNone) ++least_;
    if (least_ == kRanks) return {};
    const std::uint32_t vertex = waiting_[least_].first;
    waiting_[least_].first = next_[vertex];
    next_[vertex] = kNotQueued;
    return {vertex, least_};
  }

  static std::uint32_t rankOf(float cost) { return std::bit_cast<std::uint32_t>(cost) >> kDroppedBits; }

 private:
  // A rank is the exponent of a float and four bits of its fraction, which rise with floats that are not negative.
  static constexpr std::uint32_t kDroppedBits = 19;
  static constexpr std::uint32_t kRanks = 1U << (31 - kDroppedBits);
  static constexpr std::uint32_t kNotQueued = kNone - 1;
  struct Waiting {
    std::uint32_t first = kNone, last = kNone;
  };

  std::array<Waiting, kRanks> waiting_;
  std::vector<std::uint32_t> next_;
  std::uint32_t least_ = kRanks;  // no vertex waits below
};

}  // namespace lod::hlod::builder
