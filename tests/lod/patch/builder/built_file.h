#pragma once
// A hierarchy file read back with everything verified.
#include <gtest/gtest.h>

#include <string>
#include <utility>

#include "tests/support/built_hierarchy.h"

namespace support {

/// Opens, verifies and decodes a hierarchy file; faults fail the test.
inline BuiltHierarchy readBuilt(const std::string& path, const lod::patch::builder::HierarchySummary& summary) {
  const auto file = lod::patch::PatchFile::open(path);
  EXPECT_TRUE(file) << file.error().message;
  if (!file) return {};
  for (const std::string& fault : file->verify()) ADD_FAILURE() << fault;
  auto built = readHierarchy(path, summary);
  EXPECT_TRUE(built) << built.error().message;
  return built ? std::move(*built) : BuiltHierarchy{};
}

}  // namespace support
