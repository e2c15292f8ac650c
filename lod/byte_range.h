#pragma once
#include <cstdint>

namespace lod {

/// Bytes offset … offset + length − 1 of a file, as a stream asks for them.
struct ByteRange {
  std::uint64_t id = 0;
  std::uint64_t offset = 0;
  std::uint64_t length = 0;
};

}  // namespace lod
