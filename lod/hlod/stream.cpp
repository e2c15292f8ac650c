#include "lod/hlod/stream.h"

#include <algorithm>
#include <optional>
#include <queue>
#include <utility>

#include "lod/hlod/block.h"
#include "lod/hlod/node_cache.h"
#include "lod/hlod/node_picture.h"
#include "lod/range_requests.h"
#include "lod/view_box.h"

namespace lod::hlod {

struct Stream::State {
  State(std::uint64_t bytes, const StreamOptions& given) : options(given), file_bytes(bytes) {
    options.memory_bytes = std::max(options.memory_bytes, kMinStreamMemory);
  }

  // ---- frames ----

  void update(const TraverseRequest& request, std::vector<DrawnNode>& result, std::uint32_t frames);
  void plan(const TraverseRequest& request);
  bool planNode(const TraverseRequest& request, std::uint32_t node);
  bool refine(const TraverseRequest& request, const Sight& sight, std::uint32_t node);
  bool decodePlanned();
  bool decode(std::uint32_t node);
  void findCovered();
  void show(const base::Camera& camera, std::vector<DrawnNode>& result);
  void queueMissing();
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

  // ---- the link ----

  std::optional<PendingRequest> nextFrontRange() const;
  std::optional<PendingRequest> nextBlockRange(std::uint64_t max_bytes);
  bool isWanted(std::uint32_t node) const;
  ByteRange send(const PendingRequest& request, double now);
  void acceptFront(base::ByteView bytes);
  void readFront();
  void readLocalFront();
  void frontIsDamaged(const base::Error& error);
  void acceptBlock(std::uint32_t node, base::ByteView bytes);
  void stop(std::string reason) {
    if (problem.empty()) problem = std::move(reason);
  }

  StreamOptions options;
  const std::uint64_t file_bytes;
  std::shared_ptr<const FileBytes> file;  // null where the file is streamed

  base::Bytes front;  // what has come of header and table
  Header header;
  std::vector<Node> nodes;
  std::optional<NodeCache> cache;  // none until header and table are here
  int front_damages = 0;

  std::uint32_t frame = 0;
  std::uint64_t generation = 0;
  /// The nodes from the root down to the cut that the view asks for, or that memory allows, by falling projected error
  /// of their parents.
  std::vector<std::uint32_t> planned;
  std::uint64_t planned_bytes = 0;
  std::vector<std::uint32_t> queue;  // planned nodes that are missing, in the same order
  std::size_t queue_at = 0;
  std::uint64_t decoded = 0;     // triangles and points of this frame
  std::uint64_t may_decode = 0;  // 0: no limit
  std::uint64_t waiting = 0;     // planned nodes that nothing shows wholly
  std::uint64_t drawn = 0, lacking = 0;
  bool is_decoding = false, is_limited = false;
  bool may_refine = false;  // memory may turn out to be enough for more than was planned

