// Exact frames: when a session asks for them, and what it sends with them.
#include "tests/server/session/talk.h"

namespace server {
namespace {

/// Returns the index of the first Frame, or the number of messages.
std::size_t frameAt(const std::vector<ServerMessage>& messages) {
  const auto isFrame = [](const auto& message) { return std::holds_alternative<protocol::Frame>(message); };
  return static_cast<std::size_t>(std::find_if(messages.begin(), messages.end(), isFrame) - messages.begin());
}

/// Says the first view, from above, with frames whose last has this quality.
protocol::View sayFramesWanted(const TestScene& scene, Talk& talk, int quality) {
  protocol::View view = scene.view(1, kAbove);
  view.want_frame = true;
  view.frame_quality = static_cast<std::uint8_t>(quality);
  EXPECT_TRUE(talk.say(view));
  return view;
}

TEST(Session, frameIsRequestedAtOnceAndFollowsTheFirstGroup) {
  TestScene scene;
  Talk talk(withFrames(scene).data);
  talk.greet();
  const protocol::View view = sayFramesWanted(scene, talk, 70);
  const auto request = talk.session.nextFrameRequest();
  ASSERT_TRUE(request);
  EXPECT_EQ(request->sequence, 1U);
  EXPECT_EQ(request->quality, 70);
  EXPECT_TRUE(request->last);
  EXPECT_FALSE(talk.session.nextFrameRequest());

  const base::Bytes value = someFaceValue(500, 3);
  talk.session.frameRendered(*request, {value});
  const auto messages = talk.drain();
  const std::size_t at = frameAt(messages);
  EXPECT_EQ(at, 1U) << "the eye stands, so the picture needs no model";
  EXPECT_EQ(groupsIn(scene.data, {messages[0]}), std::vector<std::uint32_t>{0});
  ASSERT_LT(at, completeAt(messages, 1));
  const auto frame = std::get<protocol::Frame>(messages[at]);
  EXPECT_EQ(frame.sequence, 1U);
  EXPECT_TRUE(frame.last);
  EXPECT_EQ(frame.value, value);
  EXPECT_EQ(frame.camera.position, view.camera.position);
  EXPECT_TRUE(std::holds_alternative<protocol::Face>(messages.back())) << "then what may be needed next";
}

TEST(Session, tellsAFramesCodingErrorToThoseWhoTakeIt) {
  TestScene scene;
  for (const std::uint8_t abilities : {protocol::kDecodesWebp, protocol::kTakesCodingError}) {
    Talk talk(withFrames(scene).data);
    ASSERT_TRUE(talk.say(protocol::Hello{protocol::kVersion, "test 1", abilities}));
    sayFramesWanted(scene, talk, 70);
    talk.session.frameRendered(*talk.session.nextFrameRequest(), {someFaceValue(500, 3), 0.125F});
    const auto messages = talk.drain();
    const auto frame = std::get<protocol::Frame>(messages[frameAt(messages)]);
    EXPECT_EQ(frame.coding_error, abilities == protocol::kTakesCodingError ? 0.125F : 0.0F);
  }
}

TEST(Session, otherMessagesGoWhileTheFrameIsRendered) {
  TestScene scene;
  Talk talk(withFrames(scene).data);
  talk.greet();
  sayFramesWanted(scene, talk, 70);
  const auto request = talk.session.nextFrameRequest();
  const auto messages = talk.drain();
  EXPECT_EQ(completeAt(messages, 1), messages.size() - 1) << "but nothing ahead of need";
  talk.session.frameRendered(*request, {someFaceValue(500, 3)});
  EXPECT_TRUE(std::holds_alternative<protocol::Frame>(*talk.next()));
  EXPECT_TRUE(std::holds_alternative<protocol::Face>(*talk.next()));
}

TEST(Session, quickFrameComesFirstAndTheLastOneAfterCompletion) {
  TestScene scene;
  Talk talk(withFrames(scene).data);
  talk.greet();
  sayFramesWanted(scene, talk, 95);
  const auto quick = talk.session.nextFrameRequest();
  ASSERT_TRUE(quick);
  EXPECT_LT(quick->quality, 95);
  talk.session.frameRendered(*quick, {someFaceValue(500'000, 3)});
  EXPECT_FALSE(talk.session.nextFrameRequest()) << "not before everything else was sent, as it takes long";
  const auto messages = talk.drain();
  EXPECT_FALSE(std::get<protocol::Frame>(messages[frameAt(messages)]).last);
  EXPECT_EQ(completeAt(messages, 1), messages.size() - 1) << "nothing is sent ahead before the last frame";

  const auto last = talk.session.nextFrameRequest();
  ASSERT_TRUE(last);
  EXPECT_EQ(last->quality, 95);
  talk.session.frameRendered(*last, {someFaceValue(900, 3)});
  EXPECT_TRUE(std::get<protocol::Frame>(*talk.next()).last);
  EXPECT_TRUE(std::holds_alternative<protocol::Face>(*talk.next()));
}

/// Says the i-th view of an eye that moves along x, thirty milliseconds after the one before, with frames.
void sayMovedView(const TestScene& scene, Talk& talk, std::uint32_t i) {
  talk.session.setLink({0.03 * i, 0, 0, 0.04});
  protocol::View view = scene.view(i, kAbove + glm::dvec3(0.002 * i, 0.0, 0.0), {0.002 * i, 0.0, 0.0});
  view.want_frame = true;
  EXPECT_TRUE(talk.say(view));
}

TEST(Session, framesWaitForTheCoarseModelWhileTheEyeMoves) {
  TestScene scene;
  Talk talk(withFrames(scene).data);
  talk.greet();
  for (std::uint32_t i = 1; i <= 3; ++i) sayMovedView(scene, talk, i);
  talk.session.frameRendered(*talk.session.nextFrameRequest(), {someFaceValue(500, 3)});
  EXPECT_EQ(frameAt(talk.drain()), plan::coarseGroups(scene.patches->hierarchy(), plan::kCoarseBytes).size());
}

TEST(Session, aMovingViewersFrameCarriesTheCameraThatItWasDrawnFor) {
  TestScene scene;
  Talk talk(withFrames(scene).data);
  talk.greet();
  for (std::uint32_t i = 1; i <= 5; ++i) {
    sayMovedView(scene, talk, i);
    if (i == 1) talk.session.frameRendered(*talk.session.nextFrameRequest(), {someFaceValue(500, 3)});
    talk.drain(3);
  }
  const auto request = talk.session.nextFrameRequest();
  ASSERT_TRUE(request);
  EXPECT_EQ(request->sequence, 5U);
  EXPECT_GT(request->camera.position.x, scene.view(6, kAbove + glm::dvec3(0.012, 0.0, 0.0)).camera.position.x);
  talk.session.frameRendered(*request, {someFaceValue(500, 3)});
  const auto messages = talk.drain();
  ASSERT_LT(frameAt(messages), messages.size());
  EXPECT_EQ(std::get<protocol::Frame>(messages[frameAt(messages)]).camera.position, request->camera.position);
  EXPECT_TRUE(talk.session.wakeAt()) << "to see that the eye has stopped";
}

TEST(Session, framesAreAskedForInACodecThatHelloNamed) {
  for (const std::uint8_t codecs : {0, 1, 2, 3}) {
    TestScene scene;
    Talk talk(withFrames(scene).data);
    ASSERT_TRUE(talk.say(protocol::Hello{protocol::kVersion, "test 1", codecs}));
    protocol::View view = scene.view(1, kAbove);
    view.want_frame = true;
    ASSERT_TRUE(talk.say(view));
    talk.drain();
    const auto request = talk.session.nextFrameRequest();
    ASSERT_TRUE(request);
    const bool decodes_webp = codecs % 2 == 1;
    EXPECT_EQ(request->codec, decodes_webp ? protocol::FrameCodec::kWebp : protocol::FrameCodec::kJpeg) << int{codecs};
    EXPECT_LE(request->quality,
              decodes_webp ? base::ViewDefaults::kFrameWebpQuality : base::ViewDefaults::kFrameJpegQuality);
  }
}

TEST(Session, framesAreRequestedOnlyWhenPossible) {
  TestScene scene;
  for (int which = 0; which < 3; ++which) {
    scene.data.welcome.can_render_frames = which != 0;
    Talk talk(scene.data);
    talk.greet();
    protocol::View view = scene.view(1, kAbove);
    view.want_frame = which != 1;
    if (which == 2) view.camera.width = view.camera.height = 16384;
    view.max_points = 0;
    ASSERT_TRUE(talk.say(view));
    talk.drain();
    EXPECT_FALSE(talk.session.nextFrameRequest()) << which;
  }
}

TEST(Session, failedFrameHoldsNothingUp) {
  TestScene scene;
  Talk talk(withFrames(scene).data);
  talk.greet();
  sayFramesWanted(scene, talk, 70);
  const auto request = *talk.session.nextFrameRequest();
  talk.drain();
  talk.session.frameRendered(request, {});
  EXPECT_TRUE(std::holds_alternative<protocol::Face>(*talk.next()));
}

TEST(Session, frameOfAnOlderViewIsSentOnlyFromNearby) {
  for (const bool near : {true, false}) {
    TestScene scene;
    Talk talk(withFrames(scene).data);
    talk.greet();
    protocol::View view = scene.view(1, kAbove);
    view.want_frame = true;
    ASSERT_TRUE(talk.say(view));
    talk.drain();
    const auto request = *talk.session.nextFrameRequest();
    protocol::View next = scene.view(2, kAbove + glm::dvec3(near ? 0.02 : 0.6, 0.0, 0.0));
    next.want_frame = true;
    ASSERT_TRUE(talk.say(next));
    talk.session.frameRendered(request, {someFaceValue(500, 3)});
    const auto message = *talk.next();
    EXPECT_EQ(std::holds_alternative<protocol::Frame>(message), near);
  }
}

}  // namespace
}  // namespace server
