#include "lod/hlod/stream.h"

#include <algorithm>
#include <optional>
#include <queue>
#include <utility>

#include "lod/hlod/block.h"
#include "lod/hlod/node_cache.h"
#include "lod/hlod/node_picture.h"
#include "lod/hlod/prefetch.h"
#include "lod/range_requests.h"
#include "lod/view_box.h"

namespace lod::hlod {
namespace {

/// Casters get one part in so many of the memory. A choice: without a share of their own they would get none in views
/// that fill it, and casters of a model have about a third of the bytes of its pictures.
constexpr std::uint64_t kCasterShare = 4;
/// Only one request for nodes that no view wants yet is under way, so that little delays what a new view wants.
constexpr std::size_t kPrefetchesAtOnce = 1;

}  // namespace

struct Stream::State {
  State(std::uint64_t bytes, const StreamOptions& given) : options(given), file_bytes(bytes) {
    options.memory_bytes = std::max(options.memory_bytes, kMinStreamMemory);
  }

  // ---- pictures of frames ----

  void update(const TraverseRequest& request, std::vector<DrawnNode>& result, std::uint32_t frames);
  void plan(const TraverseRequest& request);
  bool planNode(const TraverseRequest& request, std::uint32_t node);
  bool refine(const TraverseRequest& request, const Sight& sight, std::uint32_t node);
  bool decodePlanned();
  bool decode(std::uint32_t node);
  std::optional<base::ByteView> readBlock(std::uint32_t part, base::Bytes& read) const;
  void giveUp(std::uint32_t part);
  void findCovered();
  void show(const base::Camera& camera, std::vector<DrawnNode>& result);
  void queueMissing();
  void countHits();
  std::uint64_t pictureMemory() const { return cache->limit() - (keeps_casters ? cache->limit() / kCasterShare : 0); }
  bool mayDecode() const { return may_decode == 0 || decoded < may_decode; }
  /// Whether nodes that are drawn finer are kept, to be shown where the view leaves their children. All of a local file
  /// can be decoded at once, unless frames limit that.
  bool keepsRefined() const { return !file || options.decode_per_frame != 0; }
  /// Calls visit(child) for the children that are planned, too.
  template <class Visit>
  void forEachPlannedChild(std::uint32_t node, const Visit& visit) const {
    for (std::uint32_t c = nodes[node].first_child; c < nodes[node].first_child + nodes[node].children; ++c)
      if ((*cache)[c].used == frame) visit(c);
  }

  // ---- casters of frames ----

  void updateCasters(std::span<const std::uint32_t> wanted, std::vector<std::shared_ptr<const CasterPicture>>& result);
  bool planCaster(std::uint32_t node);
  std::uint32_t planCasterFor(std::uint32_t node);
  bool decodeCasters(std::size_t& next);
  bool decodeCaster(std::uint32_t node);
  std::uint32_t nearestCaster(std::uint32_t node);
  void queueMissingCasters(std::size_t first);

  // ---- the link ----

  std::optional<PendingRequest> nextFrontRange() const;
  std::optional<PendingRequest> nextBlockRange(std::uint64_t max_bytes);
  std::uint64_t prefetchBudget() const;
  void findNextParts();
  void expectLights(std::vector<LightRequest> wanted);
  std::optional<PendingRequest> nextPrefetch();
  bool isWanted(std::uint32_t part) const;
  bool concernsView(const PendingRequest& request) const;
  ByteRange send(const PendingRequest& request, double now);
  void acceptFront(base::ByteView bytes);
  void readFront();
  void readLocalFront();
  void frontIsDamaged(const base::Error& error);
  void acceptBlock(std::uint32_t part, base::ByteView bytes);
  void evict() { cache->evict(frame, planned, planned_casters); }
  void stop(std::string reason) {
    if (problem.empty()) problem = std::move(reason);
  }

  StreamOptions options;
  const std::uint64_t file_bytes;
  std::shared_ptr<const FileBytes> file;  // null where the file is streamed

