#pragma once
// qsplat.lgq: a header, then blocks of 1024 bytes with sibling groups, breadth first (docs/formats/qsplat.md;
// Rusinkiewicz and Levoy 2000, section 3.2, and 2001, section 3.3). A file in the coded form has the same blocks, each
// entropy-coded by itself (coded_block.h); offsets and lengths are of the plain form where nothing else is said.
//
// Functions that a traversal calls for each group are inline; those called once for each block or file are not.
#include <array>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/geometry.h"
#include "lod/file_bytes.h"
#include "lod/qsplat/node.h"

namespace lod::qsplat {

inline constexpr std::uint32_t kBlockBytes = 1024;
/// Bytes of a block that contain groups; the block's checksum follows them.
inline constexpr std::uint32_t kPayloadBytes = kBlockBytes - 4;
inline constexpr std::uint32_t kMaxLevels = 128;

/// Limit for a coded file's header with its tables, so that a stream's first request brings more than the header.
inline constexpr std::uint32_t kMaxCodedHeaderBytes = 4096;
/// Limits for the length of a coded block.
inline constexpr std::uint32_t kMinCodedBytes = 10, kMaxCodedBytes = 1068;

struct Header {
  std::uint64_t file_bytes = 0;  ///< in the plain form
  std::uint64_t nodes = 0;
  std::uint64_t leaves = 0;
  std::uint64_t groups = 0;
  std::uint64_t pointers = 0;  ///< groups with a pointer
  bool colors = false;
  bool wide_pointers = false;
  std::uint32_t levels = 0;  ///< the root is level 0
  base::Sphere root;         ///< scene-local

  std::uint64_t coded_bytes = 0;             ///< length of the whole file if it is coded; 0: plain form
  std::uint32_t header_bytes = kBlockBytes;  ///< as stored
  std::uint32_t first_block_bytes = 0;       ///< length of coded block 1, which follows the header

  bool coded() const { return coded_bytes != 0; }
  /// Length of the file as it is stored.
  std::uint64_t storedBytes() const { return coded() ? coded_bytes : file_bytes; }
  std::uint64_t blocks() const { return file_bytes / kBlockBytes; }
  std::uint32_t nodeBytes() const { return colors ? 6 : 4; }
  std::uint32_t pointerBytes() const { return wide_pointers ? 8 : 4; }
};

/// As many of a file's first bytes as readHeader and BlockCoder::fromHeader need; fewer where it is shorter or cannot
/// be read.
base::Bytes readFront(const FileBytes& file);
/// Reads the header from the file's front. `front`: at least 1024 bytes of a plain file, kMaxCodedHeaderBytes of a
/// coded one, or the whole file. Errors: kVersion for an unknown version; kInvalidInput for a file that is no
/// qsplat.lgq, cut short, damaged or contradictory.
base::Result<Header> readHeader(base::ByteView front);
/// Returns the header of a plain file: 1024 bytes.
base::Bytes headerBytes(const Header& header);
/// Returns the header of a coded file with the bytes of packLevels in it; header.header_bytes is ignored.
base::Bytes codedHeaderBytes(const Header& header, base::ByteView tables);
/// Length of codedHeaderBytes with tables of this length, checksum included.
inline constexpr std::uint32_t codedHeaderLength(std::size_t tables) {
  return 96 + static_cast<std::uint32_t>(tables);
}
/// Returns the tables in a coded file's header. `header` was read from `front`.
inline base::ByteView codedTables(base::ByteView front, const Header& header) {
  return front.subspan(92, header.header_bytes - codedHeaderLength(0));
}

/// Whether the checksum of `block` is right for block `number` (1 is the first after the header).
bool isIntactBlock(base::ByteView block, std::uint32_t number);
/// Writes the checksum into the last four bytes of a block.
void sealBlock(std::uint8_t* block, std::uint32_t number);

// Groups ------------------------------------------------------------------------------------------

/// The sizes of a file's nodes and pointers.
struct GroupLayout {
  std::uint32_t node_bytes = 4;
  std::uint32_t pointer_bytes = 4;
  explicit GroupLayout(const Header& header) : node_bytes(header.nodeBytes()), pointer_bytes(header.pointerBytes()) {}
  GroupLayout(bool colors, bool wide_pointers) : node_bytes(colors ? 6 : 4), pointer_bytes(wide_pointers ? 8 : 4) {}

