#pragma once
// The coded form of a block of a qsplat.lgq: fewer bytes, from which the block is restored byte by byte with nothing
// but the header's tables (docs/formats/qsplat.md, "The coded form"; both papers leave this as future work).
//
// A block contains the places of the blocks that hold its groups' children. So whoever traverses as far as to need a
// block knows its place, and no index has to be fetched first.
#include <array>
#include <cstdint>
#include <span>

#include "lod/qsplat/block_model.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat {

/// The place of a coded block in its file.
struct CodedPlace {
  std::uint64_t offset = 0;
  std::uint32_t bytes = 0;  ///< 0: not known
  friend bool operator==(const CodedPlace&, const CodedPlace&) = default;
};

/// The children of a block's groups lie in at most this many blocks, since it has at most 255 nodes of 4 bytes.
inline constexpr std::size_t kMaxChildBlocks = 15;

/// The blocks that contain the children of a block's groups: consecutive in both forms of the file.
struct ChildBlocks {
  std::uint64_t first_group = 0;  ///< offset of the first child group in the plain form; 0: none
  std::uint64_t offset = 0;       ///< offset of the first child block in the coded form
  std::uint32_t count = 0;
  std::array<std::uint16_t, kMaxChildBlocks> bytes{};  ///< lengths of the coded child blocks

  std::uint64_t firstBlock() const { return first_group / kBlockBytes; }
};

/// Calls visit(number, place) for each child block.
template <class Visit>
void forEachChildBlock(const ChildBlocks& children, const Visit& visit) {
  CodedPlace place{children.offset, 0};
  for (std::uint32_t i = 0; i < children.count; ++i) {
    place.bytes = children.bytes[i];
    visit(children.firstBlock() + i, place);
    place.offset += place.bytes;
  }
}

/// The shape of a group, as its parent describes it.
struct GroupShape {
  std::uint8_t nodes = 1;
  bool has_pointer = false;
};

/// Encodes and decodes the blocks of a file. Several threads may use it at a time.
class BlockCoder {
 public:
  BlockCoder(const Header& header, const SymbolLevels& levels) : header_(header), layout_(header), tables_(levels) {}
  /// `front`: the front of a coded file, from which `header` was read. Errors: kInvalidInput, invalid tables.
  static base::Result<BlockCoder> fromHeader(base::ByteView front, const Header& header);

  /// Decodes block `number` into the kBlockBytes of `plain`. False when `coded` is damaged or contradictory; `plain` is
  /// undefined then.
  bool decode(std::uint64_t number, base::ByteView coded, std::uint8_t* plain, ChildBlocks& children) const;

  /// Encodes a block of a file in which checkTree finds no fault. `groups`: the shapes of its groups; `children`: where
  /// their children are. Returns at most kMaxCodedBytes.
  base::Bytes encode(const std::uint8_t* plain, std::span<const GroupShape> groups, const ChildBlocks& children) const;

 private:
  bool decodeGroups(std::uint32_t groups, base::ByteView symbols, const ChildBlocks& children,
                    std::uint8_t* plain) const;
  bool readChildren(std::uint64_t number, std::uint32_t count, base::ByteReader& in, ChildBlocks& children) const;

  Header header_;
  GroupLayout layout_;
  CodeTables tables_;
};

/// Adds a block's symbols to `counts`; the other arguments are as for encode().
void countSymbols(const std::uint8_t* plain, std::span<const GroupShape> groups, const Header& header,
                  SymbolCounts& counts);

}  // namespace lod::qsplat
