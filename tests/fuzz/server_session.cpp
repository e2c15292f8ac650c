// A client's messages in any order and any bytes, between everything else that happens to a session: the link's state,
// how busy the server is, messages taken out, faces fetched, frames rendered. No message may be one that the client
// cannot read, a thing that the client holds is not sent again, and after a Refusal there is silence.
//
// An input's first byte chooses the scene. Calls follow, a byte each with its arguments behind it.
#include "server/session/session.h"

#include <deque>
#include <set>

#include "base/check.h"
#include "protocol/parts.h"
#include "tests/fuzz/fuzz.h"
#include "tests/server/session/memory_store.h"

namespace fuzz {
namespace {

using protocol::ClientMessage;

enum Call : std::uint8_t {
  kLink,
  kBytes,
  kHello,
  kView,
  kHoldings,
  kEviction,
  kTakeMessages,
  kRequestFaces,
  kAnswerFaces,
  kRequestFrame,
  kRenderFrame,
  kLoad,
  kCalls
};

/// Kinds of scenes by their number: local images; remote ones; remote ones as WebP, with frames; splats alone; remote
/// tiles.
constexpr std::size_t kScenes = 5;

// Limits of one input. Planning for a view takes as long as a hundred other calls, and what a session does wrong shows
// after few of them: the rate at which inputs are tried finds more than their length.
constexpr int kMaxCalls = 100, kMaxViews = 8;

const server::SceneData& sceneOf(std::uint8_t number) {
  static server::TestScene scene(4, 300);
  static const std::vector<server::SceneData> all = [] {
    // Fewer points than the scene has faces for, and fewer rays, since planning takes most of the time.
    scene.data.ray_step = 4;
    const base::Aabb box{scene.data.welcome.box_min, scene.data.welcome.box_max};
    scene.data.welcome.grid = repository::makeGrid(box, 3, 0.5F, 256);
    std::vector<server::SceneData> made(kScenes, scene.data);
    made[1].images_are_remote = true;
    made[2].images_are_remote = made[2].images_are_webp = made[2].welcome.can_render_frames = true;
    made[3].patches = nullptr;
    made[4].images_are_remote = true;
    made[4].welcome.grid = repository::withTiles(scene.data.welcome.grid, 1);
    return made;
  }();
  return all[number % kScenes];
}

/// The receiving end: checks what comes.
class Client {
 public:
  explicit Client(const server::SceneData& scene) : scene_(scene) {}

  void receive(base::ByteView bytes) {
    LUMIGRID_CHECK(bytes.size() <= protocol::kMaxServerMessage);
    LUMIGRID_CHECK(!refused_);
    auto message = protocol::decodeServerMessage(bytes);
    LUMIGRID_CHECK(bool(message));
    if (const auto* part = std::get_if<protocol::Part>(&*message)) {
      const auto whole = parts_.accept(*part);
      LUMIGRID_CHECK(bool(whole));
      if (!*whole) return;
      message = protocol::decodeServerMessage(**whole);
      LUMIGRID_CHECK(message && !std::holds_alternative<protocol::Part>(*message));
    }
    take(*message);
  }
  /// The client gave them up, or claimed to hold them: they may come again.
  void expectAgain(const std::vector<repository::FaceKey>& faces, const std::vector<std::uint32_t>& groups) {
    faces_again_.insert(faces.begin(), faces.end());
    groups_again_.insert(groups.begin(), groups.end());
  }

 private:
  void take(const protocol::ServerMessage& message) {
    const bool greets =
        std::holds_alternative<protocol::Welcome>(message) || std::holds_alternative<protocol::Refusal>(message);
    LUMIGRID_CHECK(welcomed_ || greets);
    welcomed_ = true;
    refused_ = std::holds_alternative<protocol::Refusal>(message);
    if (const auto* face = std::get_if<protocol::Face>(&message)) {
      LUMIGRID_CHECK(scene_.welcome.grid.contains(face->key));
      LUMIGRID_CHECK(faces_.insert(face->key).second || faces_again_.erase(face->key) != 0);
    }
    if (const auto* refinement = std::get_if<protocol::Refinement>(&message)) {
      base::ByteReader record(refinement->record);
      const auto group =
          lod::patch::addGroup(record, hierarchy_, scene_.welcome.group_count, scene_.welcome.patch_count);
      LUMIGRID_CHECK(group && record.atEnd());
      LUMIGRID_CHECK(groups_.insert(*group).second || groups_again_.erase(*group) != 0);
    }
    if (std::holds_alternative<protocol::Frame>(message)) LUMIGRID_CHECK(scene_.welcome.can_render_frames);
  }

