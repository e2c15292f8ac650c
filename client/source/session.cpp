#include "client/source/session.h"

#include <algorithm>
#include <utility>

#include "lod/patch/format.h"
#include "plan/view_plan.h"

namespace client {
namespace {

/// Bytes counted for each entry beside its content (a list node and two table rows), so that a flood of empty faces
/// costs what it occupies.
constexpr std::uint64_t kEntryOverhead = 128;
/// Exact frames that are kept, the newest, as far as their bytes allow. A choice: older ones are of views farther away.
constexpr std::size_t kMaxFrames = 4;

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

// ---- the cache ----

void Session::startScene(const protocol::Welcome& message) {
  cache_ = repository::LruCache<CacheKey, base::Bytes>(options_.cache_bytes);
  cached_children_.clear();
  in_use_.clear();
  frames_.clear();
  last_frame_sequence_ = 0;
  unreported_.clear();
  stats_.cache_bytes = 0;
  stats_.frame_bytes = 0;
  events_ = {};
  events_.welcomed = true;

  refined_ = false;
  hierarchy_ = {};
  hierarchy_.lattice = {message.lattice_origin, message.lattice_step};
  hierarchy_.has_colors = message.has_colors;
  hierarchy_.source_triangles = message.source_triangles;
}

/// Returns true when the key is new.
bool Session::insert(CacheKey key, base::Bytes&& bytes) {
  const std::uint64_t cost = bytes.size() + kEntryOverhead;
  const bool is_new = !cache_.contains(key);
  cache_.insert(key, std::move(bytes), cost);
  unreported_.erase(key);
  if (is_new && isGroup(key))
    for (std::uint32_t parent : hierarchy_.parentsOf(groupOf(key))) ++cached_children_[parent];
  stats_.cache_bytes = cache_.bytes();
  return is_new;
}

/// A cut can only be drawn from the top down, so group 0 stays, and so does every group below which something is
/// cached.
bool Session::pinned(CacheKey key) const {
  if (in_use_.count(key) != 0) return true;
  if (!isGroup(key)) return false;
  const std::uint32_t group = groupOf(key);
  return group == 0 || cached_children_.count(group) != 0;
}

/// Evicts in rounds: a group whose last cached child went in one round may go in the next.
void Session::evictOverBudget() {
  while (cache_.bytes() > cache_.budget()) {
    const std::vector<CacheKey> gone = cache_.evict([this](CacheKey key) { return pinned(key); });
    if (gone.empty()) break;
    for (CacheKey key : gone) forget(key);
  }
  stats_.cache_bytes = cache_.bytes();
}

void Session::forget(CacheKey key) {
  unreported_.insert(key);
  if (!isGroup(key)) {
    if (auto face = repository::FaceKey::fromCode(key)) events_.faces_evicted.push_back(*face);
    return;
  }
  const std::uint32_t group = groupOf(key);
  events_.groups_evicted.push_back(group);
  for (std::uint32_t parent : hierarchy_.parentsOf(group)) {
    auto it = cached_children_.find(parent);
    if (it != cached_children_.end() && --it->second == 0) cached_children_.erase(it);
  }
}

std::uint64_t Session::frameBytes() const {
  std::uint64_t bytes = 0;
  for (const NumberedFrame& kept : frames_) bytes += kept.frame.value.size();
  return bytes;
}

// ---- messages from the server ----

base::Result<void> Session::acceptWelcome(protocol::Welcome&& message) {
  if (phase_ != SessionPhase::kGreeting) return badServer("said Welcome twice");
  const bool same = welcome_.has_value() && sameScene(*welcome_, message);
  if (!same) startScene(message);
  welcome_ = std::move(message);
  phase_ = SessionPhase::kReady;
  problem_.clear();
  queueHave();
  view_unsent_ = camera_.has_value();
  return {};
}

base::Result<void> Session::acceptFace(protocol::Face&& message, std::size_t bytes) {
  if (!options_.images) return badServer("sent images although none were asked for");
  if (!welcome_->grid.contains(message.key)) return badServer("sent an image of a point outside its own grid");
  ++stats_.faces_received;
  stats_.bytes_faces += bytes;
  if (insert(message.key.code(), std::move(message.value))) events_.faces_added.push_back(message.key);
  evictOverBudget();
  return {};
}

base::Result<void> Session::acceptRefinement(protocol::Refinement&& message, std::size_t bytes) {
  base::ByteReader in(message.record);
  auto group = lod::patch::addGroup(in, hierarchy_, welcome_->group_count, welcome_->patch_count);
  if (!group) return base::within("the server sent a bad group", group.error());
  if (!in.atEnd()) return badServer("sent a group record with bytes after its end");
  if (message.block.size() != hierarchy_.groups[*group].block_bytes)
    return badServer("sent a group whose geometry is not as long as its record says");
  ++stats_.groups_received;
  stats_.bytes_patches += bytes;
  if (insert(kGroupTag | *group, std::move(message.block))) events_.groups_added.push_back(*group);
  evictOverBudget();
  return {};
}

base::Result<void> Session::acceptFrame(protocol::Frame&& message, std::size_t bytes) {
  if (!frames_asked_for_) return badServer("sent a frame although none was asked for");
  if (message.sequence > sequence_) return badServer("sent a frame for a view that was never asked for");
  ++stats_.frames_received;
  stats_.bytes_frames += bytes;
  if (!options_.frames) return {};  // it was on its way when they were switched off
  if (message.last) last_frame_sequence_ = message.sequence;
  events_.frames_added.push_back(++frame_number_);
  frames_.push_back({frame_number_, std::move(message)});
  while (frames_.size() > kMaxFrames || frameBytes() > options_.frame_bytes) frames_.pop_front();
  stats_.frame_bytes = frameBytes();
  return {};
}

base::Result<void> Session::acceptCompletion(const protocol::Completion& message) {
  if (message.sequence > sequence_) return badServer("completed a view that was never asked for");
  complete_sequence_ = std::max(complete_sequence_, message.sequence);
  return {};
}

base::Result<void> Session::acceptRefusal(const protocol::Refusal& message) {
  phase_ = SessionPhase::kRefused;
  method_instead_ = methodFromName(protocol::methodOf(message.instead));
  problem_ = "the server refused: " + (message.reason.empty() ? "it gave no reason" : message.reason);
  if (message.version != protocol::kVersion)
    problem_ += " (it speaks protocol " + std::to_string(message.version) + ", this client " +
                std::to_string(protocol::kVersion) + "; update the older one)";
  return {};
}

base::Result<void> Session::acceptMessage(protocol::ServerMessage&& message, std::size_t bytes) {
  // Welcome and Refusal may come first; all else only after a Welcome.
  if (auto* welcome_message = std::get_if<protocol::Welcome>(&message))
    return acceptWelcome(std::move(*welcome_message));
  if (auto* refusal = std::get_if<protocol::Refusal>(&message)) return acceptRefusal(*refusal);
  if (phase_ != SessionPhase::kReady) return badServer("sent data before its Welcome");

  if (auto* face = std::get_if<protocol::Face>(&message)) return acceptFace(std::move(*face), bytes);
  if (auto* refine = std::get_if<protocol::Refinement>(&message)) return acceptRefinement(std::move(*refine), bytes);
  if (auto* frame = std::get_if<protocol::Frame>(&message)) return acceptFrame(std::move(*frame), bytes);
  if (auto* complete = std::get_if<protocol::Completion>(&message)) return acceptCompletion(*complete);
  return badServer("sent a message that this client does not know");
}

// ---- messages to the server ----

/// The server may remember the first of them only.
void Session::queueHave() {
  protocol::Holdings have;
  const auto flush = [&] {
    if (have.faces.empty() && have.groups.empty()) return;
    greetings_.push_back(protocol::encode(std::exchange(have, {})));
  };
  for (CacheKey key : cache_.keys()) {
    if (isGroup(key))
      have.groups.push_back(groupOf(key));
    else if (auto face = repository::FaceKey::fromCode(key))
      have.faces.push_back(*face);
    if (have.faces.size() + have.groups.size() == protocol::kMaxKeysPerMessage) flush();
  }
  flush();
}

base::Bytes Session::evictedMessage() {
  protocol::Eviction evicted;
  while (!unreported_.empty() && evicted.faces.size() + evicted.groups.size() < protocol::kMaxKeysPerMessage) {
    const CacheKey key = *unreported_.begin();
    unreported_.erase(unreported_.begin());
    if (isGroup(key))
      evicted.groups.push_back(groupOf(key));
    else if (auto face = repository::FaceKey::fromCode(key))
      evicted.faces.push_back(*face);
  }
  return protocol::encode(std::move(evicted));
}

base::Bytes Session::viewMessage() {
  view_unsent_ = false;
  ++stats_.views_sent;
  protocol::View view;
  view.sequence = ++sequence_;
  view.camera = *camera_;
  protocol::View previous;
  if (sent_camera_) previous.camera = *sent_camera_;
  is_moving_ = sent_camera_ && welcome_ && plan::isMoving(*welcome_, view, previous);
  sent_camera_ = camera_;
  const PatchGoal goal = wantedPatches();
  view.patch_tolerance_px = goal.tolerance_px;
  view.measure = goal.measure;
  view.max_triangles = goal.max_triangles;
  view.max_points = options_.images ? options_.max_points : std::uint16_t{0};
  view.want_frame = wantsFrame();
  if (!options_.refine) view.frame_quality = base::ViewDefaults::kFrameWebpQuality;
  frames_asked_for_ |= view.want_frame;
  return protocol::encode(view);
}

// ---- the public functions ----

void Session::connected() {
  phase_ = SessionPhase::kGreeting;
  problem_.clear();
  parts_.clear();
  unreported_.clear();  // a new connection begins with Holdings, which makes evictions known
  greetings_.clear();
  greetings_.push_back(protocol::encode(
      protocol::Hello{.client = "lumigrid-view", .frame_pixels = options_.frames ? options_.frame_pixels : 0}));
  view_unsent_ = false;
  frames_asked_for_ = false;
}

void Session::disconnected(const std::string& reason) {
  // A refusal explains more than the closing of the connection that follows it.
  if (phase_ == SessionPhase::kRefused) return;
  phase_ = SessionPhase::kDisconnected;
  problem_ = reason;
  greetings_.clear();
  complete_sequence_ = 0;
}

void Session::refuse(const std::string& reason, std::optional<Method> method_instead) {
  phase_ = SessionPhase::kRefused;
  method_instead_ = method_instead;
  problem_ = reason;
  greetings_.clear();
}

base::Result<void> Session::receive(base::ByteView bytes) {
  if (phase_ != SessionPhase::kGreeting && phase_ != SessionPhase::kReady)
    return badServer("went on talking after the connection ended");
  ++stats_.messages_received;
  stats_.bytes_received += bytes.size();

  auto accepted = acceptBytes(bytes);
  if (!accepted) problem_ = accepted.error().message;
  return accepted;
}

base::Result<void> Session::acceptBytes(base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(auto message, protocol::decodeServerMessage(bytes));
  const auto* part = std::get_if<protocol::Part>(&message);
  if (part == nullptr) return acceptMessage(std::move(message), bytes.size());
  LUMIGRID_ASSIGN_OR_RETURN(const auto whole, parts_.accept(*part));
  if (!whole) return {};
  LUMIGRID_ASSIGN_OR_RETURN(message, protocol::decodeServerMessage(*whole));
  if (std::holds_alternative<protocol::Part>(message)) return badServer("sent parts of a part");
  return acceptMessage(std::move(message), whole->size());
}

std::optional<base::Bytes> Session::nextToSend() {
  if (!greetings_.empty()) {
    base::Bytes next = std::move(greetings_.front());
    greetings_.pop_front();
    return next;
  }
  if (phase_ != SessionPhase::kReady) return std::nullopt;

  // Evictions are sent ahead of the next view, or as soon as a whole message of them has gathered.
  const bool tell = view_unsent_ || unreported_.size() >= protocol::kMaxKeysPerMessage;
  if (tell && !unreported_.empty()) return evictedMessage();
  if (view_unsent_) return viewMessage();
  return std::nullopt;
}

void Session::setView(const base::ViewCamera& camera) {
  if (camera_ && base::showsSameView(*camera_, camera)) return;
  camera_ = camera;
  refined_ = false;
  view_unsent_ = phase_ == SessionPhase::kReady;
}

void Session::setWanted(bool images, bool frames) {
  if (options_.images == images && options_.frames == frames) return;
  options_.images = images;
  options_.frames = frames;
  refined_ = false;
  view_unsent_ = camera_ && phase_ == SessionPhase::kReady;
}

bool Session::showsImages() const {
  return options_.images && (!welcome_ || welcome_->grid.pointCount() != 0);
}

PatchGoal Session::usualPatches() const {
  PatchGoal goal{options_.alone_tolerance_px, base::ErrorMeasure::kVisible, options_.max_triangles};
  if (showsImages()) goal.tolerance_px = options_.patch_tolerance_px, goal.measure = base::ErrorMeasure::kShape;
  if (options_.guarantee) goal.measure = base::ErrorMeasure::kBound;
  return goal;
}

PatchGoal Session::wantedPatches() const {
  if (refined_) return finePatches();
  PatchGoal goal = usualPatches();
  if (options_.refine && is_moving_ && goal.measure == base::ErrorMeasure::kShape)
    goal.measure = base::ErrorMeasure::kVisible;
  return goal;
}

PatchGoal Session::finePatches() const {
  return {options_.alone_tolerance_px, base::ErrorMeasure::kVisible, options_.max_triangles_refined};
}

bool Session::mayRefine() const {
  return options_.refine && complete() && showsImages() && !refined_ && !options_.guarantee && !wantsFrame();
}

void Session::refine() {
  if (!mayRefine()) return;
  refined_ = true;
  view_unsent_ = true;
}

bool Session::complete() const {
  if (phase_ != SessionPhase::kReady || view_unsent_ || sequence_ == 0) return false;
  if (complete_sequence_ != sequence_) return false;
  return !wantsFrame() || last_frame_sequence_ == sequence_;
}

const protocol::Frame* Session::frame(std::uint32_t number) const {
  for (const NumberedFrame& kept : frames_)
    if (kept.number == number) return &kept.frame;
  return nullptr;
}

void Session::setInUse(const std::vector<repository::FaceKey>& faces, const std::vector<std::uint32_t>& groups) {
  in_use_.clear();
  const auto use = [this](CacheKey key) {
    if (cache_.find(key) != nullptr) in_use_.insert(key);
  };
  for (const repository::FaceKey& key : faces) use(key.code());
  // Use children before their parents, so that parents end up as the more recently used.
  for (auto it = groups.rbegin(); it != groups.rend(); ++it) use(kGroupTag | *it);
  evictOverBudget();
}

}  // namespace client
