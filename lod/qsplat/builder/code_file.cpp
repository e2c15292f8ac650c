#include "lod/qsplat/builder/code_file.h"

#include <algorithm>
#include <memory>
#include <mutex>
#include <utility>
#include <vector>

#include "base/parallel.h"
#include "lod/qsplat/coded_block.h"

namespace lod::qsplat::builder {
namespace {

// Blocks in memory at a time: enough work for many threads, and a megabyte.
constexpr std::uint64_t kBatch = 1024;
constexpr std::size_t kShare = 64;  // blocks that a thread takes of a batch at a time

/// The groups of a block.
struct BlockShape {
  std::uint64_t number = 0;
  std::vector<GroupShape> groups;
  std::uint64_t first_child = 0, last_child = 0;  ///< offsets of the first and the last group of children; 0 without
};

/// Gives the blocks' shapes from the first to the last. The shapes of a level's groups are known from their parents.
class ShapeWalk {
 public:
  explicit ShapeWalk(const Header& header)
      : layout_(header),
        children_(layout_, kBlockBytes + layout_.bytes(1, header.nodes > 1)),
        level_{{1, header.nodes > 1}} {}
  /// `plain` is the next block's bytes.
  BlockShape next(const std::uint8_t* plain) {
    BlockShape shape;
    shape.number = number_++;
    while (const GroupShape* group = expected()) {
      const std::uint64_t place = groupPlace(end_, layout_.bytes(group->nodes, group->has_pointer));
      if (place / kBlockBytes != shape.number) break;
      shape.groups.push_back(*group);
      addChildren(plain + place % kBlockBytes, *group, shape);
      end_ = place + layout_.bytes(group->nodes, group->has_pointer);
      ++at_;
    }
    return shape;
  }

 private:
  const GroupShape* expected() {
    if (at_ == level_.size()) {
      std::swap(level_, next_level_);
      next_level_.clear();
      at_ = 0;
    }
    return at_ < level_.size() ? &level_[at_] : nullptr;
  }

  void addChildren(const std::uint8_t* bytes, const GroupShape& group, BlockShape& shape) {
    for (std::uint32_t i = 0; group.has_pointer && i < group.nodes; ++i) {
      const Node node = readNode(bytes, i, layout_);
      if (node.isLeaf()) continue;
      shape.last_child = children_.place(layout_.childBytes(node));
      if (shape.first_child == 0) shape.first_child = shape.last_child;
      next_level_.push_back({static_cast<std::uint8_t>(node.children()), !node.childrenAreLeaves()});
    }
  }

  const GroupLayout layout_;
  ChildLayout children_;
  std::uint64_t number_ = 1;
  std::uint64_t end_ = kBlockBytes;  // where the group before ends
  std::vector<GroupShape> level_, next_level_;
  std::size_t at_ = 0;  // place in level_
};

class FileCoder {
 public:
  FileCoder(const ReadPlain& read, const WriteCoded& write, unsigned threads,
            const std::function<bool(double done)>& progress)
      : read_(read), write_(write), threads_(threads), progress_(progress) {}

  base::Result<Header> run() {
    base::Bytes front(kBlockBytes);
    LUMIGRID_TRY(read_(0, front));
    LUMIGRID_ASSIGN_OR_RETURN(header_, readHeader(front));
    if (header_.file_bytes >> 48 != 0)
      return base::Error{base::ErrorCode::kUnsupported,
                         "a tree of more than 256 TiB is not coded; leave --qsplat-coded out"};

    SymbolLevels levels;
    LUMIGRID_TRY(countAll(levels));
    const base::Bytes tables = packLevels(levels, header_.colors);
    header_.header_bytes = codedHeaderLength(tables.size());

    // Blocks are encoded twice, since a block holds the lengths of later blocks. Its own length does not depend on
    // them.
    const BlockCoder coder(header_, levels);
    lengths_.assign(1, 0);
    LUMIGRID_TRY(forEachBatch([&](const std::vector<BlockShape>& batch) -> base::Result<void> {
      for (const base::Bytes& coded : encode(coder, batch, [](const BlockShape& shape) { return unplaced(shape); }))
        lengths_.push_back(static_cast<std::uint16_t>(coded.size()));
      return {};
    }));
    return writeAll(coder, tables);
  }

 private:
  static ChildBlocks unplaced(const BlockShape& shape) {
    ChildBlocks children;
    if (shape.first_child == 0) return children;
    children.first_group = shape.first_child;
    children.count = static_cast<std::uint32_t>(shape.last_child / kBlockBytes - shape.first_child / kBlockBytes + 1);
    return children;
  }

