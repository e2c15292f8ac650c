#include "lod/qsplat/format.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/crc32c.h"
#include "base/fields.h"

namespace lod::qsplat {
namespace {

constexpr std::array<char, 8> kMagic{'L', 'G', 'Q', 'S', 'P', 'L', 'T', '\n'};
// The version also tells the two forms apart.
constexpr std::uint32_t kPlainVersion = 1;
constexpr std::uint32_t kCodedVersion = 2;
constexpr std::uint32_t kHasColors = 1;
constexpr std::uint32_t kWidePointers = 2;
constexpr std::size_t kFieldsEnd = 80;  // bytes from here to the checksum are zero

std::uint32_t checksumAt(const std::uint8_t* at) {
  std::uint32_t crc = 0;
  std::memcpy(&crc, at, sizeof(crc));
  return crc;
}

std::uint32_t blockChecksum(const std::uint8_t* block, std::uint32_t number) {
  const auto place = base::bitCast<std::array<std::uint8_t, 4>>(number);
  return base::crc32c(base::ByteView(block, kPayloadBytes), base::crc32c(place));
}

// Checks that a tree with these counts is possible and fits the file's length.
base::Result<void> checkHeader(const Header& header, std::uint32_t flags) {
  if ((flags & ~(kHasColors | kWidePointers)) != 0) return damaged("header: unknown flags");
  if (header.file_bytes % kBlockBytes != 0 || header.file_bytes < 2 * kBlockBytes)
    return damaged("header: the file's length is no number of blocks");
  const std::uint64_t payload = (header.blocks() - 1) * kPayloadBytes;
  if (header.nodes == 0 || header.nodes > payload / header.nodeBytes())
    return damaged("header: the nodes don't fit the file's length");
  // Each inner node has one group of 2 to 4 children; the root is in a group of its own.
  if (header.leaves == 0 || header.leaves > header.nodes || header.groups != header.nodes - header.leaves + 1)
    return damaged("header: nodes, leaves and groups don't make a tree");
  const std::uint64_t inner = header.groups - 1;
  if (header.nodes - 1 < 2 * inner || header.nodes - 1 > kMaxChildren * inner)
    return damaged("header: nodes, leaves and groups don't make a tree");
  if (header.pointers > inner || (inner > 0) != (header.pointers > 0))
    return damaged("header: the number of pointers cannot be");
  if (header.nodes * header.nodeBytes() + header.pointers * header.pointerBytes() > payload ||
      header.blocks() - 1 > header.groups)
    return damaged("header: nodes and pointers don't fit the file's length");
  if (header.levels == 0 || header.levels > kMaxLevels || (header.levels > 1) != (inner > 0) ||
      header.levels - 1 > inner)
    return damaged("header: the number of levels cannot be");
  const glm::vec3& c = header.root.center;
  if (!std::isfinite(c.x) || !std::isfinite(c.y) || !std::isfinite(c.z) || !std::isfinite(header.root.radius) ||
      header.root.radius <= 0.0F)
    return damaged("header: the root is no sphere");
  return {};
}

// Checks the lengths of a coded file.
base::Result<void> checkCoded(const Header& header) {
  if (header.coded_bytes % kBlockBytes != 0 || header.coded_bytes < header.header_bytes + kMinCodedBytes)
    return damaged("header: the file's length cannot be");
  if (header.file_bytes >> 48 != 0 || header.coded_bytes >> 48 != 0)  // places have six bytes
    return damaged("header: the file's length cannot be");
  if (header.blocks() < 2 || header.blocks() - 1 > (header.coded_bytes - header.header_bytes) / kMinCodedBytes)
    return damaged("header: the blocks don't fit the file's length");
  if (header.first_block_bytes < kMinCodedBytes || header.first_block_bytes > kMaxCodedBytes ||
      header.first_block_bytes > header.coded_bytes - header.header_bytes)
    return damaged("header: the first block's length cannot be");
  return {};
}

// Returns the fields that both forms share.
base::Bytes commonFields(const Header& header, std::uint32_t version, std::uint32_t header_bytes) {
  base::ByteWriter out;
  out.write(kMagic);
  out.u32(version);
  out.u32(header_bytes);
  out.u64(header.storedBytes());
  base::writeFields(out, std::tie(header.nodes, header.leaves, header.groups, header.pointers));
  out.u32((header.colors ? kHasColors : 0U) | (header.wide_pointers ? kWidePointers : 0U));
  base::writeFields(out, std::tie(header.levels, header.root));
  return out.takeBytes();
}

base::Bytes withChecksum(base::Bytes bytes) {
  const auto crc = base::bitCast<std::array<std::uint8_t, 4>>(base::crc32c(bytes));
  bytes.insert(bytes.end(), crc.begin(), crc.end());
  return bytes;
}

}  // namespace

bool allZero(base::ByteView bytes) {
  return std::all_of(bytes.begin(), bytes.end(), [](std::uint8_t b) { return b == 0; });
}

base::Error damaged(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, problem + "; copy or build the file again"};
}

