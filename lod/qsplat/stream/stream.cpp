#include "lod/qsplat/stream/stream.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace lod::qsplat {
namespace {

// The first request: header and the top of the tree, one round trip for both.
constexpr std::uint64_t kFrontBlocks = 8;
static_assert(kFrontBlocks * kBlockBytes > kMaxCodedHeaderBytes + kMaxCodedBytes);
// What comes damaged so often stays so.
constexpr int kMaxDamages = 3;
constexpr double kFirstPause = 0.25, kLongestPause = 5.0;  // seconds
// A table's bytes for each block of the file: its place, its last use, two bits of state.
constexpr std::uint64_t kTableBytes = sizeof(void*) + sizeof(std::uint32_t) + 1;
// … and of a coded one, its place there.
constexpr std::uint64_t kPlaceBytes = sizeof(std::uint64_t);
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
      most_held_(std::max(options.memory_bytes, kMinStreamMemory) / kBlockBytes),
      availability_(file_bytes / kBlockBytes <= kMaxFilePerMemory * most_held_ ? file_bytes / kBlockBytes : 0),
      queue_(availability_) {
  if (file_bytes < 2 * kBlockBytes || file_bytes % kBlockBytes != 0)
    problem_ = "its " + inBytes(file_bytes) + " are no number of blocks; publish the scene again";
  else if (availability_.blocks() == 0)
    giveUpForMemory(file_bytes);
}

void Stream::giveUpForMemory(std::uint64_t plain_bytes) {
  giveUp("its " + inBytes(plain_bytes) + " are too many for " + inBytes(most_held_ * kBlockBytes) +
         " of memory; allow at least " + inBytes(plain_bytes / kMaxFilePerMemory));
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
  return found != damages_.end() && found->second >= kMaxDamages;
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
        std::min(link_.room() / typicalBlockBytes(), std::max<std::uint64_t>(options_.most_request_blocks, 1));
    const BlockRun run = most == 0 ? BlockRun{} : sideBySide(next(most));
    if (run.count == 0) break;
    ranges.push_back(send(run, now));
  }
  return ranges;
}

/// What room for one more block is: coded ones are shorter.
std::uint64_t Stream::typicalBlockBytes() const {
  return coder_ ? (header()->coded_bytes - header()->header_bytes) / (header()->blocks() - 1) : kBlockBytes;
}

/// In the file; bytes 0: not known.
CodedPlace Stream::placeOf(std::uint64_t number) const {
  return coder_ ? places_->find(number) : CodedPlace{number * kBlockBytes, kBlockBytes};
}

/// Blocks whose parents are here have a place, and stand side by side in the file: else it contradicts itself.
BlockRun Stream::sideBySide(const BlockRun& run) {
  if (!coder_ || run.count == 0) return run;
  std::uint64_t end = placeOf(run.first).offset;
  bool good = true;
  for (std::uint64_t b = run.first; b < run.first + run.count; ++b) {
    const CodedPlace place = placeOf(b);
    good &= place.bytes != 0 && place.offset == end;
    end = place.offset + place.bytes;
  }
  if (good) return run;
  giveUp("its blocks are not where it says; copy or build the file again");
  return {};
}

BlockRun Stream::next(std::uint64_t most) {
  if (!blocks_) {
    if (availability_.state(0) != BlockState::kAbsent) return {};
    const BlockRun front{0, std::min(kFrontBlocks, availability_.blocks())};
    for (std::uint64_t i = 0; i < front.count; ++i) availability_.set(i, BlockState::kRequested);
    return front;
  }
  if (idle_ || queue_.empty()) return nextIdle(std::min(most, freeBlocks()));
  const std::uint64_t taken = blocksInUse() + blocks_under_way_;
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
  const auto canCome = [this](std::uint64_t number) { return !isGivenUp(number) && placeOf(number).bytes != 0; };
  while ((front_to_back_ = availability_.nextAbsent(front_to_back_)) < availability_.blocks() &&
         !canCome(front_to_back_))
    ++front_to_back_;
  BlockRun run{front_to_back_, 0};
  while (run.count < most && run.first + run.count < availability_.blocks() &&
         availability_.state(run.first + run.count) == BlockState::kAbsent && canCome(run.first + run.count))
    availability_.set(run.first + run.count++, BlockState::kRequested);
  return run;
}

ByteRange Stream::send(const BlockRun& run, double now) {
  const CodedPlace last = placeOf(run.first + run.count - 1);
  ByteRange range{++counted_.requests, placeOf(run.first).offset, 0};
  range.length = last.offset + last.bytes - range.offset;
  under_way_[range.id] = {run, range.length, now};
  blocks_under_way_ += run.count;
  link_.sent(range.length, now);
  return range;
}

// ---- what comes ----

void Stream::received(std::uint64_t id, base::ByteView bytes, double now) {
  const auto found = under_way_.find(id);
  if (found == under_way_.end()) return;
  const UnderWay request = found->second;
  if (bytes.size() != request.bytes) return failed(id, now);
  under_way_.erase(found);
  blocks_under_way_ -= request.run.count;
  link_.came(bytes.size(), bytes.size(), request.sent_at, now);
  counted_.bytes_received += bytes.size();

  bool all_good = true;
  if (request.run.first == 0)
    all_good = takeFront(bytes);
  else
    takeBlocks(request.run, bytes, all_good);
  ++arrivals_;
  if (lacking_ > 0 || frame_ == 0) ++generation_;
  if (!all_good) ++counted_.failures;  // the host answers; how often one block is asked for again has its own end
  failures_in_a_row_ = 0;
}

