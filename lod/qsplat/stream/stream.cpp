#include "lod/qsplat/stream/stream.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace lod::qsplat {
namespace {

// The first request brings the header and the top of the tree in one round trip.
constexpr std::uint64_t kFrontBlocks = 8;
static_assert(kFrontBlocks * kBlockBytes > kMaxCodedHeaderBytes + kMaxCodedBytes);
// A block that came damaged this often is given up. After each failure in a row the pause doubles. These are choices:
// longer pauses spare a host that is broken, shorter ones go on sooner with one that was restarted.
constexpr int kMaxDamages = 3;
constexpr double kMinPause = 0.25, kMaxPause = 5.0;  // seconds
// Bytes of tables for each block of the file: its address, its last use, two bits of state.
constexpr std::uint64_t kTableBytes = sizeof(void*) + sizeof(std::uint32_t) + 1;
// A coded block's place takes these in addition.
constexpr std::uint64_t kPlaceBytes = sizeof(std::uint64_t);
// When memory is full, one part in so many is evicted at a time. A choice: larger parts drop more blocks that come back
// into view, smaller ones sort blocks by their last use more often.
constexpr std::uint64_t kEvictedPart = 64;
// The surroundings of a view have so many times its width and height. A choice: wider ones are ready for faster turns
// and fetch more that is never seen.
constexpr float kNearby = 1.5F;

// More than sweepPriority ever returns: a size of 2^100 pixels has priority 200 000.
constexpr float kThroughLens = 1e6F;

Priority plainPriority(StreamOrder order, int picture_height) {
  switch (order) {
    case StreamOrder::kLevel:
      return [](const MissingChildren& missing) { return -static_cast<float>(missing.level); };
    case StreamOrder::kRadius:
      return [](const MissingChildren& missing) { return missing.radius; };
    case StreamOrder::kSize:
      return [](const MissingChildren& missing) { return missing.size_px; };
    case StreamOrder::kTopDown:
      return [](const MissingChildren& missing) {
        return std::isfinite(missing.size_px) ? -missing.at_px.y : std::numeric_limits<float>::infinity();
      };
    case StreamOrder::kSweeps:
      break;
  }
  return sweepPriority(picture_height);
}

// The order's priority. Blocks that are seen through the lens come before all others.
Priority priorityFor(StreamOrder order, const std::optional<Lens>& lens, int picture_height) {
  const Priority plain = plainPriority(order, picture_height);
  if (!lens) return plain;
  return [plain, lens = *lens](const MissingChildren& missing) {
    return plain(missing) + (isSeenThrough(lens, missing.at_px, missing.size_px) ? kThroughLens : 0.0F);
  };
}

bool sameTraversal(const TraverseRequest& a, const TraverseRequest& b) {
  return base::sameCamera(a.camera, b.camera) && a.cutoff_px == b.cutoff_px;
}

// Returns a view that shows more of the scene at the same size, as a small turn would.
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

std::optional<StreamOrder> streamOrderFromName(std::string_view name) {
  for (const auto& [order, text] : kStreamOrderNames)
    if (text == name) return order;
  return std::nullopt;
}

Stream::Stream(std::uint64_t file_bytes, const StreamOptions& options)
    : options_(options),
      file_bytes_(file_bytes),
      max_kept_(std::max(options.memory_bytes, kMinStreamMemory) / kBlockBytes),
      availability_(file_bytes / kBlockBytes <= kMaxFilePerMemory * max_kept_ ? file_bytes / kBlockBytes : 0),
      queue_(availability_) {
  if (file_bytes < 2 * kBlockBytes || file_bytes % kBlockBytes != 0)
    problem_ = "its " + inBytes(file_bytes) + " are no number of blocks; publish the scene again";
  else if (availability_.blocks() == 0)
    giveUpForMemory(file_bytes);
}

Stream::Stream(std::shared_ptr<FileBlocks> file, const StreamOptions& options)
    : options_(options),
      file_bytes_(file->header().storedBytes()),
      max_kept_(std::max(options.memory_bytes, kMinStreamMemory) / kBlockBytes),
      availability_(0),
      queue_(availability_),
      whole_(std::move(file)) {
  whole_->trackUse();
}

void Stream::giveUpForMemory(std::uint64_t plain_bytes) {
  giveUp("its " + inBytes(plain_bytes) + " are too many for " + inBytes(max_kept_ * kBlockBytes) +
         " of memory; allow at least " + inBytes(plain_bytes / kMaxFilePerMemory));
}

// ---- frames ----

void Stream::traverse(const TraverseRequest& request, const std::optional<Lens>& lens, Traversal& result) {
  queue_.clear();
  idle_ = false;
  if (blocks() == nullptr) {
    result = {};
    return;
  }
  blocks()->beginFrame(++frame_);
  TraverseRequest ordered = request;
  ordered.lens = lens;
  ordered.priority = priorityFor(options_.order, lens, request.camera.height);
  qsplat::traverse(*blocks(), ordered, result);
  if (whole_) whole_->trim(options_.memory_bytes);
  if (result.damaged) giveUp("its groups don't make a tree; copy or build the file again");

  in_use_.reset();
  queueWanted(result.wanted);
  limited_ = lacking_ > 0 && under_way_.empty() && blocksInUse() >= max_kept_;
  if (frame_ > 1 && sameTraversal(ordered, view_)) return;
  view_ = std::move(ordered);
  nearby_arrivals_ = 0;
  front_to_back_ = 0;
  idle_left_ = options_.idle_bytes / kBlockBytes;
}

void Stream::queueWanted(const std::vector<WantedBlock>& wanted) {
  lacking_ = 0;
  if (whole_) return;  // the missing blocks are damaged
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

std::vector<ByteRange> Stream::nextRequests(double now) {
  std::vector<ByteRange> ranges;
  if (!problem_.empty() || whole_ || now < pause_until_) return ranges;
  while (under_way_.size() < options_.max_requests) {
    const std::uint64_t max_blocks =
        std::min(link_.roomForRequest() / typicalBlockBytes(), std::max<std::uint64_t>(options_.max_request_blocks, 1));
    const BlockRun run = max_blocks == 0 ? BlockRun{} : checkedRun(nextRun(max_blocks));
    if (run.count == 0) break;
    ranges.push_back(addRequest(run, now));
  }
  return ranges;
}

/// Returns the mean length of a stored block.
std::uint64_t Stream::typicalBlockBytes() const {
  return coder_ ? (header()->coded_bytes - header()->header_bytes) / (header()->blocks() - 1) : kBlockBytes;
}

/// Returns a block's place in the stored file; its bytes are 0 while it is not known.
CodedPlace Stream::placeOf(std::uint64_t number) const {
  return coder_ ? places_->find(number) : CodedPlace{number * kBlockBytes, kBlockBytes};
}

/// Returns `run` if its blocks have places and are consecutive in the stored file, as the blocks of present parents
/// must be. Otherwise the file contradicts itself, and the run is empty.
BlockRun Stream::checkedRun(const BlockRun& run) {
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

BlockRun Stream::nextRun(std::uint64_t max_blocks) {
  if (!blocks_) {
    if (availability_.stateOf(0) != BlockState::kAbsent) return {};
    const BlockRun front{0, std::min(kFrontBlocks, availability_.blocks())};
    for (std::uint64_t i = 0; i < front.count; ++i) availability_.setState(i, BlockState::kRequested);
    return front;
  }
  if (idle_ || queue_.empty()) return nextIdleRun(std::min(max_blocks, freeBlocks()));
  const std::uint64_t taken = blocksInUse() + blocks_under_way_;
  return queue_.takeRun(taken < max_kept_ ? std::min(max_blocks, max_kept_ - taken) : 0);
}

// Fetches ahead once the view is complete (section 4.4): the surroundings, then the file from its front.
BlockRun Stream::nextIdleRun(std::uint64_t max_blocks) {
  max_blocks = std::min(max_blocks, idle_left_);
  if (max_blocks == 0 || frame_ == 0 || lacking_ > 0) return {};
  idle_ = true;
  if (queue_.empty() && nearby_arrivals_ != arrivals_) {
    nearby_arrivals_ = arrivals_;
    qsplat::traverse(*blocks_, widened(view_), nearby_);
    in_use_.reset();
    for (const WantedBlock& one : nearby_.wanted)
      if (!isGivenUp(one.block)) queue_.add(one);
  }
  BlockRun run = queue_.takeRun(max_blocks);
  // While blocks are under way, their arrival may show more of the surroundings.
  if (run.count == 0 && under_way_.empty()) run = nextRunFromFront(max_blocks);
  idle_left_ -= run.count;
  return run;
}

BlockRun Stream::nextRunFromFront(std::uint64_t max_blocks) {
  const auto canCome = [this](std::uint64_t number) { return !isGivenUp(number) && placeOf(number).bytes != 0; };
  while ((front_to_back_ = availability_.nextAbsent(front_to_back_)) < availability_.blocks() &&
         !canCome(front_to_back_))
    ++front_to_back_;
  BlockRun run{front_to_back_, 0};
  while (run.count < max_blocks && run.first + run.count < availability_.blocks() &&
         availability_.stateOf(run.first + run.count) == BlockState::kAbsent && canCome(run.first + run.count))
    availability_.setState(run.first + run.count++, BlockState::kRequested);
  return run;
}

ByteRange Stream::addRequest(const BlockRun& run, double now) {
  const CodedPlace last = placeOf(run.first + run.count - 1);
  ByteRange range{++counted_.requests, placeOf(run.first).offset, 0};
  range.length = last.offset + last.bytes - range.offset;
  under_way_[range.id] = {run, range.length, now};
  blocks_under_way_ += run.count;
  link_.recordRequest(range.length, now);
  return range;
}

// ---- what comes ----

void Stream::acceptAnswer(std::uint64_t id, base::ByteView bytes, double now) {
  const auto found = under_way_.find(id);
  if (found == under_way_.end()) return;
  const PendingRequest request = found->second;
  if (bytes.size() != request.bytes) return acceptFailure(id, now);
  under_way_.erase(found);
  blocks_under_way_ -= request.run.count;
  link_.recordAnswer(bytes.size(), bytes.size(), request.sent_at, now);
  counted_.bytes_received += bytes.size();

  const bool intact = request.run.first == 0 ? acceptFront(bytes) : acceptBlocks(request.run, bytes);
  ++arrivals_;
  if (lacking_ > 0 || frame_ == 0) ++generation_;
  if (!intact) ++counted_.failures;  // without a pause: the host answers, and kMaxDamages ends repeated requests
  failures_in_a_row_ = 0;
}

/// Accepts the header and the blocks that came with it. False when something is damaged.
bool Stream::acceptFront(base::ByteView bytes) {
  for (std::uint64_t b = 0; b < bytes.size() / kBlockBytes; ++b) availability_.setState(b, BlockState::kAbsent);
  if (!acceptHeader(bytes)) {
    ++damages_[0];
    wasted_ += bytes.size();
    return false;
  }
  if (!blocks_) return true;
  availability_.setState(0, BlockState::kPresent);
  bool intact = true;
  std::uint64_t end = header()->header_bytes;
  // One by one, since a block of a coded file tells the places of the next ones.
  for (std::uint64_t b = 1; b < header()->blocks(); ++b) {
    const CodedPlace place = placeOf(b);
    if (place.bytes == 0 || place.offset != end || place.offset + place.bytes > bytes.size()) break;
    end = place.offset + place.bytes;
    intact &= acceptBlock(b, bytes.first(static_cast<std::size_t>(end)).last(place.bytes));
  }
  wasted_ += bytes.size() - end;
  return intact;
}

/// False when the header is damaged.
bool Stream::acceptHeader(base::ByteView front) {
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
  if (header->blocks() > kMaxFilePerMemory * max_kept_) {
    giveUpForMemory(header->file_bytes);
    return true;
  }
  blocks_ = std::make_unique<GrowingBlocks>(*header);
  blocks_->trackUse();
  if (header->coded()) {
    coder_ = std::make_unique<BlockCoder>(std::move(*coder));
    places_ = std::make_unique<PlaceTable>(*header);
    availability_ = Availability(header->blocks());
  }
  return true;
}

/// False when one of them is damaged.
bool Stream::acceptBlocks(const BlockRun& run, base::ByteView bytes) {
  bool intact = true;
  const std::uint64_t begin = placeOf(run.first).offset;
  for (std::uint64_t b = run.first; b < run.first + run.count; ++b) {
    const CodedPlace place = placeOf(b);
    intact &= acceptBlock(b, bytes.subspan(static_cast<std::size_t>(place.offset - begin), place.bytes));
  }
  return intact;
}

/// Accepts a block as it is stored in the file. False when it is damaged.
bool Stream::acceptBlock(std::uint64_t number, base::ByteView stored) {
  std::unique_ptr<std::uint8_t[]> plain(new std::uint8_t[kBlockBytes]);
  const bool good = decodeBlock(number, stored, plain.get());
  if (good && keepBlock(number, std::move(plain))) {
    availability_.setState(number, BlockState::kPresent);
    return true;
  }
  availability_.setState(number, BlockState::kAbsent);
  wasted_ += stored.size();
  if (good) return true;  // there was no memory for it
  ++damages_[number];
  return false;
}

bool Stream::decodeBlock(std::uint64_t number, base::ByteView stored, std::uint8_t* plain) {
  if (!coder_) {
    std::copy(stored.begin(), stored.end(), plain);
    return isIntactBlock(stored, static_cast<std::uint32_t>(number));
  }
  ChildBlocks children;
  if (!coder_->decode(number, stored, plain, children)) return false;
  places_->add(children);
  return true;
}

bool Stream::keepBlock(std::uint64_t number, std::unique_ptr<std::uint8_t[]> plain) {
  if (kept_.size() >= max_kept_ && !evictUnused()) return false;
  blocks_->put(number, plain.get());
  kept_[number] = {std::move(plain), frame_};
  if (in_use_) ++*in_use_;
  return true;
}

void Stream::acceptFailure(std::uint64_t id, double now) {
  const auto found = under_way_.find(id);
  if (found == under_way_.end()) return;
  const PendingRequest request = found->second;
  under_way_.erase(found);
  blocks_under_way_ -= request.run.count;
  link_.recordAnswer(request.bytes, 0, request.sent_at, now);
  for (std::uint64_t i = 0; i < request.run.count; ++i)
    availability_.setState(request.run.first + i, BlockState::kAbsent);
  front_to_back_ = std::min(front_to_back_, request.run.first);
  ++arrivals_;
  ++generation_;
  pauseAfterFailure(request.sent_at, now);
}

void Stream::pauseAfterFailure(double sent_at, double now) {
  ++counted_.failures;
  // Requests that were under way when another one failed have the same cause; the pause does not double for them.
  if (sent_at < paused_at_) return;
  paused_at_ = now;
  const double pause = kMinPause * std::exp2(std::min(failures_in_a_row_++, 8));
  pause_until_ = now + std::min(pause, kMaxPause);
}

void Stream::giveUp(std::string reason) {
  if (problem_.empty()) problem_ = std::move(reason);
}

// ---- memory ----

std::uint64_t Stream::freeBlocks() const {
  const std::uint64_t taken = kept_.size() + blocks_under_way_;
  return taken < max_kept_ ? max_kept_ - taken : 0;
}

/// Returns the frame that used a block last; a block that arrived since the last frame counts as used by it.
std::uint32_t Stream::lastUse(std::uint64_t number, const KeptBlock& kept) const {
  return std::max(blocks_->lastUse(number), kept.arrived);
}

std::uint64_t Stream::blocksInUse() {
  if (kept_.size() + blocks_under_way_ + options_.max_request_blocks < max_kept_) return kept_.size();
  if (!in_use_)
    in_use_ = static_cast<std::uint64_t>(std::count_if(
        kept_.begin(), kept_.end(), [this](const auto& one) { return lastUse(one.first, one.second) >= frame_; }));
  return *in_use_;
}

/// Whether a frame has used the block since it arrived; frames before that only found it missing.
bool Stream::wasUsed(std::uint64_t number, const KeptBlock& kept) const {
  return blocks_->lastUse(number) > kept.arrived;
}

/// Evicts blocks, those that were used longest ago first; false when the last frame used all of them. A traversal that
/// uses a block has used its parents' blocks, too, so of blocks that were last used in the same frame children go
/// first; their numbers are larger.
bool Stream::evictUnused() {
  std::vector<std::pair<std::uint32_t, std::uint64_t>> unused;  // frame of the last use, complement of the number
  for (const auto& [number, kept] : kept_)
    if (number > 1 && lastUse(number, kept) < frame_) unused.emplace_back(lastUse(number, kept), ~number);
  if (unused.empty()) return false;
  const std::size_t going =
      std::min<std::size_t>(unused.size(), static_cast<std::size_t>(max_kept_ / kEvictedPart + 1));
  std::nth_element(unused.begin(), unused.begin() + static_cast<std::ptrdiff_t>(going - 1), unused.end());
  for (std::size_t i = 0; i < going; ++i) dropBlock(~unused[i].second);
  counted_.evicted += going;
  return true;
}

void Stream::dropBlock(std::uint64_t number) {
  const auto kept = kept_.find(number);
  if (!wasUsed(number, kept->second)) wasted_ += placeOf(number).bytes;
  blocks_->drop(number);
  kept_.erase(kept);
  availability_.setState(number, BlockState::kAbsent);
  front_to_back_ = std::min(front_to_back_, number);
}

// ---- figures ----

std::string Stream::warning() const {
  std::uint64_t lost = 0, first = 0;
  for (const auto& [number, times] : damages_) {
    if (times < kMaxDamages) continue;
    first = lost++ == 0 ? number : std::min(first, number);
  }
  if (whole_ && whole_->damagedBlock() != 0) lost = 1, first = whole_->damagedBlock();
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
      kept_.size() * kBlockBytes + (blocks_ ? availability_.blocks() * (kTableBytes + (coder_ ? kPlaceBytes : 0)) : 0);
  stats.bytes_per_second = link_.bytesPerSecond();
  if (whole_) {
    stats.blocks = stats.present = header()->blocks();
    stats.given_up = whole_->damagedBlock() != 0 ? 1 : 0;
    stats.memory_bytes = stats.blocks * kTableBytes + whole_->heldBytes();
  }
  return stats;
}

std::uint64_t Stream::bytesWasted() const {
  std::uint64_t bytes = wasted_;
  for (const auto& [number, kept] : kept_)
    if (!wasUsed(number, kept)) bytes += placeOf(number).bytes;
  return bytes;
}

}  // namespace lod::qsplat
