#pragma once
// Where the blocks of a qsplat.lgq are: all of them in a mapped file, or those that have come so far.
#include <atomic>
#include <cstdint>
#include <memory>

#include "lod/qsplat/format.h"

namespace lod::qsplat {

/// One pointer for each block; a traversal asks for one at each group that it goes into. Several threads may ask at a
/// time while nobody puts or drops.
class Blocks {
 public:
  explicit Blocks(const Header& header) : header_(header), place_(new Place[header.blocks()]()) {}
  virtual ~Blocks() = default;
  Blocks(const Blocks&) = delete;
  Blocks& operator=(const Blocks&) = delete;

  const Header& header() const { return header_; }
  /// kBlockBytes of a block whose checksum is right, or null: it is not here. number: 1 … header().blocks() − 1.
  const std::uint8_t* find(std::uint64_t number) {
    const std::uint8_t* at = place_[number].load(std::memory_order_acquire);
    if (at == nullptr) at = load(number);
    if (use_ && at != nullptr) use_[number].store(frame_, std::memory_order_relaxed);
    return at;
  }

  /// Notes from now on in which frame each block was last found: which ones to drop first.
  void keepUse() { use_.reset(new std::atomic<std::uint32_t>[header_.blocks()]()); }
  /// Its number from now on, 1 or more; 1 before the first call.
  void beginFrame(std::uint32_t frame) { frame_ = frame; }
  /// The frame in which it was last found; 0: never, or keepUse() was not called.
  std::uint32_t lastUse(std::uint64_t number) const { return use_ ? use_[number].load(std::memory_order_relaxed) : 0; }

 protected:
  /// Called for what has no place yet; may set it.
  virtual const std::uint8_t* load(std::uint64_t number) = 0;
  void setPlace(std::uint64_t number, const std::uint8_t* at) { place_[number].store(at, std::memory_order_release); }

 private:
  using Place = std::atomic<const std::uint8_t*>;
  const Header header_;
  std::unique_ptr<Place[]> place_;
  std::unique_ptr<std::atomic<std::uint32_t>[]> use_;
  std::uint32_t frame_ = 1;
};

/// A whole file in memory: a block's checksum is checked when it is first asked for; one that is damaged is not here.
class MappedBlocks final : public Blocks {
 public:
  /// `file` has header.file_bytes and must outlive this.
  MappedBlocks(base::ByteView file, const Header& header);
  /// The first damaged block that was come upon; 0: none.
  std::uint64_t damagedBlock() const { return damaged_.load(std::memory_order_relaxed); }

 private:
  const std::uint8_t* load(std::uint64_t number) override;
  base::ByteView file_;
  std::atomic<std::uint64_t> damaged_{0};
};

/// Those that somebody has put there. The bytes are the caller's, and checked by him (isBlock).
class GrowingBlocks final : public Blocks {
 public:
  using Blocks::Blocks;
  /// kBlockBytes at `at`, which stay there until drop().
  void put(std::uint64_t number, const std::uint8_t* at) { setPlace(number, at); }
  void drop(std::uint64_t number) { setPlace(number, nullptr); }

 private:
  const std::uint8_t* load(std::uint64_t) override { return nullptr; }
};

}  // namespace lod::qsplat