  bool hasColors() const { return node_bytes > 4; }
  std::uint32_t bytes(std::uint32_t nodes, bool has_pointer) const {
    return nodes * node_bytes + (has_pointer ? pointer_bytes : 0);
  }
  /// Size of the group of this node's children. The node's own group has a pointer.
  std::uint32_t childBytes(const Node& node) const { return bytes(node.children(), !node.childrenAreLeaves()); }
};

/// Sibling nodes without their pointer.
struct GroupNodes {
  std::uint32_t count = 0;  ///< 1 … 4
  bool has_pointer = false;
  std::array<Node, kMaxChildren> nodes;

  std::span<const Node> view() const { return std::span(nodes).first(count); }
};

/// Returns where a group of `bytes` begins when the group before it ends at `end`: there, or at the next block.
inline std::uint64_t groupPlace(std::uint64_t end, std::uint32_t bytes) {
  const std::uint64_t within = end % kBlockBytes;
  return within + bytes <= kPayloadBytes ? end : end - within + kBlockBytes;
}

/// Lays out groups of children one after the other, in the order of their parents.
class ChildLayout {
 public:
  /// `end`: where the group before the first one ends.
  ChildLayout(const GroupLayout& layout, std::uint64_t end) : layout_(layout), end_(end) {}
  /// Returns where the next group, of so many bytes, begins.
  std::uint64_t place(std::uint32_t bytes) {
    last_ = groupPlace(end_, bytes);
    end_ = last_ + bytes;
    return last_;
  }
  /// Places the children of a group with a pointer, and returns that pointer; 0 if it has no children.
  std::uint64_t next(const GroupNodes& group) {
    std::uint64_t pointer = 0;
    for (const Node& node : group.view()) {
      if (node.isLeaf()) continue;
      const std::uint64_t child = place(layout_.childBytes(node));
      if (pointer == 0) pointer = child;
    }
    return pointer;
  }
  /// Where the last group begins (0: none), and where it ends.
  std::uint64_t last() const { return last_; }
  std::uint64_t end() const { return end_; }

 private:
  GroupLayout layout_;
  std::uint64_t end_;
  std::uint64_t last_ = 0;
};

/// Reads node i of the group that begins at `group`.
inline Node readNode(const std::uint8_t* group, std::uint32_t i, const GroupLayout& layout) {
  Node node;
  const std::uint8_t* at = group + i * layout.node_bytes;
  std::memcpy(&node.bits, at, sizeof(node.bits));
  if (layout.node_bytes > sizeof(node.bits)) std::memcpy(&node.color, at + sizeof(node.bits), sizeof(node.color));
  return node;
}

/// Writes the nodes of a group that begins at `at`; returns where its pointer belongs.
inline std::uint8_t* writeNodes(const GroupNodes& group, const GroupLayout& layout, std::uint8_t* at) {
  for (const Node& node : group.view()) {
    std::memcpy(at, &node.bits, sizeof(node.bits));
    if (layout.hasColors()) std::memcpy(at + sizeof(node.bits), &node.color, sizeof(node.color));
    at += layout.node_bytes;
  }
  return at;
}

/// Reads where the first child group of a group of `nodes` nodes begins: an offset in the plain file, unchecked.
inline std::uint64_t readPointer(const std::uint8_t* group, std::uint32_t nodes, const GroupLayout& layout) {
  std::uint64_t half = 0;
  std::memcpy(&half, group + nodes * layout.node_bytes, layout.pointer_bytes);
  return 2 * half;
}

/// Checks a group by itself and returns what is wrong with it, or null: it leaves its block, a code is invalid, or its
/// pointer leads back, into the header, beyond the file, to where no child group fits, or does not match the children.
/// `block` has kBlockBytes; `offset` is the group's place in the file. After this check nodes and pointer can be used,
/// but the last child group may still end beyond the file, so its block is looked up like any other.
const char* groupFault(const std::uint8_t* block, std::uint64_t offset, std::uint32_t nodes, bool has_pointer,
                       const Header& header);

/// Checks a whole file of either form: each block's checksum, that every group is reached exactly once and in order,
/// the header's counts, unused bytes, and each "all children are leaves". Returns a line for each of the first few
/// faults, nothing for an intact file. Memory: a byte for each inner node of a level or two; for a coded file, four
/// bytes for each block of a level.
std::vector<std::string> checkTree(base::ByteView file);
/// The same for a file on disk.
std::vector<std::string> checkTree(const FileBytes& file);

bool allZero(base::ByteView bytes);

/// Returns the error for damaged bytes: place, what is wrong, what to do.
base::Error damaged(const std::string& problem);

}  // namespace lod::qsplat
