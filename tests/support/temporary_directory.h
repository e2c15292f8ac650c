#pragma once
// A directory of one test's own that is removed when the test ends.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>

#include "tests/support/scratch_directory.h"

namespace support {

class TemporaryDirectory : public ScratchDirectory {
 public:
  /// Its name holds the test's, and no other process has the same.
  TemporaryDirectory() : ScratchDirectory(nameOfTest()) {
    if (path().empty()) ADD_FAILURE() << "no temporary directory could be made";
  }

 private:
  static std::string nameOfTest() {
    const testing::TestInfo* info = testing::UnitTest::GetInstance()->current_test_info();
    std::string name = std::string("lumigrid_") + info->test_suite_name() + "_" + info->name();
    std::replace(name.begin(), name.end(), '/', '_');  // the names of tests with parameters hold slashes
    return name;
  }
};

}  // namespace support
