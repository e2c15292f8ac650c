#pragma once
// Every byte of these values follows from a number, so that any reader can tell a whole value from a torn one. The
// store's tests and the writer process that they kill share them.
#include <cstdint>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "repository/faces/face_value.h"
#include "repository/sampling/key.h"

namespace repository::test {

inline constexpr std::uint32_t kBatchValues = 60;

/// Keys are scattered over the grid: neighbours in number are not neighbours in the store.
inline FaceKey keyOf(std::uint32_t number) {
  const std::uint32_t mixed = number * 2654435761U;
  return {number & 63U, number >> 6 & 1023U, mixed >> 22, mixed % 6};
}

/// Sizes go from 0 to about 16 KB, so that values lie in a node, on one overflow page and on several.
inline base::Bytes valueOf(std::uint32_t number) {
  base::Bytes jpeg(1 + number * 7919U % 16000U);
  std::uint32_t state = number;
  for (std::uint8_t& byte : jpeg) byte = static_cast<std::uint8_t>((state = state * 1664525U + 1013904223U) >> 24);
  return number % 11 == 0 ? encodeFaceValue({}) : encodeFaceValue({false, jpeg, {}});
}

inline std::vector<std::pair<FaceKey, base::Bytes>> batchOf(std::uint32_t batch) {
  std::vector<std::pair<FaceKey, base::Bytes>> values;
  for (std::uint32_t i = 0; i < kBatchValues; ++i) {
    const std::uint32_t number = batch * kBatchValues + i;
    values.emplace_back(keyOf(number), valueOf(number));
  }
  return values;
}

}  // namespace repository::test
