#pragma once
// Encodes and decodes published repositories: the index, its blocks, and packs (docs/formats/packs.md). It does no
// input or output, so that every reader, the browser's too, uses this code.
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

// docs/formats/packs.md defines these sizes.
inline constexpr std::uint64_t kIndexFrontBytes = 16384;  ///< hold the root; blocks begin behind them
inline constexpr std::uint64_t kPackHeaderBytes = 64;
inline constexpr std::uint64_t kPackRowBytes = 48;
inline constexpr std::uint64_t kMaxPackBytes = std::uint64_t{128} << 20;  ///< readers hold one pack in memory
inline constexpr std::uint32_t kMaxValueBytes = std::uint32_t{64} << 20;

/// The first 16 bytes of an object's SHA-256, which name the object.
using ObjectId = std::array<std::uint8_t, 16>;
/// "images/pack-<id>.lgk", "images/index-<id>.lgi".
std::string packName(const ObjectId& id);
std::string indexName(const ObjectId& id);
/// The id in the name of a pack or an index; nothing for any other name.
std::optional<ObjectId> idOfPackName(const std::string& name);
std::optional<ObjectId> idOfIndexName(const std::string& name);

/// The code of a key and the length of its value in a pack.
struct PackEntry {
  std::uint64_t code = 0;
  std::uint32_t length = 0;  ///< 0: an empty flag, which takes no bytes
  friend bool operator==(const PackEntry&, const PackEntry&) = default;
};

/// Values that lie side by side in a pack, and whose codes are 64 steps at most apart: the tiles of one face (steps of
/// 1), or the first tiles of faces in one cell of 2 × 2 × 2 points (steps of 2^kTileBits).
struct FaceRun {
  std::uint64_t cell = 0;     ///< code >> (step_bits + 6)
  std::uint64_t present = 0;  ///< bit (code >> step_bits & 63) is set for each value
  std::uint32_t offset = 0;   ///< offset of the first value in the pack
  unsigned step_bits = 0;     ///< 0 or kTileBits

  /// The bit of `present` that stands for a code; nothing for a code that no bit stands for.
  std::optional<unsigned> bitOf(std::uint64_t code) const;
  std::uint64_t codeOf(unsigned bit) const;
  std::uint64_t firstCode() const;
  std::uint64_t lastCode() const;
};

// --- Packs

/// Encodes a whole pack: header, `values` side by side, table. There is at least one entry, entries ascend by code, and
/// their lengths add up to values.size().
base::Bytes encodePack(std::span<const PackEntry> entries, base::ByteView values);

/// A pack's entries with the offset of each value.
struct PackTable {
  std::vector<PackEntry> entries;
  std::vector<std::uint32_t> offsets;
};
/// Checks header, checksums and table, but not the values themselves.
base::Result<PackTable> decodePack(base::ByteView pack);

// --- The index

/// Sums over all values in packs.
struct ValueTotals {
  std::uint64_t value_bytes = 0, jpeg_bytes = 0, coverage_bytes = 0;
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
  std::uint32_t fill_bytes = 0, fill_crc = 0;  ///< fill_bytes: as many as blocks, or 0 where there are too many
  /// For each block how many 256ths of it, less one, hold something. Empty: not known.
  std::vector<std::uint8_t> fill;

  std::uint64_t blockOffset(std::uint64_t block) const { return blocks_offset + block * block_bytes; }
  /// As much of a block as decodeIndexBlock() needs.
  std::uint64_t bytesToRead(std::uint64_t block) const {
    return fill.empty() ? block_bytes : block_bytes / kFillSteps * (std::uint64_t{fill[block]} + 1);
  }
  std::uint64_t rowsOffset() const { return blockOffset(blocks); }
  /// The first bytes of the index that hold all but blocks and rows.
  std::uint64_t frontBytes() const;
  static constexpr std::uint32_t kFillSteps = 256;
};
/// Decodes the root from the first bytes of the index, at least kIndexHeaderBytes. What tells how full the blocks are
/// is there where `front` reaches that far. The parameters lie at parameterOffset(); checkParameters checks them.
base::Result<IndexRoot> decodeIndexRoot(base::ByteView front);
constexpr std::uint64_t parameterOffset() {
  return 128;
}
base::Result<void> checkParameters(const IndexRoot& root, base::ByteView text);

/// The number of the block that locates a key's value.
std::uint64_t blockOfCode(const IndexRoot& root, std::uint64_t code);

/// Where the value of a face lies.
struct FaceLocation {
  ObjectId pack{};
  std::uint64_t offset = 0;
  std::uint32_t length = 0;  ///< 0: an empty flag, for which nothing is read
  friend bool operator==(const FaceLocation&, const FaceLocation&) = default;
};

/// A decoded block of the index.
class IndexBlock {
 public:
  std::optional<FaceLocation> find(std::uint64_t code) const;
  /// The memory that the block takes, for caches.
  std::uint64_t bytes() const;
  std::uint64_t keys() const { return lengths_.size(); }
  std::uint64_t emptyFlags() const;
  std::uint64_t valueBytes() const;  ///< sum over its faces, in packs

 private:
  friend base::Result<IndexBlock> decodeIndexBlock(const IndexRoot& root, std::uint64_t number, base::ByteView block);
  struct Row {
    FaceRun run;
    std::uint32_t pack = 0;          // index into packs_
    std::uint32_t first_length = 0;  // index into lengths_
  };
  std::vector<ObjectId> packs_;
  std::vector<Row> rows_;  // in ascending order of codes
  std::vector<std::uint32_t> lengths_;
};
/// `block`: all of it, or what IndexRoot::bytesToRead() says.
base::Result<IndexBlock> decodeIndexBlock(const IndexRoot& root, std::uint64_t number, base::ByteView block);

struct PackRow {
  ObjectId id{};
  std::uint64_t bytes = 0, first_code = 0, last_code = 0, keys = 0;
  friend bool operator==(const PackRow&, const PackRow&) = default;
};
base::Result<std::vector<PackRow>> decodePackRows(const IndexRoot& root, base::ByteView rows);

/// Builds an index. It takes 5 bytes of memory a face, and then those of the index.
class IndexBuilder {
 public:
  /// Adds the faces of the next pack, in ascending order of codes and behind those of all packs before.
  void addPack(std::span<const PackEntry> entries);
  /// Encodes the whole index. `rows` describes the packs in the order in which they were added.
  base::Result<base::Bytes> build(const std::vector<PackRow>& rows, const std::string& parameters,
                                  const ValueTotals& totals) const;

 private:
  struct EncodedRun {
    std::uint64_t first_code;
    std::uint64_t begin;  // offset in bytes_
    std::uint32_t size;
    std::uint32_t pack;
  };
  base::ByteView bytesOf(const EncodedRun& run) const;
  void chooseNeighbourhood(IndexRoot& root) const;
  std::uint64_t fullestNeighbourhood(std::uint32_t hash_shift) const;
  bool fitsIntoBlocks(const IndexRoot& root) const;
  bool chooseBlocks(IndexRoot& root) const;
  void writeBlocks(IndexRoot& root, const std::vector<PackRow>& packs, base::Bytes& out) const;

  std::vector<EncodedRun> runs_;
  base::Bytes bytes_;
  std::uint64_t keys_ = 0, empty_ = 0;
  std::uint32_t packs_ = 0;
};

}  // namespace repository
