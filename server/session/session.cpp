#include "server/session/session.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <variant>
#include <vector>

#include "repository/faces/face_value.h"

namespace server {
namespace {

constexpr std::int64_t kMaxFramePixels =
    16'000'000;  // about twice a 4K screen; a larger frame would keep other viewers waiting
// A frame is dropped when the eye has moved by more than this share of the scene's diagonal since. Measured: after 8 %
// a late frame still improves the blended view.
constexpr double kMaxFrameShift = 0.1;
constexpr std::size_t kMaxFaceRequests = 2;  // under way at a time, so that a new view need not wait for the last one's
constexpr std::size_t kMaxPrefetchedFaces = 16;  // per request, so that a new view waits for few of them

}  // namespace

struct Session::Impl {
  enum class Phase { kGreeting, kReady, kRefused };
  enum class FramePhase { kNone, kDue, kRendering };  ///< phase of the newest view's exact frame

  explicit Impl(const SceneData& shared) : scene(shared) {}

  // ---- in ----
  base::Result<void> receive(base::ByteView bytes);
  base::Result<void> acceptMessage(const protocol::Hello& hello);
  base::Result<void> acceptMessage(const protocol::View& view);
  base::Result<void> acceptMessage(const protocol::Eviction& evicted);
  base::Result<void> acceptMessage(const protocol::Holdings& have);
  base::Error refuse(base::ErrorCode code, const std::string& reason);
  base::Error refuseSplatsOnly();

  // ---- out ----
  std::optional<base::Bytes> nextMessage();
  std::optional<base::Bytes> nextForView();
  std::optional<base::Bytes> nextCoarse();
  std::optional<base::Bytes> nextWanted();
  std::optional<base::Bytes> nextPrefetch();
  std::optional<base::Bytes> groupMessage(std::uint32_t group);
  std::optional<base::Bytes> faceMessage(const repository::FaceKey& key);
  using Faces = std::vector<repository::FaceKey>;
  Faces::iterator findSendable(Faces& faces);
  std::optional<base::Bytes> removeAndEncode(Faces& faces, Faces::iterator face);
  FaceRequest unrequestedFaces(const Faces& faces, std::size_t max_count) const;
  void planPrefetch();
  void planNewestView();
  bool framePossible() const;

  const SceneData& scene;
  Phase phase = Phase::kGreeting;
  std::string client;
  SessionCounts counts;

  // Data that the client holds.
  std::vector<bool> has_group;
  std::unordered_set<repository::FaceKey> has_face;
  std::vector<std::uint32_t> coarse;

  // Its views.
  std::optional<protocol::View> newest, previous;
  bool planned = false;  // the fields below belong to `newest`

  // Data to send for the newest view. A cursor runs over the groups, and faces leave their lists when they are sent;
  // those that the client received otherwise meanwhile are skipped.
  plan::ViewPlan view_plan;
  std::size_t next_coarse = 0, next_group = 0;
  std::uint64_t group_bytes = 0, face_bytes = 0;
  bool complete_sent = false;
  FramePhase frame_phase = FramePhase::kNone;
  std::optional<Faces> prefetch;
  std::uint64_t prefetch_bytes = 0;

  // Remote faces: fetched but not sent yet, and requested but not fetched yet.
  std::unordered_map<repository::FaceKey, base::Result<std::optional<base::Bytes>>> fetched;
  std::unordered_set<repository::FaceKey> requested;
  std::size_t requests_under_way = 0;

