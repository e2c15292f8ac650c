// Implements checkTree of format.h.
#include <algorithm>
#include <array>
#include <deque>

#include "lod/file_bytes.h"
#include "lod/qsplat/coded_block.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat {
namespace {

/// Reads the blocks of a file in order, from block 1 on; asking for an earlier block starts over.
class BlockSource {
 public:
  virtual ~BlockSource() = default;
  /// Returns kBlockBytes that are valid until the next call; null for a damaged block.
  virtual const std::uint8_t* block(std::uint64_t number) = 0;
  /// Whether the block's place is known.
  virtual bool knowsPlace(std::uint64_t) { return true; }
  /// Called after the last block: returns what is wrong with the file apart from its blocks, in one line, or nothing.
  virtual std::string fault() { return ""; }
};

class PlainSource final : public BlockSource {
 public:
  explicit PlainSource(const FileBytes& file) : file_(file) {}
  const std::uint8_t* block(std::uint64_t number) override {
    const bool is_read = file_.read(number * kBlockBytes, block_);
    return is_read && isIntactBlock(block_, static_cast<std::uint32_t>(number)) ? block_.data() : nullptr;
  }

 private:
  const FileBytes& file_;
  std::array<std::uint8_t, kBlockBytes> block_{};
};

/// Decodes coded blocks. Checks that they follow each other without gaps where their parents say they are, and that
/// only zeros follow the last one.
class CodedSource final : public BlockSource {
 public:
  CodedSource(const FileBytes& file, const Header& header, const BlockCoder& coder)
      : file_(file), header_(header), coder_(coder) {
    restart();
  }

  const std::uint8_t* block(std::uint64_t number) override {
    if (number < number_) restart();
    while (number_ < number)
      if (!decodeNext()) return nullptr;
    return plain_.data();
  }
  bool knowsPlace(std::uint64_t number) override { return number <= known_; }

  std::string fault() override {
    if (!fault_.empty()) return fault_;
    const std::uint64_t end = (known_end_ + kBlockBytes - 1) / kBlockBytes * kBlockBytes;
    const char* const wrong = "something stands behind its last block";
    if (end != header_.coded_bytes) return wrong;
    base::Bytes rest(static_cast<std::size_t>(end - known_end_));
    return file_.read(known_end_, rest) && allZero(rest) ? "" : wrong;
  }

 private:
  void restart() {
    number_ = 0;
    known_ = 1;
    lengths_.assign(1, header_.first_block_bytes);
    at_ = header_.header_bytes;
    known_end_ = at_ + header_.first_block_bytes;
  }

  bool decodeNext() {
    if (lengths_.empty()) return false;
    const std::uint32_t length = lengths_.front();
    ChildBlocks children;
    ++number_;
    const std::uint64_t at = at_;
    coded_.resize(length);
    const bool good = file_.read(at, coded_) && coder_.decode(number_, coded_, plain_.data(), children);
    if (good)
      forEachChildBlock(children, [this](std::uint64_t child, const CodedPlace& place) { addPlace(child, place); });
    lengths_.pop_front();
    at_ += length;
    return good;
  }

  // Adds the place that a parent states for a child block, or compares it with the one that is known.
  void addPlace(std::uint64_t child, const CodedPlace& place) {
    if (child == known_ + 1 && place.offset == known_end_ && place.bytes <= header_.coded_bytes - known_end_) {
      lengths_.push_back(place.bytes);
      ++known_;
      known_end_ += place.bytes;
      return;
    }
    // Known before: mostly the block in which the children of one block end and those of the next begin.
    std::uint64_t offset = known_end_;
    for (std::uint64_t b = known_; child <= known_ && b >= child; --b) offset -= lengths_[b - number_];
    if (child > known_ || place != CodedPlace{offset, lengths_[child - number_]})
      fault_ = "block " + std::to_string(number_) + " says of block " + std::to_string(child) +
               " that it is where it is not";
  }

  const FileBytes& file_;
  const Header& header_;
  const BlockCoder& coder_;
  base::Bytes coded_;
  std::array<std::uint8_t, kBlockBytes> plain_{};
  std::uint64_t number_ = 0;           // number of the block in plain_
  std::uint64_t known_ = 0;            // the last block whose place is known
  std::deque<std::uint32_t> lengths_;  // lengths of blocks number_ + 1 … known_; the first begins at at_
  std::uint64_t at_ = 0, known_end_ = 0;
  std::string fault_;
};

// Walks the groups in the file's order; the shapes of the next level's groups are known from their parents.
class TreeChecker {
 public:
  TreeChecker(BlockSource& source, const Header& header)
      : source_(source),
        header_(header),
        layout_(header),
        children_(layout_, kBlockBytes + layout_.bytes(1, header.nodes > 1)) {}

  std::vector<std::string> run() {
    checkBlocks();
    if (faults_.empty()) walk();
    return std::move(faults_);
  }

 private:
  static constexpr std::size_t kMaxFaults = 10;
  // A group's shape: its number of nodes, and this bit where it has a pointer.
  static constexpr std::uint8_t kPointerBit = 8;

  void fault(const std::string& text) {
    if (faults_.size() < kMaxFaults) faults_.push_back(text);
  }

  void checkBlocks() {
    for (std::uint64_t b = 1; b < header_.blocks(); ++b) {
      if (!source_.knowsPlace(b))
        return fault("block " + std::to_string(b) + ": nothing tells where it is; build it again");
      if (source_.block(b) == nullptr)
        fault("block " + std::to_string(b) + ": checksum does not match; copy or build the file again");
    }
    if (const std::string wrong = source_.fault(); !wrong.empty()) fault(wrong + "; build the file again");
  }

