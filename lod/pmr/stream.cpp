#include "lod/pmr/stream.h"

#include <algorithm>
#include <optional>
#include <unordered_map>
#include <utility>

#include "lod/pmr/leaf_cache.h"
#include "lod/pmr/leaf_picture.h"
#include "lod/range_requests.h"

namespace lod::pmr {
struct Stream::State {
  State(std::uint64_t bytes, const StreamOptions& given) : options(given), file_bytes(bytes) {
    options.memory_bytes = std::max(options.memory_bytes, kMinStreamMemory);
  }

  // ---- frames ----

  void update(const TraverseRequest& request, std::vector<DrawnLeaf>& result, std::uint32_t frames);
  void plan();
  std::uint32_t attainable(std::uint32_t leaf, std::uint32_t level) const;
  void queueMissing();
  void show(const base::Camera& camera, std::vector<DrawnLeaf>& result);
  std::uint32_t bestHere(std::uint32_t leaf) const;
  bool decode(std::uint32_t leaf, std::uint32_t level);
  bool mayDecode() const { return may_decode == 0 || decoded < may_decode; }

  // ---- the link ----

  std::optional<PendingRequest> nextFrontRange() const;
  std::optional<PendingRequest> nextChunkRange(std::uint64_t max_bytes);
  bool isWanted(const ChunkId& id) const;
  template <class Visit>
  void forEachChunk(const PendingRequest& request, const Visit& visit) const;
  ByteRange send(const PendingRequest& request, double now);
  void acceptFront(base::ByteView bytes);
  void readFront();
  void readLocalFront();
  void frontIsDamaged(const base::Error& error);
  void acceptChunk(const ChunkId& id, base::ByteView bytes);
  void stop(std::string reason) {
    if (problem.empty()) problem = std::move(reason);
  }

  StreamOptions options;
  const std::uint64_t file_bytes;
  std::shared_ptr<const FileBytes> file;  // null where the file is streamed

  base::Bytes front;  // what has come of header and table
  Header header;
  std::vector<Leaf> leaves;
  std::optional<Octree> octree;    // none until header and table are here
  std::optional<LeafCache> cache;  // the same
  ChunkOrder chunk_order{0};       // until then of no leaves
  int front_damages = 0;

  std::uint32_t frame = 0;
  std::uint64_t generation = 0;
  std::vector<ChosenLeaf> chosen;
  std::vector<ChunkId> queue;  // the last frame's missing chunks, most urgent first
  std::size_t queue_at = 0;
  std::uint64_t decoded = 0;     // points and triangles of this frame
  std::uint64_t may_decode = 0;  // 0: no limit
  std::uint64_t waiting = 0;     // leaves that are not shown at their planned level
  std::uint64_t lacking = 0;
  bool is_decoding = false, is_limited = false;

