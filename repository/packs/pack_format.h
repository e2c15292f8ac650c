#pragma once
// The bytes of published repositories: index, its blocks, packs (docs/formats/packs.md). No input or output here, so
// that every reader, a browser's too, uses the same.
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "repository/sampling/key.h"

namespace repository {

/// What every reader reads first of an index: the root lies within.
inline constexpr std::uint64_t kIndexFrontBytes = 16384;
inline constexpr std::uint64_t kPackHeaderBytes = 64;
inline constexpr std::uint64_t kPackRowBytes = 48;
/// Readers take no larger pack into memory.
inline constexpr std::uint64_t kMaxPackBytes = std::uint64_t{128} << 20;
inline constexpr std::uint32_t kMaxValueBytes = std::uint32_t{64} << 20;

/// The first 16 bytes of an object's SHA-256.
using ObjectId = std::array<std::uint8_t, 16>;
/// "images/pack-<id>.lgk", "images/index-<id>.lgi".
std::string packName(const ObjectId& id);
std::string indexName(const ObjectId& id);
/// The id in the name of a pack or an index; nothing for another name.
std::optional<ObjectId> idOfPackName(const std::string& name);
std::optional<ObjectId> idOfIndexName(const std::string& name);

/// A key's code with the length of its value in a pack; 0: an empty flag, which has no bytes.
struct PackEntry {
  std::uint64_t code = 0;
  std::uint32_t length = 0;
  friend bool operator==(const PackEntry&, const PackEntry&) = default;
};

/// Faces of one cell of 2 × 2 × 2 points that lie side by side in a pack.
struct Run {
  std::uint64_t cell = 0;     ///< code >> 6
  std::uint64_t present = 0;  ///< bit (code & 63)
  std::uint32_t offset = 0;   ///< of the first value, in the pack
};

// --- Packs

/// A whole pack: header, `values` as they lie side by side, table. Entries in ascending order of codes, at least one;
/// their lengths add up to values.size().
base::Bytes encodePack(std::span<const PackEntry> entries, base::ByteView values);

/// A pack's entries with the place of each value.
struct PackTable {
  std::vector<PackEntry> entries;
  std::vector<std::uint32_t> offsets;
};
/// Checks everything but the values themselves.
base::Result<PackTable> decodePack(base::ByteView pack);

// --- The index

/// What the values add up to.
struct ValueTotals {
  std::uint64_t value_bytes = 0, jpeg_bytes = 0, coverage_bytes = 0;  ///< in packs
  friend bool operator==(const ValueTotals&, const ValueTotals&) = default;
};

struct IndexRoot {
  std::uint64_t object_bytes = 0;
  std::uint64_t keys = 0;   ///< empty flags among them
  std::uint64_t empty = 0;  ///< empty flags
  ValueTotals totals;
  std::uint64_t blocks = 0, blocks_offset = 0;
  std::uint64_t packs = 0;
  std::uint32_t block_bytes = 0;
  std::uint32_t hash_shift = 0;
  std::uint32_t parameter_bytes = 0, parameter_crc = 0;
  std::uint32_t rows_crc = 0;

  std::uint64_t blockOffset(std::uint64_t block) const { return blocks_offset + block * block_bytes; }
  std::uint64_t rowsOffset() const { return blockOffset(blocks); }
};
/// From the first kIndexFrontBytes of the index. The parameters lie at parameterOffset(), checked by checkParameters.
base::Result<IndexRoot> decodeIndexRoot(base::ByteView front);
constexpr std::uint64_t parameterOffset() {
  return 128;
}
base::Result<void> checkParameters(const IndexRoot& root, base::ByteView text);

/// Which block tells where a key lies.
std::uint64_t blockOfCode(const IndexRoot& root, std::uint64_t code);

struct FacePlace {
  ObjectId pack{};
  std::uint64_t offset = 0;
  std::uint32_t length = 0;  ///< 0: an empty flag; nothing to read
  friend bool operator==(const FacePlace&, const FacePlace&) = default;
};

/// A decoded block.
class IndexBlock {
 public:
  std::optional<FacePlace> find(std::uint64_t code) const;
  /// Memory taken, for caches.
  std::uint64_t bytes() const;
  std::uint64_t keys() const { return lengths_.size(); }
  std::uint64_t emptyFlags() const;
  std::uint64_t valueBytes() const;  ///< of its faces, in packs

 private:
  friend base::Result<IndexBlock> decodeIndexBlock(const IndexRoot& root, std::uint64_t number, base::ByteView block);
  struct Row {
    Run run;
    std::uint32_t pack = 0;
    std::uint32_t first_length = 0;
  };
  std::vector<ObjectId> packs_;
  std::vector<Row> rows_;  // ascending
  std::vector<std::uint32_t> lengths_;
};
base::Result<IndexBlock> decodeIndexBlock(const IndexRoot& root, std::uint64_t number, base::ByteView block);

struct PackRow {
  ObjectId id{};
  std::uint64_t bytes = 0, first_code = 0, last_code = 0, keys = 0;
  friend bool operator==(const PackRow&, const PackRow&) = default;
};
base::Result<std::vector<PackRow>> decodePackRows(const IndexRoot& root, base::ByteView rows);

/// Makes an index. Memory: 5 bytes a face, then the index itself.
class IndexBuilder {
 public:
  /// The faces of the next pack, in ascending order of codes, behind all that came before.
  void add(std::span<const PackEntry> entries);
  /// The whole object. `rows` tells of the packs, in the order in which they were added.
  base::Result<base::Bytes> build(const std::vector<PackRow>& rows, const std::string& parameters,
                                  const ValueTotals& totals) const;

 private:
  struct EncodedRun {
    std::uint64_t cell;
    std::uint64_t begin;  // of its bytes
    std::uint32_t size;
    std::uint32_t pack;
  };
  base::ByteView bytesOf(const EncodedRun& run) const;
  bool fits(const IndexRoot& root) const;
  void writeBlocks(const IndexRoot& root, const std::vector<PackRow>& packs, base::Bytes& out) const;

  std::vector<EncodedRun> runs_;
  base::Bytes bytes_;
  std::uint64_t keys_ = 0, empty_ = 0;
  std::uint32_t packs_ = 0;
};

}  // namespace repository
