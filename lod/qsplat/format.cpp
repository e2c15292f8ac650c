#include "lod/qsplat/format.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/crc32c.h"

namespace lod::qsplat {
namespace {

constexpr std::array<char, 8> kMagic{'L', 'G', 'Q', 'S', 'P', 'L', 'T', '\n'};
constexpr std::uint32_t kVersion = 1;
constexpr std::uint32_t kHasColors = 1;
constexpr std::uint32_t kWidePointers = 2;
constexpr std::size_t kFieldsEnd = 80;  // zeros from here to the checksum

bool allZero(base::ByteView bytes) {
  return std::all_of(bytes.begin(), bytes.end(), [](std::uint8_t b) { return b == 0; });
}

std::uint32_t checksumAt(const std::uint8_t* at) {
  std::uint32_t crc = 0;
  std::memcpy(&crc, at, sizeof(crc));
  return crc;
}

std::uint32_t blockChecksum(const std::uint8_t* block, std::uint32_t number) {
  const auto place = base::bitCast<std::array<std::uint8_t, 4>>(number);
  return base::crc32c(base::ByteView(block, kPayloadBytes), base::crc32c(place));
}

// Whether a tree with these counts can be, and can lie in so many bytes.
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
  if (header.nodes - 1 < 2 * inner || header.nodes - 1 > kMostChildren * inner)
    return damaged("header: nodes, leaves and groups don't make a tree");
  if (header.pointers > inner || (inner > 0) != (header.pointers > 0))
    return damaged("header: the number of pointers cannot be");
  if (header.nodes * header.nodeBytes() + header.pointers * header.pointerBytes() > payload ||
      header.blocks() - 1 > header.groups)
    return damaged("header: nodes and pointers don't fit the file's length");
  if (header.levels == 0 || header.levels > kMostLevels || (header.levels > 1) != (inner > 0) ||
      header.levels - 1 > inner)
    return damaged("header: the number of levels cannot be");
  const glm::vec3& c = header.root.center;
  if (!std::isfinite(c.x) || !std::isfinite(c.y) || !std::isfinite(c.z) || !std::isfinite(header.root.radius) ||
      header.root.radius <= 0.0F)
    return damaged("header: the root is no sphere");
  return {};
}

}  // namespace

base::Error damaged(const std::string& what) {
  return {base::ErrorCode::kInvalidInput, what + "; copy or build the file again"};
}

base::Result<Header> readHeader(base::ByteView front) {
  // What is this, and can this program read it?
  base::ByteReader in(front);
  if (in.read<std::array<char, 8>>() != kMagic || !in.ok()) return damaged("not a qsplat.lgq");
  const std::uint32_t version = in.u32();
  if (in.ok() && version != kVersion)
    return base::Error{base::ErrorCode::kVersion, "format version " + std::to_string(version) +
                                                      ", this program reads " + std::to_string(kVersion) +
                                                      "; use a newer program or build the scene again"};
  const std::uint32_t header_bytes = in.u32();
  if (!in.ok() || front.size() < kBlockBytes) return damaged("header: cut short");
  if (header_bytes != kBlockBytes)
    return damaged("header: says that it has " + std::to_string(header_bytes) + " bytes instead of 1024");
  if (checksumAt(front.data() + kPayloadBytes) != base::crc32c(front.first(kPayloadBytes)))
    return damaged("header: checksum does not match");

  Header header;
  header.file_bytes = in.u64();
  header.nodes = in.u64();
  header.leaves = in.u64();
  header.groups = in.u64();
  header.pointers = in.u64();
  const std::uint32_t flags = in.u32();
  header.colors = (flags & kHasColors) != 0;
  header.wide_pointers = (flags & kWidePointers) != 0;
  header.levels = in.u32();
  header.root.center = in.read<glm::vec3>();
  header.root.radius = in.f32();
  if (!allZero(front.subspan(kFieldsEnd, kPayloadBytes - kFieldsEnd)))
    return damaged("header: bytes that are to be zero are not");
  LUMIGRID_TRY(checkHeader(header, flags));
  return header;
}

base::Bytes headerBytes(const Header& header) {
  base::ByteWriter out;
  out.write(kMagic);
  out.u32(kVersion);
  out.u32(kBlockBytes);
  out.u64(header.file_bytes);
  out.u64(header.nodes);
  out.u64(header.leaves);
  out.u64(header.groups);
  out.u64(header.pointers);
  out.u32((header.colors ? kHasColors : 0U) | (header.wide_pointers ? kWidePointers : 0U));
  out.u32(header.levels);
  out.write(header.root.center);
  out.f32(header.root.radius);
  base::Bytes bytes = out.take();
  bytes.resize(kPayloadBytes, 0);
  const auto crc = base::bitCast<std::array<std::uint8_t, 4>>(base::crc32c(bytes));
  bytes.insert(bytes.end(), crc.begin(), crc.end());
  return bytes;
}

bool isBlock(base::ByteView block, std::uint32_t number) {
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
    if (!node.valid()) return "a node's code is none";
    if (!node.isLeaf() && first_child_bytes == 0) first_child_bytes = layout.childBytes(node);
  }
  if (has_pointer != (first_child_bytes != 0))
    return has_pointer ? "has a pointer but no children" : "has children but no pointer";
  if (!has_pointer) return nullptr;
  const std::uint64_t target = readPointer(group, nodes, layout);
  if (target <= offset || target >= header.file_bytes) return "points back or beyond the file";
  if (groupPlace(target, first_child_bytes) != target) return "points to where no group fits";
  return nullptr;
}

