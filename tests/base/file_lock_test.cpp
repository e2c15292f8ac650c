#include "base/file_lock.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <optional>
#include <thread>

#include "tests/support/temporary_directory.h"

namespace base {
namespace {

class FileLockTest : public ::testing::Test {
 protected:
  static ino_t numberOf(int fd) {
    struct stat info {};
    EXPECT_EQ(::fstat(fd, &info), 0);
    return info.st_ino;
  }
  // Whether somebody waits for the lock on a file, by /proc/locks: "1: -> FLOCK  ADVISORY  WRITE 7 fe:01:1234 0 EOF".
  static bool isWaitedFor(ino_t number) {
    const std::string name = std::string(":").append(std::to_string(number)).append(" ");
    std::ifstream locks("/proc/locks");
    for (std::string line; std::getline(locks, line);)
      if (line.find("->") != std::string::npos && line.find(name) != std::string::npos) return true;
    return false;
  }
  support::TemporaryDirectory directory_;
  const std::string path_ = directory_ / "lock";
};

TEST_F(FileLockTest, onlyOneProcessHoldsALock) {
  auto first = tryLockFile(path_);
  ASSERT_TRUE(first) << first.error().message;
  const auto second = tryLockFile(path_, 0.01);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, ErrorCode::kBusy);
  EXPECT_NE(second.error().message.find(path_), std::string::npos) << second.error().message;
  { const FileDescriptor gone = std::move(*first); }
  EXPECT_TRUE(tryLockFile(path_));
}

TEST_F(FileLockTest, errorsNameTheFileThatCannotBeMade) {
  const auto lock = lockFile(directory_ / "nowhere/lock");
  ASSERT_FALSE(lock);
  EXPECT_EQ(lock.error().code, ErrorCode::kNotFound);
}

// The holder removes the file while another process waits. Without care two would hold the lock then, one of them on
// the removed file.
TEST_F(FileLockTest, waitersOfARemovedFileLockTheNewOne) {
  auto held = lockFile(path_);
  ASSERT_TRUE(held);
  std::optional<Result<FileDescriptor>> got;
  std::thread other([&] { got.emplace(lockFile(path_)); });
  const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(20);  // where there is no /proc/locks
  while (!isWaitedFor(numberOf(held->get())) && std::chrono::steady_clock::now() < give_up)
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  ASSERT_EQ(::unlink(path_.c_str()), 0);
  { const FileDescriptor gone = std::move(*held); }
  other.join();

  ASSERT_TRUE(*got) << got->error().message;
  struct stat named {};
  ASSERT_EQ(::stat(path_.c_str(), &named), 0) << "the lock is on a file without name";
  EXPECT_EQ(numberOf((*got)->get()), named.st_ino);
}

}  // namespace
}  // namespace base
