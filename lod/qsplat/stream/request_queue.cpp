#include "lod/qsplat/stream/request_queue.h"

#include <algorithm>

namespace lod::qsplat {
namespace {

// All that one view wants, but not what is outside of a lens with what is within. A request of two blocks costs a slow
// link little more than one of one, and few requests may be under way: with a sweep of its own for each, a fifth of a
// 384 kbit/s link stood idle.
constexpr float kNearlyAsUrgent = 1e5F;

bool lessUrgent(const WantedBlock& a, const WantedBlock& b) {
  return a.priority != b.priority ? a.priority < b.priority : a.block > b.block;
}
bool byNumber(const WantedBlock& a, const WantedBlock& b) {
  return a.block < b.block;
}

}  // namespace

void RequestQueue::clear() {
  for (const WantedBlock& wanted : heap_)
    if (availability_.state(wanted.block) == BlockState::kWanted) availability_.set(wanted.block, BlockState::kAbsent);
  heap_.clear();
  by_number_.clear();
  ordered_ = false;
}

void RequestQueue::add(const WantedBlock& wanted) {
  if (availability_.state(wanted.block) != BlockState::kAbsent) return;
  availability_.set(wanted.block, BlockState::kWanted);
  heap_.push_back(wanted);
  ordered_ = false;
}

void RequestQueue::order() {
  if (ordered_) return;
  std::make_heap(heap_.begin(), heap_.end(), lessUrgent);
  by_number_ = heap_;
  std::sort(by_number_.begin(), by_number_.end(), byNumber);
  ordered_ = true;
}

bool RequestQueue::joins(std::uint64_t number, float urgent) const {
  if (number >= availability_.blocks() || availability_.state(number) != BlockState::kWanted) return false;
  const auto found = std::lower_bound(by_number_.begin(), by_number_.end(), WantedBlock{number, 0.0F}, byNumber);
  return found->priority >= urgent - kNearlyAsUrgent;
}

BlockRun RequestQueue::take(std::uint64_t most) {
  if (most == 0 || empty()) return {};
  order();

  // The top, past what went along with others. What is in the heap and wanted cannot run out before empty().
  while (availability_.state(heap_.front().block) != BlockState::kWanted) {
    std::pop_heap(heap_.begin(), heap_.end(), lessUrgent);
    heap_.pop_back();
  }
  const WantedBlock top = heap_.front();

  // Its neighbours: first those behind it, where the blocks of its siblings' children are.
  BlockRun run{top.block, 1};
  while (run.count < most && joins(run.first + run.count, top.priority)) ++run.count;
  while (run.count < most && run.first > 0 && joins(run.first - 1, top.priority)) --run.first, ++run.count;
  for (std::uint64_t i = 0; i < run.count; ++i) availability_.set(run.first + i, BlockState::kRequested);
  return run;
}

}  // namespace lod::qsplat
