#include "lod/qsplat/stream/stream.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lod::qsplat {
namespace {

// The first request: header and the top of the tree, one round trip for both.
constexpr std::uint64_t kFrontBlocks = 8;
// What comes damaged so often stays so.
constexpr int kMostDamages = 3;
constexpr double kFirstPause = 0.25, kLongestPause = 5.0;  // seconds
// A table's bytes for each block of the file: its place, its last use, two bits of state.
constexpr std::uint64_t kTableBytes = sizeof(void*) + sizeof(std::uint32_t) + 1;
// When memory is full, this part of it goes at a time.
constexpr std::uint64_t kEvictedPart = 64;
// "Near the view": so many times its width and height.
constexpr float kNearby = 1.5F;

bool sameView(const TraverseRequest& a, const TraverseRequest& b) {
  return a.camera.clip_from_eye == b.camera.clip_from_eye && a.camera.eye_from_scene == b.camera.eye_from_scene &&
         a.camera.width == b.camera.width && a.camera.height == b.camera.height && a.cutoff_px == b.cutoff_px &&
         a.section == b.section;
}

// More of the scene at the same size, and what a small turn would show.
TraverseRequest widened(TraverseRequest request) {
  base::Camera& camera = request.camera;
  for (const int axis : {0, 1}) camera.clip_from_eye[axis][axis] /= kNearby;
  camera.width = static_cast<int>(kNearby * static_cast<float>(camera.width));
  camera.height = static_cast<int>(kNearby * static_cast<float>(camera.height));
  request.cull_back_faces = false;
  request.lens.reset();
  return request;
}

std::string inBytes(std::uint64_t bytes) {
  return std::to_string(bytes) + " bytes";
}

}  // namespace

Stream::Stream(std::uint64_t file_bytes, const StreamOptions& options)
    : options_(options),
      file_bytes_(file_bytes),
      most_held_(std::max(options.memory_bytes, kLeastStreamMemory) / kBlockBytes),
      availability_(file_bytes / kBlockBytes <= kMostFilePerMemory * most_held_ ? file_bytes / kBlockBytes : 0),
      queue_(availability_) {
  if (file_bytes < 2 * kBlockBytes || file_bytes % kBlockBytes != 0)
    problem_ = "its " + inBytes(file_bytes) + " are no number of blocks; publish the scene again";
  else if (availability_.blocks() == 0)
    problem_ = "its " + inBytes(file_bytes) + " are too many for " + inBytes(most_held_ * kBlockBytes) +
               " of memory; allow at least " + inBytes(file_bytes / kMostFilePerMemory);
}

// ---- frames ----

void Stream::traverse(const TraverseRequest& request, const std::optional<Lens>& lens, Traversal& result) {
  queue_.clear();
  idle_ = false;
  if (!blocks_) {
    result = {};
    return;
  }
  blocks_->beginFrame(++frame_);
  TraverseRequest ordered = request;
  ordered.lens = lens;
  ordered.priority = priorityFor(options_.order, lens, request.camera.height);
  qsplat::traverse(*blocks_, ordered, result);
  if (result.damaged) giveUp("its groups don't make a tree; copy or build the file again");

  in_use_.reset();
  queueWanted(result.wanted);
  limited_ = lacking_ > 0 && under_way_.empty() && blocksInUse() >= most_held_;
  if (frame_ > 1 && sameView(ordered, view_)) return;
  view_ = std::move(ordered);
  nearby_generation_ = 0;
  front_to_back_ = 0;
  idle_left_ = options_.idle_bytes / kBlockBytes;
}

void Stream::queueWanted(const std::vector<WantedBlock>& wanted) {
  lacking_ = 0;
  for (const WantedBlock& one : wanted) {
    if (isGivenUp(one.block)) continue;
    ++lacking_;
    queue_.add(one);
  }
}

bool Stream::isGivenUp(std::uint64_t number) const {
  const auto found = damages_.find(number);
  return found != damages_.end() && found->second >= kMostDamages;
}

bool Stream::complete() const {
  return problem_.empty() && frame_ > 0 && (lacking_ == 0 || limited_);
}

// ---- what to ask for ----

std::vector<ByteRange> Stream::requests(double now) {
  std::vector<ByteRange> ranges;
  if (!problem_.empty() || now < pause_until_) return ranges;
  while (under_way_.size() < options_.most_requests) {
    const std::uint64_t most =
        std::min(link_.room() / kBlockBytes, std::max<std::uint64_t>(options_.most_request_blocks, 1));
    const BlockRun run = most == 0 ? BlockRun{} : next(most);
    if (run.count == 0) break;
    ranges.push_back(send(run, now));
  }
  return ranges;
}