  void walk() {
    std::vector<std::uint8_t> level{static_cast<std::uint8_t>(1 | (header_.nodes > 1 ? kPointerBit : 0))};
    while (!level.empty()) {
      if (++levels_ > kMaxLevels) return fault("more than 128 levels; build the file again");
      next_.clear();
      for (const std::uint8_t expected : level)
        if (!checkGroup(expected & (kPointerBit - 1), (expected & kPointerBit) != 0)) return;
      std::swap(level, next_);
    }
    checkEnd();
  }

  // Checks a group; false when the groups after it cannot be located.
  bool checkGroup(std::uint32_t nodes, bool has_pointer) {
    const std::uint32_t bytes = layout_.bytes(nodes, has_pointer);
    const std::uint64_t offset = groupPlace(end_, bytes);
    const std::string place = "group " + std::to_string(groups_) + " at byte " + std::to_string(offset) + ": ";
    if (offset >= header_.file_bytes) return fault(place + "the file ends before it; build it again"), false;
    checkZeros(end_, offset);
    end_ = offset + bytes;
    ++groups_;
    if (block_ == nullptr || offset / kBlockBytes != number_) block_ = source_.block(number_ = offset / kBlockBytes);
    if (block_ == nullptr) return fault(place + "its block is gone; copy the file again"), false;
    if (const char* wrong = groupFault(block_, offset, nodes, has_pointer, header_))
      return fault(place + wrong + "; build the file again"), false;

    const std::uint8_t* group = block_ + offset % kBlockBytes;
    bool first = true;
    for (std::uint32_t i = 0; i < nodes; ++i) {
      const Node node = readNode(group, i, layout_);
      ++nodes_;
      if (i == 0 && groups_ == 1 && node.sphereCode() != kWholeParent)
        fault(place + "the root's sphere is not the header's; build the file again");
      if (!has_pointer || node.isLeaf()) {
        ++leaves_;
        continue;
      }
      const std::uint64_t child = children_.place(layout_.childBytes(node));
      if (first && readPointer(group, nodes, layout_) != child)
        return fault(place + "does not point to its children; build the file again"), false;
      first = false;
      next_.push_back(static_cast<std::uint8_t>(node.children() | (node.childrenAreLeaves() ? 0 : kPointerBit)));
    }
    pointers_ += has_pointer ? 1 : 0;
    return true;
  }

  // Checks the bytes between two groups, apart from checksums; `from` lies in the block of the last group or at its
  // end.
  void checkZeros(std::uint64_t from, std::uint64_t to) {
    const std::uint64_t within = from % kBlockBytes;
    if (from == to || block_ == nullptr || within == 0) return;
    if (within < kPayloadBytes && !allZero({block_ + within, static_cast<std::size_t>(kPayloadBytes - within)}))
      fault("block " + std::to_string(from / kBlockBytes) + ": something stands behind its groups");
  }

  void checkEnd() {
    const std::uint64_t file_end = (end_ + kBlockBytes - 1) / kBlockBytes * kBlockBytes;
    checkZeros(end_, file_end);
    if (file_end != header_.file_bytes) fault("the file goes on behind its last group");
    const auto compare = [this](const char* items, std::uint64_t found, std::uint64_t said) {
      if (found != said)
        fault("header: " + std::to_string(said) + " " + items + ", the file has " + std::to_string(found));
    };
    compare("nodes", nodes_, header_.nodes);
    compare("leaves", leaves_, header_.leaves);
    compare("groups", groups_, header_.groups);
    compare("pointers", pointers_, header_.pointers);
    compare("levels", levels_, header_.levels);
  }

  BlockSource& source_;
  const Header& header_;
  const GroupLayout layout_;
  const std::uint8_t* block_ = nullptr;  // the block of the last group
  std::uint64_t number_ = 0;             // its number
  std::vector<std::string> faults_;
  std::vector<std::uint8_t> next_;   // shapes of the next level's groups
  std::uint64_t end_ = kBlockBytes;  // end of the last group
  ChildLayout children_;             // the groups whose shapes are known so far
  std::uint64_t nodes_ = 0, leaves_ = 0, groups_ = 0, pointers_ = 0;
  std::uint32_t levels_ = 0;
};

}  // namespace

base::Bytes readFront(const FileBytes& file) {
  base::Bytes front(static_cast<std::size_t>(std::min<std::uint64_t>(file.size(), kMaxCodedHeaderBytes)));
  if (!file.read(0, front)) front.clear();
  return front;
}

std::vector<std::string> checkTree(base::ByteView file) {
  return checkTree(MemoryBytes(file));
}

std::vector<std::string> checkTree(const FileBytes& file) {
  const base::Bytes front = readFront(file);
  const auto header = readHeader(front);
  if (!header) return {header.error().message};
  if (header->storedBytes() != file.size())
    return {"has " + std::to_string(file.size()) + " bytes, its header says " + std::to_string(header->storedBytes())};
  if (!header->coded()) {
    PlainSource source(file);
    return TreeChecker(source, *header).run();
  }
  const auto coder = BlockCoder::fromHeader(front, *header);
  if (!coder) return {coder.error().message};
  CodedSource source(file, *header, *coder);
  return TreeChecker(source, *header).run();
}

}  // namespace lod::qsplat
