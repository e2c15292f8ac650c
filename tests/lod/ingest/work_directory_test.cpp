// A build goes on in a work directory under the key it was left with, behind the last stage that is on disk.
#include "lod/ingest/work_directory.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <future>
#include <thread>

#include "base/file.h"
#include "tests/support/temporary_directory.h"

namespace {

using namespace lod::ingest;
namespace fs = std::filesystem;

class WorkDirectoryTest : public ::testing::Test {
 protected:
  ResumeKey key(const std::string& text) {
    return [this, text]() -> base::Result<std::string> {
      ++asked_;
      return text;
    };
  }
  /// Leaves a directory with the first three stages finished.
  void leave(const std::string& text) {
    auto directory = WorkDirectory::open(path_, key(text));
    ASSERT_TRUE(directory) << directory.error().message;
    for (const Stage stage : {Stage::kSpooled, Stage::kSorted, Stage::kPatchLeaves})
      ASSERT_TRUE(directory->finishStage(stage, {static_cast<std::uint8_t>(stage)}, {}));
    ASSERT_TRUE(directory->settle());
  }

  const support::TemporaryDirectory scratch_;
  const std::string path_ = scratch_ / "work";
  int asked_ = 0;
};

TEST_F(WorkDirectoryTest, continuesUnderTheSameKeyOnly) {
  leave("one");
  {
    auto same = WorkDirectory::open(path_, key("one"));
    ASSERT_TRUE(same);
    EXPECT_TRUE(same->isFinished(Stage::kPatchLeaves));
    EXPECT_FALSE(same->isFinished(Stage::kSplatSubtrees));
    ASSERT_TRUE(same->readStageState(Stage::kSorted));
    EXPECT_EQ(*same->readStageState(Stage::kSorted), base::Bytes{2});
  }
  auto other = WorkDirectory::open(path_, key("two"));
  ASSERT_TRUE(other);
  EXPECT_FALSE(other->isFinished(Stage::kSpooled));
  EXPECT_FALSE(fs::exists(path_ + "/stage1"));
}

// Working out a key may take as long as reading the source, so nothing waits for it that does not need it.
TEST_F(WorkDirectoryTest, asksForTheKeyWhereOneWasLeftAndWhenAStageIsFinished) {
  auto directory = WorkDirectory::open(path_, key("one"));
  ASSERT_TRUE(directory);
  EXPECT_EQ(asked_, 0) << "nothing is there to go on with";
  std::promise<void> known;
  auto slow = WorkDirectory::open(scratch_ / "slow", [&]() -> base::Result<std::string> {
    known.get_future().wait();
    return std::string("late");
  });
  ASSERT_TRUE(slow);
  ASSERT_TRUE(slow->finishStage(Stage::kSpooled, {}, {}));
  ASSERT_TRUE(slow->finishStage(Stage::kSorted, {}, {}));
  EXPECT_TRUE(slow->isFinished(Stage::kSorted)) << "the next stage is under way before the key is known";
  EXPECT_FALSE(fs::exists(scratch_ / "slow/stage1")) << "a stage counts only under a key";
  known.set_value();
  ASSERT_TRUE(slow->settle());
  EXPECT_TRUE(fs::exists(scratch_ / "slow/key"));
  EXPECT_TRUE(fs::exists(scratch_ / "slow/stage2"));
}

TEST_F(WorkDirectoryTest, aKeyThatCannotBeWorkedOutIsAnErrorAndLeavesNoStage) {
  const ResumeKey broken = []() -> base::Result<std::string> {
    return base::Error{base::ErrorCode::kIo, "the source cannot be read"};
  };
  auto directory = WorkDirectory::open(path_, broken);
  ASSERT_TRUE(directory);
  ASSERT_TRUE(directory->finishStage(Stage::kSpooled, {}, {}));
  const auto settled = directory->settle();
  ASSERT_FALSE(settled);
  EXPECT_EQ(settled.error().message, "the source cannot be read");
  EXPECT_FALSE(fs::exists(path_ + "/stage1"));
}

// Syncing costs a small build more than it would cost to do the work once more.
TEST_F(WorkDirectoryTest, aBuildThatIsDoneAtOnceWritesNoStages) {
  const auto begin = std::chrono::steady_clock::now();
  auto directory = WorkDirectory::open(path_, key("one"));
  ASSERT_TRUE(directory);
  ASSERT_TRUE(directory->finishStage(Stage::kSpooled, {1}, {}));
  ASSERT_TRUE(directory->finishStage(Stage::kSorted, {2}, {}));
  directory->abandonStages();
  const bool late = std::chrono::steady_clock::now() - begin > WorkDirectory::kStageDelay;
  ASSERT_TRUE(directory->settle());
  if (late) GTEST_SKIP() << "this machine is busy";
  EXPECT_EQ(asked_, 0);
  EXPECT_FALSE(fs::exists(path_ + "/key"));
  EXPECT_FALSE(fs::exists(path_ + "/stage1"));
}

TEST_F(WorkDirectoryTest, aStageIsWrittenThoughNobodySettlesIt) {
  auto directory = WorkDirectory::open(path_, key("one"));
  ASSERT_TRUE(directory);
  ASSERT_TRUE(directory->finishStage(Stage::kSpooled, {1}, {}));
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!fs::exists(path_ + "/stage1") && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_TRUE(fs::exists(path_ + "/stage1"));
}

// The first stage's file is missing, so no later stage may count or release what the first one needed.
TEST_F(WorkDirectoryTest, aStageThatFailsKeepsLaterOnesFromCounting) {
  auto directory = WorkDirectory::open(path_, key("one"));
  ASSERT_TRUE(directory);
  bool released = false;
  ASSERT_TRUE(directory->finishStage(Stage::kSpooled, {}, {"nowhere"}));
  const bool refused = !directory->finishStage(Stage::kSorted, {}, {}, [&] { released = true; });
  EXPECT_TRUE(refused || !directory->settle()) << "it is told at once where it is known, else at the end";
  EXPECT_FALSE(fs::exists(path_ + "/stage1"));
  EXPECT_FALSE(fs::exists(path_ + "/stage2"));
  EXPECT_FALSE(released);
}

TEST_F(WorkDirectoryTest, withoutAKeyNothingIsKept) {
  {
    auto directory = WorkDirectory::open(path_, {});
    ASSERT_TRUE(directory);
    bool released = false;
    ASSERT_TRUE(directory->finishStage(Stage::kSpooled, {}, {}, [&] { released = true; }));
    EXPECT_TRUE(released);
  }
  EXPECT_FALSE(fs::exists(path_ + "/stage1"));
  EXPECT_FALSE(fs::exists(path_ + "/key"));
}

}  // namespace
