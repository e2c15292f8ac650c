#include "server/session/session.h"

#include <algorithm>
#include <cmath>
#include <utility>
#include <variant>

#include "repository/faces/face_value.h"

namespace server {
namespace {

constexpr std::size_t kMaxFaceRequests = 2;  // under way at a time, so that a new view need not wait for the last one's
constexpr std::size_t kMaxPrefetchedFaces = 16;  // per request, so that a new view waits for few of them
// A message that occupies the link longer goes in parts of so many seconds, so that a new view's frame need not wait
// for it; each is a segment of TCP at least.
constexpr double kPartSeconds = 0.05;
constexpr double kMinPartBytes = 1400.0;
constexpr double kBusySeconds =
    0.5;  // until a busy server is asked again whether it has time for what is not needed yet

base::Error damaged(const std::string& item) {
  return {base::ErrorCode::kInvalidInput, item + " is damaged or too large for a message; it is not sent"};
}

}  // namespace

void describeHierarchy(const lod::patch::Hierarchy& hierarchy, protocol::Welcome& welcome) {
  welcome.has_colors = hierarchy.has_colors;
  welcome.lattice_origin = hierarchy.lattice.origin;
  welcome.lattice_step = hierarchy.lattice.step;
  welcome.group_count = static_cast<std::uint32_t>(hierarchy.groups.size());
  welcome.patch_count = static_cast<std::uint32_t>(hierarchy.patches.size());
  welcome.source_triangles = hierarchy.source_triangles;
}

std::shared_ptr<const SessionStart> startOf(const SceneData& scene) {
  // The encoded bytes tell whether anything changed, and take a microsecond.
  SharedMessage greeting(protocol::encode(scene.welcome));
  const bool is_known = scene.start && scene.start->patches == scene.patches;
  if (is_known && scene.start->greeting.bytes() == greeting.bytes()) return scene.start;
  SessionStart start{scene.welcome, std::move(greeting), scene.patches, {}};
  if (is_known)
    start.coarse = scene.start->coarse;
  else if (scene.patches != nullptr)
    start.coarse = plan::coarseGroups(scene.patches->hierarchy(), plan::kCoarseBytes);
  scene.start = std::make_shared<const SessionStart>(std::move(start));
  return scene.start;
}

Session::Session(const SceneData& scene)
    : scene_(scene),
      start_(startOf(scene)),
      held_(scene.held),
      remote_(scene.images_are_remote ? std::make_unique<RemoteFaces>() : nullptr),
      frames_(static_cast<double>(glm::length(scene.welcome.box_max - scene.welcome.box_min))) {}

void Session::setLink(const LinkState& state) {
  frames_.link().update(state, counts_.bytes);
  frames_.passTime();
}

// ---- in ----

base::Result<void> Session::receive(base::ByteView bytes) {
  if (phase_ == Phase::kRefused)
    return base::Error{base::ErrorCode::kInvalidInput, "the connection was refused already"};
  auto message = protocol::decodeClientMessage(bytes);
  if (!message) return refuse(message.error().code, message.error().message);
  const bool is_hello = std::holds_alternative<protocol::Hello>(*message);
  if (is_hello != (phase_ == Phase::kGreeting))
    return refuse(base::ErrorCode::kInvalidInput,
                  is_hello ? "Hello was said twice" : "the first message must be Hello");
  return std::visit([this](const auto& one) { return acceptMessage(one); }, *message);
}

base::Result<void> Session::acceptMessage(const protocol::Hello& hello) {
  if (hello.version != protocol::kVersion) {
    const bool client_older = hello.version < protocol::kVersion;
    return refuse(base::ErrorCode::kVersion, "this server speaks protocol " + std::to_string(protocol::kVersion) +
                                                 ", the client speaks " + std::to_string(hello.version) +
                                                 "; update the " + (client_older ? "client" : "server"));
  }
  client_ = hello.client;
  decodes_webp_ = (hello.abilities & protocol::kDecodesWebp) != 0;
  takes_coding_error_ = (hello.abilities & protocol::kTakesCodingError) != 0;
  frames_.setCodec(decodes_webp_ ? protocol::FrameCodec::kWebp : protocol::FrameCodec::kJpeg);
  frames_.setMostPixels(hello.frame_pixels);
  if (scene_.patches == nullptr) return refuseWithoutPatches();
  phase_ = Phase::kReady;
  has_group_.assign(scene_.patches->hierarchy().groups.size(), false);
  greeting_ = start_->greeting;
  if ((hello.abilities & protocol::kTakesHull) == 0 && !start_->welcome.hull.empty()) {
    // Earlier clients refuse what they do not know.
    protocol::Welcome welcome = start_->welcome;
    welcome.hull.clear();
    greeting_ = protocol::encode(welcome);
  }
  return {};
}

base::Result<void> Session::acceptMessage(const protocol::View& view) {
  ++counts_.views;
  if (newest_ && !planned_) ++counts_.replaced;
  if (planned_) previous_ = newest_;
  newest_ = std::make_shared<const protocol::View>(view);
  planned_ = false;
  frames_.accept(newest_, framePossible(view));
  if (sent_frame_ && !frames_.isUseful(*sent_frame_)) frame_parts_.giveUp();
  return {};
}

base::Result<void> Session::acceptMessage(const protocol::Eviction& evicted) {
  for (const repository::FaceKey& key : evicted.faces) held_.erase(key);
  for (std::uint32_t group : evicted.groups)
    if (group < has_group_.size()) has_group_[group] = false;
  return {};
}

/// Keys that this scene does not have are ignored: the client may hold them from an older build of the scene. Clients
/// name first what they used last.
base::Result<void> Session::acceptMessage(const protocol::Holdings& have) {
  for (const repository::FaceKey& key : have.faces)
    if (start_->welcome.grid.contains(key) && !held_.contains(key)) ++faces_claimed_, held_.claim(key);
  for (std::uint32_t group : have.groups)
    if (group < has_group_.size()) has_group_[group] = true;
  if (faces_claimed_ > kMaxFacesHeld)
    return refuse(base::ErrorCode::kInvalidInput, "the client claims to hold over " + std::to_string(kMaxFacesHeld) +
                                                      " faces; give it a smaller cache");
  return {};
}

base::Error Session::refuse(base::ErrorCode code, const std::string& reason) {
  phase_ = Phase::kRefused;
  greeting_ = protocol::encode(protocol::Refusal{protocol::kVersion, reason});
  return {code, reason};
}

/// The Refusal says what the scene has instead; clients that draw that fetch it over HTTP then.
base::Error Session::refuseWithoutPatches() {
  const base::Error error =
      refuse(base::ErrorCode::kUnsupported, std::string("this scene has ") + protocol::contentOf(scene_.instead) +
                                                " only; look at it with --method " +
                                                protocol::methodOf(scene_.instead) + ", or in a browser");
  greeting_ = protocol::encode(protocol::Refusal{protocol::kVersion, error.message, scene_.instead});
  return error;
}

// ---- out ----

std::optional<SharedMessage> Session::nextMessage() {
  needs_time_ = false;
  auto message = chooseMessage();
  if (message) counts_.bytes += message->size();
  return message;
}

std::optional<SharedMessage> Session::nextReadyMessage() {
  ready_only_ = true;
  auto message = nextMessage();
  ready_only_ = false;
  return message;
}

/// Once this has said that something takes time, nothing after it is looked for.
bool Session::takesTime() {
  needs_time_ = ready_only_;
  return ready_only_;
}

std::optional<SharedMessage> Session::chooseMessage() {
  if (greeting_) return std::exchange(greeting_, std::nullopt);
  if (phase_ != Phase::kReady) return std::nullopt;
  if (!newest_) return std::nullopt;
  if (remote_ && takesTime()) return std::nullopt;
  if (!planned_ && planIsDue()) {
    if (takesTime()) return std::nullopt;
    planNewestView();
  }
  // A frame for a moving eye has nothing to lie on without the coarse model.
  const bool needs_model = !frames_.standsAlone() || !has_group_[0];
  const double coarse_bytes = coarseBytesNext();
  if (needs_model && coarse_bytes > 0.0 && !frames_.linkIsFull()) return nextOfData();
  if (frame_ && takesTime()) return std::nullopt;
  if (auto message = nextOfFrames()) return message;
  if (frames_.holdsOthers(std::min(coarse_bytes, partBytes()))) return std::nullopt;
  auto message = nextOfData();
  if (message && coarse_bytes <= 0.0) frames_.countOther(message->size());
  return message;
}

/// While others work, a view at which the eye arrived by a jump is planned for at once, one of a motion when the last
/// plan is old enough: what that chose is still good, and goes on being sent.
bool Session::planIsDue() const {
  const double now = frames_.link().now();
  return !previous_ || now <= 0.0 || now >= nextPlanAt() || !plan::isMoving(start_->welcome, *newest_, *previous_);
}

/// When a view of a motion is planned for, seconds.
double Session::nextPlanAt() const {
  if (load_ == Load::kFree) return planned_at_;
  const double rate = scene_.views_per_second;
  return planned_at_ + 1.0 / (load_ == Load::kBehind ? rate : std::max(rate, kSharedViewsPerSecond));
}

/// The bytes of a message that is sent whole are at most twice as many.
double Session::partBytes() const {
  const LinkEstimate& link = frames_.link();
  if (link.roundTrip() <= 0.0) return static_cast<double>(protocol::kMaxServerMessage);  // no transport tells anything
  if (!link.isMeasured()) return LinkEstimate::kFirstWindow;
  return std::max(kMinPartBytes, kPartSeconds * link.rate());
}

/// The next part is as large as the link, as it is known by now, takes in kPartSeconds.
SharedMessage Session::nextPart(protocol::PartSender& stream) const {
  return stream.next(static_cast<std::size_t>(partBytes()));
}

/// A large message is begun in parts where it would occupy the link for long, and returned whole otherwise.
std::optional<SharedMessage> Session::inParts(protocol::PartSender& stream,
                                              std::optional<SharedMessage> message) const {
  if (!message || static_cast<double>(message->size()) <= 2.0 * partBytes()) return message;
  stream.begin(message->bytes());
  return nextPart(stream);
}

std::optional<SharedMessage> Session::nextOfFrames() {
  if (frame_parts_.empty()) return inParts(frame_parts_, nextFrame());
  return frames_.linkIsFull() ? std::nullopt : std::optional(nextPart(frame_parts_));
}

std::optional<SharedMessage> Session::nextFrame() {
  if (!frame_) return std::nullopt;
  const auto frame = std::move(frame_);
  if (!frames_.isUseful(frame->camera)) return std::nullopt;
  ++counts_.frames;
  counts_.frame_bytes += frame->value.size();
  sent_frame_ = std::make_unique<const base::ViewCamera>(frame->camera);
  return protocol::encode(*frame);
}

std::optional<SharedMessage> Session::nextOfData() {
  if (!data_parts_.empty()) return nextPart(data_parts_);
  if (auto message = nextCoarse()) return inParts(data_parts_, std::move(message));
  if (needs_time_) return std::nullopt;
  return inParts(data_parts_, nextOther());
}

std::optional<SharedMessage> Session::nextOther() {
  if (auto message = nextWanted()) return message;
  if (needs_time_) return std::nullopt;
  if (!view_plan_.faces.empty()) return std::nullopt;  // they are being fetched
  if (!planned_) return std::nullopt;                  // that was an older view's
  if (!complete_sent_) {
    complete_sent_ = true;
    return protocol::encode(protocol::Completion{newest_->sequence});
  }
  // The frame comes before anything that is not needed yet.
  if (frames_.owesFrame()) return std::nullopt;
  return nextPrefetch();
}

plan::Scene Session::sceneToPlan() const {
  plan::Scene scene = scene_.toPlan();
  scene.welcome = &start_->welcome;
  // Remembered lines of sight are those of places nearby, which choose a little less well for a fifth of the time.
  const bool is_hurried = load_ == Load::kBehind;
  scene.ray_step = std::max(scene_.ray_step, is_hurried ? 2 : 1);
  if (!is_hurried) scene.sight_cache = nullptr;
  scene.images = scene.images && (decodes_webp_ || !scene_.images_are_webp);
  scene.image_bytes = image_bytes_;
  scene.is_fast = frames_.eyeIsFast();
  scene.link_rate = frames_.link().isKnown() ? frames_.link().rate() : 0.0;
  scene.rests = previous_ && base::showsSameView(previous_->camera, newest_->camera);
  scene.stored_bytes = [this](const repository::FaceKey& key) -> std::optional<std::uint64_t> {
    if (remote_) return remote_->absent.count(key) != 0 ? std::optional<std::uint64_t>(0) : std::nullopt;
    const auto bytes = scene_.images->valueBytes(key);
    if (!bytes || (*bytes && **bytes == 0)) return std::nullopt;
    const bool shows_something = *bytes && **bytes > repository::kImageHeaderBytes;  // an empty flag is shorter
    return shows_something ? **bytes : 0;
  };
  return scene;
}

plan::Holdings Session::holdings() const {
  return {[this](const repository::FaceKey& key) { return held_.contains(key); },
          [this](std::uint32_t group) { return static_cast<bool>(has_group_[group]); }};
}

void Session::planNewestView() {
  view_plan_ = plan::planView(sceneToPlan(), *newest_, holdings());
  faces_planned_ = view_plan_.faces.size();
  if (remote_)
    std::erase_if(remote_->fetched, [this](const auto& one) {
      return std::find(view_plan_.faces.begin(), view_plan_.faces.end(), one.first) == view_plan_.faces.end();
    });
  next_coarse_ = next_group_ = 0;
  prefetch_bytes_ = 0;
  complete_sent_ = false;
  prefetch_.reset();
  planned_ = true;
  ++counts_.planned;
  planned_at_ = frames_.link().now();
}

std::optional<SharedMessage> Session::nextCoarse() {
  for (; next_coarse_ < start_->coarse.size(); ++next_coarse_) {
    auto message = groupMessage(start_->coarse[next_coarse_]);
    if (needs_time_) return std::nullopt;
    if (message) return ++next_coarse_, message;
  }
  return std::nullopt;
}

std::optional<SharedMessage> Session::nextWanted() {
  while (true) {
    while (next_group_ < view_plan_.groups.size() && has_group_[view_plan_.groups[next_group_]]) ++next_group_;
    const auto face = findSendable(view_plan_.faces);
    const bool group_left = next_group_ < view_plan_.groups.size();
    const bool face_left = face != view_plan_.faces.end();
    if (!group_left && !face_left) return std::nullopt;

    // Faces leave the list as they are sent.
    const std::size_t faces_gone = faces_planned_ - std::min(faces_planned_, view_plan_.faces.size());
    if (group_left && (!face_left || view_plan_.faces_before[next_group_] <= faces_gone)) {
      auto message = groupMessage(view_plan_.groups[next_group_]);
      if (needs_time_) return std::nullopt;
      ++next_group_;
      if (message) return message;
    } else if (auto message = removeAndEncode(view_plan_.faces, face); message || needs_time_) {
      return message;
    }
  }
}

/// The bytes of the next group of the coarse model; 0 when the client has it.
double Session::coarseBytesNext() const {
  const std::vector<std::uint32_t>& coarse = start_->coarse;
  for (std::size_t i = next_coarse_; i < coarse.size(); ++i)
    if (!has_group_[coarse[i]]) return static_cast<double>(scene_.patches->hierarchy().groups[coarse[i]].block_bytes);
  return 0.0;
}

void Session::planPrefetch() {
  if (prefetch_) return;
  prefetch_ = view_plan_.other_faces;
  if (!previous_) return;
  const auto ahead = plan::planMotion(sceneToPlan(), *newest_, *previous_, holdings());
  prefetch_->insert(prefetch_->end(), ahead.begin(), ahead.end());
}

/// Whether all that is prefetched for the view was sent.
bool Session::prefetchIsOver() const {
  return prefetch_bytes_ >= scene_.ahead_bytes || (prefetch_ && prefetch_->empty());
}

std::optional<SharedMessage> Session::nextPrefetch() {
  if (load_ != Load::kFree || prefetchIsOver() || takesTime()) return std::nullopt;
  planPrefetch();
  while (prefetch_bytes_ < scene_.ahead_bytes) {
    const auto face = findSendable(*prefetch_);
    if (face == prefetch_->end()) return std::nullopt;
    if (auto message = removeAndEncode(*prefetch_, face)) {
      prefetch_bytes_ += message->size();
      return message;
    }
  }
  return std::nullopt;
}

/// The first face of the list that can be sent now, or the end; faces before it that the client has are removed.
Session::Faces::iterator Session::findSendable(Faces& faces) {
  if (!remote_) {
    // The others are not looked at, since a view has hundreds of images and this is asked for each.
    const auto first =
        std::find_if(faces.begin(), faces.end(), [this](const auto& key) { return !held_.contains(key); });
    return faces.erase(faces.begin(), first);
  }
  std::erase_if(faces, [this](const repository::FaceKey& key) { return held_.contains(key); });
  return std::find_if(faces.begin(), faces.end(),
                      [this](const repository::FaceKey& key) { return remote_->fetched.count(key) != 0; });
}

std::optional<SharedMessage> Session::removeAndEncode(Faces& faces, Faces::iterator face) {
  const repository::FaceKey key = *face;
  const auto at = face - faces.begin();
  auto message = faceMessage(key);
  if (!needs_time_) faces.erase(faces.begin() + at);
  return message;
}

/// The Refinement message of a group; nullopt when the client has it, or the block cannot be read or is damaged.
std::optional<SharedMessage> Session::groupMessage(std::uint32_t group) {
  if (has_group_[group]) return std::nullopt;
  auto message = encodedOnce(MessageCache::keyOf(group), [&]() -> std::optional<base::Bytes> {
    auto block = readGroup(group);
    if (!block) {
      countCorrupt(block.error());
      return std::nullopt;
    }
    base::ByteWriter record;
    lod::patch::encodeGroup(scene_.patches->hierarchy(), group, record);
    return protocol::encode(protocol::Refinement{record.takeBytes(), std::move(*block)});
  });
  if (!message) return std::nullopt;  // or it takes time
  has_group_[group] = true;
  ++counts_.groups;
  counts_.group_bytes += message->size();
  if (scene_.access != nullptr) scene_.access->addGroup(group);
  return message;
}

/// The message of the scene's cache, or what `encode` returns, which is kept there.
template <class Encode>
std::optional<SharedMessage> Session::encodedOnce(std::uint64_t key, Encode encode) {
  if (scene_.messages != nullptr)
    if (auto message = scene_.messages->find(key)) return message;
  if (takesTime()) return std::nullopt;
  auto bytes = encode();
  if (!bytes) return std::nullopt;
  SharedMessage message(std::move(*bytes));
  if (scene_.messages != nullptr) scene_.messages->add(key, message);
  return message;
}

/// The Face message of a key; nullopt when the client has it, the store lacks it (it is being baked) or holds damaged
/// bytes.
std::optional<SharedMessage> Session::faceMessage(const repository::FaceKey& key) {
  if (held_.contains(key)) return std::nullopt;
  const auto found = remote_ ? remote_->fetched.extract(key) : decltype(remote_->fetched)::node_type();
  bool is_absent = false;
  auto message = encodedOnce(MessageCache::keyOf(key), [&]() -> std::optional<base::Bytes> {
    auto value = found ? std::move(found.mapped()) : scene_.images->get(key);
    is_absent = value && !value->has_value();
    if (is_absent) return std::nullopt;
    if (!value || (*value)->size() > protocol::kMaxPayload || !repository::decodeFaceValue(**value)) {
      countCorrupt(value ? damaged(repository::nameOf(key)) : value.error());
      return std::nullopt;
    }
    return protocol::encode(protocol::Face{key, std::move(**value)});
  });
  if (!message && needs_time_) return std::nullopt;
  if (!message) {
    if (is_absent && key.tile != 0) return ancestorInstead(key);
    if (is_absent) ++counts_.missing;
    return std::nullopt;
  }
  held_.add(key);
  image_bytes_.add(message->size());
  ++counts_.faces;
  counts_.face_bytes += message->size();
  if (scene_.access != nullptr) scene_.access->addFace(key);
  return message;
}

base::Result<base::Bytes> Session::readGroup(std::uint32_t group) const {
  if (scene_.patches->hierarchy().groups[group].block_bytes > protocol::kMaxPayload)
    return damaged("group " + std::to_string(group));
  return scene_.patches->checkedBlock(group);
}

void Session::countCorrupt(const base::Error& error) {
  ++counts_.corrupt;
  if (scene_.on_read_error) scene_.on_read_error(error);
}

/// A tile that was not worth storing has an ancestor that shows as much.
std::optional<SharedMessage> Session::ancestorInstead(const repository::FaceKey& key) {
  constexpr std::size_t kMaxAbsent = 100'000;
  const repository::FaceKey parent{key.x, key.y, key.z, key.d, repository::parentOfTile(key.tile)};
  if (!remote_) return faceMessage(parent);
  if (remote_->absent.size() >= kMaxAbsent) remote_->absent.clear();
  remote_->absent.insert(key);
  const bool is_planned = std::find(view_plan_.faces.begin(), view_plan_.faces.end(), parent) != view_plan_.faces.end();
  if (!held_.contains(parent) && !is_planned) view_plan_.faces.push_back(parent);
  return std::nullopt;
}

// ---- remote faces ----

FaceRequest Session::unrequestedFaces(const Faces& faces, std::size_t max_count) const {
  FaceRequest keys;
  for (const repository::FaceKey& key : faces) {
    if (keys.size() == max_count) break;
    if (!held_.contains(key) && remote_->requested.count(key) == 0 && remote_->fetched.count(key) == 0)
      keys.push_back(key);
  }
  return keys;
}

std::optional<FaceRequest> Session::nextFaceRequest() {
  if (!remote_ || phase_ != Phase::kReady || !planned_) return std::nullopt;
  if (remote_->requests_under_way == kMaxFaceRequests) return std::nullopt;
  FaceRequest request = unrequestedFaces(view_plan_.faces, view_plan_.faces.size());
  const bool at_rest = complete_sent_ && !frames_.owesFrame() && load_ == Load::kFree;
  const bool has_all = remote_->requested.empty() && remote_->fetched.empty();
  if (request.empty() && at_rest && has_all && prefetch_bytes_ < scene_.ahead_bytes) {
    planPrefetch();
    request = unrequestedFaces(*prefetch_, kMaxPrefetchedFaces);
  }
  if (request.empty()) return std::nullopt;
  remote_->requested.insert(request.begin(), request.end());
  ++remote_->requests_under_way;
  return request;
}

void Session::facesFetched(const FaceRequest& request, FaceValues values) {
  --remote_->requests_under_way;
  for (std::size_t i = 0; i < request.size(); ++i) {
    remote_->requested.erase(request[i]);
    const auto wants = [&](const Faces& faces) {
      return std::find(faces.begin(), faces.end(), request[i]) != faces.end();
    };
    // A face that the newest view does not want is dropped; later views find it in the cache.
    if (wants(view_plan_.faces) || (prefetch_ && wants(*prefetch_)))
      remote_->fetched.insert_or_assign(request[i], std::move(values[i]));
  }
}

// ---- frames ----

bool Session::framePossible(const protocol::View& view) const {
  const std::int64_t pixels = std::int64_t{view.camera.width} * view.camera.height;
  return view.want_frame && start_->welcome.can_render_frames && pixels <= base::ViewDefaults::kMaxFramePixels;
}

std::optional<FrameRequest> Session::nextFrameRequest() {
  if (phase_ != Phase::kReady || !newest_ || !frame_parts_.empty()) return std::nullopt;
  return frames_.next(planned_ && complete_sent_);
}

void Session::frameRendered(const FrameRequest& request, protocol::EncodedFrame frame) {
  base::Bytes& value = frame.value;
  if (phase_ != Phase::kReady || !newest_) return;
  frames_.rendered(request, value.size());
  // A frame of an older view is still a good sample while the eye is near and looks the same way.
  if (value.empty() || value.size() > protocol::kMaxPayload || !frames_.isUseful(request.camera)) return;
  frame_ = std::make_unique<const protocol::Frame>(protocol::Frame{request.sequence, request.camera, request.last,
                                                                   std::move(value),
                                                                   takes_coding_error_ ? frame.coding_error : 0.0F});
}

/// Frames, and what is fetched, wait for more than room; a session that has any to send is asked each time.
bool Session::needsRoom() const {
  if (phase_ != Phase::kReady || !newest_) return false;
  if (framePossible(*newest_) || remote_) return true;
  const bool is_sent = planned_ && complete_sent_ && data_parts_.empty();
  return frames_.linkIsFull() && !(is_sent && (load_ != Load::kFree || prefetchIsOver()));
}

std::optional<double> Session::wakeAt(bool tells_room) const {
  if (phase_ != Phase::kReady) return std::nullopt;
  std::optional<double> at = frames_.wakeAt(tells_room);
  const double now = frames_.link().now();
  if (newest_ && !planned_ && nextPlanAt() > now) at = std::min(at.value_or(nextPlanAt()), nextPlanAt());
  if (waitsToPrefetch()) at = std::min(at.value_or(now + kBusySeconds), now + kBusySeconds);
  return at;
}

}  // namespace server
