#include "lod/qsplat/blocks.h"

#include <algorithm>
#include <array>
#include <utility>

#include "base/check.h"

namespace lod::qsplat {

PlaceTable::PlaceTable(const Header& header) : places_(new std::atomic<std::uint64_t>[header.blocks()]()) {
  places_[1] = std::uint64_t{header.header_bytes} << kLengthBits | header.first_block_bytes;
}

CodedPlace PlaceTable::find(std::uint64_t number) const {
  const std::uint64_t place = places_[number].load(std::memory_order_relaxed);
  return {place >> kLengthBits, static_cast<std::uint32_t>(place & ((1U << kLengthBits) - 1))};
}

void PlaceTable::add(const ChildBlocks& children) {
  forEachChildBlock(children, [this](std::uint64_t number, const CodedPlace& place) {
    std::uint64_t none = 0;
    places_[number].compare_exchange_strong(none, place.offset << kLengthBits | place.bytes, std::memory_order_relaxed);
  });
}

base::Result<std::unique_ptr<FileBlocks>> openBlocks(std::shared_ptr<const FileBytes> file, const Header& header) {
  if (!header.coded()) return std::unique_ptr<FileBlocks>(std::make_unique<ReadBlocks>(std::move(file), header));
  LUMIGRID_ASSIGN_OR_RETURN(auto coder, BlockCoder::fromHeader(readFront(*file), header));
  return std::unique_ptr<FileBlocks>(std::make_unique<CodedBlocks>(std::move(file), header, std::move(coder)));
}

base::Result<std::unique_ptr<FileBlocks>> openBlocks(base::ByteView file, const Header& header) {
  if (header.coded()) return openBlocks(std::make_shared<MemoryBytes>(file), header);
  return std::unique_ptr<FileBlocks>(std::make_unique<MemoryBlocks>(file, header));
}

MemoryBlocks::MemoryBlocks(base::ByteView file, const Header& header) : FileBlocks(header), file_(file) {
  LUMIGRID_CHECK_EQ(file.size(), header.file_bytes);
}

const std::uint8_t* MemoryBlocks::load(std::uint64_t number) {
  const base::ByteView block = file_.subspan(static_cast<std::size_t>(number * kBlockBytes), kBlockBytes);
  if (!isIntactBlock(block, static_cast<std::uint32_t>(number))) {
    noteDamage(number);
    return nullptr;
  }
  setAddress(number, block.data());
  return block.data();
}

HeldBlocks::~HeldBlocks() {
  for (std::uint64_t b = 1; b < header().blocks(); ++b) delete[] address(b);
}

const std::uint8_t* HeldBlocks::hold(std::uint64_t number, std::unique_ptr<std::uint8_t[]> block) {
  const std::uint8_t* const here = offerAddress(number, block.get());
  if (here == block.get()) {
    static_cast<void>(block.release());
    held_.fetch_add(1, std::memory_order_relaxed);
  }
  return here;
}

void HeldBlocks::trim(std::uint64_t bytes) {
  const std::uint64_t max_blocks = bytes / kBlockBytes;
  if (held_ <= max_blocks) return;
  std::vector<std::pair<std::uint32_t, std::uint64_t>> by_use;  // frame of the last use, number
  for (std::uint64_t b = 1; b < header().blocks(); ++b)
    if (address(b) != nullptr && lastUse(b) < frame()) by_use.emplace_back(lastUse(b), b);
  const auto going = std::min<std::size_t>(by_use.size(), static_cast<std::size_t>(held_ - max_blocks));
  std::nth_element(by_use.begin(), by_use.begin() + static_cast<std::ptrdiff_t>(going), by_use.end());
  for (std::size_t i = 0; i < going; ++i) {
    delete[] address(by_use[i].second);
    setAddress(by_use[i].second, nullptr);
  }
  held_ -= going;
}

ReadBlocks::ReadBlocks(std::shared_ptr<const FileBytes> file, const Header& header)
    : HeldBlocks(header), file_(std::move(file)) {
  LUMIGRID_CHECK_EQ(file_->size(), header.file_bytes);
}

const std::uint8_t* ReadBlocks::load(std::uint64_t number) {
  std::unique_ptr<std::uint8_t[]> block(new std::uint8_t[kBlockBytes]);
  const std::span<std::uint8_t> bytes(block.get(), kBlockBytes);
  if (!file_->read(number * kBlockBytes, bytes) || !isIntactBlock(bytes, static_cast<std::uint32_t>(number))) {
    noteDamage(number);
    return nullptr;
  }
  return hold(number, std::move(block));
}

CodedBlocks::CodedBlocks(std::shared_ptr<const FileBytes> file, const Header& header, BlockCoder coder)
    : HeldBlocks(header), file_(std::move(file)), coder_(std::move(coder)), places_(header) {
  LUMIGRID_CHECK_EQ(file_->size(), header.coded_bytes);
}

const std::uint8_t* CodedBlocks::load(std::uint64_t number) {
  const CodedPlace at = places_.find(number);
  if (at.bytes == 0) return nullptr;
  std::array<std::uint8_t, kMaxCodedBytes> buffer;
  const std::span<std::uint8_t> coded = std::span(buffer).first(std::min<std::size_t>(at.bytes, buffer.size()));
  std::unique_ptr<std::uint8_t[]> plain(new std::uint8_t[kBlockBytes]);
  ChildBlocks children;
  if (at.bytes > buffer.size() || !file_->read(at.offset, coded) ||
      !coder_.decode(number, coded, plain.get(), children)) {
    noteDamage(number);
    return nullptr;
  }
  places_.add(children);  // before another thread can find the block and look up its children
  return hold(number, std::move(plain));
}

}  // namespace lod::qsplat
