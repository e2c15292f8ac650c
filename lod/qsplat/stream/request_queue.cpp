#include "lod/qsplat/stream/request_queue.h"

#include <algorithm>

namespace lod::qsplat {
namespace {

// Any two blocks of a view may share a request, but not one inside of a lens with one outside. A request for two blocks
// costs a slow link little more than a request for one, and few may be under way: when blocks of different sweeps were
// kept apart, a fifth of a 384 kbit/s link stood idle.
constexpr float kNearlyAsUrgent = 1e5F;

bool lessUrgent(const WantedBlock& a, const WantedBlock& b) {
  return a.priority != b.priority ? a.priority < b.priority : a.block > b.block;
}
bool byNumber(const WantedBlock& a, const WantedBlock& b) {
  return a.block < b.block;
}

}  // namespace

Availability::Availability(std::uint64_t blocks) : blocks_(blocks), words_((blocks + kPerWord - 1) / kPerWord, 0) {
  counts_[static_cast<std::size_t>(BlockState::kAbsent)] = blocks;
}

void Availability::setState(std::uint64_t number, BlockState state) {
  --counts_[static_cast<std::size_t>(stateOf(number))];
  ++counts_[static_cast<std::size_t>(state)];
  std::uint64_t& word = words_[number / kPerWord];
  word = (word & ~(std::uint64_t{3} << shift(number))) | static_cast<std::uint64_t>(state) << shift(number);
}

std::uint64_t Availability::nextAbsent(std::uint64_t from) const {
  constexpr std::uint64_t kAllPresent = ~std::uint64_t{0};
  while (from < blocks_ && stateOf(from) != BlockState::kAbsent)
    from = from % kPerWord == 0 && words_[from / kPerWord] == kAllPresent ? from + kPerWord : from + 1;
  return from < blocks_ ? from : blocks_;
}

void RequestQueue::clear() {
  for (const WantedBlock& wanted : heap_)
    if (availability_.stateOf(wanted.block) == BlockState::kWanted)
      availability_.setState(wanted.block, BlockState::kAbsent);
  heap_.clear();
  by_number_.clear();
  sorted_ = false;
}

void RequestQueue::add(const WantedBlock& wanted) {
  if (availability_.stateOf(wanted.block) != BlockState::kAbsent) return;
  availability_.setState(wanted.block, BlockState::kWanted);
  heap_.push_back(wanted);
  sorted_ = false;
}

void RequestQueue::sort() {
  if (sorted_) return;
  std::make_heap(heap_.begin(), heap_.end(), lessUrgent);
  by_number_ = heap_;
  std::sort(by_number_.begin(), by_number_.end(), byNumber);
  sorted_ = true;
}

bool RequestQueue::mayJoin(std::uint64_t number, float priority) const {
  if (number >= availability_.blocks() || availability_.stateOf(number) != BlockState::kWanted) return false;
  const auto found = std::lower_bound(by_number_.begin(), by_number_.end(), WantedBlock{number, 0.0F}, byNumber);
  return found->priority >= priority - kNearlyAsUrgent;
}

BlockRun RequestQueue::takeRun(std::uint64_t max_blocks) {
  if (max_blocks == 0 || empty()) return {};
  sort();

  // Skip blocks that were taken as neighbours of others. A wanted one is left, since the queue is not empty.
  while (availability_.stateOf(heap_.front().block) != BlockState::kWanted) {
    std::pop_heap(heap_.begin(), heap_.end(), lessUrgent);
    heap_.pop_back();
  }
  const WantedBlock top = heap_.front();

  // Neighbours join: first those behind it, which hold the children of its nodes' siblings.
  BlockRun run{top.block, 1};
  while (run.count < max_blocks && mayJoin(run.first + run.count, top.priority)) ++run.count;
  while (run.count < max_blocks && run.first > 0 && mayJoin(run.first - 1, top.priority)) --run.first, ++run.count;
  for (std::uint64_t i = 0; i < run.count; ++i) availability_.setState(run.first + i, BlockState::kRequested);
  return run;
}

}  // namespace lod::qsplat