  const server::SceneData& scene_;
  protocol::PartReceiver parts_;
  lod::patch::Hierarchy hierarchy_;
  bool welcomed_ = false, refused_ = false;
  std::set<repository::FaceKey> faces_, faces_again_;
  std::set<std::uint32_t> groups_, groups_again_;
};

class Run {
 public:
  explicit Run(base::ByteView bytes) : in_(bytes), scene_(sceneOf(in_.u8())), session_(scene_), client_(scene_) {}

  void play() {
    for (int calls = 0; calls < kMaxCalls && in_.ok() && in_.remaining() > 0; ++calls) makeCall(in_.u8() % kCalls);
    takeMessages(64);
    LUMIGRID_CHECK_EQ(session_.counts().bytes, bytes_taken_);
  }

 private:
  void makeCall(std::uint8_t call) {
    switch (call) {
      case kLink:
        return passTime();
      case kBytes: {
        const std::size_t count = std::min<std::size_t>(in_.u16() % 4096, in_.remaining());
        return send(in_.bytes(count));
      }
      case kHello:
        return sendHello(in_.u8());
      case kView:
        return sendView();
      case kHoldings:
        return send(protocol::encode(ClientMessage(keys<protocol::Holdings>())));
      case kEviction:
        return send(protocol::encode(ClientMessage(keys<protocol::Eviction>())));
      case kTakeMessages:
        return takeMessages(1 + in_.u8() % 32);
      case kRequestFaces:
        if (auto request = session_.nextFaceRequest()) requests_.push_back(std::move(*request));
        return;
      case kAnswerFaces:
        return answerFaces();
      case kRequestFrame:
        if (const auto request = session_.nextFrameRequest()) frames_.push_back(*request);
        return;
      case kRenderFrame:
        return renderFrame();
      default:
        return session_.setLoad(static_cast<server::Load>(in_.u8() % 3));
    }
  }

  void passTime() {
    link_.seconds += 0.01 * in_.u8();
    link_.unsent_bytes = std::uint64_t{in_.u8()} * in_.u8();
    link_.unconfirmed_bytes = std::uint64_t{in_.u8()} * in_.u8();
    link_.round_trip_seconds = 0.001 * in_.u8();
    session_.setLink(link_);
    const auto wake = session_.wakeAt();
    LUMIGRID_CHECK(!wake || std::isfinite(*wake));
  }

  void send(base::ByteView bytes) {
    // The session may send these again while it takes in the message.
    if (const auto message = protocol::decodeClientMessage(bytes)) {
      if (const auto* gone = std::get_if<protocol::Eviction>(&*message)) client_.expectAgain(gone->faces, gone->groups);
      if (const auto* held = std::get_if<protocol::Holdings>(&*message)) client_.expectAgain(held->faces, held->groups);
    }
    const bool was_finished = session_.finished();
    const bool accepted = bool(session_.receive(bytes));
    LUMIGRID_CHECK(!(was_finished && accepted));
  }

  void sendHello(std::uint8_t flags) {
    protocol::Hello hello;
    hello.client = "fuzz";
    hello.abilities = flags & 1U ? protocol::kDecodesWebp : protocol::kTakesHull;
    hello.frame_pixels = (flags & 2U) != 0 ? 1'000'000 : 0;
    send(protocol::encode(ClientMessage(hello)));
  }

  /// A view from around the scene, so that most inputs have some.
  void sendView() {
    const auto step = [this] { return static_cast<double>(static_cast<std::int8_t>(in_.u8())) / 32.0; };
    protocol::View view;
    view.sequence = ++sequence_;
    const base::Aabb box{scene_.welcome.box_min, scene_.welcome.box_max};
    const glm::dvec3 size(box.max - box.min);
    view.camera.position = 0.5 * glm::dvec3(box.min + box.max) + glm::length(size) * glm::dvec3(step(), step(), step());
    const glm::dvec3 toward(step(), step(), step() - 0.01);
    view.camera.direction = glm::normalize(glm::length(toward) > 0.0 ? toward : glm::dvec3(1.0, 0.0, 0.0));
    view.camera.up = {0.0, 1.0, 0.0};
    view.camera.width = 1 + 16 * in_.u8();
    view.camera.height = 1 + 16 * in_.u8();
    // Every second height cuts away what lies before, or behind, the middle.
    const glm::dvec3 normal = (view.camera.height / 32 % 2 == 0 ? 1.0 : -1.0) * view.camera.direction;
    if (view.camera.height / 16 % 2 == 1)
      view.camera.section = {normal, 0.5 * glm::dot(normal, glm::dvec3(box.min + box.max))};
    const std::uint8_t flags = in_.u8();
    view.want_frame = (flags & 1U) != 0;
    view.max_points = static_cast<std::uint16_t>(flags >> 1U & 7U);
    view.frame_quality = static_cast<std::uint8_t>((flags >> 4U) * 5);
    view.patch_tolerance_px = 0.25F * static_cast<float>(1 + in_.u8());
    if (view.sequence <= kMaxViews) send(protocol::encode(ClientMessage(view)));
  }

