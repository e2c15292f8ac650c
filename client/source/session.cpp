#include "client/source/session.h"

#include <algorithm>
#include <deque>
#include <unordered_map>
#include <unordered_set>
#include <utility>

#include "lod/patch/format.h"
#include "repository/cache.h"

namespace client {
namespace {

/// Faces and groups share one cache. A face's key is its code (63 bits), a group's its number with the highest bit set.
using CacheKey = std::uint64_t;
constexpr CacheKey kGroupTag = CacheKey{1} << 63U;

CacheKey cacheKey(const repository::FaceKey& key) {
  return key.code();
}
CacheKey cacheKey(std::uint32_t group) {
  return kGroupTag | group;
}
bool isGroup(CacheKey key) {
  return (key & kGroupTag) != 0;
}
std::uint32_t groupOf(CacheKey key) {
  return static_cast<std::uint32_t>(key & ~kGroupTag);
}

/// Bytes counted for each entry beside its content (a list node and two table rows), so that a flood of empty faces
/// costs what it occupies.
constexpr std::uint64_t kEntryOverhead = 128;
/// Exact frames that are kept, the newest, as far as their bytes allow. A choice: older ones are of views farther away.
constexpr std::size_t kMaxFrames = 4;

bool sameView(const base::ViewCamera& a, const base::ViewCamera& b) {
  return a.position == b.position && a.direction == b.direction && a.up == b.up && a.fov_y == b.fov_y &&
         a.width == b.width && a.height == b.height;
}

/// Whether cached faces and groups of one scene are valid in the other.
bool sameScene(const protocol::Welcome& a, const protocol::Welcome& b) {
  return a.scene_name == b.scene_name && a.origin == b.origin && a.lattice_origin == b.lattice_origin &&
         a.lattice_step == b.lattice_step && a.grid == b.grid && a.group_count == b.group_count &&
         a.patch_count == b.patch_count && a.source_triangles == b.source_triangles;
}

base::Error badServer(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "the server " + problem + "; is it a lumigrid server of this version?"};
}

}  // namespace

struct Session::Impl {
  explicit Impl(const SessionOptions& wanted) : options(wanted), cache(wanted.cache_bytes) {}

  SessionOptions options;
  SessionPhase phase = SessionPhase::kDisconnected;
  std::string problem;
  std::optional<Method> method_instead;
  std::optional<protocol::Welcome> welcome;
  lod::patch::Hierarchy hierarchy;

  repository::LruCache<CacheKey, base::Bytes> cache;
  std::unordered_set<CacheKey> cached;  // the cache's keys, for Holdings
  std::unordered_map<std::uint32_t, std::uint32_t>
      cached_children;  // per group: cached groups that have it as a parent
  std::unordered_set<CacheKey> in_use;
  std::deque<protocol::Frame> frames;  // oldest first
  std::uint32_t frame_sequence = 0;    // view of the last frame that arrived, kept or not

  std::deque<base::Bytes> greetings;        // Hello or Holdings, sent before anything else
  std::unordered_set<CacheKey> unreported;  // evicted, and the server does not know yet
  std::optional<base::ViewCamera> camera;   // the newest
  std::uint32_t sequence = 0;               // number of the newest view
  std::uint32_t complete_sequence = 0;
  bool view_unsent = false;

  SessionEvents events;
  SessionStats stats;

  base::Result<void> acceptWelcome(protocol::Welcome&& message);
  base::Result<void> acceptFace(protocol::Face&& message, std::size_t bytes);
  base::Result<void> acceptRefinement(protocol::Refinement&& message, std::size_t bytes);
  base::Result<void> acceptFrame(protocol::Frame&& message, std::size_t bytes);
  base::Result<void> acceptCompletion(const protocol::Completion& message);
  base::Result<void> acceptRefusal(const protocol::Refusal& message);
  base::Result<void> acceptMessage(protocol::ServerMessage&& message, std::size_t bytes);

  void startScene(const protocol::Welcome& message);
  bool insert(CacheKey key, base::Bytes&& bytes);
  void evictOverBudget();
  void forget(CacheKey key);
  bool pinned(CacheKey key) const;
  void queueHave();
  base::Bytes evictedMessage();
  base::Bytes viewMessage();
  std::uint64_t frameBytes() const;
  bool wantsFrame() const { return options.frames && welcome->can_render_frames; }
};

// ---- the cache ----

