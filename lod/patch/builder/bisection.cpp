#include "lod/patch/builder/bisection.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <limits>
#include <span>

namespace lod::patch::builder {
namespace {

// With four starts, cuts of voxel graphs are as short as METIS makes them; with three they are a hundredth longer.
constexpr std::size_t kStarts = 4;
constexpr std::size_t kMaxPasses = 6;  // most graphs need two or three

// The cost of a division: weight beyond the limits, then the length of the cut, then the distance from the target.
struct Cost {
  std::int64_t excess = 0;
  std::int64_t cut = 0;
  std::int64_t off_target = 0;
  auto operator<=>(const Cost&) const = default;
};

class Bisection {
 public:
  Bisection(const Graph& graph, const BisectionTarget& target)
      : graph_(graph),
        target_(target),
        size_(static_cast<std::uint32_t>(graph.size())),
        sign_(size_),
        gain_(size_),
        degree_(size_, 0),
        near_{std::vector<std::uint32_t>(size_ + 1), std::vector<std::uint32_t>(size_ + 1)},
        order_(size_ + 1),
        seen_(size_),
        fruitless_moves_(std::max(12U, size_ / 14)) {
    for (std::uint32_t v = 0; v < size_; ++v) {
      total_ += graph.vertex_weights[v];
      forEachNeighbor(v, [&](std::uint32_t, std::int32_t w) { degree_[v] += w; });
    }
  }

  std::vector<std::int32_t> run() {
    std::vector<std::int32_t> best;
    Cost best_cost;
    // Starts lie far from each other: each is the last vertex to be reached from those before it.
    std::array<std::uint32_t, kStarts> starts{};
    breadthFirst(std::span(starts).first(1));
    for (std::size_t s = 0; s < kStarts; ++s) {
      starts[s] = order_[size_ - 1];
      breadthFirst(std::span(starts).subspan(s, 1));
      grow();
      for (std::size_t pass = 0; pass < kMaxPasses && refine(); ++pass) continue;
      if (best.empty() || cost() < best_cost) best = sign_, best_cost = cost();
      if (s > 0) breadthFirst(std::span(starts).first(s + 1));
    }
    for (std::int32_t& s : best) s = s < 0 ? 0 : 1;
    return best;
  }

 private:
  // Calls body(neighbour, weight of the edge).
  template <class Body>
  void forEachNeighbor(std::uint32_t v, Body&& body) const {
    const std::int32_t* neighbors = graph_.neighbors.data();
    const std::int32_t* weights = graph_.edge_weights.data();
    const std::int32_t end = graph_.row[v + 1];
    for (std::int32_t e = graph_.row[v]; e < end; ++e) body(static_cast<std::uint32_t>(neighbors[e]), weights[e]);
  }

  // Lists all vertices in order_, those nearest to `from` first. Other components follow by number.
  void breadthFirst(std::span<const std::uint32_t> from) {
    std::fill(seen_.begin(), seen_.end(), 0);
    std::uint8_t* seen = seen_.data();
    std::uint32_t* order = order_.data();
    std::uint32_t count = 0;
    // No branch could predict whether a vertex is new.
    const auto add = [&](std::uint32_t v) {
      order[count] = v;
      count += 1U - seen[v];
      seen[v] = 1;
    };
    for (const std::uint32_t v : from) add(v);
    std::uint32_t unseen = 0;
    for (std::uint32_t next = 0; next < size_; ++next) {
      while (next == count) add(unseen++);
      forEachNeighbor(order[next], [&](std::uint32_t u, std::int32_t) { add(u); });
    }
  }

  // The first vertices of order_ become side 0.
  void grow() {
    std::fill(sign_.begin(), sign_.end(), 1);
    left_ = 0;
    for (std::uint32_t i = 0; i + 1 < size_ && (i == 0 || left_ < target_.weight); ++i) {
      sign_[order_[i]] = -1;
      left_ += graph_.vertex_weights[order_[i]];
    }
    std::int64_t sum = 0;
    for (std::uint32_t v = 0; v < size_; ++v) {
      std::int32_t within = 0;
      forEachNeighbor(v, [&](std::uint32_t u, std::int32_t w) { within += w * sign_[u]; });
      gain_[v] = -within * sign_[v];
      sum += degree_[v] + gain_[v];  // twice the weight of the edges to the other side
    }
    cut_ = sum / 4;
  }

