// A session over a slow link that queues, played in steps of time: what a new view's frame waits for.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <variant>
#include <vector>

#include "protocol/parts.h"
#include "tests/server/session/memory_store.h"

namespace server {
namespace {

constexpr double kRate = 48'000.0;  // bytes a second
constexpr double kRoundTrip = 0.1;
constexpr double kStep = 0.005;
constexpr double kRenderSeconds = 0.02;
// Bytes under way, as TCP has them: at first, and at most, which is more than the link holds and queues on it.
constexpr double kFirstWindow = 14'600.0, kWidestWindow = 70'000.0;

/// A client behind the link: what came at which time, put together from parts.
struct Played {
  explicit Played(const SceneData& scene) : session(scene) {
    say(protocol::Hello{protocol::kVersion, "test 1"});
    run(0.5);
  }

  void say(const protocol::ClientMessage& message) { EXPECT_TRUE(session.receive(protocol::encode(message))); }
  void run(double seconds) {
    for (const double end = now + seconds; now < end; now += kStep) step();
  }
  /// When the first frame of this view or a later one was there, seconds.
  double frameAt(std::uint32_t sequence) const {
    for (const auto& [at, message] : received)
      if (const auto* frame = std::get_if<protocol::Frame>(&message); frame && frame->sequence >= sequence) return at;
    return 1e9;
  }
  template <class Message>
  std::size_t count() const {
    return static_cast<std::size_t>(std::count_if(
        received.begin(), received.end(), [](const auto& one) { return std::holds_alternative<Message>(one.second); }));
  }

  Session session;
  double now = 0.0;
  std::size_t frame_bytes = 5'000;  // of each that is rendered from now on
  std::size_t parts = 0;
  std::vector<std::pair<double, protocol::ServerMessage>> received;

 private:
  struct OnTheWay {
    double arrives;
    base::Bytes message;
  };

  void step() {
    for (; !on_the_way_.empty() && on_the_way_.front().arrives <= now; on_the_way_.erase(on_the_way_.begin()))
      accept(on_the_way_.front());
    for (; !unconfirmed_.empty() && unconfirmed_.front().second <= now; unconfirmed_.erase(unconfirmed_.begin()))
      window_ = std::min(kWidestWindow, window_ + unconfirmed_.front().first);
    tellLink();
    if (rendering_ && rendering_->second <= now)
      session.frameRendered(std::exchange(rendering_, std::nullopt)->first, someFaceValue(frame_bytes, 3));
    request();
    while (unsent() == 0) {
      auto message = session.nextMessage();
      if (!message) break;
      send(std::move(*message));
      tellLink();
      request();
    }
  }
  void request() {
    if (const auto one = session.nextFrameRequest()) rendering_ = {*one, now + kRenderSeconds};
  }
  void send(base::Bytes message) {
    const auto bytes = static_cast<double>(message.size());
    free_at_ = std::max(free_at_, now) + bytes / kRate;
    unconfirmed_.emplace_back(bytes, free_at_ + kRoundTrip);
    on_the_way_.push_back({free_at_ + 0.5 * kRoundTrip, std::move(message)});
  }
  double waiting() const {
    double bytes = 0.0;
    for (const auto& [size, at] : unconfirmed_) bytes += size;
    return bytes;
  }
  std::uint64_t unsent() const { return static_cast<std::uint64_t>(std::max(0.0, waiting() - window_)); }
  void tellLink() { session.setLink({now, unsent(), static_cast<std::uint64_t>(waiting()) - unsent(), kRoundTrip}); }
  void accept(const OnTheWay& one) {
    auto message = protocol::decodeServerMessage(one.message);
    ASSERT_TRUE(message);
    if (const auto* part = std::get_if<protocol::Part>(&*message)) {
      ++parts;
      const auto whole = receiver_.accept(*part);
      ASSERT_TRUE(whole);
      if (!*whole) return;
      message = protocol::decodeServerMessage(**whole);
      ASSERT_TRUE(message) << "a whole message";
    }
    received.emplace_back(now, *message);
  }

  double free_at_ = 0.0, window_ = kFirstWindow;
  std::vector<OnTheWay> on_the_way_;
  std::vector<std::pair<double, double>> unconfirmed_;  // bytes, and when their acknowledgement comes
  std::optional<std::pair<FrameRequest, double>> rendering_;
  protocol::PartReceiver receiver_;
};

const glm::dvec3 kAbove(0.1, 0.05, 0.7);
const glm::dvec3 kElsewhere(-0.3, 0.2, 0.5);

protocol::View framesWanted(protocol::View view) {
  view.want_frame = true;
  view.frame_quality = 95;
  return view;
}

// Images of 200 kB, and frames of the old view that take as long as these, are under way when the eye jumps.
TEST(SlowLink, aNewViewsFrameWaitsForAFewTenthsOfASecondWhateverIsUnderWay) {
  TestScene scene(8, 200'000);
  scene.data.welcome.can_render_frames = true;
  for (const double jump_after : {1.3, 2.0, 3.1, 4.7, 6.0}) {
    SCOPED_TRACE("a jump after " + std::to_string(jump_after) + " s");
    Played client(scene.data);
    client.say(framesWanted(scene.view(1, kAbove)));
    client.run(jump_after);
    client.frame_bytes = 5'000;
    const double jumped = client.now;
    client.say(framesWanted(scene.view(2, kElsewhere)));
    client.run(2.0);
    const double least = kRenderSeconds + 5'000.0 / kRate + 0.5 * kRoundTrip;
    EXPECT_LT(client.frameAt(2) - jumped, least + 0.3);
    EXPECT_GT(client.parts, 0U);
  }
}

TEST(SlowLink, whatComesInPartsIsComplete) {
  TestScene scene(8, 60'000);
  scene.data.welcome.can_render_frames = true;
  Played client(scene.data);
  client.frame_bytes = 30'000;
  client.say(framesWanted(scene.view(1, kAbove)));
  client.run(60.0);
  EXPECT_EQ(client.count<protocol::Completion>(), 1U);
  EXPECT_EQ(client.count<protocol::Face>(), client.session.counts().faces);
  EXPECT_EQ(client.count<protocol::Refinement>(), client.session.counts().groups);
  EXPECT_EQ(client.count<protocol::Frame>(), client.session.counts().frames) << "no frame was given up";
  EXPECT_GT(client.count<protocol::Face>(), 4U);
  EXPECT_GT(client.parts, client.received.size());
}

// A frame of half a second is under way when the eye jumps: nobody needs it any more.
TEST(SlowLink, aFrameOfAViewThatIsGoneIsGivenUp) {
  TestScene scene(8, 1'000);
  scene.data.welcome.can_render_frames = true;
  Played client(scene.data);
  client.frame_bytes = 100'000;
  client.say(framesWanted(scene.view(1, kAbove)));
  client.run(1.0);
  ASSERT_EQ(client.session.counts().frames, 1U);
  client.frame_bytes = 5'000;
  client.say(framesWanted(scene.view(2, kElsewhere)));
  client.run(20.0);
  EXPECT_EQ(client.frameAt(1), client.frameAt(2)) << "no frame of the first view came";
  EXPECT_EQ(client.count<protocol::Frame>(), client.session.counts().frames - 1);
}

}  // namespace
}  // namespace server