  RangeRequests requests;
  std::unordered_map<std::uint64_t, int> damages;  // by leaf · kLeafChunks + chunk
  std::uint64_t given_up = 0;                      // chunks
  std::string problem;
};

// ---- frames ----

void Stream::State::update(const TraverseRequest& request, std::vector<DrawnLeaf>& result, std::uint32_t frames) {
  result.clear();
  if (!cache) return;
  may_decode = frames * options.decode_per_frame;
  ++frame;
  octree->choose(leaves, request, chosen);
  plan();
  show(request.camera, result);
  queueMissing();
  cache->evict(frame);
}

/// Gives each chosen leaf the level that memory allows: first all of them their coarsest, then the ones that matter
/// most the level that the view asks for.
void Stream::State::plan() {
  is_limited = false;
  std::uint64_t planned_bytes = 0;
  for (const ChosenLeaf& one : chosen) {
    LeafState& state = (*cache)[one.leaf];
    state.used = frame;
    state.planned = kNoLevel;
    const std::uint32_t level = attainable(one.leaf, kCoarsest);
    if (level == kNoLevel) continue;
    const std::uint64_t cost = cache->costOf(one.leaf, level);
    if (planned_bytes + cost > cache->limit()) {
      is_limited = true;
      continue;
    }
    planned_bytes += cost;
    state.planned = static_cast<std::uint8_t>(level);
  }
  for (const ChosenLeaf& one : chosen) {
    LeafState& state = (*cache)[one.leaf];
    const std::uint32_t best = attainable(one.leaf, one.level);
    if (state.planned == kNoLevel || best >= state.planned) continue;
    const std::uint64_t others = planned_bytes - cache->costOf(one.leaf, state.planned);
    for (std::uint32_t level = best; level < state.planned; ++level) {
      if (!state.canHave(level)) continue;
      const std::uint64_t cost = cache->costOf(one.leaf, level);
      if (others + cost <= cache->limit()) {
        planned_bytes = others + cost;
        state.planned = static_cast<std::uint8_t>(level);
        break;
      }
      is_limited = true;
    }
  }
}

/// The level, or else the next coarser one, or else the next finer one that is not damaged; kNoLevel without any.
std::uint32_t Stream::State::attainable(std::uint32_t leaf, std::uint32_t level) const {
  const LeafState& state = (*cache)[leaf];
  for (std::uint32_t l = level; l < kLevels; ++l)
    if (state.canHave(l)) return l;
  for (std::uint32_t l = level; l-- > 0;)
    if (state.canHave(l)) return l;
  return kNoLevel;
}

/// First come the coarsest levels of leaves that would show nothing else, then the planned ones.
void Stream::State::queueMissing() {
  queue.clear();
  queue_at = 0;
  for (const ChosenLeaf& one : chosen) (*cache)[one.leaf].wanted = 0;
  if (file) return;
  for (const bool coarsest : {true, false}) {
    for (const ChosenLeaf& one : chosen) {
      LeafState& state = (*cache)[one.leaf];
      if (state.planned == kNoLevel || state.pictureAt(state.planned) ||
          (coarsest && (state.hasPicture() || !state.canHave(kCoarsest))))
        continue;
      const ChunkMask needed = chunksOfLevel(coarsest ? kCoarsest : state.planned);
      const ChunkMask missing = needed & ~state.present & ~state.wanted;
      state.wanted |= missing;
      for (std::uint32_t chunk = kLeafChunks; chunk-- > 0;)
        if ((missing & chunkBit(chunk)) != 0) queue.push_back({one.leaf, chunk});
    }
  }
}

void Stream::State::show(const base::Camera& camera, std::vector<DrawnLeaf>& result) {
  decoded = waiting = lacking = 0;
  is_decoding = false;
  // With little time for decoding, a hole in the picture is worse than a coarse leaf.
  if (may_decode != 0)
    for (const ChosenLeaf& one : chosen)
      if (const LeafState& state = (*cache)[one.leaf];
          state.planned != kNoLevel && !state.hasPicture() && state.has(kCoarsest) && mayDecode())
        decode(one.leaf, kCoarsest);

  for (const ChosenLeaf& one : chosen) {
    LeafState& state = (*cache)[one.leaf];
    std::uint32_t level = bestHere(one.leaf);
    while (level != kNoLevel && !state.pictureAt(level) && mayDecode()) {
      if (decode(one.leaf, level)) break;
      state.planned = static_cast<std::uint8_t>(attainable(one.leaf, state.planned));
      level = bestHere(one.leaf);
    }
    is_decoding |= level != kNoLevel && !state.pictureAt(level);

    auto picture = state.planned != kNoLevel ? state.bestPicture(state.planned) : nullptr;
    const std::uint32_t shown = picture ? picture->level : kNoLevel;
    state.shown = static_cast<std::uint8_t>(shown);
    waiting += shown != state.planned ? 1 : 0;
    lacking += shown != one.level ? 1 : 0;
    if (picture) result.push_back({one.pixel, one.level, std::move(picture)});
  }

  const auto depthOf = [&](const DrawnLeaf& drawn) {
    return -(camera.eye_from_scene * glm::vec4(leaves[drawn.picture->leaf].box.center(), 1.0F)).z;
  };
  std::vector<std::pair<float, std::size_t>> order;
  for (std::size_t i = 0; i < result.size(); ++i) order.emplace_back(depthOf(result[i]), i);
  std::stable_sort(order.begin(), order.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<DrawnLeaf> sorted;
  sorted.reserve(result.size());
  for (const auto& [depth, i] : order) sorted.push_back(std::move(result[i]));
  result = std::move(sorted);
}

/// The finest level whose chunks are here, no finer than planned, or else the coarsest of the finer ones.
std::uint32_t Stream::State::bestHere(std::uint32_t leaf) const {
  const LeafState& state = (*cache)[leaf];
  if (state.planned == kNoLevel || state.pictureAt(state.planned)) return state.planned;
  for (std::uint32_t l = state.planned; l < kLevels; ++l)
    if (state.has(l)) return l;
  // A picture of a coarser level needs no chunks.
  if (const auto picture = state.bestPicture(state.planned); picture && picture->level >= state.planned)
    return picture->level;
  for (std::uint32_t l = state.planned; l-- > 0;)
    if (state.has(l)) return l;
  return kNoLevel;
}

/// False where a chunk is damaged, which is given up then.
bool Stream::State::decode(std::uint32_t leaf, std::uint32_t level) {
  decoded += leaves[leaf].verticesAt(level) + leaves[leaf].levels[level].triangles;
  base::Bytes read;
  const auto bytesOf = [&](std::uint32_t chunk) -> std::optional<base::ByteView> {
    if (!file) return cache->chunk(leaf, chunk);
    const ChunkPlace place = placeOf(leaves[leaf], chunk);
    read.resize(place.bytes);
    return file->read(place.offset, read) ? std::optional<base::ByteView>(read) : std::nullopt;
  };
  DecodedLeaf made = decodeLeaf(header, leaves[leaf], leaf, level, bytesOf);
  if (made.picture) {
    cache->keepPicture(std::move(made.picture));
    return true;
  }
  cache->giveUp(leaf, made.damaged_chunk);
  ++given_up;
  return false;
}

// ---- what to ask for ----

std::optional<PendingRequest> Stream::State::nextFrontRange() const {
  if (cache || requests.frontIsUnderWay()) return std::nullopt;
  return frontRequest(file_bytes, front.size(), kHeaderBytes + header.table_bytes);
}

bool Stream::State::isWanted(const ChunkId& id) const {
  const LeafState& state = (*cache)[id.leaf];
  return state.used == frame &&
         (state.wanted & ~state.requested & ~state.present & ~state.given_up & chunkBit(id.chunk)) != 0;
}

/// A chunk, however long, and neighbours of its section as long as all have at most so many bytes.
std::optional<PendingRequest> Stream::State::nextChunkRange(std::uint64_t max_bytes) {
  if (!cache) return std::nullopt;
  while (queue_at < queue.size() && !isWanted(queue[queue_at])) ++queue_at;
  if (queue_at == queue.size()) return std::nullopt;
  const ChunkId id = queue[queue_at];
  const std::uint64_t place = chunk_order.placeOf(id);
  const bool is_base = place < chunk_order.baseChunks();
  const std::uint64_t begin = is_base ? 0 : chunk_order.baseChunks();
  const std::uint64_t end = is_base ? chunk_order.baseChunks() : chunk_order.chunks();
  const auto partAt = [this](std::uint64_t at) {
    const ChunkId part = chunk_order.at(at);
    return RequestablePart{placeOf(leaves[part.leaf], part.chunk).bytes, isWanted(part),
                           ((*cache)[part.leaf].requested & chunkBit(part.chunk)) != 0};
  };
  std::uint64_t bytes = placeOf(leaves[id.leaf], id.chunk).bytes;
  PendingRequest request;
  request.last = extendRequest(place, 1, begin, end, max_bytes, bytes, partAt);
  request.first = extendRequest(place, -1, begin, end, max_bytes, bytes, partAt);
  const ChunkId first = chunk_order.at(request.first);
  request.range = {0, placeOf(leaves[first.leaf], first.chunk).offset, bytes};
  return request;
}

template <class Visit>
void Stream::State::forEachChunk(const PendingRequest& request, const Visit& visit) const {
  for (std::uint64_t place = request.first; place <= request.last; ++place) visit(chunk_order.at(place));
}

ByteRange Stream::State::send(const PendingRequest& request, double now) {
  if (!request.is_front)
    forEachChunk(request, [&](const ChunkId& id) { (*cache)[id.leaf].requested |= chunkBit(id.chunk); });
  return requests.send(request, now);
}

// ---- what comes ----

void Stream::State::acceptFront(base::ByteView bytes) {
  front.insert(front.end(), bytes.begin(), bytes.end());
  auto read = readHeader(front);
  if (!read) return frontIsDamaged(read.error());
  header = *read;
  if (header.file_bytes != file_bytes)
    return stop("has " + std::to_string(file_bytes) + " bytes, but its header says " +
                std::to_string(header.file_bytes) + "; publish the scene again");
  if (front.size() >= std::uint64_t{kHeaderBytes} + header.table_bytes) readFront();
}

void Stream::State::readFront() {
  auto table = readTable(header, base::ByteView(front).subspan(kHeaderBytes, header.table_bytes));
  if (!table) return frontIsDamaged(table.error());
  leaves = std::move(*table);
  octree.emplace(leaves);
  cache.emplace(leaves, options.memory_bytes, file != nullptr);
  chunk_order = ChunkOrder(header.leaves);
  // Chunks may have come with the table.
  for (std::uint64_t n = 0; n < chunk_order.chunks(); ++n) {
    const ChunkId id = chunk_order.at(n);
    const ChunkPlace place = placeOf(leaves[id.leaf], id.chunk);
    if (place.offset + place.bytes > front.size()) break;
    acceptChunk(id, base::ByteView(front).subspan(place.offset, place.bytes));
  }
  front = {};
}

void Stream::State::readLocalFront() {
  front_damages = kMaxDamages - 1;  // another try would read the same
  const auto read = [this](std::uint64_t bytes) {
    base::Bytes part(static_cast<std::size_t>(bytes));
    if (file->read(front.size(), part)) return acceptFront(part);
    stop("cannot be read; copy the file again");
  };
  read(std::min<std::uint64_t>(file_bytes, kHeaderBytes));
  if (problem.empty()) read(header.table_bytes);
}

void Stream::State::frontIsDamaged(const base::Error& error) {
  front.clear();
  requests.countDamage();
  if (++front_damages >= kMaxDamages) stop(error.message);
}

void Stream::State::acceptChunk(const ChunkId& id, base::ByteView bytes) {
  LeafState& state = (*cache)[id.leaf];
  if (((state.present | state.given_up) & chunkBit(id.chunk)) != 0) return;
  if (isIntact(leaves[id.leaf], id.chunk, bytes)) return cache->keepChunk(id.leaf, id.chunk, bytes);
  requests.countDamage();
  queue_at = 0;
  if (++damages[std::uint64_t{id.leaf} * kLeafChunks + id.chunk] < kMaxDamages) return;
  cache->giveUp(id.leaf, id.chunk);
  ++given_up;
}

// ---- the class ----

Stream::Stream(std::uint64_t file_bytes, const StreamOptions& options)
    : state_(std::make_unique<State>(file_bytes, options)) {
  if (file_bytes < kHeaderBytes)
    state_->stop("its " + std::to_string(file_bytes) + " bytes are no pmr.lgm; publish the scene again");
}

Stream::Stream(std::shared_ptr<const FileBytes> file, const StreamOptions& options)
    : state_(std::make_unique<State>(file->size(), options)) {
  state_->file = std::move(file);
  state_->readLocalFront();
}

Stream::~Stream() = default;

const Header* Stream::header() const {
  return state_->cache ? &state_->header : nullptr;
}
std::span<const Leaf> Stream::leaves() const {
  return state_->leaves;
}

void Stream::update(const TraverseRequest& request, std::vector<DrawnLeaf>& result, std::uint32_t frames) {
  state_->update(request, result, frames);
}
std::uint64_t Stream::generation() const {
  return state_->generation;
}
bool Stream::complete() const {
  return state_->problem.empty() && state_->frame > 0 && state_->waiting == 0;
}
bool Stream::decoding() const {
  return state_->is_decoding;
}
bool Stream::limitedByMemory() const {
  return state_->is_limited;
}

std::vector<ByteRange> Stream::nextRequests(double now) {
  State& s = *state_;
  std::vector<ByteRange> ranges;
  if (!s.problem.empty() || s.file) return ranges;
  while (const std::uint64_t room = s.requests.roomAt(now, s.options.max_requests)) {
    auto next = s.nextFrontRange();
    if (!next) next = s.nextChunkRange(std::min(room, s.options.max_request_bytes));
    if (!next) break;
    ranges.push_back(s.send(*next, now));
  }
  return ranges;
}

void Stream::acceptAnswer(std::uint64_t id, base::ByteView bytes, double now) {
  State& s = *state_;
  const auto answered = s.requests.takeAnswered(id, bytes.size(), now);
  if (!answered) return;
  const PendingRequest& request = answered->request;
  ++s.generation;
  if (answered->has_failed) s.queue_at = 0;
  if (request.is_front) {
    if (!answered->has_failed) s.acceptFront(bytes);
  } else {
    s.forEachChunk(request, [&](const ChunkId& chunk) {
      const ChunkPlace place = placeOf(s.leaves[chunk.leaf], chunk.chunk);
      (*s.cache)[chunk.leaf].requested &= ~chunkBit(chunk.chunk);
      if (!answered->has_failed)
        s.acceptChunk(chunk, bytes.subspan(static_cast<std::size_t>(place.offset - request.range.offset), place.bytes));
    });
  }
  if (s.cache) s.cache->evict(s.frame);
}

void Stream::acceptFailure(std::uint64_t id, double now) {
  acceptAnswer(id, {}, now);
}

void Stream::giveUp(std::string reason) {
  state_->stop(std::move(reason));
}
const std::string& Stream::problem() const {
  return state_->problem;
}

std::string Stream::warning() const {
  const State& s = *state_;
  if (s.given_up == 0) return "";
  std::uint64_t damaged_leaves = 0, first = 0;
  for (std::uint64_t leaf = s.leaves.size(); s.cache && leaf-- > 0;)
    if (s.cache->states()[leaf].given_up != 0) ++damaged_leaves, first = leaf;
  return "leaf " + std::to_string(first) +
         (damaged_leaves > 1 ? " and " + std::to_string(damaged_leaves - 1) + " more are" : " is") +
         " damaged: checksums do not match; " + (s.file ? "copy the file" : "publish the scene") + " again";
}

StreamStats Stream::stats() const {
  const State& s = *state_;
  StreamStats stats;
  stats.bytes_received = s.requests.bytesReceived();
  stats.requests = s.requests.requests();
  stats.failures = s.requests.failures();
  stats.damaged = s.given_up;
  stats.leaves = s.leaves.size();
  stats.chosen = s.chosen.size();
  stats.lacking = s.lacking;
  stats.under_way = s.requests.underWay();
  if (!s.cache) return stats;
  stats.present = s.cache->leavesWithPicture();
  stats.memory_bytes = s.cache->bytes() + s.leaves.size() * (sizeof(Leaf) + sizeof(LeafState));
  return stats;
}

}  // namespace lod::pmr
