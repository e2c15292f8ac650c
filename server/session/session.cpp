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

constexpr std::int64_t kMaxFramePixels = 16'000'000;
// An exact frame still helps after the eye moved by 8 % of the scene (DESIGN section 7).
constexpr double kFarOff = 0.1;
constexpr std::size_t kRequestsUnderWay = 2;  // for far faces: a new view need not wait for the last one's
constexpr std::size_t kFacesAhead = 16;       // that are asked for at a time when the view is complete

std::size_t headroom() {
  return protocol::kMaxServerMessage - 256;
}

}  // namespace

struct Session::State {
  enum class Phase { kGreeting, kReady, kRefused };
  /// Of the newest view's exact frame.
  enum class FramePhase { kNone, kDue, kRendering };

  explicit State(const SceneData& shared) : scene(shared) {}

  // ---- in ----
  base::Result<void> receive(base::ByteView bytes);
  base::Result<void> take(const protocol::Hello& hello);
  base::Result<void> take(const protocol::View& view);
  base::Result<void> take(const protocol::Eviction& evicted);
  base::Result<void> take(const protocol::Holdings& have);
  base::Error refuse(base::ErrorCode code, const std::string& reason);
  base::Error refuseAsSplatsOnly();

  // ---- out ----
  std::optional<base::Bytes> next();
  std::optional<base::Bytes> nextForView();
  std::optional<base::Bytes> nextCoarse();
  std::optional<base::Bytes> nextWanted();
  std::optional<base::Bytes> nextPrefetch();
  std::optional<base::Bytes> groupMessage(std::uint32_t group);
  std::optional<base::Bytes> faceMessage(const repository::FaceKey& key);
  using Faces = std::vector<repository::FaceKey>;
  /// The first of the list that can be sent now.
  Faces::iterator sendable(Faces& faces);
  std::optional<base::Bytes> takeFaceMessage(Faces& faces, Faces::iterator face);
  FaceRequest notAskedFor(const Faces& faces, std::size_t most) const;
  void planPrefetch();
  void planNewestView();
  bool framePossible() const;

  const SceneData& scene;
  Phase phase = Phase::kGreeting;
  std::string client;
  SessionCounts counts;

  // What the client holds.
  std::vector<bool> has_group;
  std::unordered_set<repository::FaceKey> has_face;
  std::vector<std::uint32_t> coarse;

  // What it looks at.
  std::optional<protocol::View> newest, previous;
  bool planned = false;  // the fields below belong to `newest`

  // What is still to be sent for it; a cursor runs over the groups, faces leave their lists; what the client got
  // meanwhile is passed over.
  plan::ViewPlan view_plan;
  std::size_t next_coarse = 0, next_group = 0;
  std::uint64_t group_bytes = 0, face_bytes = 0;
  bool complete_said = false;
  FramePhase frame_phase = FramePhase::kNone;
  std::optional<Faces> prefetch;
  std::uint64_t prefetch_bytes = 0;

  // Of far faces: those that came and were not sent yet, and those that are to come.
  std::unordered_map<repository::FaceKey, base::Result<std::optional<base::Bytes>>> fetched;
  std::unordered_set<repository::FaceKey> coming;
  std::size_t requests_under_way = 0;

  // Messages that go before all else.
  std::optional<base::Bytes> greeting;  // Welcome or Refusal
  std::optional<base::Bytes> frame;
};

// ---- in ----

base::Error Session::State::refuse(base::ErrorCode code, const std::string& reason) {
  phase = Phase::kRefused;
  greeting = protocol::encode(protocol::Refusal{protocol::kVersion, reason});
  return {code, reason};
}

/// Clients that know splats read them over HTTP then.
base::Error Session::State::refuseAsSplatsOnly() {
  const base::Error error = refuse(base::ErrorCode::kUnsupported,
                                   "this scene has splats alone; look at it with --method qsplat, or in a browser");
  greeting = protocol::encode(protocol::Refusal{protocol::kVersion, error.message, true});
  return error;
}

