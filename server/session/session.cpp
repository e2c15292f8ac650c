#include "server/session/session.h"

#include <algorithm>
#include <cmath>
#include <unordered_set>
#include <utility>
#include <variant>
#include <vector>

#include "repository/face_value.h"

namespace server {
namespace {

constexpr std::int64_t kMaxFramePixels = 16'000'000;
// An exact frame still helps after the eye moved by 8 % of the scene (DESIGN section 7).
constexpr double kFarOff = 0.1;

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
  base::Result<void> take(const protocol::Evicted& evicted);
  base::Result<void> take(const protocol::Have& have);
  base::Error refuse(base::ErrorCode code, const std::string& reason);

  // ---- out ----
  std::optional<base::Bytes> next();
  std::optional<base::Bytes> nextForView();
  std::optional<base::Bytes> nextCoarse();
  std::optional<base::Bytes> nextWanted();
  std::optional<base::Bytes> nextPrefetch();
  std::optional<base::Bytes> groupMessage(std::uint32_t group);
  std::optional<base::Bytes> faceMessage(const repository::FaceKey& key);
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

  // What is still to be sent for it; cursors run over the lists, and what the client got meanwhile is passed over.
  plan::ViewPlan view_plan;
  std::size_t next_coarse = 0, next_group = 0, next_face = 0;
  std::uint64_t group_bytes = 0, face_bytes = 0;
  bool complete_said = false;
  FramePhase frame_phase = FramePhase::kNone;
  std::optional<std::vector<repository::FaceKey>> prefetch;
  std::size_t next_prefetch = 0;
  std::uint64_t prefetch_bytes = 0;

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

base::Result<void> Session::State::take(const protocol::Evicted& evicted) {
  for (const repository::FaceKey& key : evicted.faces) has_face.erase(key);
  for (std::uint32_t group : evicted.groups)
    if (group < has_group.size()) has_group[group] = false;
  return {};
}

/// Keys that this scene does not have are passed over: the client may come from an older build of it.
base::Result<void> Session::State::take(const protocol::Have& have) {
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
  if (!complete_said) {
    complete_said = true;
    if (framePossible()) frame_phase = FramePhase::kDue;
    return protocol::encode(protocol::Complete{newest->sequence});
  }
  // The frame comes before anything that is not needed yet.
  if (frame_phase != FramePhase::kNone) return std::nullopt;
  return nextPrefetch();
}

void Session::State::planNewestView() {
  view_plan = plan::planView(scene.toPlan(), *newest,
                             [this](const repository::FaceKey& key) { return has_face.count(key) != 0; });
  next_coarse = next_group = next_face = next_prefetch = 0;
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
    while (next_face < view_plan.faces.size() && has_face.count(view_plan.faces[next_face]) != 0) ++next_face;
    const bool group_left = next_group < view_plan.groups.size();
    const bool face_left = next_face < view_plan.faces.size();
    if (!group_left && !face_left) return std::nullopt;

    const bool urgent = group_left && plan::isUrgent(view_plan.group_error_px[next_group], *newest);
    if (group_left && (!face_left || urgent || group_bytes <= face_bytes)) {
      if (auto message = groupMessage(view_plan.groups[next_group++])) {
        group_bytes += message->size();
        return message;
      }
    } else if (auto message = faceMessage(view_plan.faces[next_face++])) {
      face_bytes += message->size();
      return message;
    }
  }
}

std::optional<base::Bytes> Session::State::nextPrefetch() {
  if (!prefetch) {
    prefetch = view_plan.other_faces;
    if (previous) {
      const auto ahead = plan::planMotion(scene.toPlan(), *newest, *previous,
                                          [this](const repository::FaceKey& key) { return has_face.count(key) != 0; });
      prefetch->insert(prefetch->end(), ahead.begin(), ahead.end());
    }
  }
  while (next_prefetch < prefetch->size() && prefetch_bytes < scene.ahead_bytes) {
    if (auto message = faceMessage((*prefetch)[next_prefetch++])) {
      prefetch_bytes += message->size();
      return message;
    }
  }
  return std::nullopt;
}

/// The Refine message of a group; nothing when the client has it or the block cannot be read.
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
  return protocol::encode(protocol::Refine{record.take(), {block->begin(), block->end()}});
}

/// The Face message of a key; nothing when the client has it, or the store lacks it (it is being built) or holds broken
/// bytes.
std::optional<base::Bytes> Session::State::faceMessage(const repository::FaceKey& key) {
  if (has_face.count(key) != 0) return std::nullopt;
  auto value = scene.images->get(key);
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