  base::Bytes front;  // what has come of header and table
  Header header;
  std::vector<Node> nodes;
  std::vector<std::uint32_t> parents;  // of each node
  std::optional<NodeCache> cache;      // none until header and table are here
  int front_damages = 0;

  std::uint32_t frame = 0;
  std::uint64_t generation = 0;
  /// The nodes from the root down to the cut that the view asks for, or that memory allows, by falling projected error
  /// of their parents.
  std::vector<std::uint32_t> planned;
  std::uint64_t planned_bytes = 0;
  std::vector<std::uint32_t> planned_casters;  // parts
  std::vector<std::uint32_t> queue;            // parts that are missing, in the order in which they are wanted
  std::size_t queue_at = 0;
  std::uint64_t decoded = 0;     // triangles and points of this frame
  std::uint64_t may_decode = 0;  // 0: no limit
  std::uint64_t waiting = 0;     // planned nodes that nothing shows wholly
  std::uint64_t drawn = 0, lacking = 0;
  bool is_decoding = false, is_limited = false;
  bool may_refine = false;         // memory may turn out to be enough for more than was planned
  bool asked_for_casters = false;  // since the last update()
  bool keeps_casters = false;      // a share of the memory is theirs
  std::uint64_t waiting_casters = 0;

  TraverseRequest view;     // of the last update()
  std::uint32_t views = 0;  // calls of update()
  bool is_new_view = true;  // next_parts are to be found
  std::vector<LightRequest> lights;
  std::vector<NextNode> next_parts;  // parts in place of nodes
  std::size_t next_at = 0;
  std::uint64_t may_prefetch = 0;  // bytes left for the view
  std::uint64_t prefetch_id = 0;   // of the last request
  std::uint64_t prefetched = 0, hits = 0, misses = 0;