  RangeRequests requests;
  std::uint64_t given_up = 0;
  std::string problem;
};

// ---- frames ----

void Stream::State::update(const TraverseRequest& request, std::vector<DrawnNode>& result, std::uint32_t frames) {
  result.clear();
  if (!cache) return;
  may_decode = frames * options.decode_per_frame;
  decoded = 0;
  // Decoded nodes tell how much memory they take, and whether they are damaged, so the plan may change.
  do {
    ++frame;
    plan(request);
  } while (!decodePlanned());
  findCovered();
  show(request.camera, result);
  queueMissing();
  cache->evict(frame, planned);
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
  if (planned_bytes + cache->costOf(node) > cache->limit()) {
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
  if (planned_bytes - freed + cost > cache->limit()) {
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
  base::ByteView bytes = (*cache)[node].block;
  bool is_here = true;
  if (file) {
    read.resize(row.picture.bytes);
    is_here = file->read(row.picture.offset, read);
    bytes = read;
  }
  auto picture = is_here ? decodePicture(header, row, node, bytes) : nullptr;
  if (picture) {
    cache->keepPicture(std::move(picture));
    return true;
  }
  cache->giveUp(node);
  ++given_up;
  return false;
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

// ---- what to ask for ----

std::optional<PendingRequest> Stream::State::nextFrontRange() const {
  if (cache || requests.frontIsUnderWay()) return std::nullopt;
  return frontRequest(file_bytes, front.size(), kHeaderBytes + header.table_bytes);
}

bool Stream::State::isWanted(std::uint32_t node) const {
  const NodeState& state = (*cache)[node];
  return state.used == frame && !state.is_covered && !state.is_requested && !state.is_given_up && !cache->has(node);
}

/// A block, however long, and neighbours as long as all have at most so many bytes.
std::optional<PendingRequest> Stream::State::nextBlockRange(std::uint64_t max_bytes) {
  if (!cache) return std::nullopt;
  while (queue_at < queue.size() && !isWanted(queue[queue_at])) ++queue_at;
  if (queue_at == queue.size()) return std::nullopt;
  const std::uint32_t node = queue[queue_at];
  std::uint64_t bytes = nodes[node].picture.bytes;
  const auto partAt = [this](std::uint64_t place) {
    const auto number = static_cast<std::uint32_t>(place);
    return RequestablePart{nodes[number].picture.bytes, isWanted(number), (*cache)[number].is_requested};
  };
  PendingRequest request;
  request.last = extendRequest(node, 1, 0, nodes.size(), max_bytes, bytes, partAt);
  request.first = extendRequest(node, -1, 0, nodes.size(), max_bytes, bytes, partAt);
  request.range = {0, nodes[request.first].picture.offset, bytes};
  return request;
}

ByteRange Stream::State::send(const PendingRequest& request, double now) {
  if (!request.is_front)
    for (std::uint64_t node = request.first; node <= request.last; ++node)
      (*cache)[static_cast<std::uint32_t>(node)].is_requested = true;
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
  // Blocks may have come with the table.
  for (std::uint32_t node = 0; node < nodes.size(); ++node) {
    const BlockPlace& place = nodes[node].picture;
    if (place.offset + place.bytes > front.size()) break;
    acceptBlock(node, base::ByteView(front).subspan(place.offset, place.bytes));
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

void Stream::State::acceptBlock(std::uint32_t node, base::ByteView bytes) {
  NodeState& state = (*cache)[node];
  if (state.is_given_up || cache->has(node)) return;
  if (isIntact(bytes, nodes[node], {header.colors, false})) return cache->keepBlock(node, bytes);
  requests.countDamage();
  queue_at = 0;
  if (++state.damages < kMaxDamages) return;
  cache->giveUp(node);
  ++given_up;
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

void Stream::update(const TraverseRequest& request, std::vector<DrawnNode>& result, std::uint32_t frames) {
  state_->update(request, result, frames);
}
std::uint64_t Stream::generation() const {
  return state_->generation;
}
bool Stream::complete() const {
  return state_->problem.empty() && state_->frame > 0 && state_->waiting == 0 && !state_->may_refine;
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
    for (auto node = static_cast<std::uint32_t>(request.first); node <= request.last; ++node) {
      (*s.cache)[node].is_requested = false;
      const BlockPlace& place = s.nodes[node].picture;
      if (!answered->has_failed)
        s.acceptBlock(node, bytes.subspan(static_cast<std::size_t>(place.offset - request.range.offset), place.bytes));
    }
  }
  if (s.cache) s.cache->evict(s.frame, s.planned);
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
  return "node " + std::to_string(first - states.begin()) +
         (s.given_up > 1 ? " and " + std::to_string(s.given_up - 1) + " more are" : " is") +
         " damaged: checksums do not match; " + (s.file ? "copy the file" : "publish the scene") + " again";
}

StreamStats Stream::stats() const {
  const State& s = *state_;
  StreamStats stats;
  stats.nodes = s.nodes.size();
  stats.drawn = s.drawn;
  stats.lacking = s.lacking;
  stats.bytes_received = s.requests.bytesReceived();
  stats.requests = s.requests.requests();
  stats.failures = s.requests.failures();
  stats.under_way = s.requests.underWay();
  stats.damaged = s.given_up;
  if (!s.cache) return stats;
  stats.present = s.cache->pictures();
  stats.memory_bytes = s.cache->bytes() + s.nodes.size() * (sizeof(Node) + sizeof(NodeState));
  return stats;
}

}  // namespace lod::hlod