void Session::Impl::startScene(const protocol::Welcome& message) {
  cache = repository::LruCache<CacheKey, base::Bytes>(options.cache_bytes);
  cached.clear();
  cached_children.clear();
  in_use.clear();
  frames.clear();
  frame_sequence = 0;
  unreported.clear();
  stats.cache_bytes = 0;
  stats.frame_bytes = 0;
  events = {};
  events.welcomed = true;

  hierarchy = {};
  hierarchy.lattice = {message.lattice_origin, message.lattice_step};
  hierarchy.has_colors = message.has_colors;
  hierarchy.source_triangles = message.source_triangles;
}

/// Returns true when the key is new.
bool Session::Impl::insert(CacheKey key, base::Bytes&& bytes) {
  const std::uint64_t cost = bytes.size() + kEntryOverhead;
  cache.insert(key, std::move(bytes), cost);
  unreported.erase(key);
  const bool is_new = cached.insert(key).second;
  if (is_new && isGroup(key))
    for (std::uint32_t parent : hierarchy.parentsOf(groupOf(key))) ++cached_children[parent];
  stats.cache_bytes = cache.bytes();
  return is_new;
}

/// A cut can only be drawn from the top down, so group 0 stays, and so does every group below which something is
/// cached.
bool Session::Impl::pinned(CacheKey key) const {
  if (in_use.count(key) != 0) return true;
  if (!isGroup(key)) return false;
  const std::uint32_t group = groupOf(key);
  return group == 0 || cached_children.count(group) != 0;
}

/// Evicts in rounds: a group whose last cached child went in one round may go in the next.
void Session::Impl::evictOverBudget() {
  while (cache.bytes() > cache.budget()) {
    const std::vector<CacheKey> gone = cache.evict([this](CacheKey key) { return pinned(key); });
    if (gone.empty()) break;
    for (CacheKey key : gone) forget(key);
  }
  stats.cache_bytes = cache.bytes();
}

void Session::Impl::forget(CacheKey key) {
  cached.erase(key);
  unreported.insert(key);
  if (!isGroup(key)) {
    if (auto face = repository::FaceKey::fromCode(key)) events.faces_evicted.push_back(*face);
    return;
  }
  const std::uint32_t group = groupOf(key);
  events.groups_evicted.push_back(group);
  for (std::uint32_t parent : hierarchy.parentsOf(group)) {
    auto it = cached_children.find(parent);
    if (it != cached_children.end() && --it->second == 0) cached_children.erase(it);
  }
}

std::uint64_t Session::Impl::frameBytes() const {
  std::uint64_t bytes = 0;
  for (const protocol::Frame& frame : frames) bytes += frame.value.size();
  return bytes;
}

// ---- messages from the server ----

base::Result<void> Session::Impl::acceptWelcome(protocol::Welcome&& message) {
  if (phase != SessionPhase::kGreeting) return badServer("said Welcome twice");
  const bool same = welcome.has_value() && sameScene(*welcome, message);
  if (!same) startScene(message);
  welcome = std::move(message);
  phase = SessionPhase::kReady;
  problem.clear();
  queueHave();
  view_unsent = camera.has_value();
  return {};
}

base::Result<void> Session::Impl::acceptFace(protocol::Face&& message, std::size_t bytes) {
  if (!options.images) return badServer("sent images although none were asked for");
  if (!welcome->grid.contains(message.key)) return badServer("sent an image of a point outside its own grid");
  ++stats.faces_received;
  stats.bytes_faces += bytes;
  if (insert(cacheKey(message.key), std::move(message.value))) events.faces_added.push_back(message.key);
  evictOverBudget();
  return {};
}

base::Result<void> Session::Impl::acceptRefinement(protocol::Refinement&& message, std::size_t bytes) {
  base::ByteReader in(message.record);
  auto group = lod::patch::addGroup(in, hierarchy, welcome->group_count, welcome->patch_count);
  if (!group) return base::within("the server sent a bad group", group.error());
  if (!in.atEnd()) return badServer("sent a group record with bytes after its end");
  if (message.block.size() != hierarchy.groups[*group].block_bytes)
    return badServer("sent a group whose geometry is not as long as its record says");
  ++stats.groups_received;
  stats.bytes_patches += bytes;
  if (insert(cacheKey(*group), std::move(message.block))) events.groups_added.push_back(*group);
  evictOverBudget();
  return {};
}

