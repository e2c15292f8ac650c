#pragma once
// The built leaves on disk, and the file that is made of them.
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "lod/ingest/record_log.h"
#include "lod/pmr/builder/block.h"

namespace lod::pmr::builder {

/// The leaves of all blocks on disk, which is also the journal of the blocks that are done.
class LeafStore {
 public:
  /// Creates `path`, or with `resume` reads and continues it. Errors: kNoSpace, kIo.
  static base::Result<LeafStore> open(const std::string& path, bool resume, const std::vector<CellBlock>& blocks);
  bool has(std::size_t block) const { return !leaves_[block].empty(); }
  /// Safe from several threads. Errors: kNoSpace, kIo.
  base::Result<void> add(std::uint32_t block, std::span<const BuiltLeaf> leaves);
  std::uint64_t bytes() const { return log_.size(); }

  /// A leaf as it is kept in memory.
  struct StoredLeaf {
    Leaf leaf;
    std::uint64_t unused = 0;  ///< as in BuiltLeaf
    std::uint64_t offset = 0;  ///< of its chunks in the store
  };
  /// All leaves in order, once all blocks are there.
  std::vector<StoredLeaf> leaves() const;
  base::Result<void> readAt(std::uint64_t offset, std::span<std::uint8_t> out) const {
    return log_.readAt(offset, out);
  }

 private:
  bool keep(std::uint64_t offset, base::ByteView payload, const std::vector<CellBlock>& blocks);

  ingest::RecordLog log_;
  std::vector<std::vector<StoredLeaf>> leaves_;  // by block; each is written by the one thread that adds it
};

/// Writes the file at `path`; it appears whole or not at all. Of `header` colours, orientation and lattice are given.
/// `progress` gets the share done, and cancels by false. Errors: kNoSpace, kIo, kCancelled.
base::Result<Header> writeFile(const LeafStore& store, const std::vector<LeafStore::StoredLeaf>& leaves, Header header,
                               const std::string& path, const std::function<bool(double)>& progress);

}  // namespace lod::pmr::builder
