#include "base/guard/guarded_read.h"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <atomic>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <string>
#include <thread>
#include <vector>

#include "base/file.h"

namespace {

constexpr std::size_t kBytes = std::size_t{1} << 16;

// A mapped file of kBytes, in which byte i is i modulo 251. cut() shortens the file under the map.
class CutFile {
 public:
  explicit CutFile(const std::string& name)
      : path_((std::filesystem::temp_directory_path() / ("lumigrid_guard_" + name + std::to_string(::getpid())))
                  .string()) {
    base::Bytes bytes(kBytes);
    for (std::size_t i = 0; i < kBytes; ++i) bytes[i] = static_cast<std::uint8_t>(i % 251);
    EXPECT_TRUE(base::writeFileAtomically(path_, bytes));
    map_ = *base::MappedFile::open(path_);
  }
  ~CutFile() { std::filesystem::remove(path_); }
  CutFile(const CutFile&) = delete;
  CutFile& operator=(const CutFile&) = delete;

  void cut(std::size_t bytes) const { ASSERT_EQ(::truncate(path_.c_str(), static_cast<off_t>(bytes)), 0); }
  base::ByteView bytes() const { return map_.bytes(); }
  std::uint8_t at(std::size_t i) const { return *static_cast<const volatile std::uint8_t*>(map_.bytes().data() + i); }

 private:
  std::string path_;
  base::MappedFile map_;
};

TEST(GuardedRead, readsWhatIsThere) {
  const CutFile file("whole");
  std::uint8_t read = 0;
  EXPECT_TRUE(base::guardedRead([&] { read = file.at(1000); }));
  EXPECT_EQ(read, 1000 % 251);
  base::Bytes copy(kBytes);
  ASSERT_TRUE(base::copyGuarded(file.bytes(), copy.data()));
  EXPECT_TRUE(std::equal(copy.begin(), copy.end(), file.bytes().begin()));
  EXPECT_TRUE(base::copyGuarded({}, nullptr));
}

TEST(GuardedRead, cutFileIsAnAnswerAndNoDeath) {
  const CutFile file("cut");
  file.cut(kBytes / 2);
  base::Bytes copy(kBytes);
  for (int again = 0; again < 3; ++again) {
    EXPECT_FALSE(base::copyGuarded(file.bytes(), copy.data()));
    EXPECT_TRUE(base::copyGuarded(file.bytes().first(kBytes / 2), copy.data()));
  }
}

TEST(GuardedRead, faultSkipsTheRestOfTheBody) {
  const CutFile file("rest");
  file.cut(0);
  volatile bool before = false, after = false;
  std::uint8_t read = 0;
  EXPECT_FALSE(base::guardedRead([&] {
    before = true;
    read = file.at(0);
    after = true;
  }));
  EXPECT_TRUE(before);
  EXPECT_FALSE(after);
  EXPECT_EQ(read, 0);
}

TEST(GuardedRead, faultEndsTheInnermostGuard) {
  const CutFile file("nested");
  file.cut(0);
  std::uint8_t read = 0;
  volatile bool inner = true, went_on = false;
  EXPECT_TRUE(base::guardedRead([&] {
    inner = base::guardedRead([&] { read = file.at(0); });
    went_on = true;
  }));
  EXPECT_FALSE(inner);
  EXPECT_TRUE(went_on);

  went_on = false;
  EXPECT_FALSE(base::guardedRead([&] {
    inner = base::guardedRead([] {});
    read = file.at(0);
    went_on = true;
  }));
  EXPECT_TRUE(inner);
  EXPECT_FALSE(went_on);
}

TEST(GuardedRead, leavingAGuardIsLikeAFault) {
  volatile bool after = false;
  EXPECT_FALSE(base::guardedRead([&] {
    base::leaveGuard();
    after = true;
  }));
  EXPECT_FALSE(after);
  base::leaveGuard();  // outside of guards it does nothing
}

TEST(GuardedRead, threadsFaultOnTheirOwn) {
  const CutFile whole("threads_whole");
  const CutFile cut("threads_cut");
  cut.cut(0);
  constexpr int kThreads = 4, kTimes = 2000;
  std::atomic<int> faults{0}, reads{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t)
    threads.emplace_back([&, t] {
      for (int i = 0; i < kTimes; ++i) {
        const CutFile& file = (t + i) % 2 == 0 ? whole : cut;
        std::uint8_t read = 0;
        const bool good = base::guardedRead([&] { read = file.at(kBytes - 1); });
        if (good && read == (kBytes - 1) % 251) ++reads;
        if (!good) ++faults;
      }
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(reads, kThreads * kTimes / 2);
  EXPECT_EQ(faults, kThreads * kTimes / 2);
}

TEST(GuardedRead, fileCutWhileItIsCopiedEndsTheCopy) {
  for (int round = 0; round < 20; ++round) {
    const CutFile file("race");
    std::thread cutter([&] { file.cut(0); });
    base::Bytes copy(kBytes);
    bool whole = true;
    while (whole) whole = base::copyGuarded(file.bytes(), copy.data());
    cutter.join();
    EXPECT_FALSE(base::copyGuarded(file.bytes(), copy.data()));
  }
}

// A sanitizer that handles SIGBUS exits by itself, so how the process ends is not compared.
TEST(GuardedReadDeathTest, faultOutsideOfAGuardStillEndsTheProcess) {
  const CutFile file("outside");
  file.cut(0);
  EXPECT_TRUE(base::guardedRead([] {}));
  EXPECT_DEATH(static_cast<void>(file.at(0)), "");
  EXPECT_DEATH(
      {
        static_cast<void>(base::guardedRead([&] { static_cast<void>(file.at(0)); }));
        static_cast<void>(file.at(0));  // after a guard that caught one
      },
      "");
}

TEST(GuardedReadDeathTest, sentSignalEndsTheProcessEvenInAGuard) {
  EXPECT_DEATH(static_cast<void>(base::guardedRead([] { ::kill(::getpid(), SIGBUS); })), "");
}

// The handler takes over from one that the process had: needs a process in which no guard ran before.
TEST(GuardedReadDeathTest, handlerThatWasThereBeforeGetsFaultsOutsideOfGuards) {
  ::testing::FLAGS_gtest_death_test_style = "threadsafe";
  EXPECT_EXIT(
      {
        std::signal(SIGBUS, [](int) { std::_Exit(42); });
        const CutFile file("before");
        file.cut(0);
        if (!base::guardedRead([&] { static_cast<void>(file.at(0)); })) static_cast<void>(file.at(0));
      },
      ::testing::ExitedWithCode(42), "");
  ::testing::FLAGS_gtest_death_test_style = "fast";
}

}  // namespace