  // Messages that are sent before all others.
  std::optional<base::Bytes> greeting;  // Welcome or Refusal
  std::optional<base::Bytes> frame;
};

Session::Session(const SceneData& scene) : impl_(std::make_unique<Impl>(scene)) {}
Session::~Session() = default;

base::Result<void> Session::receive(base::ByteView bytes) {
  return impl_->receive(bytes);
}

std::optional<base::Bytes> Session::nextMessage() {
  auto message = impl_->nextMessage();
  if (message) impl_->counts.bytes += message->size();
  return message;
}

bool Session::finished() const {
  return impl_->phase == Impl::Phase::kRefused && !impl_->greeting;
}
const std::string& Session::clientName() const {
  return impl_->client;
}
const SessionCounts& Session::counts() const {
  return impl_->counts;
}

// ---- in ----

base::Result<void> Session::Impl::receive(base::ByteView bytes) {
  if (phase == Phase::kRefused)
    return base::Error{base::ErrorCode::kInvalidInput, "the connection was refused already"};
  auto message = protocol::decodeClientMessage(bytes);
  if (!message) return refuse(message.error().code, message.error().message);
  const bool is_hello = std::holds_alternative<protocol::Hello>(*message);
  if (is_hello != (phase == Phase::kGreeting))
    return refuse(base::ErrorCode::kInvalidInput,
                  is_hello ? "Hello was said twice" : "the first message must be Hello");
  return std::visit([this](const auto& one) { return acceptMessage(one); }, *message);
}

base::Result<void> Session::Impl::acceptMessage(const protocol::Hello& hello) {
  if (hello.version != protocol::kVersion) {
    const bool client_older = hello.version < protocol::kVersion;
    return refuse(base::ErrorCode::kVersion, "this server speaks protocol " + std::to_string(protocol::kVersion) +
                                                 ", the client speaks " + std::to_string(hello.version) +
                                                 "; update the " + (client_older ? "client" : "server"));
  }
  client = hello.client;
  if (scene.patches == nullptr) return refuseSplatsOnly();
  phase = Phase::kReady;
  const lod::patch::Hierarchy& hierarchy = scene.patches->hierarchy();
  has_group.assign(hierarchy.groups.size(), false);
  coarse = plan::coarseGroups(hierarchy, plan::kCoarseBytes);
  greeting = protocol::encode(scene.welcome);
  return {};
}

base::Result<void> Session::Impl::acceptMessage(const protocol::View& view) {
  ++counts.views;
  if (planned) previous = newest;
  newest = view;
  planned = false;
  return {};
}

base::Result<void> Session::Impl::acceptMessage(const protocol::Eviction& evicted) {
  for (const repository::FaceKey& key : evicted.faces) has_face.erase(key);
  for (std::uint32_t group : evicted.groups)
    if (group < has_group.size()) has_group[group] = false;
  return {};
}

/// Keys that this scene does not have are ignored: the client may hold them from an older build of the scene.
base::Result<void> Session::Impl::acceptMessage(const protocol::Holdings& have) {
  for (const repository::FaceKey& key : have.faces)
    if (scene.welcome.grid.contains(key)) has_face.insert(key);
  for (std::uint32_t group : have.groups)
    if (group < has_group.size()) has_group[group] = true;
  if (has_face.size() > kMaxFacesHeld)
    return refuse(base::ErrorCode::kInvalidInput,
                  "the client claims to hold over a million faces; give it a smaller cache");
  return {};
}

base::Error Session::Impl::refuse(base::ErrorCode code, const std::string& reason) {
  phase = Phase::kRefused;
  greeting = protocol::encode(protocol::Refusal{protocol::kVersion, reason});
  return {code, reason};
}

/// The Refusal says that the scene is splats-only; clients that draw splats fetch them over HTTP then.
base::Error Session::Impl::refuseSplatsOnly() {
  const base::Error error = refuse(base::ErrorCode::kUnsupported,
                                   "this scene has splats only; look at it with --method qsplat, or in a browser");
  greeting = protocol::encode(protocol::Refusal{protocol::kVersion, error.message, true});
  return error;
}

// ---- out ----

std::optional<base::Bytes> Session::Impl::nextMessage() {
  if (greeting) return std::exchange(greeting, std::nullopt);
  if (phase != Phase::kReady) return std::nullopt;
  if (frame) {
    ++counts.frames;
    return std::exchange(frame, std::nullopt);
  }
  if (!newest) return std::nullopt;
  if (!planned) planNewestView();
  return nextForView();
}

std::optional<base::Bytes> Session::Impl::nextForView() {
  if (auto message = nextCoarse()) return message;
  if (auto message = nextWanted()) return message;
  if (!view_plan.faces.empty()) return std::nullopt;  // they are being fetched
  if (!complete_sent) {
    complete_sent = true;
    if (framePossible()) frame_phase = FramePhase::kDue;
    return protocol::encode(protocol::Completion{newest->sequence});
  }
  // The frame comes before anything that is not needed yet.
  if (frame_phase != FramePhase::kNone) return std::nullopt;
  return nextPrefetch();
}

void Session::Impl::planNewestView() {
  view_plan = plan::planView(scene.toPlan(), *newest,
                             [this](const repository::FaceKey& key) { return has_face.count(key) != 0; });
  std::erase_if(fetched, [this](const auto& one) {
    return std::find(view_plan.faces.begin(), view_plan.faces.end(), one.first) == view_plan.faces.end();
  });
  next_coarse = next_group = 0;
  group_bytes = face_bytes = prefetch_bytes = 0;
  complete_sent = false;
  frame_phase = FramePhase::kNone;
  prefetch.reset();
  planned = true;
}

std::optional<base::Bytes> Session::Impl::nextCoarse() {
  while (next_coarse < coarse.size())
    if (auto message = groupMessage(coarse[next_coarse++])) return message;
  return std::nullopt;
}

std::optional<base::Bytes> Session::Impl::nextWanted() {
  while (true) {
    while (next_group < view_plan.groups.size() && has_group[view_plan.groups[next_group]]) ++next_group;
    const auto face = findSendable(view_plan.faces);
    const bool group_left = next_group < view_plan.groups.size();
    const bool face_left = face != view_plan.faces.end();
    if (!group_left && !face_left) return std::nullopt;

    const bool urgent = group_left && plan::isUrgent(view_plan.group_error_px[next_group], *newest);
    if (group_left && (!face_left || urgent || group_bytes <= face_bytes)) {
      if (auto message = groupMessage(view_plan.groups[next_group++])) {
        group_bytes += message->size();
        return message;
      }
    } else if (auto message = removeAndEncode(view_plan.faces, face)) {
      face_bytes += message->size();
      return message;
    }
  }
}

void Session::Impl::planPrefetch() {
  if (prefetch) return;
  prefetch = view_plan.other_faces;
  if (!previous) return;
  const auto ahead = plan::planMotion(scene.toPlan(), *newest, *previous,
                                      [this](const repository::FaceKey& key) { return has_face.count(key) != 0; });
  prefetch->insert(prefetch->end(), ahead.begin(), ahead.end());
}

std::optional<base::Bytes> Session::Impl::nextPrefetch() {
  planPrefetch();
  while (prefetch_bytes < scene.ahead_bytes) {
    const auto face = findSendable(*prefetch);
    if (face == prefetch->end()) return std::nullopt;
    if (auto message = removeAndEncode(*prefetch, face)) {
      prefetch_bytes += message->size();
      return message;
    }
  }
  return std::nullopt;
}

/// The first face of the list that can be sent now, or the end; faces that the client has are removed.
Session::Impl::Faces::iterator Session::Impl::findSendable(Faces& faces) {
  std::erase_if(faces, [this](const repository::FaceKey& key) { return has_face.count(key) != 0; });
  if (!scene.images_are_remote) return faces.begin();
  return std::find_if(faces.begin(), faces.end(),
                      [this](const repository::FaceKey& key) { return fetched.count(key) != 0; });
}

std::optional<base::Bytes> Session::Impl::removeAndEncode(Faces& faces, Faces::iterator face) {
  const repository::FaceKey key = *face;
  faces.erase(face);
  return faceMessage(key);
}

/// The Refinement message of a group; nullopt when the client has it or the block cannot be read.
std::optional<base::Bytes> Session::Impl::groupMessage(std::uint32_t group) {
  if (has_group[group]) return std::nullopt;
  auto block = scene.patches->block(group);
  if (!block || block->size() > protocol::kMaxPayload) {
    ++counts.corrupt;
    return std::nullopt;
  }
  base::ByteWriter record;
  lod::patch::encodeGroup(scene.patches->hierarchy(), group, record);
  has_group[group] = true;
  ++counts.groups;
  if (scene.access != nullptr) scene.access->addGroup(group);
  return protocol::encode(protocol::Refinement{record.takeBytes(), {block->begin(), block->end()}});
}

/// The Face message of a key; nullopt when the client has it, the store lacks it (it is being baked) or holds damaged
/// bytes.
std::optional<base::Bytes> Session::Impl::faceMessage(const repository::FaceKey& key) {
  if (has_face.count(key) != 0) return std::nullopt;
  const auto found = fetched.extract(key);
  auto value = found ? std::move(found.mapped()) : scene.images->get(key);
  if (value && !value->has_value()) {
    ++counts.missing;
    return std::nullopt;
  }
  if (!value || (*value)->size() > protocol::kMaxPayload || !repository::decodeFaceValue(**value)) {
    ++counts.corrupt;
    return std::nullopt;
  }
  has_face.insert(key);
  ++counts.faces;
  if (scene.access != nullptr) scene.access->addFace(key);
  return protocol::encode(protocol::Face{key, std::move(**value)});
}

// ---- remote faces ----

FaceRequest Session::Impl::unrequestedFaces(const Faces& faces, std::size_t max_count) const {
  FaceRequest keys;
  for (const repository::FaceKey& key : faces) {
    if (keys.size() == max_count) break;
    if (has_face.count(key) == 0 && requested.count(key) == 0 && fetched.count(key) == 0) keys.push_back(key);
  }
  return keys;
}

std::optional<FaceRequest> Session::nextFaceRequest() {
  Impl& s = *impl_;
  if (!s.scene.images_are_remote || s.phase != Impl::Phase::kReady || !s.planned) return std::nullopt;
  if (s.requests_under_way == kMaxFaceRequests) return std::nullopt;
  FaceRequest request = s.unrequestedFaces(s.view_plan.faces, s.view_plan.faces.size());
  const bool at_rest = s.complete_sent && s.frame_phase == Impl::FramePhase::kNone;
  if (request.empty() && at_rest && s.requested.empty() && s.fetched.empty() &&
      s.prefetch_bytes < s.scene.ahead_bytes) {
    s.planPrefetch();
    request = s.unrequestedFaces(*s.prefetch, kMaxPrefetchedFaces);
  }
  if (request.empty()) return std::nullopt;
  s.requested.insert(request.begin(), request.end());
  ++s.requests_under_way;
  return request;
}

void Session::facesFetched(const FaceRequest& request, FaceValues values) {
  Impl& s = *impl_;
  --s.requests_under_way;
  for (std::size_t i = 0; i < request.size(); ++i) {
    s.requested.erase(request[i]);
    const auto wants = [&](const Impl::Faces& faces) {
      return std::find(faces.begin(), faces.end(), request[i]) != faces.end();
    };
    // A face that the newest view does not want is dropped; later views find it in the cache.
    if (wants(s.view_plan.faces) || (s.prefetch && wants(*s.prefetch)))
      s.fetched.insert_or_assign(request[i], std::move(values[i]));
  }
}

// ---- frames ----

bool Session::Impl::framePossible() const {
  const std::int64_t pixels = std::int64_t{newest->camera.width} * newest->camera.height;
  return newest->want_frame && scene.welcome.can_render_frames && pixels <= kMaxFramePixels;
}

std::optional<FrameRequest> Session::nextFrameRequest() {
  Impl& s = *impl_;
  if (!s.planned || s.frame_phase != Impl::FramePhase::kDue) return std::nullopt;
  s.frame_phase = Impl::FramePhase::kRendering;
  return FrameRequest{s.newest->sequence, s.newest->camera, s.newest->frame_quality};
}

void Session::frameRendered(const FrameRequest& request, base::Bytes value) {
  Impl& s = *impl_;
  if (s.phase != Impl::Phase::kReady || !s.newest) return;
  if (s.planned && request.sequence == s.newest->sequence) s.frame_phase = Impl::FramePhase::kNone;

  // A frame of an older view is still a good sample while the eye is near and looks the same way.
  const base::ViewCamera& now = s.newest->camera;
  const double moved = glm::length(now.position - request.camera.position);
  const double reach =
      kMaxFrameShift * static_cast<double>(glm::length(s.scene.welcome.box_max - s.scene.welcome.box_min));
  const bool same_way = glm::dot(now.direction, request.camera.direction) > std::cos(now.fov_y);
  if (value.empty() || value.size() > protocol::kMaxPayload || moved > reach || !same_way) return;
  s.frame = protocol::encode(protocol::Frame{request.sequence, request.camera, std::move(value)});
}

}  // namespace server
