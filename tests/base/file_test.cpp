#include "base/file.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <filesystem>

namespace {

class FileTest : public ::testing::Test {
 protected:
  void SetUp() override {
    directory_ = std::filesystem::temp_directory_path() / ("lumigrid_file_" + std::to_string(::getpid()));
    std::filesystem::create_directories(directory_);
  }
  void TearDown() override { std::filesystem::remove_all(directory_); }
  std::string path(const std::string& name) const { return (directory_ / name).string(); }
  std::filesystem::path directory_;
};

TEST_F(FileTest, atomicWriteReplacesTheWholeFile) {
  ASSERT_TRUE(base::writeFileAtomically(path("a"), base::Bytes{1, 2, 3}));
  ASSERT_TRUE(base::writeFileAtomically(path("a"), base::Bytes{9}));
  auto read = base::readFile(path("a"));
  ASSERT_TRUE(read);
  EXPECT_EQ(*read, base::Bytes{9});
}

TEST_F(FileTest, uncommittedFileLeavesNothing) {
  {
    auto file = base::AtomicFile::create(path("b"));
    ASSERT_TRUE(file);
    ASSERT_TRUE(file->write(base::Bytes(100, 7)));
  }
  EXPECT_TRUE(std::filesystem::is_empty(directory_));
}

TEST_F(FileTest, filesOfKilledWritersAreRecognisedAndRemoved) {
  const pid_t child = ::fork();
  if (child == 0) {
    auto file = base::AtomicFile::create(path("d"));
    if (file && file->write(base::Bytes(100, 7))) ::raise(SIGKILL);
    ::_exit(1);
  }
  int status = 0;
  ASSERT_EQ(::waitpid(child, &status, 0), child);
  ASSERT_TRUE(WIFSIGNALED(status));
  const std::string left = std::filesystem::directory_iterator(directory_)->path().filename().string();
  EXPECT_TRUE(base::isUnfinished(left, "d")) << left;
  EXPECT_FALSE(base::isUnfinished(left, "e"));
  EXPECT_FALSE(base::isUnfinished("d", "d"));
  EXPECT_FALSE(base::isUnfinished(left + "x", "d"));

  ASSERT_TRUE(base::writeFileAtomically(path("d"), base::Bytes{1}));
  ASSERT_TRUE(base::writeFileAtomically(path("dd"), base::Bytes{2}));
  ASSERT_TRUE(base::writeFileAtomically(path(left + "x"), base::Bytes{3}));
  base::removeUnfinished(path("d"));
  EXPECT_FALSE(std::filesystem::exists(path(left)));
  EXPECT_TRUE(std::filesystem::exists(path("d")));
  EXPECT_TRUE(std::filesystem::exists(path("dd")));
  EXPECT_TRUE(std::filesystem::exists(path(left + "x")));
}

TEST_F(FileTest, errorsNameTheFileAndTheReason) {
  auto missing = base::readFile(path("missing"));
  ASSERT_FALSE(missing);
  EXPECT_EQ(missing.error().code, base::ErrorCode::kNotFound);
  EXPECT_NE(missing.error().message.find("missing: cannot open: No such file"), std::string::npos)
      << missing.error().message;
  auto directory = base::readFile(directory_.string());
  ASSERT_FALSE(directory);
  EXPECT_NE(directory.error().message.find("Is a directory"), std::string::npos) << directory.error().message;
}

TEST_F(FileTest, aFileReadByPositionMayBeCutMeanwhile) {
  ASSERT_TRUE(base::writeFileAtomically(path("p"), base::Bytes{1, 2, 3, 4, 5}));
  const auto file = base::PositionedFile::open(path("p"));
  ASSERT_TRUE(file);
  EXPECT_EQ(file->size(), 5U);
  base::Bytes read(3);
  ASSERT_TRUE(file->readAt(2, read));
  EXPECT_EQ(read, (base::Bytes{3, 4, 5}));
  EXPECT_TRUE(file->readAt(5, {}));

  std::filesystem::resize_file(path("p"), 4);
  const auto cut = file->readAt(2, read);
  ASSERT_FALSE(cut);
  EXPECT_EQ(cut.error().code, base::ErrorCode::kInvalidInput);
  EXPECT_EQ(cut.error().message, path("p") + ": ends at byte 4 instead of 5; copy or build the file again");
  EXPECT_FALSE(base::PositionedFile::open(path("missing")));
}

// Nobody writes into the pipe, and opening it must not wait. An earlier value of errno must not matter.
TEST_F(FileTest, pipesAndDevicesAreRefusedAtOnce) {
  ASSERT_EQ(::mkfifo(path("pipe").c_str(), 0600), 0);
  for (const std::string& name : {path("pipe"), std::string("/dev/null")}) {
    errno = ENOENT;
    const auto read = base::readFile(name);
    ASSERT_FALSE(read);
    EXPECT_EQ(read.error().code, base::ErrorCode::kUnsupported);
    EXPECT_EQ(read.error().message, name + ": is a pipe or a device; give a file");
    EXPECT_FALSE(base::MappedFile::open(name));
    const auto written = base::writeFileAtomically(name, base::Bytes{1});
    ASSERT_FALSE(written);
    EXPECT_EQ(written.error().message, name + ": is a pipe or a device; give a file");
  }
}

TEST_F(FileTest, fullDiskIsNamedAndLeavesTheOldFile) {
  ASSERT_TRUE(base::writeFileAtomically(path("c"), base::Bytes{1}));
  const base::Error error = base::systemError(path("c"), "write", ENOSPC);
  EXPECT_EQ(error.code, base::ErrorCode::kNoSpace);
  EXPECT_NE(error.message.find("free some space"), std::string::npos);
  auto file = base::AtomicFile::create(path("c"));
  ASSERT_TRUE(file);
  rlimit old{};
  ::getrlimit(RLIMIT_FSIZE, &old);
  auto* previous = std::signal(SIGXFSZ, SIG_IGN);
  rlimit small = old;
  small.rlim_cur = 4096;
  ::setrlimit(RLIMIT_FSIZE, &small);
  auto result = file->write(base::Bytes(10000, 1));
  ::setrlimit(RLIMIT_FSIZE, &old);
  std::signal(SIGXFSZ, previous);
  EXPECT_FALSE(result);
  auto read = base::readFile(path("c"));
  ASSERT_TRUE(read);
  EXPECT_EQ(*read, base::Bytes{1});
}

}  // namespace