/// The header and as many blocks as came with it. False when something is damaged.
bool Stream::takeFront(base::ByteView bytes) {
  for (std::uint64_t b = 0; b < bytes.size() / kBlockBytes; ++b) availability_.set(b, BlockState::kAbsent);
  if (!takeHeader(bytes)) {
    ++damages_[0];
    wasted_ += bytes.size();
    return false;
  }
  if (!blocks_) return true;
  availability_.set(0, BlockState::kPresent);
  bool all_good = true;
  BlockRun run{1, 0};
  std::uint64_t end = header()->header_bytes;
  // A block of a coded file may tell of the next ones: one after the other.
  for (; run.first < header()->blocks(); ++run.first) {
    const CodedPlace place = placeOf(run.first);
    if (place.bytes == 0 || place.offset != end || place.offset + place.bytes > bytes.size()) break;
    end = place.offset + place.bytes;
    takeBlocks({run.first, 1}, bytes.first(static_cast<std::size_t>(end)).last(place.bytes), all_good);
  }
  wasted_ += bytes.size() - end;
  return all_good;
}

/// False when it is damaged.
bool Stream::takeHeader(base::ByteView front) {
  auto header = readHeader(front);
  auto coder = header && header->coded() ? BlockCoder::fromHeader(front, *header) : damaged("");
  if (!header || (header->coded() && !coder)) {
    if (damages_[0] + 1 >= kMaxDamages) giveUp(!header ? header.error().message : coder.error().message);
    return false;
  }
  if (header->storedBytes() != file_bytes_) {
    giveUp("has " + inBytes(file_bytes_) + ", but its header says " + std::to_string(header->storedBytes()) +
           "; publish the scene again");
    return true;
  }
  if (header->blocks() > kMaxFilePerMemory * most_held_) {
    giveUpForMemory(header->file_bytes);
    return true;
  }
  blocks_ = std::make_unique<GrowingBlocks>(*header);
  blocks_->keepUse();
  if (header->coded()) {
    coder_ = std::make_unique<BlockCoder>(std::move(*coder));
    places_ = std::make_unique<PlaceTable>(*header);
    availability_ = Availability(header->blocks());
  }
  return true;
}

void Stream::takeBlocks(const BlockRun& run, base::ByteView bytes, bool& all_good) {
  const std::uint64_t begin = placeOf(run.first).offset;
  for (std::uint64_t b = run.first; b < run.first + run.count; ++b) {
    const CodedPlace place = placeOf(b);
    all_good &= takeBlock(b, bytes.subspan(static_cast<std::size_t>(place.offset - begin), place.bytes));
  }
}

/// `stored`: as it is in the file. False when it is damaged.
bool Stream::takeBlock(std::uint64_t number, base::ByteView stored) {
  std::unique_ptr<std::uint8_t[]> plain(new std::uint8_t[kBlockBytes]);
  const bool good = decode(number, stored, plain.get());
  if (good && keep(number, std::move(plain))) {
    availability_.set(number, BlockState::kPresent);
    return true;
  }
  availability_.set(number, BlockState::kAbsent);
  wasted_ += stored.size();
  if (good) return true;  // no place for it
  ++damages_[number];
  return false;
}

bool Stream::decode(std::uint64_t number, base::ByteView stored, std::uint8_t* plain) {
  if (!coder_) {
    std::copy(stored.begin(), stored.end(), plain);
    return isBlock(stored, static_cast<std::uint32_t>(number));
  }
  ChildBlocks children;
  if (!coder_->decode(number, stored, plain, children)) return false;
  places_->add(children);
  return true;
}

bool Stream::keep(std::uint64_t number, std::unique_ptr<std::uint8_t[]> plain) {
  if (held_.size() >= most_held_ && !makeRoom()) return false;
  blocks_->put(number, plain.get());
  held_[number] = {std::move(plain), frame_};
  if (in_use_) ++*in_use_;
  return true;
}

void Stream::failed(std::uint64_t id, double now) {
  const auto found = under_way_.find(id);
  if (found == under_way_.end()) return;
  const UnderWay request = found->second;
  under_way_.erase(found);
  blocks_under_way_ -= request.run.count;
  link_.came(request.bytes, 0, request.sent_at, now);
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
  const std::uint64_t taken = held_.size() + blocks_under_way_;
  return taken < most_held_ ? most_held_ - taken : 0;
}

/// What came since the last frame counts as used in it.
std::uint32_t Stream::lastUse(std::uint64_t number, const Held& held) const {
  return std::max(blocks_->lastUse(number), held.arrived);
}

std::uint64_t Stream::blocksInUse() {
  if (held_.size() + blocks_under_way_ + options_.most_request_blocks < most_held_) return held_.size();
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
  if (!wasDrawn(number, held->second)) wasted_ += placeOf(number).bytes;
  blocks_->drop(number);
  held_.erase(held);
  availability_.set(number, BlockState::kAbsent);
  front_to_back_ = std::min(front_to_back_, number);
}

// ---- figures ----

std::string Stream::warning() const {
  std::uint64_t lost = 0, first = 0;
  for (const auto& [number, times] : damages_) {
    if (times < kMaxDamages) continue;
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
  for (const auto& [number, times] : damages_) stats.given_up += times >= kMaxDamages ? 1 : 0;
  stats.memory_bytes =
      held_.size() * kBlockBytes + (blocks_ ? availability_.blocks() * (kTableBytes + (coder_ ? kPlaceBytes : 0)) : 0);
  stats.bytes_per_second = link_.bytesPerSecond();
  return stats;
}

std::uint64_t Stream::bytesWasted() const {
  std::uint64_t bytes = wasted_;
  for (const auto& [number, held] : held_)
    if (!wasDrawn(number, held)) bytes += placeOf(number).bytes;
  return bytes;
}

}  // namespace lod::qsplat
