#include "lod/qsplat/blocks.h"

#include "base/check.h"

namespace lod::qsplat {

MappedBlocks::MappedBlocks(base::ByteView file, const Header& header) : Blocks(header), file_(file) {
  LUMIGRID_CHECK_EQ(file.size(), header.file_bytes);
}

const std::uint8_t* MappedBlocks::load(std::uint64_t number) {
  const base::ByteView block = file_.subspan(static_cast<std::size_t>(number * kBlockBytes), kBlockBytes);
  if (!isBlock(block, static_cast<std::uint32_t>(number))) {
    std::uint64_t none = 0;
    damaged_.compare_exchange_strong(none, number, std::memory_order_relaxed);
    return nullptr;
  }
  setPlace(number, block.data());
  return block.data();
}

}  // namespace lod::qsplat