base::Result<void> Session::Impl::acceptFrame(protocol::Frame&& message, std::size_t bytes) {
  if (!options.frames) return badServer("sent a frame although none was asked for");
  if (message.sequence > sequence) return badServer("sent a frame for a view that was never asked for");
  ++stats.frames_received;
  stats.bytes_frames += bytes;
  std::erase_if(frames, [&](const protocol::Frame& kept) { return kept.sequence == message.sequence; });
  frame_sequence = message.sequence;
  events.frames_added.push_back(message.sequence);
  frames.push_back(std::move(message));
  while (frames.size() > kMaxFrames || frameBytes() > options.frame_bytes) frames.pop_front();
  stats.frame_bytes = frameBytes();
  return {};
}

base::Result<void> Session::Impl::acceptCompletion(const protocol::Completion& message) {
  if (message.sequence > sequence) return badServer("completed a view that was never asked for");
  complete_sequence = std::max(complete_sequence, message.sequence);
  return {};
}

base::Result<void> Session::Impl::acceptRefusal(const protocol::Refusal& message) {
  phase = SessionPhase::kRefused;
  if (message.splats_only) method_instead = Method::kQsplat;
  problem = "the server refused: " + (message.reason.empty() ? "it gave no reason" : message.reason);
  if (message.version != protocol::kVersion)
    problem += " (it speaks protocol " + std::to_string(message.version) + ", this client " +
               std::to_string(protocol::kVersion) + "; update the older one)";
  return {};
}

base::Result<void> Session::Impl::acceptMessage(protocol::ServerMessage&& message, std::size_t bytes) {
  // Welcome and Refusal may come first; all else only after a Welcome.
  if (auto* welcome_message = std::get_if<protocol::Welcome>(&message))
    return acceptWelcome(std::move(*welcome_message));
  if (auto* refusal = std::get_if<protocol::Refusal>(&message)) return acceptRefusal(*refusal);
  if (phase != SessionPhase::kReady) return badServer("sent data before its Welcome");

  if (auto* face = std::get_if<protocol::Face>(&message)) return acceptFace(std::move(*face), bytes);
  if (auto* refine = std::get_if<protocol::Refinement>(&message)) return acceptRefinement(std::move(*refine), bytes);
  if (auto* frame = std::get_if<protocol::Frame>(&message)) return acceptFrame(std::move(*frame), bytes);
  if (auto* complete = std::get_if<protocol::Completion>(&message)) return acceptCompletion(*complete);
  return badServer("sent a message that this client does not know");
}

// ---- messages to the server ----

void Session::Impl::queueHave() {
  protocol::Holdings have;
  const auto flush = [&] {
    if (have.faces.empty() && have.groups.empty()) return;
    greetings.push_back(protocol::encode(std::exchange(have, {})));
  };
  for (CacheKey key : cached) {
    if (isGroup(key))
      have.groups.push_back(groupOf(key));
    else if (auto face = repository::FaceKey::fromCode(key))
      have.faces.push_back(*face);
    if (have.faces.size() + have.groups.size() == protocol::kMaxKeysPerMessage) flush();
  }
  flush();
}

base::Bytes Session::Impl::evictedMessage() {
  protocol::Eviction evicted;
  while (!unreported.empty() && evicted.faces.size() + evicted.groups.size() < protocol::kMaxKeysPerMessage) {
    const CacheKey key = *unreported.begin();
    unreported.erase(unreported.begin());
    if (isGroup(key))
      evicted.groups.push_back(groupOf(key));
    else if (auto face = repository::FaceKey::fromCode(key))
      evicted.faces.push_back(*face);
  }
  return protocol::encode(std::move(evicted));
}

base::Bytes Session::Impl::viewMessage() {
  view_unsent = false;
  ++stats.views_sent;
  protocol::View view;
  view.sequence = ++sequence;
  view.camera = *camera;
  view.patch_tolerance_px = options.patch_tolerance_px;
  view.max_triangles = options.max_triangles;
  view.max_points = options.images ? options.max_points : std::uint16_t{0};
  view.want_frame = wantsFrame();
  return protocol::encode(view);
}

// ---- the public functions ----

Session::Session(const SessionOptions& options) : impl_(std::make_unique<Impl>(options)) {}
Session::~Session() = default;
Session::Session(Session&& other) noexcept = default;
Session& Session::operator=(Session&& other) noexcept = default;

void Session::connected() {
  Impl& s = *impl_;
  s.phase = SessionPhase::kGreeting;
  s.problem.clear();
  s.unreported.clear();  // a new connection begins with Holdings, which makes evictions known
  s.greetings.clear();
  s.greetings.push_back(protocol::encode(protocol::Hello{protocol::kVersion, "lumigrid-view"}));
  s.view_unsent = false;
}