BlockRun Stream::next(std::uint64_t most) {
  if (!blocks_) {
    if (availability_.state(0) != BlockState::kAbsent) return {};
    const BlockRun front{0, std::min(kFrontBlocks, availability_.blocks())};
    for (std::uint64_t i = 0; i < front.count; ++i) availability_.set(i, BlockState::kRequested);
    return front;
  }
  if (idle_ || queue_.empty()) return nextIdle(std::min(most, freeBlocks()));
  const std::uint64_t taken = blocksInUse() + blocksUnderWay();
  return queue_.take(taken < most_held_ ? std::min(most, most_held_ - taken) : 0);
}

// Only once the view has all that it wants (section 4.4): the surroundings, then the file from its front.
BlockRun Stream::nextIdle(std::uint64_t most) {
  most = std::min(most, idle_left_);
  if (most == 0 || frame_ == 0 || lacking_ > 0) return {};
  idle_ = true;
  if (queue_.empty() && nearby_generation_ != arrivals_) {
    nearby_generation_ = arrivals_;
    qsplat::traverse(*blocks_, widened(view_), nearby_);
    in_use_.reset();
    for (const WantedBlock& one : nearby_.wanted)
      if (!isGivenUp(one.block)) queue_.add(one);
  }
  BlockRun run = queue_.take(most);
  // While some of it is under way, more may come of it.
  if (run.count == 0 && under_way_.empty()) run = nextFromFront(most);
  idle_left_ -= run.count;
  return run;
}

BlockRun Stream::nextFromFront(std::uint64_t most) {
  while ((front_to_back_ = availability_.nextAbsent(front_to_back_)) < availability_.blocks() &&
         isGivenUp(front_to_back_))
    ++front_to_back_;
  BlockRun run{front_to_back_, 0};
  while (run.count < most && run.first + run.count < availability_.blocks() &&
         availability_.state(run.first + run.count) == BlockState::kAbsent && !isGivenUp(run.first + run.count))
    availability_.set(run.first + run.count++, BlockState::kRequested);
  return run;
}

ByteRange Stream::send(const BlockRun& run, double now) {
  const std::uint64_t id = ++counted_.requests;
  under_way_[id] = {run, now};
  link_.sent(run.count * kBlockBytes, now);
  return {id, run.first * kBlockBytes, run.count * kBlockBytes};
}

// ---- what comes ----

void Stream::received(std::uint64_t id, base::ByteView bytes, double now) {
  const auto found = under_way_.find(id);
  if (found == under_way_.end()) return;
  const UnderWay request = found->second;
  if (bytes.size() != request.run.count * kBlockBytes) return failed(id, now);
  under_way_.erase(found);
  link_.came(bytes.size(), bytes.size(), request.sent_at, now);
  counted_.bytes_received += bytes.size();

  bool all_good = true;
  for (std::uint64_t i = 0; i < request.run.count; ++i)
    all_good &= takeBlock(request.run.first + i, bytes.subspan(static_cast<std::size_t>(i * kBlockBytes), kBlockBytes));
  ++arrivals_;
  if (lacking_ > 0 || frame_ == 0) ++generation_;
  if (!all_good) ++counted_.failures;  // the host answers; how often one block is asked for again has its own end
  failures_in_a_row_ = 0;
}

/// False when it is damaged.
bool Stream::takeBlock(std::uint64_t number, base::ByteView block) {
  const bool good = number == 0 ? takeHeader(block) : blocks_ && isBlock(block, static_cast<std::uint32_t>(number));
  if (good && (number == 0 || keep(number, block))) {
    availability_.set(number, BlockState::kPresent);
    return true;
  }
  availability_.set(number, BlockState::kAbsent);
  wasted_ += kBlockBytes;
  if (good || (number > 0 && !blocks_)) return true;  // no place for it; or the header that stands before it is bad
  ++damages_[number];
  return false;
}

bool Stream::takeHeader(base::ByteView block) {
  auto header = readHeader(block);
  if (!header) {
    if (damages_[0] + 1 >= kMostDamages) giveUp(header.error().message);
    return false;
  }
  if (header->file_bytes == file_bytes_) {
    blocks_ = std::make_unique<GrowingBlocks>(*header);
    blocks_->keepUse();
  } else {
    giveUp("has " + inBytes(file_bytes_) + ", but its header says " + std::to_string(header->file_bytes) +
           "; publish the scene again");
  }
  return true;
}

bool Stream::keep(std::uint64_t number, base::ByteView block) {
  if (held_.size() >= most_held_ && !makeRoom()) return false;
  Held held{std::unique_ptr<std::uint8_t[]>(new std::uint8_t[kBlockBytes]), frame_};
  std::copy(block.begin(), block.end(), held.bytes.get());
  blocks_->put(number, held.bytes.get());
  held_[number] = std::move(held);
  if (in_use_) ++*in_use_;
  return true;
}

