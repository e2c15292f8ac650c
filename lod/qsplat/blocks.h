#pragma once
// Where the blocks of a qsplat.lgq are: all of them in a mapped file, or those that have come so far.
#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "lod/qsplat/coded_block.h"
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
  void trackUse() { use_.reset(new std::atomic<std::uint32_t>[header_.blocks()]()); }
  /// Its number from now on, 1 or more; 1 before the first call.
  void beginFrame(std::uint32_t frame) { frame_ = frame; }
  std::uint32_t frame() const { return frame_; }
  /// The frame in which it was last found; 0: never, or trackUse() was not called.
  std::uint32_t lastUse(std::uint64_t number) const { return use_ ? use_[number].load(std::memory_order_relaxed) : 0; }

 protected:
  /// Called for what has no place yet; may set it.
  virtual const std::uint8_t* load(std::uint64_t number) = 0;
  void setPlace(std::uint64_t number, const std::uint8_t* at) { place_[number].store(at, std::memory_order_release); }
  /// The same where it has none yet; what it has then: `at`, or what another thread has set.
  const std::uint8_t* offerPlace(std::uint64_t number, const std::uint8_t* at) {
    const std::uint8_t* none = nullptr;
    return place_[number].compare_exchange_strong(none, at, std::memory_order_acq_rel) ? at : none;
  }
  const std::uint8_t* place(std::uint64_t number) const { return place_[number].load(std::memory_order_acquire); }

 private:
  using Place = std::atomic<const std::uint8_t*>;
  const Header header_;
  std::unique_ptr<Place[]> place_;
  std::unique_ptr<std::atomic<std::uint32_t>[]> use_;
  std::uint32_t frame_ = 1;
};

/// Where the blocks of a coded file are, as far as it is known. Several threads may use it at a time.
class PlaceTable {
 public:
  /// With block 1, which the header tells of.
  explicit PlaceTable(const Header& header);
  CodedPlace find(std::uint64_t number) const;
  /// What is known stays.
  void add(const ChildBlocks& children);

 private:
  static constexpr unsigned kLengthBits = 11;
  static_assert(kMaxCodedBytes < 1U << kLengthBits);
  std::unique_ptr<std::atomic<std::uint64_t>[]> places_;  ///< offset · 2^11 + length; 0: not known
};

/// A whole file in memory, in either form: a block's checksum is checked when it is first asked for; one that is
/// damaged is not here.
class FileBlocks : public Blocks {
 public:
  using Blocks::Blocks;
  /// The first damaged block that was come upon; 0: none.
  std::uint64_t damagedBlock() const { return damaged_.load(std::memory_order_relaxed); }
  /// Between frames: what it holds in memory of its own shrinks to so many bytes, or to what the last frame looked
  /// into. trackUse() was called.
  virtual void trim(std::uint64_t /*bytes*/) {}
  /// A block's length in the file, once it was here.
  virtual std::uint32_t storedBytes(std::uint64_t /*number*/) const { return kBlockBytes; }

 protected:
  void noteDamage(std::uint64_t number) {
    std::uint64_t none = 0;
    damaged_.compare_exchange_strong(none, number, std::memory_order_relaxed);
  }

 private:
  std::atomic<std::uint64_t> damaged_{0};
};

/// `file` has header.storedBytes() and must outlive what is made. Errors: kInvalidInput, a coded file without tables.
base::Result<std::unique_ptr<FileBlocks>> openBlocks(base::ByteView file, const Header& header);

/// In the plain form.
class MappedBlocks final : public FileBlocks {
 public:
  /// `file` has header.file_bytes and must outlive this.
  MappedBlocks(base::ByteView file, const Header& header);

 private:
  const std::uint8_t* load(std::uint64_t number) override;
  base::ByteView file_;
};

/// In the coded form: a block is decoded when it is first asked for. One is here once a block with its parents was.
class CodedBlocks final : public FileBlocks {
 public:
  /// `file` has header.coded_bytes and must outlive this.
  CodedBlocks(base::ByteView file, const Header& header, BlockCoder coder);
  ~CodedBlocks() override;
  void trim(std::uint64_t bytes) override;
  std::uint32_t storedBytes(std::uint64_t number) const override { return places_.find(number).bytes; }

 private:
  const std::uint8_t* load(std::uint64_t number) override;
  base::ByteView file_;
  BlockCoder coder_;
  PlaceTable places_;
  std::atomic<std::uint64_t> held_{0};  ///< blocks
};

/// Those that somebody has put there. The bytes are the caller's, and checked by him (isIntactBlock).
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