base::Result<Header> readHeader(base::ByteView front) {
  // Is this a qsplat.lgq of a version that this program reads?
  base::ByteReader in(front);
  if (in.read<std::array<char, 8>>() != kMagic || !in.ok()) return damaged("not a qsplat.lgq");
  const std::uint32_t version = in.u32();
  if (in.ok() && version != kPlainVersion && version != kCodedVersion)
    return base::Error{base::ErrorCode::kVersion, "format version " + std::to_string(version) +
                                                      ", this program reads 1 and 2; use a newer program or build the "
                                                      "scene again"};
  const bool coded = version == kCodedVersion;
  const std::uint32_t header_bytes = in.u32();
  if (!in.ok()) return damaged("header: cut short");
  if (coded ? header_bytes <= codedHeaderLength(0) || header_bytes > kMaxCodedHeaderBytes : header_bytes != kBlockBytes)
    return damaged("header: says that it has " + std::to_string(header_bytes) + " bytes" +
                   (coded ? "" : " instead of 1024"));
  if (front.size() < header_bytes) return damaged("header: cut short");
  const std::size_t checked = header_bytes - sizeof(std::uint32_t);
  if (checksumAt(front.data() + checked) != base::crc32c(front.first(checked)))
    return damaged("header: checksum does not match");

  Header header;
  header.header_bytes = header_bytes;
  (coded ? header.coded_bytes : header.file_bytes) = in.u64();
  base::readFields(in, std::tie(header.nodes, header.leaves, header.groups, header.pointers));
  const std::uint32_t flags = in.u32();
  header.colors = (flags & kHasColors) != 0;
  header.wide_pointers = (flags & kWidePointers) != 0;
  base::readFields(in, std::tie(header.levels, header.root));
  if (coded) {
    base::readFields(in, std::tie(header.file_bytes, header.first_block_bytes));
    LUMIGRID_TRY(checkCoded(header));
  } else if (!allZero(front.subspan(kFieldsEnd, kPayloadBytes - kFieldsEnd))) {
    return damaged("header: bytes that are to be zero are not");
  }
  LUMIGRID_TRY(checkHeader(header, flags));
  return header;
}

base::Bytes headerBytes(const Header& header) {
  base::Bytes bytes = commonFields(header, kPlainVersion, kBlockBytes);
  bytes.resize(kPayloadBytes, 0);
  return withChecksum(std::move(bytes));
}

base::Bytes codedHeaderBytes(const Header& header, base::ByteView tables) {
  base::Bytes bytes = commonFields(header, kCodedVersion, codedHeaderLength(tables.size()));
  base::ByteWriter more;
  base::writeFields(more, std::tie(header.file_bytes, header.first_block_bytes));
  bytes.insert(bytes.end(), more.view().begin(), more.view().end());
  bytes.insert(bytes.end(), tables.begin(), tables.end());
  return withChecksum(std::move(bytes));
}

bool isIntactBlock(base::ByteView block, std::uint32_t number) {
  return block.size() == kBlockBytes && checksumAt(block.data() + kPayloadBytes) == blockChecksum(block.data(), number);
}

void sealBlock(std::uint8_t* block, std::uint32_t number) {
  const std::uint32_t crc = blockChecksum(block, number);
  std::memcpy(block + kPayloadBytes, &crc, sizeof(crc));
}

const char* groupFault(const std::uint8_t* block, std::uint64_t offset, std::uint32_t nodes, bool has_pointer,
                       const Header& header) {
  const GroupLayout layout(header);
  const std::uint64_t within = offset % kBlockBytes;
  if (within + layout.bytes(nodes, has_pointer) > kPayloadBytes) return "leaves its block";
  const std::uint8_t* group = block + within;
  std::uint32_t first_child_bytes = 0;
  for (std::uint32_t i = 0; i < nodes; ++i) {
    const Node node = readNode(group, i, layout);
    if (has_pointer ? !node.valid() : !node.hasCodes()) return "a node's code is none";
    if (has_pointer && !node.isLeaf() && first_child_bytes == 0) first_child_bytes = layout.childBytes(node);
  }
  if (!has_pointer) return nullptr;
  if (first_child_bytes == 0) return "has a pointer but no children";
  const std::uint64_t target = readPointer(group, nodes, layout);
  if (target <= offset || target >= header.file_bytes) return "points back or beyond the file";
  if (groupPlace(target, first_child_bytes) != target) return "points to where no group fits";
  return nullptr;
}

}  // namespace lod::qsplat
