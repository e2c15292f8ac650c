#pragma once
// The blocks of a qsplat.lgq: of a whole file in memory or on disk, or those that have arrived so far.
#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "lod/file_bytes.h"
#include "lod/qsplat/coded_block.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat {

/// A table of block addresses, which a traversal looks up for each group that it visits. Several threads may call
/// find() at a time while none puts or drops blocks.
class Blocks {
 public:
  explicit Blocks(const Header& header) : header_(header), address_(new Address[header.blocks()]()) {}
  virtual ~Blocks() = default;
  Blocks(const Blocks&) = delete;
  Blocks& operator=(const Blocks&) = delete;

  const Header& header() const { return header_; }
  /// Returns the kBlockBytes of an intact block, or null if it is missing. number: 1 … header().blocks() − 1.
  const std::uint8_t* find(std::uint64_t number) {
    const std::uint8_t* at = address_[number].load(std::memory_order_acquire);
    if (at == nullptr) at = load(number);
    if (use_ && at != nullptr) use_[number].store(frame_, std::memory_order_relaxed);
    return at;
  }

  /// Records from now on in which frame each block was last found, for deciding which ones to drop.
  void trackUse() { use_.reset(new std::atomic<std::uint32_t>[header_.blocks()]()); }
  /// Sets the number of the current frame, 1 or more; it is 1 before the first call.
  void beginFrame(std::uint32_t frame) { frame_ = frame; }
  std::uint32_t frame() const { return frame_; }
  /// Returns the frame in which a block was last found; 0: never, or trackUse() was not called.
  std::uint32_t lastUse(std::uint64_t number) const { return use_ ? use_[number].load(std::memory_order_relaxed) : 0; }

 protected:
  /// Called by find() for a block without an address; may set it.
  virtual const std::uint8_t* load(std::uint64_t number) = 0;
  void setAddress(std::uint64_t number, const std::uint8_t* at) {
    address_[number].store(at, std::memory_order_release);
  }
  /// Sets the address unless another thread has set one; returns the one that is set then.
  const std::uint8_t* offerAddress(std::uint64_t number, const std::uint8_t* at) {
    const std::uint8_t* none = nullptr;
    return address_[number].compare_exchange_strong(none, at, std::memory_order_acq_rel) ? at : none;
  }
  const std::uint8_t* address(std::uint64_t number) const { return address_[number].load(std::memory_order_acquire); }

 private:
  using Address = std::atomic<const std::uint8_t*>;
  const Header header_;
  std::unique_ptr<Address[]> address_;
  std::unique_ptr<std::atomic<std::uint32_t>[]> use_;
  std::uint32_t frame_ = 1;
};

/// The places of a coded file's blocks, as far as they are known. Several threads may use it at a time.
class PlaceTable {
 public:
  /// Block 1 is known at first: the header has its place.
  explicit PlaceTable(const Header& header);
  CodedPlace find(std::uint64_t number) const;
  /// Adds the places of child blocks; known ones stay.
  void add(const ChildBlocks& children);

 private:
  static constexpr unsigned kLengthBits = 11;
  static_assert(kMaxCodedBytes < 1U << kLengthBits);
  std::unique_ptr<std::atomic<std::uint64_t>[]> places_;  ///< offset · 2^11 + length; 0: not known
};

/// A whole file of either form. A block's checksum is checked when it is first looked up; blocks that are damaged or
/// cannot be read count as missing.
class FileBlocks : public Blocks {
 public:
  using Blocks::Blocks;
  /// Returns the first block that was looked up and was damaged or could not be read; 0: none.
  std::uint64_t damagedBlock() const { return damaged_.load(std::memory_order_relaxed); }
  /// Called between frames after trackUse(): shrinks the blocks that were read or decoded to so many bytes, or to those
  /// that the last frame used if they are more.
  virtual void trim(std::uint64_t /*bytes*/) {}
  /// Returns how many bytes such blocks take now.
  virtual std::uint64_t heldBytes() const { return 0; }
  /// Returns a block's length in the file, once it was found.
  virtual std::uint32_t storedBytes(std::uint64_t /*number*/) const { return kBlockBytes; }

 protected:
  void noteDamage(std::uint64_t number) {
    std::uint64_t none = 0;
    damaged_.compare_exchange_strong(none, number, std::memory_order_relaxed);
  }

 private:
  std::atomic<std::uint64_t> damaged_{0};
};

/// `file` has header.storedBytes(). Errors: kInvalidInput, a coded file without tables.
base::Result<std::unique_ptr<FileBlocks>> openBlocks(std::shared_ptr<const FileBytes> file, const Header& header);
/// The same for a file in memory, which must outlive the result. Plain blocks are used where they lie.
base::Result<std::unique_ptr<FileBlocks>> openBlocks(base::ByteView file, const Header& header);

/// The blocks of a plain file in memory.
class MemoryBlocks final : public FileBlocks {
 public:
  /// `file` has header.file_bytes and must outlive this.
  MemoryBlocks(base::ByteView file, const Header& header);

 private:
  const std::uint8_t* load(std::uint64_t number) override;
  base::ByteView file_;
};

/// Blocks that are read or decoded when they are first looked up, and held until they are trimmed.
class HeldBlocks : public FileBlocks {
 public:
  using FileBlocks::FileBlocks;
  ~HeldBlocks() override;
  void trim(std::uint64_t bytes) override;
  std::uint64_t heldBytes() const override { return held_.load(std::memory_order_relaxed) * kBlockBytes; }

 protected:
  /// Holds a block of kBlockBytes, unless another thread was quicker; returns the one that is held.
  const std::uint8_t* hold(std::uint64_t number, std::unique_ptr<std::uint8_t[]> block);

 private:
  std::atomic<std::uint64_t> held_{0};  ///< blocks
};

/// The blocks of a plain file on disk.
class ReadBlocks final : public HeldBlocks {
 public:
  /// `file` has header.file_bytes.
  ReadBlocks(std::shared_ptr<const FileBytes> file, const Header& header);

 private:
  const std::uint8_t* load(std::uint64_t number) override;
  std::shared_ptr<const FileBytes> file_;
};

/// The blocks of a coded file. A block can be found once a block with parents of its nodes was.
class CodedBlocks final : public HeldBlocks {
 public:
  /// `file` has header.coded_bytes.
  CodedBlocks(std::shared_ptr<const FileBytes> file, const Header& header, BlockCoder coder);
  std::uint32_t storedBytes(std::uint64_t number) const override { return places_.find(number).bytes; }

 private:
  const std::uint8_t* load(std::uint64_t number) override;
  std::shared_ptr<const FileBytes> file_;
  BlockCoder coder_;
  PlaceTable places_;
};

/// Blocks that arrive one by one. The caller owns and checks their bytes (isIntactBlock).
class GrowingBlocks final : public Blocks {
 public:
  using Blocks::Blocks;
  /// `at`: kBlockBytes that stay there until drop().
  void put(std::uint64_t number, const std::uint8_t* at) { setAddress(number, at); }
  void drop(std::uint64_t number) { setAddress(number, nullptr); }

 private:
  const std::uint8_t* load(std::uint64_t) override { return nullptr; }
};

}  // namespace lod::qsplat