  base::Result<void> countAll(SymbolLevels& levels) {
    auto sums = std::make_unique<SymbolCounts>();
    for (auto& context : *sums) context.fill(0);
    std::mutex mutex;
    LUMIGRID_TRY(forEachBatch([&](const std::vector<BlockShape>& batch) -> base::Result<void> {
      forEachShare(batch.size(), [&](std::size_t begin, std::size_t end) {
        auto counts = std::make_unique<SymbolCounts>();
        for (auto& context : *counts) context.fill(0);
        for (std::size_t i = begin; i < end; ++i)
          countSymbols(blockAt(batch[i].number), batch[i].groups, header_, *counts);
        const std::lock_guard lock(mutex);
        for (std::size_t c = 0; c < counts->size(); ++c)
          for (std::size_t s = 0; s < (*counts)[c].size(); ++s) (*sums)[c][s] += (*counts)[c][s];
      });
      return {};
    }));
    levelsFrom(*sums, levels);
    flattenRarest(*sums, header_.colors, kMaxCodedHeaderBytes - codedHeaderLength(0), levels);
    return {};
  }

  base::Result<Header> writeAll(const BlockCoder& coder, base::ByteView tables) {
    std::uint64_t end = header_.header_bytes;
    for (const std::uint16_t length : lengths_) end += length;
    header_.coded_bytes = (end + kBlockBytes - 1) / kBlockBytes * kBlockBytes;
    header_.first_block_bytes = lengths_[1];
    LUMIGRID_TRY(write_(codedHeaderBytes(header_, tables)));

    // The children of a block begin in the block where those of the block before it ended, or in the next.
    std::uint64_t known = 1, known_at = header_.header_bytes;
    LUMIGRID_TRY(forEachBatch([&](const std::vector<BlockShape>& batch) -> base::Result<void> {
      std::vector<ChildBlocks> placed;
      for (const BlockShape& shape : batch) {
        ChildBlocks children = unplaced(shape);
        for (; children.count > 0 && known < children.firstBlock(); ++known) known_at += lengths_[known];
        children.offset = children.count > 0 ? known_at : 0;
        for (std::uint32_t k = 0; k < children.count; ++k) children.bytes[k] = lengths_[children.firstBlock() + k];
        placed.push_back(children);
      }
      base::Bytes piece;
      for (const base::Bytes& coded :
           encode(coder, batch, [&](const BlockShape& shape) { return placed[shape.number - batch[0].number]; }))
        piece.insert(piece.end(), coded.begin(), coded.end());
      return write_(piece);
    }));
    LUMIGRID_TRY(write_(base::Bytes(static_cast<std::size_t>(header_.coded_bytes - end), 0)));
    return header_;
  }

  template <class ChildrenOf>
  std::vector<base::Bytes> encode(const BlockCoder& coder, const std::vector<BlockShape>& batch,
                                  const ChildrenOf& children_of) const {
    std::vector<base::Bytes> coded(batch.size());
    forEachShare(batch.size(), [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i)
        coded[i] = coder.encode(blockAt(batch[i].number), batch[i].groups, children_of(batch[i]));
    });
    return coded;
  }

  const std::uint8_t* blockAt(std::uint64_t number) const {
    return &batch_bytes_[(number - batch_first_) * kBlockBytes];
  }

  void forEachShare(std::size_t count, const std::function<void(std::size_t begin, std::size_t end)>& body) const {
    base::parallelFor((count + kShare - 1) / kShare, threads_,
                      [&](std::size_t share) { body(share * kShare, std::min(count, (share + 1) * kShare)); });
  }

  base::Result<void> forEachBatch(const std::function<base::Result<void>(const std::vector<BlockShape>&)>& body) {
    ShapeWalk walk(header_);
    std::vector<BlockShape> batch;
    for (batch_first_ = 1; batch_first_ < header_.blocks(); batch_first_ += batch.size()) {
      batch_bytes_.resize(static_cast<std::size_t>(std::min(kBatch, header_.blocks() - batch_first_) * kBlockBytes));
      LUMIGRID_TRY(read_(batch_first_ * kBlockBytes, batch_bytes_));
      batch.clear();
      for (std::size_t at = 0; at < batch_bytes_.size(); at += kBlockBytes)
        batch.push_back(walk.next(&batch_bytes_[at]));
      LUMIGRID_TRY(body(batch));
      done_ += batch.size();
      if (progress_ && !progress_(static_cast<double>(done_) / (kPasses * static_cast<double>(header_.blocks()))))
        return base::Error{base::ErrorCode::kCancelled, "coding the splat tree was cancelled"};
    }
    return {};
  }

  static constexpr double kPasses = 3.0;  // over all blocks; each counts a third of the progress
  const ReadPlain& read_;
  const WriteCoded& write_;
  const unsigned threads_;
  const std::function<bool(double done)>& progress_;
  Header header_;
  std::uint64_t batch_first_ = 1;       // the number of the batch's first block
  base::Bytes batch_bytes_;             // the batch's blocks
  std::vector<std::uint16_t> lengths_;  // lengths of coded blocks, by number
  std::uint64_t done_ = 0;              // blocks, summed over the passes
};

}  // namespace

base::Result<Header> codeFile(const ReadPlain& read, const WriteCoded& write, unsigned threads,
                              const std::function<bool(double done)>& progress) {
  return FileCoder(read, write, threads, progress).run();
}

}  // namespace lod::qsplat::builder