void Session::disconnected(const std::string& reason) {
  Impl& s = *impl_;
  // A refusal explains more than the closing of the connection that follows it.
  if (s.phase == SessionPhase::kRefused) return;
  s.phase = SessionPhase::kDisconnected;
  s.problem = reason;
  s.greetings.clear();
  s.complete_sequence = 0;
}

void Session::refuse(const std::string& reason, std::optional<Method> method_instead) {
  Impl& s = *impl_;
  s.phase = SessionPhase::kRefused;
  s.method_instead = method_instead;
  s.problem = reason;
  s.greetings.clear();
}

base::Result<void> Session::receive(base::ByteView bytes) {
  Impl& s = *impl_;
  if (s.phase != SessionPhase::kGreeting && s.phase != SessionPhase::kReady)
    return badServer("went on talking after the connection ended");
  ++s.stats.messages_received;
  s.stats.bytes_received += bytes.size();

  auto message = protocol::decodeServerMessage(bytes);
  if (!message) {
    s.problem = message.error().message;
    return message.error();
  }
  auto taken = s.acceptMessage(std::move(*message), bytes.size());
  if (!taken) s.problem = taken.error().message;
  return taken;
}

std::optional<base::Bytes> Session::nextToSend() {
  Impl& s = *impl_;
  if (!s.greetings.empty()) {
    base::Bytes next = std::move(s.greetings.front());
    s.greetings.pop_front();
    return next;
  }
  if (s.phase != SessionPhase::kReady) return std::nullopt;

  // Evictions are sent ahead of the next view, or as soon as a whole message of them has gathered.
  const bool tell = s.view_unsent || s.unreported.size() >= protocol::kMaxKeysPerMessage;
  if (tell && !s.unreported.empty()) return s.evictedMessage();
  if (s.view_unsent) return s.viewMessage();
  return std::nullopt;
}

void Session::setView(const base::ViewCamera& camera) {
  Impl& s = *impl_;
  if (s.camera && sameView(*s.camera, camera)) return;
  s.camera = camera;
  s.view_unsent = s.phase == SessionPhase::kReady;
}

void Session::setWanted(bool images, bool frames) {
  Impl& s = *impl_;
  if (s.options.images == images && s.options.frames == frames) return;
  s.options.images = images;
  s.options.frames = frames;
  s.view_unsent = s.camera && s.phase == SessionPhase::kReady;
}

SessionPhase Session::phase() const {
  return impl_->phase;
}
std::optional<Method> Session::methodInstead() const {
  return impl_->method_instead;
}

const std::string& Session::problem() const {
  return impl_->problem;
}
const protocol::Welcome* Session::welcome() const {
  return impl_->welcome ? &*impl_->welcome : nullptr;
}
bool Session::complete() const {
  const Impl& s = *impl_;
  if (s.phase != SessionPhase::kReady || s.view_unsent || s.sequence == 0) return false;
  if (s.complete_sequence != s.sequence) return false;
  return !s.wantsFrame() || s.frame_sequence == s.sequence;
}
SessionEvents Session::takeEvents() {
  return std::exchange(impl_->events, {});
}

const base::Bytes* Session::face(const repository::FaceKey& key) {
  return impl_->cache.find(cacheKey(key));
}
const base::Bytes* Session::block(std::uint32_t group) {
  return impl_->cache.find(cacheKey(group));
}
const protocol::Frame* Session::frame(std::uint32_t sequence) const {
  for (const protocol::Frame& frame : impl_->frames)
    if (frame.sequence == sequence) return &frame;
  return nullptr;
}

void Session::setInUse(const std::vector<repository::FaceKey>& faces, const std::vector<std::uint32_t>& groups) {
  Impl& s = *impl_;
  s.in_use.clear();
  const auto use = [&s](CacheKey key) {
    if (s.cache.find(key) != nullptr) s.in_use.insert(key);
  };
  for (const repository::FaceKey& key : faces) use(cacheKey(key));
  // Use children before their parents, so that parents end up as the more recently used.
  for (auto it = groups.rbegin(); it != groups.rend(); ++it) use(cacheKey(*it));
  s.evictOverBudget();
}

const lod::patch::Hierarchy& Session::hierarchy() const {
  return impl_->hierarchy;
}
bool Session::hasGroup(std::uint32_t group) const {
  return impl_->cache.contains(cacheKey(group));
}
const SessionStats& Session::stats() const {
  return impl_->stats;
}
const SessionOptions& Session::options() const {
  return impl_->options;
}

}  // namespace client
