#pragma once
// All that an image repository holds, to compare two builds value by value.
#include <gtest/gtest.h>

#include <cstdint>
#include <map>
#include <string>

#include "base/bytes.h"
#include "repository/store.h"

namespace programs {

/// The values of a scene's undivided repository by the codes of their keys.
inline std::map<std::uint64_t, base::Bytes> faceValues(const std::string& scene) {
  std::map<std::uint64_t, base::Bytes> all;
  auto store = repository::openLmdbStore(scene + "/images", repository::StoreMode::kRead);
  EXPECT_TRUE(store);
  if (!store) return all;
  auto visited = (*store)->forEach([&](const repository::FaceKey& key, base::ByteView value) {
    all[key.code()] = base::Bytes(value.begin(), value.end());
    return true;
  });
  EXPECT_TRUE(visited);
  return all;
}

}  // namespace programs