base::Result<void> Session::State::receive(base::ByteView bytes) {
  if (phase == Phase::kRefused)
    return base::Error{base::ErrorCode::kInvalidInput, "the connection was refused already"};
  auto message = protocol::decodeClientMessage(bytes);
  if (!message) return refuse(message.error().code, message.error().message);
  const bool is_hello = std::holds_alternative<protocol::Hello>(*message);
  if (is_hello != (phase == Phase::kGreeting))
    return refuse(base::ErrorCode::kInvalidInput,
                  is_hello ? "Hello was said twice" : "the first message must be Hello");
  return std::visit([this](const auto& one) { return take(one); }, *message);
}

base::Result<void> Session::State::take(const protocol::Hello& hello) {
  if (hello.version != protocol::kVersion) {
    const bool client_older = hello.version < protocol::kVersion;
    return refuse(base::ErrorCode::kVersion, "this server speaks protocol " + std::to_string(protocol::kVersion) +
                                                 ", the client speaks " + std::to_string(hello.version) +
                                                 "; update the " + (client_older ? "client" : "server"));
  }
  client = hello.client;
  if (scene.patches == nullptr) return refuseAsSplatsOnly();
  phase = Phase::kReady;
  const lod::patch::Hierarchy& hierarchy = scene.patches->hierarchy();
  has_group.assign(hierarchy.groups.size(), false);
  coarse = plan::coarseGroups(hierarchy, plan::kCoarseBytes);
  greeting = protocol::encode(scene.welcome);
  return {};
}

base::Result<void> Session::State::take(const protocol::View& view) {
  ++counts.views;
  if (planned) previous = newest;
  newest = view;
  planned = false;
  return {};
}

base::Result<void> Session::State::take(const protocol::Eviction& evicted) {
  for (const repository::FaceKey& key : evicted.faces) has_face.erase(key);
  for (std::uint32_t group : evicted.groups)
    if (group < has_group.size()) has_group[group] = false;
  return {};
}

/// Keys that this scene does not have are passed over: the client may come from an older build of it.
base::Result<void> Session::State::take(const protocol::Holdings& have) {
  for (const repository::FaceKey& key : have.faces)
    if (scene.welcome.grid.contains(key)) has_face.insert(key);
  for (std::uint32_t group : have.groups)
    if (group < has_group.size()) has_group[group] = true;
  if (has_face.size() > kMaxFacesHeld)
    return refuse(base::ErrorCode::kInvalidInput,
                  "the client claims to hold over a million faces; give it a smaller cache");
  return {};
}

// ---- out ----

