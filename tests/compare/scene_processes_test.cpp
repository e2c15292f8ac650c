#include "compare/sim/scene_processes.h"

#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <filesystem>
#include <map>

#include "tests/support/temporary_directory.h"

namespace {

using compare::PlayedScene;

PlayedScene sceneOf(std::size_t number) {
  compare::PlayedRun run;
  run.scene = "scene " + std::to_string(number);
  run.setting = {"patches", 2.5};
  run.link = "train";
  run.path = "walk";
  run.rest_seconds = -1.0;
  compare::DisplayedFrame frame;
  frame.kind = compare::InstantKind::kRest;
  frame.seconds = 3.25;
  frame.counts.bytes = 1234;
  frame.accuracy.psnr_db = 30.5;
  frame.accuracy.foreground = 77;
  frame.flicker = {0.75, 0.5};
  frame.picture_jpeg = {1, 2, 3};
  run.frames.assign(2, frame);
  run.frames[1].flicker.reset();
  run.frames[1].at_rest = true;
  return {"renderer", {run, run}};
}

class SceneProcesses : public testing::Test {
 protected:
  base::Result<void> play(std::size_t scenes, unsigned jobs, const compare::PlayScene& play) {
    return compare::playInProcesses(scenes, jobs, directory_.path(), play, [this](std::size_t i, PlayedScene played) {
      played_[i] = std::move(played);
      return base::Result<void>();
    });
  }
  const support::TemporaryDirectory directory_;
  std::map<std::size_t, PlayedScene> played_;
};

TEST_F(SceneProcesses, bringBackWhatEachHasPlayed) {
  const auto done = play(5, 2, [](std::size_t i) -> base::Result<PlayedScene> { return sceneOf(i); });
  ASSERT_TRUE(done) << done.error().message;
  ASSERT_EQ(played_.size(), 5U);
  for (const auto& [i, scene] : played_) {
    EXPECT_EQ(compare::encodeScene(scene), compare::encodeScene(sceneOf(i)));
    EXPECT_EQ(scene.runs.at(1).scene, "scene " + std::to_string(i));
    ASSERT_TRUE(scene.runs[0].frames.at(0).flicker);
    EXPECT_EQ(scene.runs[0].frames[0].flicker->share, 0.5);
    EXPECT_FALSE(scene.runs[0].frames.at(1).flicker);
    EXPECT_EQ(scene.runs[0].frames[0].picture_jpeg, (base::Bytes{1, 2, 3}));
  }
  EXPECT_TRUE(std::filesystem::is_empty(directory_.path())) << "a file stayed";
}

TEST_F(SceneProcesses, anErrorIsPassedOnInItsWords) {
  const auto done = play(3, 3, [](std::size_t i) -> base::Result<PlayedScene> {
    if (i == 1) return base::Error{base::ErrorCode::kNotFound, "b.scene: it is not there"};
    return sceneOf(i);
  });
  ASSERT_FALSE(done);
  EXPECT_EQ(done.error().message, "b.scene: it is not there");
  EXPECT_TRUE(std::filesystem::is_empty(directory_.path())) << "a file stayed";
}

TEST_F(SceneProcesses, aKilledProcessIsAnError) {
  const auto done = play(1, 1, [](std::size_t) -> base::Result<PlayedScene> {
    ::kill(::getpid(), SIGKILL);
    return PlayedScene();
  });
  ASSERT_FALSE(done);
  EXPECT_NE(done.error().message.find("signal 9"), std::string::npos) << done.error().message;
}

TEST(EncodedScene, thatIsCutIsNone) {
  const base::Bytes whole = compare::encodeScene(sceneOf(0));
  for (std::size_t size = 0; size < whole.size(); ++size)
    EXPECT_FALSE(compare::decodeScene({whole.data(), size})) << size;
}

}  // namespace