void Stream::failed(std::uint64_t id, double now) {
  const auto found = under_way_.find(id);
  if (found == under_way_.end()) return;
  const UnderWay request = found->second;
  under_way_.erase(found);
  link_.came(request.run.count * kBlockBytes, 0, request.sent_at, now);
  for (std::uint64_t i = 0; i < request.run.count; ++i) availability_.set(request.run.first + i, BlockState::kAbsent);
  front_to_back_ = std::min(front_to_back_, request.run.first);
  ++arrivals_;
  ++generation_;
  pauseAfterFailure(request.sent_at, now);
}

void Stream::pauseAfterFailure(double sent_at, double now) {
  ++counted_.failures;
  // What was under way when another one failed is the same trouble, and no reason to wait twice as long.
  if (sent_at < paused_at_) return;
  paused_at_ = now;
  const double pause = kFirstPause * std::exp2(std::min(failures_in_a_row_++, 8));
  pause_until_ = now + std::min(pause, kLongestPause);
}

void Stream::giveUp(std::string reason) {
  if (problem_.empty()) problem_ = std::move(reason);
}

// ---- memory ----

std::uint64_t Stream::freeBlocks() const {
  const std::uint64_t taken = held_.size() + blocksUnderWay();
  return taken < most_held_ ? most_held_ - taken : 0;
}

/// What came since the last frame counts as used in it.
std::uint32_t Stream::lastUse(std::uint64_t number, const Held& held) const {
  return std::max(blocks_->lastUse(number), held.arrived);
}

std::uint64_t Stream::blocksInUse() {
  if (held_.size() + blocksUnderWay() + options_.most_request_blocks < most_held_) return held_.size();
  if (!in_use_)
    in_use_ = static_cast<std::uint64_t>(std::count_if(
        held_.begin(), held_.end(), [this](const auto& one) { return lastUse(one.first, one.second) >= frame_; }));
  return *in_use_;
}

/// Frames ask for blocks that are not here, too: only those after its arrival count.
bool Stream::wasDrawn(std::uint64_t number, const Held& held) const {
  return blocks_->lastUse(number) > held.arrived;
}

/// False when all that is kept was looked into in the last frame. Who looks into a block has looked into those above
/// it: so children go before their parents where both were used last in the same frame, and numbers grow downwards.
bool Stream::makeRoom() {
  std::vector<std::pair<std::uint32_t, std::uint64_t>> unused;  // frame, and the number from the end
  for (const auto& [number, held] : held_)
    if (number > 1 && lastUse(number, held) < frame_) unused.emplace_back(lastUse(number, held), ~number);
  if (unused.empty()) return false;
  const std::size_t going =
      std::min<std::size_t>(unused.size(), static_cast<std::size_t>(most_held_ / kEvictedPart + 1));
  std::nth_element(unused.begin(), unused.begin() + static_cast<std::ptrdiff_t>(going - 1), unused.end());
  for (std::size_t i = 0; i < going; ++i) drop(~unused[i].second);
  counted_.evicted += going;
  return true;
}

void Stream::drop(std::uint64_t number) {
  const auto held = held_.find(number);
  if (!wasDrawn(number, held->second)) wasted_ += kBlockBytes;
  blocks_->drop(number);
  held_.erase(held);
  availability_.set(number, BlockState::kAbsent);
  front_to_back_ = std::min(front_to_back_, number);
}

// ---- figures ----

std::string Stream::warning() const {
  std::uint64_t lost = 0, first = 0;
  for (const auto& [number, times] : damages_) {
    if (times < kMostDamages) continue;
    first = lost++ == 0 ? number : std::min(first, number);
  }
  if (lost == 0) return "";
  return "block " + std::to_string(first) + (lost > 1 ? " and " + std::to_string(lost - 1) + " more are" : " is") +
         " damaged: checksum does not match; publish the scene again";
}

StreamStats Stream::stats() const {
  StreamStats stats = counted_;
  stats.blocks = availability_.blocks();
  stats.present = availability_.count(BlockState::kPresent);
  stats.requested = availability_.count(BlockState::kRequested);
  stats.wanted = availability_.count(BlockState::kWanted);
  for (const auto& [number, times] : damages_) stats.given_up += times >= kMostDamages ? 1 : 0;
  stats.memory_bytes = held_.size() * kBlockBytes + (blocks_ ? availability_.blocks() * kTableBytes : 0);
  stats.bytes_per_second = link_.bytesPerSecond();
  return stats;
}

std::uint64_t Stream::bytesWasted() const {
  std::uint64_t bytes = wasted_;
  for (const auto& [number, held] : held_)
    if (!wasDrawn(number, held)) bytes += kBlockBytes;
  return bytes;
}

}  // namespace lod::qsplat
