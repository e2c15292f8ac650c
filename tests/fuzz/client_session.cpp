// A server's messages in any order and any bytes, between the viewer's calls and lost connections. All that the client
// sends is something that a server accepts, frames keep within their budget, and every block that the client holds in
// the end is that of its group.
#include "client/source/session.h"

#include "base/check.h"
#include "tests/client/source/scripted_server.h"
#include "tests/fuzz/fuzz.h"

namespace fuzz {
namespace {

using client::SessionPhase;

enum Call : std::uint8_t {
  kConnect,
  kDisconnect,
  kBytes,
  kWelcome,
  kGroup,
  kFace,
  kFrame,
  kCompletion,
  kParts,
  kSend,
  kLook,
  kWish,
  kUse,
  kTakeEvents,
  kCalls
};

const client::ScriptedServer& scriptedServer() {
  static const client::ScriptedServer made(4);
  return made;
}

/// The messages of all its groups, since encoding them takes longer than a session needs to accept them.
const base::Bytes& messageOfGroup(std::uint8_t number) {
  static const std::vector<base::Bytes> all = [] {
    std::vector<base::Bytes> messages;
    const auto count = static_cast<std::uint32_t>(scriptedServer().hierarchy().groups.size());
    for (std::uint32_t group = 0; group < count; ++group) messages.push_back(scriptedServer().sayGroup(group));
    return messages;
  }();
  return all[number % all.size()];
}

constexpr int kMaxCalls = 150;  // of one input: the rate at which inputs are tried finds more than their length

client::SessionOptions optionsOf(std::uint8_t flags) {
  client::SessionOptions options;
  options.images = (flags & 1U) == 0;
  options.frames = (flags & 2U) == 0;
  options.cache_bytes = (flags & 4U) == 0 ? 50'000'000 : 4'000;
  options.frame_bytes = 1'000;
  return options;
}

class Run {
 public:
  explicit Run(base::ByteView bytes) : in_(bytes), session_(optionsOf(in_.u8())) {}

  void play() {
    for (int calls = 0; calls < kMaxCalls && in_.ok() && in_.remaining() > 0; ++calls) {
      makeCall(in_.u8() % kCalls);
      check();
    }
    checkBlocks();
  }

 private:
  void makeCall(std::uint8_t call) {
    const client::ScriptedServer& server = scriptedServer();
    switch (call) {
      case kConnect:
        return session_.connected();
      case kDisconnect:
        return session_.disconnected("gone");
      case kBytes:
        return receive(in_.bytes(std::min<std::size_t>(in_.u16() % 4096, in_.remaining())));
      case kWelcome:
        return sayWelcome(in_.u8());
      case kGroup:
        return receive(messageOfGroup(in_.u8()));
      case kFace:
        return receive(server.sayFace(nextKey(), in_.u8()));
      case kFrame:
        return receive(server.sayFrame(in_.u8(), 4 * in_.u8(), in_.u8() % 2 != 0));
      case kCompletion:
        return receive(server.sayComplete(in_.u8()));
      case kParts:
        return sayInParts();
      case kSend:
        return takeSent();
      case kLook:
        return session_.setView(server.lookDown(1.0 + in_.u8()));
      case kWish: {
        const std::uint8_t flags = in_.u8();
        session_.setWanted((flags & 1U) != 0, (flags & 2U) != 0);
        if ((flags & 4U) != 0) session_.refine();
        return;
      }
      case kUse:
        return session_.setInUse({nextKey()}, {in_.u8() % 32U, in_.u8() % 32U});
      default:
        (void)session_.takeEvents();
    }
  }

  void receive(base::ByteView bytes) {
    // The transport ends a connection whose server did wrong.
    if (!session_.receive(bytes)) {
      LUMIGRID_CHECK(!session_.problem().empty() || session_.phase() == SessionPhase::kDisconnected);
      session_.disconnected("broken");
    }
  }