std::optional<base::Bytes> Session::State::next() {
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

std::optional<base::Bytes> Session::State::nextForView() {
  if (auto message = nextCoarse()) return message;
  if (auto message = nextWanted()) return message;
  if (!view_plan.faces.empty()) return std::nullopt;  // they are to come
  if (!complete_said) {
    complete_said = true;
    if (framePossible()) frame_phase = FramePhase::kDue;
    return protocol::encode(protocol::Completion{newest->sequence});
  }
  // The frame comes before anything that is not needed yet.
  if (frame_phase != FramePhase::kNone) return std::nullopt;
  return nextPrefetch();
}

void Session::State::planNewestView() {
  view_plan = plan::planView(scene.toPlan(), *newest,
                             [this](const repository::FaceKey& key) { return has_face.count(key) != 0; });
  std::erase_if(fetched, [this](const auto& one) {
    return std::find(view_plan.faces.begin(), view_plan.faces.end(), one.first) == view_plan.faces.end();
  });
  next_coarse = next_group = 0;
  group_bytes = face_bytes = prefetch_bytes = 0;
  complete_said = false;
  frame_phase = FramePhase::kNone;
  prefetch.reset();
  planned = true;
}

std::optional<base::Bytes> Session::State::nextCoarse() {
  while (next_coarse < coarse.size())
    if (auto message = groupMessage(coarse[next_coarse++])) return message;
  return std::nullopt;
}

std::optional<base::Bytes> Session::State::nextWanted() {
  while (true) {
    while (next_group < view_plan.groups.size() && has_group[view_plan.groups[next_group]]) ++next_group;
    const auto face = sendable(view_plan.faces);
    const bool group_left = next_group < view_plan.groups.size();
    const bool face_left = face != view_plan.faces.end();
    if (!group_left && !face_left) return std::nullopt;

    const bool urgent = group_left && plan::isUrgent(view_plan.group_error_px[next_group], *newest);
    if (group_left && (!face_left || urgent || group_bytes <= face_bytes)) {
      if (auto message = groupMessage(view_plan.groups[next_group++])) {
        group_bytes += message->size();
        return message;
      }
    } else if (auto message = takeFaceMessage(view_plan.faces, face)) {
      face_bytes += message->size();
      return message;
    }
  }
}

void Session::State::planPrefetch() {
  if (prefetch) return;
  prefetch = view_plan.other_faces;
  if (!previous) return;
  const auto ahead = plan::planMotion(scene.toPlan(), *newest, *previous,
                                      [this](const repository::FaceKey& key) { return has_face.count(key) != 0; });
  prefetch->insert(prefetch->end(), ahead.begin(), ahead.end());
}

std::optional<base::Bytes> Session::State::nextPrefetch() {
  planPrefetch();
  while (prefetch_bytes < scene.ahead_bytes) {
    const auto face = sendable(*prefetch);
    if (face == prefetch->end()) return std::nullopt;
    if (auto message = takeFaceMessage(*prefetch, face)) {
      prefetch_bytes += message->size();
      return message;
    }
  }
  return std::nullopt;
}

Session::State::Faces::iterator Session::State::sendable(Faces& faces) {
  std::erase_if(faces, [this](const repository::FaceKey& key) { return has_face.count(key) != 0; });
  if (!scene.images_are_far) return faces.begin();
  return std::find_if(faces.begin(), faces.end(),
                      [this](const repository::FaceKey& key) { return fetched.count(key) != 0; });
}

std::optional<base::Bytes> Session::State::takeFaceMessage(Faces& faces, Faces::iterator face) {
  const repository::FaceKey key = *face;
  faces.erase(face);
  return faceMessage(key);
}

/// The Refinement message of a group; nothing when the client has it or the block cannot be read.
std::optional<base::Bytes> Session::State::groupMessage(std::uint32_t group) {
  if (has_group[group]) return std::nullopt;
  auto block = scene.patches->block(group);
  if (!block || block->size() > headroom()) {
    ++counts.corrupt;
    return std::nullopt;
  }
  base::ByteWriter record;
  lod::patch::encodeGroup(scene.patches->hierarchy(), group, record);
  has_group[group] = true;
  ++counts.groups;
  if (scene.access != nullptr) scene.access->addGroup(group);
  return protocol::encode(protocol::Refinement{record.take(), {block->begin(), block->end()}});
}

/// The Face message of a key; nothing when the client has it, or the store lacks it (it is being built) or holds broken
/// bytes.
std::optional<base::Bytes> Session::State::faceMessage(const repository::FaceKey& key) {
  if (has_face.count(key) != 0) return std::nullopt;
  const auto here = fetched.extract(key);
  auto value = here ? std::move(here.mapped()) : scene.images->get(key);
  if (value && !value->has_value()) {
    ++counts.missing;
    return std::nullopt;
  }
  if (!value || (*value)->size() > headroom() || !repository::decodeFaceValue(**value)) {
    ++counts.corrupt;
    return std::nullopt;
  }
  has_face.insert(key);
  ++counts.faces;
  if (scene.access != nullptr) scene.access->addFace(key);
  return protocol::encode(protocol::Face{key, std::move(**value)});
}

// ---- far faces ----

FaceRequest Session::State::notAskedFor(const Faces& faces, std::size_t most) const {
  FaceRequest keys;
  for (const repository::FaceKey& key : faces) {
    if (keys.size() == most) break;
    if (has_face.count(key) == 0 && coming.count(key) == 0 && fetched.count(key) == 0) keys.push_back(key);
  }
  return keys;
}

std::optional<FaceRequest> Session::takeFaceRequest() {
  State& s = *state_;
  if (!s.scene.images_are_far || s.phase != State::Phase::kReady || !s.planned) return std::nullopt;
  if (s.requests_under_way == kRequestsUnderWay) return std::nullopt;
  FaceRequest request = s.notAskedFor(s.view_plan.faces, s.view_plan.faces.size());
  const bool at_rest = s.complete_said && s.frame_phase == State::FramePhase::kNone;
  if (request.empty() && at_rest && s.coming.empty() && s.fetched.empty() && s.prefetch_bytes < s.scene.ahead_bytes) {
    s.planPrefetch();
    request = s.notAskedFor(*s.prefetch, kFacesAhead);
  }
  if (request.empty()) return std::nullopt;
  s.coming.insert(request.begin(), request.end());
  ++s.requests_under_way;
  return request;
}

void Session::facesFetched(const FaceRequest& request, FaceValues values) {
  State& s = *state_;
  --s.requests_under_way;
  for (std::size_t i = 0; i < request.size(); ++i) {
    s.coming.erase(request[i]);
    const auto wants = [&](const State::Faces& faces) {
      return std::find(faces.begin(), faces.end(), request[i]) != faces.end();
    };
    // What a newer view does not want goes; the next one finds it in the cache.
    if (wants(s.view_plan.faces) || (s.prefetch && wants(*s.prefetch)))
      s.fetched.insert_or_assign(request[i], std::move(values[i]));
  }
}

// ---- frames ----

bool Session::State::framePossible() const {
  const std::int64_t pixels = std::int64_t{newest->camera.width} * newest->camera.height;
  return newest->want_frame && scene.welcome.can_render_frames && pixels <= kMaxFramePixels;
}

Session::Session(const SceneData& scene) : state_(std::make_unique<State>(scene)) {}
Session::~Session() = default;

base::Result<void> Session::receive(base::ByteView bytes) {
  return state_->receive(bytes);
}

std::optional<base::Bytes> Session::nextMessage() {
  auto message = state_->next();
  if (message) state_->counts.bytes += message->size();
  return message;
}

std::optional<FrameRequest> Session::takeFrameRequest() {
  State& s = *state_;
  if (!s.planned || s.frame_phase != State::FramePhase::kDue) return std::nullopt;
  s.frame_phase = State::FramePhase::kRendering;
  return FrameRequest{s.newest->sequence, s.newest->camera, s.newest->frame_quality};
}

void Session::frameRendered(const FrameRequest& request, base::Bytes value) {
  State& s = *state_;
  if (s.phase != State::Phase::kReady || !s.newest) return;
  if (s.planned && request.sequence == s.newest->sequence) s.frame_phase = State::FramePhase::kNone;

  // Of an older view it is still a good sample while the eye is near it and looks the same way.
  const base::ViewCamera& now = s.newest->camera;
  const double moved = glm::length(now.position - request.camera.position);
  const double reach = kFarOff * static_cast<double>(glm::length(s.scene.welcome.box_max - s.scene.welcome.box_min));
  const bool same_way = glm::dot(now.direction, request.camera.direction) > std::cos(now.fov_y);
  if (value.empty() || value.size() > headroom() || moved > reach || !same_way) return;
  s.frame = protocol::encode(protocol::Frame{request.sequence, request.camera, std::move(value)});
}

bool Session::finished() const {
  return state_->phase == State::Phase::kRefused && !state_->greeting;
}
const std::string& Session::clientName() const {
  return state_->client;
}
const SessionCounts& Session::counts() const {
  return state_->counts;
}

}  // namespace server
