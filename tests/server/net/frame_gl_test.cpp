#include <gtest/gtest.h>

#include "repository/faces/face_value.h"
#include "repository/faces/frame_image.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"

namespace server {
namespace {

void expectFrameByItself(std::uint8_t abilities, bool is_webp) {
  const SceneDirectory scene;
  ServerOptions options;
  options.render_frames = true;
  RunningServer server(scene.path, options);
  auto client = LoopbackClient::connect(server.port());
  ASSERT_TRUE(client);
  ASSERT_TRUE(client->send(protocol::Hello{protocol::kVersion, "test", abilities}));
  const auto welcome = std::get<protocol::Welcome>(*client->receive());
  ASSERT_TRUE(welcome.can_render_frames) << "no GL context here";
  protocol::View view = viewOf(welcome, 3);
  view.want_frame = true;
  ASSERT_TRUE(client->send(view));

  bool complete = false;
  std::optional<protocol::Frame> frame;
  while (!frame || !frame->last || !complete) {
    auto message = client->receive();
    ASSERT_TRUE(message);
    complete |= std::holds_alternative<protocol::Completion>(*message);
    if (auto* got = std::get_if<protocol::Frame>(&*message)) frame = std::move(*got);
  }
  EXPECT_EQ(frame->sequence, 3U);
  EXPECT_TRUE(frame->last);

  // The square of 32 units fills the middle of the view; from 20 above, the view is 16.6 high and 22 wide.
  EXPECT_EQ(repository::isWebp(repository::decodeFaceValue(frame->value)->picture), is_webp);
  const auto picture = repository::decodeFrameImage(frame->value, 320 * 240);
  ASSERT_TRUE(picture) << picture.error().message;
  EXPECT_EQ(picture->width, 320);
  EXPECT_EQ(picture->height, 240);
  EXPECT_EQ(picture->at(160, 120)[3], 255);
}

TEST(Frame, exactFrameOfAViewComesByItself) {
  expectFrameByItself(protocol::kDecodesWebp, true);
}

TEST(Frame, clientsThatDecodeNoWebpGetJpeg) {
  expectFrameByItself(0, false);
}

TEST(Frame, viewOfNothingGivesAnEmptyFrame) {
  const SceneDirectory scene(0);
  ServerOptions options;
  RunningServer server(scene.path, options);
  auto client = LoopbackClient::connect(server.port());
  ASSERT_TRUE(client);
  ASSERT_TRUE(client->send(protocol::Hello{}));
  const auto welcome = std::get<protocol::Welcome>(*client->receive());
  ASSERT_TRUE(welcome.can_render_frames) << "no GL context here";
  protocol::View view = viewOf(welcome, 1);
  view.want_frame = true;
  view.camera.direction = {0.0, 0.0, 1.0};
  ASSERT_TRUE(client->send(view));
  while (auto message = client->receive()) {
    if (auto* got = std::get_if<protocol::Frame>(&*message)) {
      EXPECT_TRUE(repository::decodeFaceValue(got->value)->empty);
      return;
    }
  }
  FAIL() << "no frame came";
}

}  // namespace
}  // namespace server