  /// Welcomes the client to the scripted scene, or to one that differs.
  void sayWelcome(std::uint8_t flags) {
    protocol::Welcome welcome = scriptedServer().welcome;
    welcome.can_render_frames = (flags & 1U) != 0;
    if ((flags & 2U) != 0) welcome.group_count /= 2;
    if ((flags & 4U) != 0) welcome.grid.count = glm::uvec3(0);
    receive(protocol::encode(protocol::ServerMessage(welcome)));
  }

  repository::FaceKey nextKey() { return {in_.u8() % 5U, in_.u8() % 5U, in_.u8() % 4U, in_.u8() % 6U, in_.u8() % 4U}; }

  /// A face in parts, of which one may be missing.
  void sayInParts() {
    protocol::PartSender sender(protocol::Stream::kData);
    sender.begin(scriptedServer().sayFace(nextKey(), in_.u8()));
    const std::size_t most = 1 + in_.u8();
    const std::size_t missing = in_.u8();
    for (std::size_t i = 0; !sender.empty(); ++i) {
      const base::Bytes part = sender.next(most);
      if (i != missing) receive(part);
    }
  }

  void takeSent() {
    while (const auto message = session_.nextToSend()) {
      LUMIGRID_CHECK(message->size() <= protocol::kMaxClientMessage);
      LUMIGRID_CHECK(bool(protocol::decodeClientMessage(*message)));
    }
  }

  void check() {
    if (session_.complete()) LUMIGRID_CHECK(session_.phase() == SessionPhase::kReady);
    LUMIGRID_CHECK(session_.stats().frame_bytes <= session_.options().frame_bytes);
  }

  /// Looking at a block counts as a use, so that the order in which blocks go would be this one's if it were called in
  /// between.
  void checkBlocks() {
    const auto& groups = session_.hierarchy().groups;
    for (std::uint32_t group = 0; group < groups.size(); ++group) {
      if (!session_.hasGroup(group)) continue;
      const base::Bytes* const block = session_.block(group);
      LUMIGRID_CHECK(block != nullptr);
      LUMIGRID_CHECK_EQ(block->size(), groups[group].block_bytes);
    }
  }

  base::ByteReader in_;
  client::Session session_;
};

/// A visit: greeted, some of everything, a lost connection, and greeted again.
base::Bytes visit(std::uint8_t options, std::uint8_t welcome) {
  base::ByteWriter out;
  const auto call = [&](std::initializer_list<int> bytes) {
    for (const int byte : bytes) out.u8(static_cast<std::uint8_t>(byte));
  };
  call({options, kLook, 20, kConnect, kSend, kWelcome, welcome, kSend, kGroup, 0, kGroup, 1, kGroup, 2, kGroup, 3});
  call({kFace, 1, 2, 1, 3, 0, 200, kFace, 1, 2, 1, 4, 0, 200, kUse, 1, 2, 1, 3, 0, 0, 1, kCompletion, 1, kWish, 7});
  call({kParts, 1, 1, 1, 1, 0, 250, 40, 255, kFrame, 1, 50, 1, kTakeEvents, kLook, 9, kSend, kDisconnect, kConnect});
  call({kSend, kWelcome, welcome ^ 2, kSend, kGroup, 0, kFrame, 2, 255, 0, kCompletion, 2, kSend});
  const base::Bytes refusal = scriptedServer().sayRefusal(3, "update");
  out.u8(kBytes);
  out.u16(static_cast<std::uint16_t>(refusal.size()));
  out.bytes(refusal);
  return out.takeBytes();
}

}  // namespace

std::vector<base::Bytes> seeds() {
  return {visit(0, 0), visit(0, 1), visit(4, 1), visit(1, 1), visit(2, 4)};
}

void fuzzOne(base::ByteView bytes) {
  if (!bytes.empty()) Run(bytes).play();
}

}  // namespace fuzz