  RangeRequests requests;
  std::uint64_t given_up = 0;
  std::string problem;
};

// ---- pictures of frames ----

void Stream::State::update(const TraverseRequest& request, std::vector<DrawnNode>& result, std::uint32_t frames) {
  result.clear();
  if (!cache) return;
  may_decode = frames * options.decode_per_frame;
  decoded = 0;
  keeps_casters = std::exchange(asked_for_casters, false);
  planned_casters.clear();
  waiting_casters = 0;
  // Decoded nodes tell how much memory they take, and whether they are damaged, so the plan may change.
  do {
    ++frame;
    plan(request);
  } while (!decodePlanned());
  findCovered();
  show(request.camera, result);
  queueMissing();
  countHits();
  evict();
  if (views++ == 0 || !isSameRequest(view, request)) {
    view = request;
    is_new_view = true;
  }
}

/// Plans the cut that the view asks for, those nodes first whose parents look worst, as long as memory is left.
void Stream::State::plan(const TraverseRequest& request) {
  planned.clear();
  planned_bytes = 0;
  is_limited = false;
  const Sight sight(request);
  if (!sight.maySee(nodes[0]) || !planNode(request, 0)) return;
  std::priority_queue<std::pair<float, std::uint32_t>> open;
  open.emplace((*cache)[0].error_px, 0);
  while (!open.empty()) {
    const auto [error_px, node] = open.top();
    open.pop();
    const bool is_too_coarse = error_px > request.tolerance || (*cache)[node].is_given_up;
    if (nodes[node].isLeaf() || !is_too_coarse || !refine(request, sight, node)) continue;
    forEachPlannedChild(node, [&](std::uint32_t child) { open.emplace((*cache)[child].error_px, child); });
  }
}

/// False where there is no memory for it.
bool Stream::State::planNode(const TraverseRequest& request, std::uint32_t node) {
  if (planned_bytes + cache->costOf(node) > pictureMemory()) {
    is_limited = true;
    return false;
  }
  planned_bytes += cache->costOf(node);
  planned.push_back(node);
  NodeState& state = (*cache)[node];
  state.used = frame;
  state.error_px = projectedError(request.camera, nodes[node].box, nodes[node].error);
  state.is_refined = false;
  return true;
}

/// Plans the children of a node that may be seen: all of them or none.
bool Stream::State::refine(const TraverseRequest& request, const Sight& sight, std::uint32_t node) {
  std::vector<std::uint32_t> seen;
  std::uint64_t cost = 0;
  NodeState& state = (*cache)[node];
  for (std::uint32_t c = nodes[node].first_child; c < nodes[node].first_child + nodes[node].children; ++c) {
    if (!sight.maySee(nodes[c])) continue;
    // Its parent shows what a damaged node would, unless that is damaged itself.
    if ((*cache)[c].is_given_up && !state.is_given_up) return false;
    seen.push_back(c);
    cost += cache->costOf(c);
  }
  const std::uint64_t freed = keepsRefined() ? 0 : cache->costOf(node);
  if (planned_bytes - freed + cost > pictureMemory()) {
    is_limited = true;
    return false;
  }
  planned_bytes -= freed;
  state.is_refined = true;
  for (const std::uint32_t child : seen) planNode(request, child);
  return true;
}

/// False where the plan is to be made again.
bool Stream::State::decodePlanned() {
  is_decoding = false;
  bool has_learnt = false;
  for (const std::uint32_t node : planned) {
    const NodeState& state = (*cache)[node];
    if (state.picture || !cache->has(node) || (state.is_refined && !keepsRefined())) continue;
    if (!mayDecode()) {
      is_decoding = true;
      break;
    }
    has_learnt |= state.known_cost == 0;
    if (!decode(node)) return false;
  }
  may_refine = is_limited && has_learnt;
  return !may_refine || !mayDecode();
}

/// False where the block is damaged, which is given up then.
bool Stream::State::decode(std::uint32_t node) {
  const Node& row = nodes[node];
  decoded += std::uint64_t{row.triangles} + row.points + 1;
  base::Bytes read;
  const auto bytes = readBlock(node, read);
  auto picture = bytes ? decodePicture(header, row, node, *bytes) : nullptr;
  if (!picture) return giveUp(node), false;
  cache->keepPicture(std::move(picture));
  return true;
}

/// The block that is here. `read`: holds it where it is read from the file. None where that fails.
std::optional<base::ByteView> Stream::State::readBlock(std::uint32_t part, base::Bytes& read) const {
  if (!file) return (*cache)[part].block;
  read.resize(cache->placeOf(part).bytes);
  if (!file->read(cache->placeOf(part).offset, read)) return std::nullopt;
  return read;
}

void Stream::State::giveUp(std::uint32_t part) {
  cache->giveUp(part);
  ++given_up;
}

/// A node is covered by its picture, or by children that are.
void Stream::State::findCovered() {
  waiting = 0;
  // Children are planned behind their parents.
  for (std::size_t i = planned.size(); i-- > 0;) {
    NodeState& state = (*cache)[planned[i]];
    bool has_children = state.is_refined;
    if (state.is_refined)
      forEachPlannedChild(planned[i], [&](std::uint32_t child) { has_children &= (*cache)[child].is_covered; });
    state.is_covered = state.picture || has_children;
    waiting += state.is_covered || state.is_given_up ? 0 : 1;
  }
}

void Stream::State::show(const base::Camera& camera, std::vector<DrawnNode>& result) {
  lacking = 0;
  std::vector<std::pair<float, std::uint32_t>> order;
  std::vector<std::uint32_t> open;
  if (!planned.empty()) open.push_back(planned.front());
  while (!open.empty()) {
    const std::uint32_t node = open.back();
    open.pop_back();
    const NodeState& state = (*cache)[node];
    bool has_children = state.is_refined;
    if (state.is_refined)
      forEachPlannedChild(node, [&](std::uint32_t child) { has_children &= (*cache)[child].is_covered; });
    if (state.picture && !has_children)
      order.emplace_back(depthOf(camera, nodes[node].box), node);
    else if (state.is_refined)
      forEachPlannedChild(node, [&](std::uint32_t child) { open.push_back(child); });
  }
  std::sort(order.begin(), order.end());
  for (const auto& [depth, node] : order) {
    const NodeState& state = (*cache)[node];
    lacking += state.is_refined ? 1 : 0;
    result.push_back({state.error_px, state.is_refined, state.picture});
  }
  drawn = result.size();
}

void Stream::State::queueMissing() {
  queue.clear();
  queue_at = 0;
  if (file) return;
  for (const std::uint32_t node : planned)
    if (isWanted(node)) queue.push_back(node);
}

/// Counts the nodes that this view wants and the one before did not.
void Stream::State::countHits() {
  for (const std::uint32_t node : planned) {
    NodeState& state = (*cache)[node];
    const bool is_new = views == 0 || state.last_wanted != views;
    state.last_wanted = views + 1;
    if (!is_new || (state.is_refined && !keepsRefined())) continue;
    if (cache->has(node))
      ++hits;
    else if (isWanted(node) || state.is_requested)
      ++misses;
  }
}

// ---- casters of frames ----

void Stream::State::updateCasters(std::span<const std::uint32_t> wanted,
                                  std::vector<std::shared_ptr<const CasterPicture>>& result) {
  result.clear();
  if (frame == 0) return;
  asked_for_casters = true;
  const std::size_t first = planned_casters.size();
  const bool pictures_are_limited = is_limited;
  // Decoded casters tell how much memory they take, which may leave room for more.
  for (std::size_t next = first; true;) {
    is_limited = pictures_are_limited;
    planCasterFor(0);  // stands in for all others
    for (const std::uint32_t node : wanted) planCasterFor(node);
    if (!decodeCasters(next)) break;
  }
  std::vector<std::uint32_t> shown;
  for (const std::uint32_t node : wanted) shown.push_back(nearestCaster(node));
  std::sort(shown.begin(), shown.end());
  shown.erase(std::unique(shown.begin(), shown.end()), shown.end());
  for (const std::uint32_t node : shown) {
    const auto& caster = (*cache)[cache->casterOf(node)].caster;
    if (caster && !caster->triangles.empty()) result.push_back(caster);
  }
  queueMissingCasters(first);
  evict();
}

/// False where there is no memory for it, or it is damaged.
bool Stream::State::planCaster(std::uint32_t node) {
  const std::uint32_t part = cache->casterOf(node);
  NodeState& state = (*cache)[part];
  if (state.used == frame) return true;
  if (!state.caster && (*cache)[cache->sourceOfCaster(node)].is_given_up) return false;
  if (planned_bytes + cache->costOf(part) > cache->limit()) {
    is_limited = true;
    // The next update() keeps memory for casters.
    if (!keeps_casters) ++generation, may_refine = true;
    return false;
  }
  planned_bytes += cache->costOf(part);
  planned_casters.push_back(part);
  state.used = frame;
  return true;
}

/// Plans the node's caster or the nearest above it that can be had, and returns its node; that may be none, too, for
/// the root.
std::uint32_t Stream::State::planCasterFor(std::uint32_t node) {
  while (!planCaster(node) && node != 0) node = parents[node];
  return node;
}

/// Decodes the planned casters from `next` on, and moves it behind them. Whether more may fit into the memory then.
bool Stream::State::decodeCasters(std::size_t& next) {
  bool has_learnt = false;
  for (; next < planned_casters.size(); ++next) {
    const std::uint32_t part = planned_casters[next], node = cache->nodeOf(part);
    const std::uint64_t cost = cache->costOf(part);
    if (!decodeCaster(node)) planCasterFor(node);  // the one above, behind the others
    has_learnt |= cache->costOf(part) < cost;
    planned_bytes -= cost - cache->costOf(part);
  }
  return has_learnt && is_limited;
}

/// Decodes a planned caster if its block is here. False where that is damaged, which is given up then.
bool Stream::State::decodeCaster(std::uint32_t node) {
  const std::uint32_t part = cache->casterOf(node), source = cache->sourceOfCaster(node);
  if ((*cache)[part].caster || !cache->has(source)) return true;
  if (!mayDecode()) {
    is_decoding = true;
    return true;
  }
  const Node& row = nodes[node];
  decoded += std::uint64_t{row.isLeaf() ? row.triangles : row.caster_triangles} + 1;
  const auto& picture = (*cache)[source].picture;
  base::Bytes read;
  const auto bytes = picture ? base::ByteView() : readBlock(source, read);
  auto caster = picture ? casterOfLeaf(*picture) : bytes ? hlod::decodeCaster(header, row, node, *bytes) : nullptr;
  (*cache)[source].needed = 0;
  if (!caster) return giveUp(source), (*cache)[part].used = 0, false;
  cache->keepCaster(std::move(caster));
  return true;
}

/// The node whose caster is shown for the node's: itself or the nearest above it that is here; the root where none is.
std::uint32_t Stream::State::nearestCaster(std::uint32_t node) {
  const auto isShown = [this](std::uint32_t at) { return (*cache)[cache->casterOf(at)].caster && planCaster(at); };
  while (!isShown(node) && node != 0) node = parents[node];
  return node;
}

/// `first`: the first of the planned casters that the call has added.
void Stream::State::queueMissingCasters(std::size_t first) {
  for (std::size_t i = first; i < planned_casters.size(); ++i) {
    const std::uint32_t node = cache->nodeOf(planned_casters[i]), source = cache->sourceOfCaster(node);
    if ((*cache)[planned_casters[i]].caster || (*cache)[source].is_given_up) continue;
    ++waiting_casters;
    (*cache)[source].needed = frame;
    if (isWanted(source)) queue.push_back(source);
  }
}

// ---- what to ask for ----

std::optional<PendingRequest> Stream::State::nextFrontRange() const {
  if (cache || requests.frontIsUnderWay()) return std::nullopt;
  return frontRequest(file_bytes, front.size(), kHeaderBytes + header.table_bytes);
}

bool Stream::State::isWanted(std::uint32_t part) const {
  const NodeState& state = (*cache)[part];
  const bool is_of_view = !cache->isCaster(part) && state.used == frame && !state.is_covered;
  return (is_of_view || state.needed == frame) && !state.is_requested && !state.is_given_up && !cache->has(part);
}

/// A block, however long, and neighbours as long as all have at most so many bytes.
std::optional<PendingRequest> Stream::State::nextBlockRange(std::uint64_t max_bytes) {
  if (!cache) return std::nullopt;
  while (queue_at < queue.size() && !isWanted(queue[queue_at])) ++queue_at;
  if (queue_at == queue.size()) return std::nullopt;
  const std::uint32_t part = queue[queue_at];
  std::uint64_t bytes = cache->placeOf(part).bytes;
  const auto partAt = [this](std::uint64_t place) {
    const auto number = static_cast<std::uint32_t>(place);
    return RequestablePart{cache->placeOf(number).bytes, isWanted(number), (*cache)[number].is_requested};
  };
  PendingRequest request;
  request.last = extendRequest(part, 1, 0, cache->parts(), max_bytes, bytes, partAt);
  request.first = extendRequest(part, -1, 0, cache->parts(), max_bytes, bytes, partAt);
  request.range = {0, cache->placeOf(static_cast<std::uint32_t>(request.first)).offset, bytes};
  return request;
}

/// Bytes for a view.
std::uint64_t Stream::State::prefetchBudget() const {
  const double rate = requests.bytesPerSecond();
  if (rate < options.prefetch_least_rate) return 0;
  return static_cast<std::uint64_t>(
      std::min(static_cast<double>(options.prefetch_bytes), options.prefetch_seconds * rate));
}

/// The block that the view wants with the least motion, once it has all that it wants.
std::optional<PendingRequest> Stream::State::nextPrefetch() {
  if (!cache || frame == 0 || options.prefetch_bytes == 0 || waiting + waiting_casters > 0 || is_decoding)
    return std::nullopt;
  if (requests.underWay() >= kPrefetchesAtOnce) return std::nullopt;
  if (std::exchange(is_new_view, false)) {
    may_prefetch = prefetchBudget();
    next_at = 0;
    findNextParts();
  }
  for (; next_at < next_parts.size(); ++next_at) {
    const std::uint32_t part = next_parts[next_at].node;
    const BlockPlace& place = cache->placeOf(part);
    if (cache->has(part) || (*cache)[part].is_given_up) continue;
    if (place.bytes > may_prefetch || cache->bytes() + place.bytes > cache->limit()) return std::nullopt;
    may_prefetch -= place.bytes;
    prefetched += place.bytes;
    ++next_at;
    PendingRequest request;
    request.first = request.last = part;
    request.range = {0, place.offset, place.bytes};
    return request;
  }
  return std::nullopt;
}

void Stream::State::findNextParts() {
  next_parts.clear();
  if (may_prefetch == 0) return;
  // Some are here already, so that there may be use for more than are fetched.
  const std::uint64_t bytes = 4 * may_prefetch;
  next_parts = nodesWantedNext(nodes, view, bytes);
  for (const LightRequest& light : lights)
    for (const NextNode& next : castersWantedNext(nodes, light, bytes))
      next_parts.push_back({next.motion, cache->sourceOfCaster(next.node)});
  std::stable_sort(next_parts.begin(), next_parts.end(),
                   [](const NextNode& a, const NextNode& b) { return a.motion < b.motion; });
}

void Stream::State::expectLights(std::vector<LightRequest> wanted) {
  const auto isSame = [](const LightRequest& a, const LightRequest& b) {
    return base::sameCamera(a.camera, b.camera) && a.max_error == b.max_error;
  };
  if (!std::equal(lights.begin(), lights.end(), wanted.begin(), wanted.end(), isSame)) is_new_view = true;
  lights = std::move(wanted);
}

/// Whether the last view awaits the request.
bool Stream::State::concernsView(const PendingRequest& request) const {
  if (request.range.id != prefetch_id) return true;
  const NodeState& state = (*cache)[static_cast<std::uint32_t>(request.first)];
  return state.used == frame || state.needed == frame;
}

ByteRange Stream::State::send(const PendingRequest& request, double now) {
  if (!request.is_front)
    for (std::uint64_t part = request.first; part <= request.last; ++part)
      (*cache)[static_cast<std::uint32_t>(part)].is_requested = true;
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
  nodes = std::move(*table);
  cache.emplace(nodes, options.memory_bytes, file != nullptr);
  parents.assign(nodes.size(), 0);
  for (std::uint32_t node = 0; node < nodes.size(); ++node)
    for (std::uint32_t c = nodes[node].first_child; c < nodes[node].first_child + nodes[node].children; ++c)
      parents[c] = node;
  // Blocks may have come with the table.
  for (std::uint32_t part = 0; part < cache->parts(); ++part) {
    const BlockPlace& place = cache->placeOf(part);
    if (place.offset + place.bytes > front.size()) break;
    acceptBlock(part, base::ByteView(front).subspan(place.offset, place.bytes));
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

void Stream::State::acceptBlock(std::uint32_t part, base::ByteView bytes) {
  NodeState& state = (*cache)[part];
  if (state.is_given_up || cache->has(part)) return;
  if (isIntact(bytes, nodes[cache->nodeOf(part)], {header.colors, cache->isCaster(part)}))
    return cache->keepBlock(part, bytes, frame);
  requests.countDamage();
  queue_at = 0;
  if (++state.damages >= kMaxDamages) giveUp(part);
}

// ---- the class ----

Stream::Stream(std::uint64_t file_bytes, const StreamOptions& options)
    : state_(std::make_unique<State>(file_bytes, options)) {
  if (file_bytes < kHeaderBytes)
    state_->stop("its " + std::to_string(file_bytes) + " bytes are no hlod.lgh; publish the scene again");
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
std::span<const Node> Stream::nodes() const {
  return state_->nodes;
}

void Stream::setMemory(std::uint64_t bytes) {
  State& s = *state_;
  bytes = std::max(bytes, kMinStreamMemory);
  if (s.options.memory_bytes == bytes) return;
  s.options.memory_bytes = bytes;
  if (s.cache) s.cache->setLimit(bytes);
  ++s.generation;
}

void Stream::update(const TraverseRequest& request, std::vector<DrawnNode>& result, std::uint32_t frames) {
  state_->update(request, result, frames);
}
void Stream::updateCasters(std::span<const std::uint32_t> wanted,
                           std::vector<std::shared_ptr<const CasterPicture>>& result) {
  state_->updateCasters(wanted, result);
}
void Stream::expectLights(std::vector<LightRequest> lights) {
  state_->expectLights(std::move(lights));
}
std::uint64_t Stream::generation() const {
  return state_->generation;
}
bool Stream::complete() const {
  const State& s = *state_;
  return s.problem.empty() && s.frame > 0 && s.waiting + s.waiting_casters == 0 && !s.may_refine;
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
    if (!next) next = s.nextBlockRange(std::min(room, s.options.max_request_bytes));
    const bool is_prefetch = !next;
    if (!next) next = s.nextPrefetch();
    if (!next) break;
    ranges.push_back(s.send(*next, now));
    if (is_prefetch) s.prefetch_id = ranges.back().id;
  }
  return ranges;
}

void Stream::acceptAnswer(std::uint64_t id, base::ByteView bytes, double now) {
  State& s = *state_;
  const auto answered = s.requests.takeAnswered(id, bytes.size(), now);
  if (!answered) return;
  const PendingRequest& request = answered->request;
  if (s.concernsView(request)) ++s.generation;
  if (answered->has_failed) s.queue_at = 0;
  if (request.is_front) {
    if (!answered->has_failed) s.acceptFront(bytes);
  } else {
    for (auto part = static_cast<std::uint32_t>(request.first); part <= request.last; ++part) {
      (*s.cache)[part].is_requested = false;
      const BlockPlace& place = s.cache->placeOf(part);
      if (!answered->has_failed)
        s.acceptBlock(part, bytes.subspan(static_cast<std::size_t>(place.offset - request.range.offset), place.bytes));
    }
  }
  if (s.cache) s.evict();
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
  const auto states = s.cache->states();
  const auto first =
      std::find_if(states.begin(), states.end(), [](const NodeState& state) { return state.is_given_up; });
  const auto part = static_cast<std::uint32_t>(first - states.begin());
  return (s.cache->isCaster(part) ? "caster of node " : "node ") + std::to_string(s.cache->nodeOf(part)) +
         (s.given_up > 1 ? " and " + std::to_string(s.given_up - 1) + " more are" : " is") +
         " damaged: checksums do not match; " + (s.file ? "copy the file" : "publish the scene") + " again";
}

StreamStats Stream::stats() const {
  const State& s = *state_;
  StreamStats stats;
  stats.nodes = s.nodes.size();
  stats.drawn = s.drawn;
  stats.lacking = s.lacking + s.waiting_casters;
  stats.bytes_received = s.requests.bytesReceived();
  stats.requests = s.requests.requests();
  stats.failures = s.requests.failures();
  stats.under_way = s.requests.underWay();
  stats.damaged = s.given_up;
  stats.prefetched_bytes = s.prefetched;
  stats.hits = s.hits, stats.misses = s.misses;
  if (!s.cache) return stats;
  stats.present = s.cache->pictures();
  stats.memory_bytes =
      s.cache->bytes() + s.nodes.size() * (sizeof(Node) + 2 * sizeof(NodeState) + sizeof(std::uint32_t));
  return stats;
}

}  // namespace lod::hlod
