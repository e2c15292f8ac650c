#pragma once
// qsplat.lgq: a header, then blocks of 1024 bytes with sibling groups, breadth first (docs/formats/qsplat.md;
// Rusinkiewicz and Levoy 2000, section 3.2, and 2001, section 3.3). A file in the coded form has the same blocks, each
// entropy-coded by itself (coded_block.h); offsets and lengths are of the plain form where nothing else is said.
//
// What a traversal does for each group is inline; what is done once for each block or file is not.
#include <array>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/geometry.h"
#include "lod/qsplat/node.h"

namespace lod::qsplat {

inline constexpr std::uint32_t kBlockBytes = 1024;
/// Of these are groups; the checksum stands behind them.
inline constexpr std::uint32_t kPayloadBytes = kBlockBytes - 4;
inline constexpr std::uint32_t kMaxLevels = 128;

/// A coded file's header with its tables has this at most, so that a first request brings more than it.
inline constexpr std::uint32_t kMaxCodedHeaderBytes = 4096;
/// A block's length in the coded form.
inline constexpr std::uint32_t kMinCodedBytes = 10, kMaxCodedBytes = 1068;

struct Header {
  std::uint64_t file_bytes = 0;  ///< in the plain form
  std::uint64_t nodes = 0;
  std::uint64_t leaves = 0;
  std::uint64_t groups = 0;
  std::uint64_t pointers = 0;  ///< groups with one
  bool colors = false;
  bool wide_pointers = false;
  std::uint32_t levels = 0;  ///< the root is level 0
  base::Sphere root;         ///< scene-local

  std::uint64_t coded_bytes = 0;             ///< of a file in the coded form, all of it; 0: in the plain form
  std::uint32_t header_bytes = kBlockBytes;  ///< in the file
  std::uint32_t first_block_bytes = 0;       ///< of block 1 in the coded form; it stands behind the header

  bool coded() const { return coded_bytes != 0; }
  /// How long the file is.
  std::uint64_t storedBytes() const { return coded() ? coded_bytes : file_bytes; }
  std::uint64_t blocks() const { return file_bytes / kBlockBytes; }
  std::uint32_t nodeBytes() const { return colors ? 6 : 4; }
  std::uint32_t pointerBytes() const { return wide_pointers ? 8 : 4; }
};

/// From the file's front: 1024 bytes or more in the plain form, kMaxCodedHeaderBytes or more (or all there is) in the
/// coded one. Errors: kVersion for another version; kInvalidInput for what is no qsplat.lgq, cut short, damaged, or
/// says what cannot be.
base::Result<Header> readHeader(base::ByteView front);
/// Of a file in the plain form: 1024 bytes.
base::Bytes headerBytes(const Header& header);
/// Of one in the coded form, with packLevels' bytes at its end; header.header_bytes is not looked at.
base::Bytes codedHeaderBytes(const Header& header, base::ByteView tables);
/// codedHeaderBytes has so many, checksum included.
inline constexpr std::uint32_t codedHeaderLength(std::size_t tables) {
  return 96 + static_cast<std::uint32_t>(tables);
}
/// The tables in a header that readHeader took.
inline base::ByteView codedTables(base::ByteView front, const Header& header) {
  return front.subspan(92, header.header_bytes - codedHeaderLength(0));
}

/// Whether `block`, kBlockBytes long, is block `number` (1 for the first after the header) as it was written.
bool isIntactBlock(base::ByteView block, std::uint32_t number);
/// Writes the checksum into the last four of the block's bytes.
void sealBlock(std::uint8_t* block, std::uint32_t number);

// Groups ------------------------------------------------------------------------------------------

/// The sizes that a file's groups are made of.
struct GroupLayout {
  std::uint32_t node_bytes = 4;
  std::uint32_t pointer_bytes = 4;
  explicit GroupLayout(const Header& header) : node_bytes(header.nodeBytes()), pointer_bytes(header.pointerBytes()) {}
  GroupLayout(bool colors, bool wide_pointers) : node_bytes(colors ? 6 : 4), pointer_bytes(wide_pointers ? 8 : 4) {}

  bool hasColors() const { return node_bytes > 4; }
  std::uint32_t bytes(std::uint32_t nodes, bool has_pointer) const {
    return nodes * node_bytes + (has_pointer ? pointer_bytes : 0);
  }
  /// Of the group of this node's children; the node's own group has a pointer.
  std::uint32_t childBytes(const Node& node) const { return bytes(node.children(), !node.childrenAreLeaves()); }
};

/// Siblings, without their pointer.
struct GroupNodes {
  std::uint32_t count = 0;  ///< 1 … 4
  bool has_pointer = false;
  std::array<Node, kMaxChildren> nodes;

  std::span<const Node> view() const { return std::span(nodes).first(count); }
};

/// Where in the file a group of `bytes` begins when the one before it ends at `end`: there, or at the next block.
inline std::uint64_t groupPlace(std::uint64_t end, std::uint32_t bytes) {
  const std::uint64_t within = end % kBlockBytes;
  return within + bytes <= kPayloadBytes ? end : end - within + kBlockBytes;
}

/// Node i of the group that begins at `group`.
inline Node readNode(const std::uint8_t* group, std::uint32_t i, const GroupLayout& layout) {
  Node node;
  const std::uint8_t* at = group + i * layout.node_bytes;
  std::memcpy(&node.bits, at, sizeof(node.bits));
  if (layout.node_bytes > sizeof(node.bits)) std::memcpy(&node.color, at + sizeof(node.bits), sizeof(node.color));
  return node;
}

/// Where the first group of children of a group of so many nodes begins: an offset in the file, not checked.
inline std::uint64_t readPointer(const std::uint8_t* group, std::uint32_t nodes, const GroupLayout& layout) {
  std::uint64_t half = 0;
  std::memcpy(&half, group + nodes * layout.node_bytes, layout.pointer_bytes);
  return 2 * half;
}

/// What is wrong with a group by itself, or null: it leaves its block, a node is none, its pointer leads back, into a
/// header, beyond the file or to where no group of children fits, leaves where there should be a pointer or the other
/// way round. `block` has kBlockBytes, the group begins at byte `within` of it and at `offset` of the file.
/// After this, nodes and pointer can be used without another look; the last child group's end is not known to lie in
/// the file, its block is asked for like any other.
const char* groupFault(const std::uint8_t* block, std::uint64_t offset, std::uint32_t nodes, bool has_pointer,
                       const Header& header);

/// Walks a whole file in either form: each block's checksum, every group reached exactly once and in order, counts as
/// the header says, zeros where zeros are due, each "all children are leaves". One line a fault, the first few; empty
/// when all is well. Memory: a byte for each inner node of a level or two, and four for each block of one.
std::vector<std::string> checkTree(base::ByteView file);

bool allZero(base::ByteView bytes);

/// Errors about a file's bytes: place, what is wrong, what to do.
base::Error damaged(const std::string& what);

}  // namespace lod::qsplat