namespace {

// One walk of checkTree: groups in the file's order; what is expected of the next level's is known from their parents.
class TreeChecker {
 public:
  TreeChecker(base::ByteView file, const Header& header) : file_(file), header_(header), layout_(header) {}

  std::vector<std::string> run() {
    checkBlocks();
    if (faults_.empty()) walk();
    return std::move(faults_);
  }

 private:
  static constexpr std::size_t kMostFaults = 10;
  // A group's nodes, and bit 3 where it has a pointer.
  static constexpr std::uint8_t kPointerBit = 8;

  void fault(const std::string& text) {
    if (faults_.size() < kMostFaults) faults_.push_back(text);
  }

  void checkBlocks() {
    for (std::uint64_t b = 1; b < header_.blocks(); ++b)
      if (!isBlock(file_.subspan(static_cast<std::size_t>(b * kBlockBytes), kBlockBytes),
                   static_cast<std::uint32_t>(b)))
        fault("block " + std::to_string(b) + ": checksum does not match; copy or build the file again");
  }

  void walk() {
    std::vector<std::uint8_t> level{static_cast<std::uint8_t>(1 | (header_.nodes > 1 ? kPointerBit : 0))};
    laid_out_ = kBlockBytes + layout_.bytes(1, header_.nodes > 1);
    while (!level.empty()) {
      if (++levels_ > kMostLevels) return fault("more than 128 levels; build the file again");
      next_.clear();
      for (const std::uint8_t expected : level)
        if (!checkGroup(expected & (kPointerBit - 1), (expected & kPointerBit) != 0)) return;
      std::swap(level, next_);
    }
    checkEnd();
  }

  // False when nothing behind it can be trusted.
  bool checkGroup(std::uint32_t nodes, bool has_pointer) {
    const std::uint32_t bytes = layout_.bytes(nodes, has_pointer);
    const std::uint64_t offset = groupPlace(end_, bytes);
    const std::string place = "group " + std::to_string(groups_) + " at byte " + std::to_string(offset) + ": ";
    if (offset >= header_.file_bytes) return fault(place + "the file ends before it; build it again"), false;
    checkZeros(end_, offset);
    end_ = offset + bytes;
    ++groups_;
    const std::uint8_t* block = file_.data() + (offset - offset % kBlockBytes);
    if (const char* wrong = groupFault(block, offset, nodes, has_pointer, header_))
      return fault(place + wrong + "; build the file again"), false;

    const std::uint8_t* group = file_.data() + offset;
    bool first = true;
    for (std::uint32_t i = 0; i < nodes; ++i) {
      const Node node = readNode(group, i, layout_);
      ++nodes_;
      if (i == 0 && groups_ == 1 && node.sphereCode() != kWholeParent)
        fault(place + "the root's sphere is not the header's; build the file again");
      if (node.isLeaf()) {
        ++leaves_;
        continue;
      }
      const std::uint32_t child_bytes = layout_.childBytes(node);
      const std::uint64_t child = groupPlace(laid_out_, child_bytes);
      if (first && readPointer(group, nodes, layout_) != child)
        return fault(place + "does not point to its children; build the file again"), false;
      first = false;
      laid_out_ = child + child_bytes;
      next_.push_back(static_cast<std::uint8_t>(node.children() | (node.childrenAreLeaves() ? 0 : kPointerBit)));
    }
    pointers_ += has_pointer ? 1 : 0;
    return true;
  }

  // Between two groups, but for the checksum.
  void checkZeros(std::uint64_t from, std::uint64_t to) {
    if (from == to) return;
    const std::uint64_t payload_end = from - from % kBlockBytes + kPayloadBytes;
    if (from < payload_end &&
        !allZero(file_.subspan(static_cast<std::size_t>(from), static_cast<std::size_t>(payload_end - from))))
      fault("block " + std::to_string(from / kBlockBytes) + ": something stands behind its groups");
  }

  void checkEnd() {
    const std::uint64_t file_end = (end_ + kBlockBytes - 1) / kBlockBytes * kBlockBytes;
    checkZeros(end_, file_end);
    if (file_end != header_.file_bytes) fault("the file goes on behind its last group");
    const auto compare = [this](const char* what, std::uint64_t found, std::uint64_t said) {
      if (found != said)
        fault("header: " + std::to_string(said) + " " + what + ", the file has " + std::to_string(found));
    };
    compare("nodes", nodes_, header_.nodes);
    compare("leaves", leaves_, header_.leaves);
    compare("groups", groups_, header_.groups);
    compare("pointers", pointers_, header_.pointers);
    compare("levels", levels_, header_.levels);
  }

  base::ByteView file_;
  const Header& header_;
  const GroupLayout layout_;
  std::vector<std::string> faults_;
  std::vector<std::uint8_t> next_;        // of the next level, its groups
  std::uint64_t end_ = kBlockBytes;       // of the group before
  std::uint64_t laid_out_ = kBlockBytes;  // where the groups known so far end
  std::uint64_t nodes_ = 0, leaves_ = 0, groups_ = 0, pointers_ = 0;
  std::uint32_t levels_ = 0;
};

}  // namespace

std::vector<std::string> checkTree(base::ByteView file) {
  const auto header = readHeader(file);
  if (!header) return {header.error().message};
  if (header->file_bytes != file.size())
    return {"has " + std::to_string(file.size()) + " bytes, its header says " + std::to_string(header->file_bytes)};
  return TreeChecker(file, *header).run();
}

}  // namespace lod::qsplat