  Cost cost() const {
    if (left_ == 0 || left_ == total_)
      return {std::numeric_limits<std::int64_t>::max(), cut_, 0};  // an empty side is worse than any weight
    return {std::max<std::int64_t>({0, left_ - target_.max, target_.min - left_}), cut_,
            std::abs(left_ - target_.weight)};
  }

  // Moves the vertex to the other side.
  void move(std::uint32_t v) {
    const std::int32_t from = sign_[v];
    cut_ -= gain_[v];
    left_ += from * graph_.vertex_weights[v];
    sign_[v] = -from;
    gain_[v] = -gain_[v];
    std::int32_t* gain = gain_.data();
    const std::int32_t* sign = sign_.data();
    forEachNeighbor(v, [&](std::uint32_t u, std::int32_t w) { gain[u] += 2 * w * from * sign[u]; });
  }

  // Makes one pass. Each vertex moves once at most, from the side that is too heavy, the one that shortens the cut the
  // most first; then the pass goes back to its best division. False when that is the one it started from.
  bool refine() {
    findNear();
    moved_.clear();
    Cost best = cost();
    std::size_t kept = 0;
    while (moved_.size() < kept + fruitless_moves_) {
      const std::size_t from = left_ > target_.weight ? 0 : 1;
      if (near_count_[from] == 0) break;
      const std::uint32_t v = takeBestVertex(from);
      move(v);
      forEachNeighbor(v, [&](std::uint32_t u, std::int32_t) { addNear(u); });
      moved_.push_back(v);
      if (const Cost now = cost(); now < best) best = now, kept = moved_.size();
    }
    for (; moved_.size() > kept; moved_.pop_back()) move(moved_.back());
    return kept > 0;
  }

  void findNear() {
    near_count_ = {0, 0};
    std::fill(seen_.begin(), seen_.end(), 0);
    for (std::uint32_t v = 0; v < size_; ++v)
      if (gain_[v] != -degree_[v]) addNear(v);
  }

  void addNear(std::uint32_t v) {
    const std::size_t side = sign_[v] < 0 ? 0 : 1;
    near_[side][near_count_[side]] = v;
    near_count_[side] += 1U - seen_[v];
    seen_[v] = 1;
  }

  static constexpr std::int64_t kPlaces = std::int64_t{1} << 32;
  std::uint32_t takeBestVertex(std::size_t side) {
    std::uint32_t* near = near_[side].data();
    std::uint32_t& count = near_count_[side];
    const std::int32_t* gain = gain_.data();
    // Gain and place make one number, so the greatest is found without branches.
    std::int64_t best = std::numeric_limits<std::int64_t>::min();
    for (std::uint32_t i = 0; i < count; ++i) best = std::max(best, std::int64_t{gain[near[i]]} * kPlaces + i);
    const auto at = static_cast<std::uint32_t>(best & (kPlaces - 1));
    const std::uint32_t v = near[at];
    near[at] = near[--count];
    return v;
  }

  const Graph& graph_;
  const BisectionTarget target_;
  const std::uint32_t size_;
  std::vector<std::int32_t> sign_;    // −1: side 0, 1: side 1
  std::vector<std::int32_t> gain_;    // how much shorter the cut is once the vertex has changed sides
  std::vector<std::int32_t> degree_;  // weight of the vertex's edges
  std::int64_t cut_ = 0;
  std::int64_t left_ = 0;  // weight of side 0
  std::int64_t total_ = 0;
  // During a pass: the vertices of each side at the cut that have not moved yet, and those that have.
  std::array<std::vector<std::uint32_t>, 2> near_;
  std::array<std::uint32_t, 2> near_count_{};
  std::vector<std::uint32_t> moved_;
  std::vector<std::uint32_t> order_;
  std::vector<std::uint8_t> seen_;
  const std::uint32_t fruitless_moves_;  // a pass ends after this many moves without a better division
};

}  // namespace

std::vector<std::int32_t> bisect(const Graph& graph, const BisectionTarget& target) {
  return Bisection(graph, target).run();
}

}  // namespace lod::patch::builder
