// A work directory is gone on with under the key it was left with, from the last stage that the disk has.
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
  void leave(const std::string& text, std::uint32_t stages) {
    auto directory = WorkDirectory::open(path_, key(text));
    ASSERT_TRUE(directory) << directory.error().message;
    for (std::uint32_t stage = 1; stage <= stages; ++stage)
      ASSERT_TRUE(directory->finishStage(stage, {static_cast<std::uint8_t>(stage)}, {}));
    ASSERT_TRUE(directory->settle());
  }

  const support::TemporaryDirectory scratch_;
  const std::string path_ = scratch_ / "work";
  int asked_ = 0;
};

TEST_F(WorkDirectoryTest, goesOnUnderTheSameKeyOnly) {
  leave("one", 3);
  {
    auto same = WorkDirectory::open(path_, key("one"));
    ASSERT_TRUE(same);
    EXPECT_EQ(same->stage(), 3U);
    ASSERT_TRUE(same->state(2));
    EXPECT_EQ(*same->state(2), base::Bytes{2});
  }
  auto other = WorkDirectory::open(path_, key("two"));
  ASSERT_TRUE(other);
  EXPECT_EQ(other->stage(), 0U);
  EXPECT_FALSE(fs::exists(path_ + "/stage1"));
}

// To work a key out may take as long as reading the source: nobody waits for it who does not need it.
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
  ASSERT_TRUE(slow->finishStage(1, {}, {}));
  ASSERT_TRUE(slow->finishStage(2, {}, {}));
  EXPECT_EQ(slow->stage(), 2U) << "the next stage is under way before the key is known";
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
  ASSERT_TRUE(directory->finishStage(1, {}, {}));
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
  ASSERT_TRUE(directory->finishStage(1, {1}, {}));
  ASSERT_TRUE(directory->finishStage(2, {2}, {}));
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
  ASSERT_TRUE(directory->finishStage(1, {1}, {}));
  const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(60);
  while (!fs::exists(path_ + "/stage1") && std::chrono::steady_clock::now() < end)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  EXPECT_TRUE(fs::exists(path_ + "/stage1"));
}

// The first stage's file is missing: no later one may count, nor give back what it needed.
TEST_F(WorkDirectoryTest, aStageThatFailsKeepsLaterOnesFromCounting) {
  auto directory = WorkDirectory::open(path_, key("one"));
  ASSERT_TRUE(directory);
  bool gave_back = false;
  ASSERT_TRUE(directory->finishStage(1, {}, {"nowhere"}));
  const bool refused = !directory->finishStage(2, {}, {}, [&] { gave_back = true; });
  EXPECT_TRUE(refused || !directory->settle()) << "it is told at once where it is known, else at the end";
  EXPECT_FALSE(fs::exists(path_ + "/stage1"));
  EXPECT_FALSE(fs::exists(path_ + "/stage2"));
  EXPECT_FALSE(gave_back);
}

TEST_F(WorkDirectoryTest, withoutAKeyNothingIsKept) {
  {
    auto directory = WorkDirectory::open(path_, {});
    ASSERT_TRUE(directory);
    bool gave_back = false;
    ASSERT_TRUE(directory->finishStage(1, {}, {}, [&] { gave_back = true; }));
    EXPECT_TRUE(gave_back);
  }
  EXPECT_FALSE(fs::exists(path_ + "/stage1"));
  EXPECT_FALSE(fs::exists(path_ + "/key"));
}

}  // namespace
