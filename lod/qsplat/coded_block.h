#pragma once
// A block of a qsplat.lgq in the coded form: fewer bytes from which the block comes back as it was, byte by byte, with
// nothing but the header's tables (docs/formats/qsplat.md, "The coded form"; both papers leave this as future work).
//
// Where it lies in the file its parents say: a block tells the places of the blocks that its groups' children are in.
// So who has come as far as to want a block knows where it is, and no index has to be fetched first.
#include <array>
#include <cstdint>
#include <optional>
#include <span>

#include "lod/qsplat/block_model.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat {

/// Bytes of a coded block in its file.
struct CodedPlace {
  std::uint64_t offset = 0;
  std::uint32_t bytes = 0;  ///< 0: not known
  friend bool operator==(const CodedPlace&, const CodedPlace&) = default;
};

/// Children of a block's groups lie in at most so many blocks: it has at most 255 nodes, of 4 bytes.
inline constexpr std::size_t kMaxChildBlocks = 15;

/// The blocks that the children of a block's groups lie in: side by side, in both forms of the file.
struct ChildBlocks {
  std::uint64_t first_group = 0;  ///< offset of the first group of children in the plain form; 0: there are none
  std::uint64_t offset = 0;       ///< of the first of these blocks in the coded form
  std::uint32_t count = 0;
  std::array<std::uint16_t, kMaxChildBlocks> bytes{};  ///< their lengths there

  std::uint64_t firstBlock() const { return first_group / kBlockBytes; }
};

/// Calls take(number, place) for each.
template <class Take>
void forEachChildBlock(const ChildBlocks& children, const Take& take) {
  CodedPlace place{children.offset, 0};
  for (std::uint32_t i = 0; i < children.count; ++i) {
    place.bytes = children.bytes[i];
    take(children.firstBlock() + i, place);
    place.offset += place.bytes;
  }
}

/// A group as its parent describes it.
struct GroupShape {
  std::uint8_t nodes = 1;
  bool has_pointer = false;
};

/// Codes and decodes the blocks of one file. Several threads may use it at a time.
class BlockCoder {
 public:
  BlockCoder(const Header& header, const SymbolLevels& levels) : header_(header), layout_(header), tables_(levels) {}
  /// From the front of a coded file whose header was read. Errors: kInvalidInput, tables that are none.
  static base::Result<BlockCoder> fromHeader(base::ByteView front, const Header& header);

  /// Block `number`, kBlockBytes, into `plain`. False when `coded` is damaged or says what cannot be; then `plain` has
  /// no meaning.
  bool decode(std::uint64_t number, base::ByteView coded, std::uint8_t* plain, ChildBlocks& children) const;

  /// `plain`: a block of a file that checkTree finds nothing in, `groups` what it holds, `children` the same of their
  /// children. At most kMaxCodedBytes.
  base::Bytes encode(const std::uint8_t* plain, std::span<const GroupShape> groups, const ChildBlocks& children) const;

 private:
  bool decodeGroups(std::uint32_t groups, base::ByteView symbols, const ChildBlocks& children,
                    std::uint8_t* plain) const;
  bool readChildren(std::uint64_t number, std::uint32_t count, base::ByteReader& in, ChildBlocks& children) const;

  Header header_;
  GroupLayout layout_;
  CodeTables tables_;
};

/// Counts a block's symbols; arguments as of encode().
void countSymbols(const std::uint8_t* plain, std::span<const GroupShape> groups, const Header& header,
                  SymbolCounts& counts);

}  // namespace lod::qsplat
