#pragma once
// A directory of one test's own, gone with it.
#include <gtest/gtest.h>
#include <stdlib.h>

#include <algorithm>
#include <filesystem>
#include <string>

namespace support {

class TemporaryDirectory {
 public:
  /// Its name holds the test's, and is no other process's.
  TemporaryDirectory() {
    const testing::TestInfo* info = testing::UnitTest::GetInstance()->current_test_info();
    std::string name = std::string("lumigrid_") + info->test_suite_name() + "_" + info->name() + "_XXXXXX";
    std::replace(name.begin(), name.end(), '/', '_');  // of tests with parameters
    path_ = (std::filesystem::temp_directory_path() / name).string();
    if (::mkdtemp(path_.data()) == nullptr) ADD_FAILURE() << "no directory " << path_;
  }
  ~TemporaryDirectory() {
    std::error_code ignored;
    std::filesystem::remove_all(path_, ignored);
  }
  TemporaryDirectory(const TemporaryDirectory&) = delete;
  TemporaryDirectory& operator=(const TemporaryDirectory&) = delete;
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }
  const std::string& path() const { return path_; }

 private:
  std::string path_;
};

}  // namespace support