  template <class Message>
  Message keys() {
    Message message;
    for (std::size_t i = 0, count = in_.u8() % 16; i < count; ++i)
      message.faces.push_back({in_.u8() % 4U, in_.u8() % 4U, in_.u8() % 4U, in_.u8() % 6U, in_.u8() % 8U});
    for (std::size_t i = 0, count = in_.u8() % 16; i < count; ++i) message.groups.push_back(in_.u8());
    return message;
  }

  void takeMessages(int most) {
    for (; most > 0; --most) {
      const auto message = session_.nextMessage();
      if (!message) return;
      bytes_taken_ += message->size();
      client_.receive(*message);
    }
  }

  /// Faces come as they are stored, or not at all, or broken.
  void answerFaces() {
    if (requests_.empty()) return;
    const std::size_t at = in_.u8() % requests_.size();
    const server::FaceRequest request = requests_[at];
    requests_.erase(requests_.begin() + static_cast<std::ptrdiff_t>(at));
    server::Session::FaceValues values;
    const std::uint8_t kinds = in_.u8();
    for (std::size_t i = 0; i < request.size(); ++i) {
      const unsigned kind = kinds >> 2U * (i % 4) & 3U;
      if (kind == 0)
        values.emplace_back(std::optional<base::Bytes>());
      else if (kind == 1)
        values.push_back(base::Error{base::ErrorCode::kIo, "the network is away"});
      else if (kind == 2)
        values.push_back(std::optional(base::Bytes(i % 40, 0x5A)));
      else
        values.push_back(scene_.images->get(request[i]));
    }
    session_.facesFetched(request, std::move(values));
  }

  void renderFrame() {
    if (frames_.empty()) return;
    const std::size_t at = in_.u8() % frames_.size();
    const server::FrameRequest request = frames_[at];
    frames_.erase(frames_.begin() + static_cast<std::ptrdiff_t>(at));
    session_.frameRendered(request, {base::Bytes(in_.u16(), 0x5A)});
  }

  base::ByteReader in_;
  const server::SceneData& scene_;
  server::Session session_;
  Client client_;
  server::LinkState link_;
  std::uint32_t sequence_ = 0;
  std::uint64_t bytes_taken_ = 0;
  std::deque<server::FaceRequest> requests_;
  std::deque<server::FrameRequest> frames_;
};

/// A visit: greeted, a look around with everything taken, then from another place on a busy link.
base::Bytes visit(std::uint8_t scene, std::uint8_t view_flags) {
  base::ByteWriter out;
  const auto call = [&](std::initializer_list<int> bytes) {
    for (const int byte : bytes) out.u8(static_cast<std::uint8_t>(byte));
  };
  call({scene, kHello, 3, kTakeMessages, 1, kView, 0, 0, 40, 0, 0, -32, 40, 30, view_flags, 3, kRequestFrame});
  call({kTakeMessages, 31, kRequestFaces, kTakeMessages, 31, kAnswerFaces, 0, 0xFF, kRenderFrame, 0, 0, 9});
  call({kTakeMessages, 31, kLink, 5, 90, 90, 60, 60, 80, kHoldings, 1, 1, 2, 3, 4, 0, 2, 1, 2});
  call({kView, 30, 5, 20, -30, 0, -20, 40, 30, view_flags, 1, kEviction, 1, 1, 2, 3, 4, 0, 1, 0, kRequestFaces});
  call({kAnswerFaces, 0, 0x1B, kTakeMessages, 31, kLink, 50, 0, 0, 9, 9, 80, kRequestFrame, kRenderFrame, 0, 0, 200});
  call({kTakeMessages, 31, kLoad, static_cast<int>(server::Load::kBehind), kView, 31, 5, 20, -30, 0, -20, 40, 30});
  call({view_flags, 1, kTakeMessages, 31, kLoad, static_cast<int>(server::Load::kShared), kTakeMessages, 31});
  const base::Bytes eviction = protocol::encode(ClientMessage(protocol::Eviction{{{1, 2, 3, 4}}, {1, 2}}));
  out.u8(kBytes);
  out.u16(static_cast<std::uint16_t>(eviction.size()));
  out.bytes(eviction);
  return out.takeBytes();
}

}  // namespace

std::vector<base::Bytes> seeds() {
  return {visit(0, 0x0E), visit(1, 0x0E), visit(2, 0x0F), visit(2, 0xFF), visit(3, 0x0E), visit(4, 0x0E)};
}

void fuzzOne(base::ByteView bytes) {
  if (!bytes.empty()) Run(bytes).play();
}

}  // namespace fuzz
