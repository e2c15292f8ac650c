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
struct SlowClient {
  /// `image_bytes`: of each stored image.
  explicit SlowClient(std::size_t image_bytes) : scene(8, image_bytes), session(withFrames(scene).data) {
    say(protocol::Hello{protocol::kVersion, "test 1"});
    run(0.5);
  }

  /// Looks from above, or from elsewhere, with frames of so many bytes, for so many seconds.
  void look(std::uint32_t sequence, const glm::dvec3& from, std::size_t bytes_of_frames, double seconds) {
    frame_bytes = bytes_of_frames;
    protocol::View view = scene.view(sequence, from);
    view.want_frame = true;
    view.frame_quality = 95;
    say(view);
    run(seconds);
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

  TestScene scene;
  Session session;
  double now = 0.0;
  std::size_t frame_bytes = 0;  // of each that is rendered from now on
  std::size_t parts = 0;
  std::vector<std::pair<double, protocol::ServerMessage>> received;

 private:
  struct Delivery {
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
      session.frameRendered(std::exchange(rendering_, std::nullopt)->first, {someFaceValue(frame_bytes, 3)});
    request();
    while (unsent() == 0) {
      auto message = session.nextMessage();
      if (!message) break;
      send(message->bytes());
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
  void accept(const Delivery& one) {
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
  std::vector<Delivery> on_the_way_;
  std::vector<std::pair<double, double>> unconfirmed_;  // bytes, and when their acknowledgement comes
  std::optional<std::pair<FrameRequest, double>> rendering_;
  protocol::PartReceiver receiver_;
};

const glm::dvec3 kAbove(0.1, 0.05, 0.7);
const glm::dvec3 kElsewhere(-0.3, 0.2, 0.5);

// Images of 200 kB, and frames of the old view that take two seconds, are under way when the eye jumps.
TEST(SlowLink, aNewViewsFrameWaitsForAFewTenthsOfASecondWhateverIsUnderWay) {
  for (const double jump_after : {1.3, 2.0, 3.1, 4.7, 6.0}) {
    SCOPED_TRACE("a jump after " + std::to_string(jump_after) + " s");
    SlowClient client(200'000);
    client.look(1, kAbove, 100'000, jump_after);
    const double jumped = client.now;
    client.look(2, kElsewhere, 5'000, 2.0);
    const double least = kRenderSeconds + 5'000.0 / kRate + 0.5 * kRoundTrip;
    EXPECT_LT(client.frameAt(2) - jumped, least + 0.3);
    EXPECT_GT(client.parts, 0U);
  }
}

TEST(SlowLink, whatComesInPartsIsComplete) {
  SlowClient client(60'000);
  client.look(1, kAbove, 30'000, 60.0);
  EXPECT_EQ(client.count<protocol::Completion>(), 1U);
  EXPECT_EQ(client.count<protocol::Face>(), client.session.counts().faces);
  EXPECT_EQ(client.count<protocol::Refinement>(), client.session.counts().groups);
  EXPECT_EQ(client.count<protocol::Frame>(), client.session.counts().frames) << "no frame was given up";
  EXPECT_GT(client.count<protocol::Face>(), 4U);
  EXPECT_GT(client.parts, client.received.size());
}

TEST(SlowLink, aFrameOfAViewThatIsGoneIsGivenUp) {
  SlowClient client(1'000);
  client.look(1, kAbove, 100'000, 1.0);
  ASSERT_EQ(client.session.counts().frames, 1U) << "which takes two seconds";
  client.look(2, kElsewhere, 5'000, 20.0);
  EXPECT_EQ(client.frameAt(1), client.frameAt(2)) << "no frame of the first view came";
  EXPECT_EQ(client.count<protocol::Frame>(), client.session.counts().frames - 1);
}

}  // namespace
}  // namespace server
