#include <gtest/gtest.h>

#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"
#include "repository/faces/jpeg.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"

namespace server {
namespace {

TEST(Frame, exactFrameComesAfterCompletion) {
  const SceneDirectory scene;
  ServerOptions options;
  options.render_frames = true;
  RunningServer server(scene.path, options);
  auto client = LoopbackClient::connect(server.port());
  ASSERT_TRUE(client);
  ASSERT_TRUE(client->send(protocol::Hello{}));
  const auto welcome = std::get<protocol::Welcome>(*client->receive());
  ASSERT_TRUE(welcome.can_render_frames) << "no GL context here";
  protocol::View view = viewOf(welcome, 3);
  view.want_frame = true;
  ASSERT_TRUE(client->send(view));

  bool complete = false;
  std::optional<protocol::Frame> frame;
  while (!frame) {
    auto message = client->receive();
    ASSERT_TRUE(message);
    complete |= std::holds_alternative<protocol::Completion>(*message);
    if (auto* got = std::get_if<protocol::Frame>(&*message)) frame = std::move(*got);
  }
  EXPECT_TRUE(complete);
  EXPECT_EQ(frame->sequence, 3U);

  // The square of 32 units fills the middle of the view; from 20 above, the view is 16.6 high and 22 wide.
  auto value = repository::decodeFaceValue(frame->value);
  ASSERT_TRUE(value);
  ASSERT_FALSE(value->empty);
  auto picture = repository::decodeJpeg(value->picture);
  ASSERT_TRUE(picture);
  EXPECT_EQ(picture->width, 320);
  EXPECT_EQ(picture->height, 240);
  if (!value->coverage.empty()) {
    auto mask = repository::decodeCoverage(value->coverage, 320, 240);
    ASSERT_TRUE(mask);
    EXPECT_EQ(*mask->at(160, 120), 255);
  }
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
