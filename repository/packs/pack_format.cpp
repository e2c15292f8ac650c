#include "repository/packs/pack_format.h"

#include <algorithm>
#include <bit>
#include <cstring>
#include <numeric>
#include <utility>

#include "base/check.h"
#include "base/crc32c.h"
#include "base/fields.h"

namespace repository {
namespace {

using base::ByteReader;
using base::Bytes;
using base::ByteView;
using base::ByteWriter;
using base::Error;
using base::ErrorCode;
using base::Result;

constexpr char kPackMagic[9] = "LGPACKS\n";
constexpr char kIndexMagic[9] = "LGINDEX\n";
constexpr std::size_t kMagicBytes = 8;
constexpr std::uint32_t kPackVersion = 2;
constexpr std::uint32_t kIndexVersion = 3;
constexpr std::uint32_t kIndexHeaderBytes = 128;
constexpr std::uint32_t kMaxParameterBytes = std::uint32_t{16} << 20;
constexpr std::uint64_t kMaxPacks = std::uint64_t{1} << 24;
constexpr std::uint64_t kMaxBlocks = std::uint64_t{1} << 32;
constexpr std::uint32_t kMinBlockBytes = 4096;
constexpr std::uint32_t kMaxBlockBytes = 262144;
constexpr std::uint32_t kBlockHeaderBytes = 12;
constexpr std::uint64_t kMaxFillBytes = 4096;  // more blocks have no fill, which a first picture would wait for
constexpr std::uint32_t kCellBits = 6;
constexpr std::uint64_t kCellMask = (1U << kCellBits) - 1;
constexpr std::uint64_t kNoDirection = 0xC0C0C0C0C0C0C0C0ULL;  // bits of d = 6 and 7 in steps of whole faces
constexpr std::uint64_t kWholeFaces = std::uint64_t{1} << 63;  // of a run's cell: its bits stand for first tiles
constexpr std::uint32_t kMinValueBytes = 8;                    // the header of a face value
// The writer's choices; docs/formats/packs.md gives the reasons.
constexpr std::uint32_t kBlockBytes = 16384;
constexpr std::uint64_t kMostRoom = 16;  // blocks take at most so many times what they hold, while larger ones are left
// A neighbourhood of 4 × 4 × 4 points, or of 2 × 2 × 2 where tiles make that too large for a block. No run is longer.
constexpr std::uint32_t kManyPoints = kTileBits + 9, kFewPoints = kTileBits + 6;

Error damaged(const std::string& problem) {
  return {ErrorCode::kInvalidInput, problem + "; publish it again"};
}

std::uint64_t alignUp(std::uint64_t offset, std::uint64_t step) {
  return (offset + step - 1) / step * step;
}

// Stafford's 13th variant of the MurmurHash3 finalizer: flipping a bit of x flips each bit of the result with
// probability 1/2.
std::uint64_t mixBits(std::uint64_t x) {
  x ^= x >> 30;
  x *= 0xbf58476d1ce4e5b9ULL;
  x ^= x >> 27;
  x *= 0x94d049bb133111ebULL;
  return x ^ x >> 31;
}

std::uint64_t blocksOffsetOf(const IndexRoot& root) {
  return alignUp(std::max(kIndexFrontBytes, root.frontBytes()), root.block_bytes);
}

std::uint32_t fillBytesOf(const IndexRoot& root) {
  return root.blocks <= kMaxFillBytes ? static_cast<std::uint32_t>(root.blocks) : 0;
}

// --- Runs

// The run, without values, that begins with the first entry. Its bits stand for whole faces where no tile but the first
// of a face is next.
FaceRun runFrom(std::span<const PackEntry> entries) {
  const auto isFirstTile = [&](std::size_t i) { return (entries[i].code & ((1U << kTileBits) - 1)) == 0; };
  FaceRun run;
  if (isFirstTile(0) && (entries.size() == 1 || isFirstTile(1))) run.step_bits = kTileBits;
  run.cell = entries[0].code >> (run.step_bits + kCellBits);
  return run;
}

struct WrittenRun {
  std::size_t entries = 0;  // of those at the front
  std::uint32_t value_bytes = 0;
};

// Writes as many entries at the front as one run can hold.
WrittenRun writeRun(std::span<const PackEntry> entries, std::uint32_t offset, ByteWriter& out) {
  FaceRun run = runFrom(entries);
  WrittenRun written;
  for (; written.entries < entries.size(); ++written.entries) {
    const auto bit = run.bitOf(entries[written.entries].code);
    if (!bit) break;
    run.present |= std::uint64_t{1} << *bit;
  }
  out.u64(run.cell | (run.step_bits != 0 ? kWholeFaces : 0));
  out.u64(run.present);
  out.u32(offset);
  for (const PackEntry& entry : entries.first(written.entries)) {
    out.varint(entry.length);
    written.value_bytes += entry.length;
  }
  return written;
}

// Why a run's codes are no keys; null when they are.
const char* checkCodes(const FaceRun& run) {
  if (run.present == 0) return "a run's faces are none";
  if (run.step_bits != 0 && (run.present & kNoDirection) != 0) return "a run's faces are none";
  if (!FaceKey::fromCode(run.firstCode()) || !FaceKey::fromCode(run.lastCode())) return "a run's cell is none";
  return nullptr;
}

// Reads a run and appends its lengths. Returns the fault, or null when there is none.
const char* readRun(ByteReader& in, FaceRun& run, std::vector<std::uint32_t>& lengths) {
  const std::uint64_t cell = in.u64();
  run.step_bits = (cell & kWholeFaces) != 0 ? kTileBits : 0;
  run.cell = cell & ~kWholeFaces;
  run.present = in.u64();
  run.offset = in.u32();
  if (!in.ok()) return "a run is cut short";
  if (run.cell >> (63 - kCellBits - run.step_bits) != 0) return "a run's cell is none";
  if (const char* wrong = checkCodes(run)) return wrong;
  std::uint64_t end = run.offset;
  for (int i = std::popcount(run.present); i > 0; --i) {
    const std::uint64_t length = in.varint();
    if ((length != 0 && length < kMinValueBytes) || length > kMaxValueBytes) in.fail();
    end += length;
    lengths.push_back(static_cast<std::uint32_t>(length));
  }
  if (!in.ok()) return "a run's lengths are none";
  if (run.offset < kPackHeaderBytes || end > kMaxPackBytes) return "a run's values do not lie in a pack";
  return nullptr;
}

// Visits the codes of a run in ascending order.
template <class Visit>
void forEachCode(const FaceRun& run, Visit visit) {
  for (std::uint64_t left = run.present; left != 0; left &= left - 1)
    visit(run.codeOf(static_cast<unsigned>(std::countr_zero(left))));
}

// Checks magic, version, and the header's checksum, which is its last word.
Result<void> checkHeader(ByteView bytes, const char* magic, std::uint32_t expected_version, std::uint32_t header_bytes,
                         const std::string& name) {
  if (bytes.size() < header_bytes) return damaged(name + " is cut short");
  ByteReader in(bytes);
  if (std::memcmp(in.bytes(kMagicBytes).data(), magic, kMagicBytes) != 0)
    return damaged("not " + name + " (wrong magic)");
  const std::uint32_t version = in.u32();
  if (version != expected_version)
    return Error{ErrorCode::kVersion, name + " is of version " + std::to_string(version) + ", this program reads " +
                                          std::to_string(expected_version) + "; publish it again"};
  if (in.u32() != header_bytes) return damaged(name + " has a header of another length");
  ByteReader end(bytes.subspan(header_bytes - 4));
  if (end.u32() != base::crc32c(bytes.first(header_bytes - 4)))
    return damaged(name + ": its header's checksum differs");
  return {};
}

// --- Fields, as they follow each other in the file

// The fields of a pack's header behind its length.
struct PackSummary {
  std::uint64_t bytes = 0, table_offset = 0, keys = 0, first_code = 0, last_code = 0;
  std::uint32_t table_crc = 0;
};
auto fieldsOf(auto& pack) {
  return std::tie(pack.bytes, pack.table_offset, pack.keys, pack.first_code, pack.last_code, pack.table_crc);
}
auto fieldsOfRoot(auto& root) {
  return std::tie(root.object_bytes, root.keys, root.empty, root.totals.value_bytes, root.totals.jpeg_bytes,
                  root.totals.coverage_bytes, root.blocks, root.blocks_offset, root.packs, root.block_bytes,
                  root.hash_shift, root.parameter_bytes, root.parameter_crc, root.rows_crc, root.fill_bytes,
                  root.fill_crc);
}
auto fieldsOfRow(auto& row) {
  return std::tie(row.id, row.bytes, row.first_code, row.last_code, row.keys);
}

// --- Names

std::string nameOf(const char* front, const ObjectId& id, const char* back) {
  return front + base::hexOf(id) + back;
}

constexpr const char* kPackFront = "images/pack-";
constexpr const char* kPackBack = ".lgk";
constexpr const char* kIndexFront = "images/index-";
constexpr const char* kIndexBack = ".lgi";

std::optional<ObjectId> idIn(const std::string& name, std::string_view front, std::string_view back) {
  ObjectId id{};
  if (name.size() != front.size() + 2 * id.size() + back.size() || !name.starts_with(front) || !name.ends_with(back))
    return std::nullopt;
  const auto bytes = base::bytesOfHex(std::string_view(name).substr(front.size(), 2 * id.size()));
  if (!bytes) return std::nullopt;
  std::copy(bytes->begin(), bytes->end(), id.begin());
  return id;
}

}  // namespace

// --- Runs

std::optional<unsigned> FaceRun::bitOf(std::uint64_t code) const {
  const std::uint64_t steps = code >> step_bits;
  if (steps << step_bits != code || steps >> kCellBits != cell) return std::nullopt;
  return static_cast<unsigned>(steps & kCellMask);
}

std::uint64_t FaceRun::codeOf(unsigned bit) const {
  return (cell << kCellBits | bit) << step_bits;
}

std::uint64_t FaceRun::firstCode() const {
  return codeOf(static_cast<unsigned>(std::countr_zero(present)));
}

std::uint64_t FaceRun::lastCode() const {
  return codeOf(static_cast<unsigned>(63 - std::countl_zero(present)));
}

std::string packName(const ObjectId& id) {
  return nameOf(kPackFront, id, kPackBack);
}
std::string indexName(const ObjectId& id) {
  return nameOf(kIndexFront, id, kIndexBack);
}
std::optional<ObjectId> idOfPackName(const std::string& name) {
  return idIn(name, kPackFront, kPackBack);
}
std::optional<ObjectId> idOfIndexName(const std::string& name) {
  return idIn(name, kIndexFront, kIndexBack);
}

// --- Packs

Bytes encodePack(std::span<const PackEntry> entries, ByteView values) {
  LUMIGRID_CHECK(!entries.empty());
  ByteWriter table;
  auto offset = static_cast<std::uint32_t>(kPackHeaderBytes);
  for (auto rest = entries; !rest.empty();) {
    const WrittenRun written = writeRun(rest, offset, table);
    offset += written.value_bytes;
    rest = rest.subspan(written.entries);
  }
  LUMIGRID_CHECK_EQ(offset, kPackHeaderBytes + values.size());

  ByteWriter out;
  out.bytes(base::viewOfText({kPackMagic, kMagicBytes}));
  out.u32(kPackVersion);
  out.u32(static_cast<std::uint32_t>(kPackHeaderBytes));
  const PackSummary summary{kPackHeaderBytes + values.size() + table.size(),
                            kPackHeaderBytes + values.size(),
                            entries.size(),
                            entries.front().code,
                            entries.back().code,
                            base::crc32c(table.view())};
  base::writeFields(out, fieldsOf(summary));
  out.u32(base::crc32c(out.view()));
  out.bytes(values);
  out.bytes(table.view());
  return out.takeBytes();
}

Result<PackTable> decodePack(ByteView pack) {
  LUMIGRID_TRY(checkHeader(pack, kPackMagic, kPackVersion, kPackHeaderBytes, "a pack"));
  ByteReader header(pack.subspan(kMagicBytes + 8));
  PackSummary summary;
  base::readFields(header, fieldsOf(summary));
  if (summary.bytes != pack.size())
    return damaged("has " + std::to_string(pack.size()) + " bytes, its header says " + std::to_string(summary.bytes));
  if (summary.table_offset < kPackHeaderBytes || summary.table_offset > summary.bytes)
    return damaged("its table does not lie in it");
  const ByteView table = pack.subspan(summary.table_offset);
  if (base::crc32c(table) != summary.table_crc) return damaged("its table's checksum differs");

  PackTable out;
  ByteReader in(table);
  std::uint64_t offset = kPackHeaderBytes;
  std::vector<std::uint32_t> lengths;
  while (!in.atEnd()) {
    FaceRun run;
    lengths.clear();
    if (const char* wrong = readRun(in, run, lengths)) return damaged(std::string("its table: ") + wrong);
    if (run.offset != offset) return damaged("its table: values do not lie side by side");
    if (!out.entries.empty() && out.entries.back().code >= run.firstCode())
      return damaged("its table: runs are out of order");
    std::size_t i = 0;
    forEachCode(run, [&](std::uint64_t code) {
      out.entries.push_back({code, lengths[i]});
      out.offsets.push_back(static_cast<std::uint32_t>(offset));
      offset += lengths[i++];
    });
  }
  if (out.entries.empty() || out.entries.size() != summary.keys || out.entries.front().code != summary.first_code ||
      out.entries.back().code != summary.last_code || offset != summary.table_offset)
    return damaged("its table and its header differ");
  return out;
}

// --- Reading the index

std::uint64_t IndexRoot::frontBytes() const {
  return parameterOffset() + parameter_bytes + fill_bytes;
}

Result<IndexRoot> decodeIndexRoot(ByteView front) {
  LUMIGRID_TRY(checkHeader(front, kIndexMagic, kIndexVersion, kIndexHeaderBytes, "an index"));
  ByteReader in(front.subspan(kMagicBytes + 8));
  IndexRoot root;
  base::readFields(in, fieldsOfRoot(root));

  if (root.empty > root.keys) return damaged("the index counts more empty flags than keys");
  if (!std::has_single_bit(root.block_bytes) || root.block_bytes < kMinBlockBytes || root.block_bytes > kMaxBlockBytes)
    return damaged("the index has blocks of " + std::to_string(root.block_bytes) + " bytes");
  if (root.hash_shift < kCellBits + kTileBits || root.hash_shift > 62)
    return damaged("the index's hash shift is " + std::to_string(root.hash_shift));
  if (root.parameter_bytes > kMaxParameterBytes) return damaged("the index's parameters are too long");
  if (root.blocks == 0 || root.blocks > kMaxBlocks) return damaged("the index has no blocks or too many");
  if (root.packs > kMaxPacks || root.packs > root.keys) return damaged("the index has too many packs");
  if (root.fill_bytes != fillBytesOf(root)) return damaged("the index tells of too many or too few blocks");
  if (root.blocks_offset != blocksOffsetOf(root)) return damaged("the index's blocks do not lie behind its parameters");
  if (root.object_bytes != root.rowsOffset() + root.packs * kPackRowBytes)
    return damaged("the index's lengths do not add up");
  if (front.size() >= root.frontBytes()) {
    const ByteView fill = front.subspan(root.frontBytes() - root.fill_bytes, root.fill_bytes);
    if (base::crc32c(fill) != root.fill_crc) return damaged("how full the index's blocks are: the checksum differs");
    root.fill.assign(fill.begin(), fill.end());
  }
  return root;
}

Result<void> checkParameters(const IndexRoot& root, ByteView text) {
  if (text.size() != root.parameter_bytes) return damaged("the parameters are cut short");
  if (base::crc32c(text) != root.parameter_crc) return damaged("the parameters' checksum differs");
  return {};
}

std::uint64_t blockOfCode(const IndexRoot& root, std::uint64_t code) {
  return mixBits(code >> root.hash_shift) % root.blocks;
}

Result<IndexBlock> decodeIndexBlock(const IndexRoot& root, std::uint64_t number, ByteView block) {
  const std::string name = "block " + std::to_string(number) + " of the index";
  ByteReader in(block);
  const std::uint32_t crc = in.u32();
  const std::uint32_t used = in.u32();
  if (!in.ok() || block.size() > root.block_bytes || used > block.size() || used < kBlockHeaderBytes)
    return damaged(name + " is cut short");
  if (crc != base::crc32c(block.first(used).subspan(4))) return damaged(name + ": its checksum differs");
  const std::uint16_t packs = in.u16();
  const std::uint16_t runs = in.u16();

  IndexBlock out;
  for (std::uint16_t i = 0; i < packs && in.ok(); ++i) out.packs_.push_back(in.read<ObjectId>());
  for (std::uint16_t i = 0; i < runs; ++i) {
    IndexBlock::Row row;
    row.pack = in.u16();
    row.first_length = static_cast<std::uint32_t>(out.lengths_.size());
    if (const char* wrong = readRun(in, row.run, out.lengths_)) return damaged(name + ": " + wrong);
    if (row.pack >= out.packs_.size()) return damaged(name + ": a run's pack is none");
    if (blockOfCode(root, row.run.firstCode()) != number) return damaged(name + ": a run belongs in another block");
    if (!out.rows_.empty() && out.rows_.back().run.lastCode() >= row.run.firstCode())
      return damaged(name + ": runs are out of order");
    out.rows_.push_back(row);
  }
  if (!in.ok() || in.offset() != used) return damaged(name + ": its lengths do not add up");
  const ByteView rest = block.subspan(used);
  if (std::any_of(rest.begin(), rest.end(), [](std::uint8_t byte) { return byte != 0; }))
    return damaged(name + ": something stands behind its end");
  return out;
}

std::optional<FaceLocation> IndexBlock::find(std::uint64_t code) const {
  // The first run that does not end before the code is the only candidate, since runs do not overlap.
  const auto row = std::partition_point(rows_.begin(), rows_.end(),
                                        [&](const Row& candidate) { return candidate.run.lastCode() < code; });
  if (row == rows_.end()) return std::nullopt;
  const auto place = row->run.bitOf(code);
  if (!place) return std::nullopt;
  const std::uint64_t bit = std::uint64_t{1} << *place;
  if ((row->run.present & bit) == 0) return std::nullopt;
  const auto before = static_cast<std::ptrdiff_t>(std::popcount(row->run.present & (bit - 1)));
  const auto first = lengths_.begin() + row->first_length;
  return FaceLocation{packs_[row->pack], std::accumulate(first, first + before, std::uint64_t{row->run.offset}),
                      first[before]};
}

std::uint64_t IndexBlock::bytes() const {
  return sizeof(*this) + packs_.size() * sizeof(ObjectId) + rows_.size() * sizeof(Row) +
         lengths_.size() * sizeof(std::uint32_t);
}

std::uint64_t IndexBlock::emptyFlags() const {
  return static_cast<std::uint64_t>(std::count(lengths_.begin(), lengths_.end(), 0U));
}

std::uint64_t IndexBlock::valueBytes() const {
  return std::accumulate(lengths_.begin(), lengths_.end(), std::uint64_t{0});
}

Result<std::vector<PackRow>> decodePackRows(const IndexRoot& root, ByteView bytes) {
  if (bytes.size() != root.packs * kPackRowBytes) return damaged("the index's list of packs is cut short");
  if (base::crc32c(bytes) != root.rows_crc) return damaged("the index's list of packs: its checksum differs");
  ByteReader in(bytes);
  std::vector<PackRow> rows(root.packs);
  std::uint64_t keys = 0;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    PackRow& row = rows[i];
    base::readFields(in, fieldsOfRow(row));
    if (row.bytes < kPackHeaderBytes || row.bytes > kMaxPackBytes || row.keys == 0 || row.keys > root.keys - keys ||
        row.first_code > row.last_code || (i > 0 && rows[i - 1].last_code >= row.first_code))
      return damaged("the index's list of packs: row " + std::to_string(i) + " cannot be");
    keys += row.keys;
  }
  if (keys != root.keys)
    return damaged("the index's list of packs counts " + std::to_string(keys) + " keys, its header " +
                   std::to_string(root.keys));
  return rows;
}

// --- Writing the index

void IndexBuilder::addPack(std::span<const PackEntry> entries) {
  ByteWriter run;
  auto offset = static_cast<std::uint32_t>(kPackHeaderBytes);
  for (auto rest = entries; !rest.empty();) {
    run = {};
    const WrittenRun written = writeRun(rest, offset, run);
    offset += written.value_bytes;
    runs_.push_back({rest[0].code, bytes_.size(), static_cast<std::uint32_t>(run.size()), packs_});
    bytes_.insert(bytes_.end(), run.view().begin(), run.view().end());
    rest = rest.subspan(written.entries);
  }
  for (const PackEntry& entry : entries) empty_ += entry.length == 0 ? 1U : 0U;
  keys_ += entries.size();
  ++packs_;
}

ByteView IndexBuilder::bytesOf(const EncodedRun& run) const {
  return ByteView(bytes_).subspan(run.begin, run.size);
}

// The bytes of the runs of the neighbourhood that has most, with a pack's id for each run that begins one.
std::uint64_t IndexBuilder::fullestNeighbourhood(std::uint32_t hash_shift) const {
  std::uint64_t fullest = 0, bytes = 0;
  for (std::size_t i = 0; i < runs_.size(); ++i) {
    const bool begins = i == 0 || runs_[i].first_code >> hash_shift != runs_[i - 1].first_code >> hash_shift;
    if (begins) bytes = kBlockHeaderBytes;
    if (begins || runs_[i].pack != runs_[i - 1].pack) bytes += sizeof(ObjectId);
    bytes += 2 + runs_[i].size;
    fullest = std::max(fullest, bytes);
  }
  return fullest;
}

// Chooses how many points share a block, and its size: 4 × 4 × 4 where a quarter of a block of the usual size holds
// any so many, else 2 × 2 × 2, and the smallest blocks that hold those. The largest hold their whole tiles.
void IndexBuilder::chooseNeighbourhood(IndexRoot& root) const {
  root.block_bytes = kBlockBytes;
  root.hash_shift = kManyPoints;
  if (4 * fullestNeighbourhood(root.hash_shift) <= root.block_bytes) return;
  root.hash_shift = kFewPoints;
  root.block_bytes = kMinBlockBytes;
  while (fullestNeighbourhood(root.hash_shift) > root.block_bytes) root.block_bytes *= 2;
  LUMIGRID_CHECK_LE(root.block_bytes, kMaxBlockBytes);
}

// Whether each block has room for its runs. They come in order of packs, so a block names each of its packs once.
bool IndexBuilder::fitsIntoBlocks(const IndexRoot& root) const {
  constexpr std::uint32_t kNone = ~std::uint32_t{0};
  std::vector<std::uint32_t> filled(root.blocks, kBlockHeaderBytes);
  std::vector<std::uint32_t> last_pack(root.blocks, kNone);
  for (const EncodedRun& run : runs_) {
    const std::uint64_t block = blockOfCode(root, run.first_code);
    filled[block] += 2 + run.size;
    if (last_pack[block] != run.pack) filled[block] += sizeof(ObjectId);
    last_pack[block] = run.pack;
    if (filled[block] > root.block_bytes) return false;
  }
  return true;
}

// Takes the fewest blocks that hold all, of those that are tried. Where neighbourhoods fill blocks of this size almost,
// so that hardly two may share one, that would be far too many, and larger ones are needed: returns false then.
bool IndexBuilder::chooseBlocks(IndexRoot& root) const {
  const std::uint64_t most = root.block_bytes + kMostRoom * bytes_.size();
  for (root.blocks = 1 + bytes_.size() / root.block_bytes; !fitsIntoBlocks(root); root.blocks += 1 + root.blocks / 8)
    if (root.blocks * root.block_bytes > most && root.block_bytes < kMaxBlockBytes) return false;
  return true;
}

// Says in root.fill how full each is.
void IndexBuilder::writeBlocks(IndexRoot& root, const std::vector<PackRow>& packs, Bytes& out) const {
  std::vector<std::pair<std::uint64_t, std::uint64_t>> order;  // number of the block, index of the run
  order.reserve(runs_.size());
  for (std::size_t i = 0; i < runs_.size(); ++i) order.emplace_back(blockOfCode(root, runs_[i].first_code), i);
  std::sort(order.begin(), order.end());

  auto next = order.begin();
  for (std::uint64_t block = 0; block < root.blocks; ++block) {
    ByteWriter ids;
    ByteWriter runs;
    std::uint16_t id_count = 0;
    std::uint16_t run_count = 0;
    std::optional<std::uint32_t> last_pack;
    for (; next != order.end() && next->first == block; ++next, ++run_count) {
      const EncodedRun& run = runs_[next->second];
      if (last_pack != run.pack) {
        ids.write(packs[run.pack].id);
        ++id_count;
        last_pack = run.pack;
      }
      runs.u16(static_cast<std::uint16_t>(id_count - 1));
      runs.bytes(bytesOf(run));
    }
    const auto used = static_cast<std::uint32_t>(kBlockHeaderBytes + ids.size() + runs.size());
    ByteWriter content;
    content.u32(used);
    content.u16(id_count);
    content.u16(run_count);
    content.bytes(ids.view());
    content.bytes(runs.view());
    ByteWriter checksum;
    checksum.u32(base::crc32c(content.view()));
    out.insert(out.end(), checksum.view().begin(), checksum.view().end());
    out.insert(out.end(), content.view().begin(), content.view().end());
    out.resize(out.size() + root.block_bytes - used);
    const std::uint32_t step = root.block_bytes / IndexRoot::kFillSteps;
    root.fill.push_back(static_cast<std::uint8_t>((used - 1) / step));
  }
}

Result<Bytes> IndexBuilder::build(const std::vector<PackRow>& packs, const std::string& parameters,
                                  const ValueTotals& totals) const {
  LUMIGRID_CHECK_EQ(packs.size(), packs_);
  if (parameters.size() > kMaxParameterBytes)
    return Error{ErrorCode::kUnsupported, "the repository's parameters exceed 16 MiB"};
  IndexRoot root;
  chooseNeighbourhood(root);
  while (!chooseBlocks(root)) root.block_bytes *= 2;

  ByteWriter rows;
  for (const PackRow& pack : packs) base::writeFields(rows, fieldsOfRow(pack));
  root.keys = keys_;
  root.empty = empty_;
  root.totals = totals;
  root.packs = packs.size();
  root.parameter_bytes = static_cast<std::uint32_t>(parameters.size());
  root.parameter_crc = base::crc32c(base::viewOfText(parameters));
  root.rows_crc = base::crc32c(rows.view());
  root.fill_bytes = fillBytesOf(root);
  root.blocks_offset = blocksOffsetOf(root);
  root.object_bytes = root.rowsOffset() + rows.size();
  Bytes out;
  out.reserve(root.object_bytes);
  out.resize(root.blocks_offset);
  writeBlocks(root, packs, out);
  out.insert(out.end(), rows.view().begin(), rows.view().end());
  if (root.fill_bytes == 0) root.fill.clear();
  root.fill_crc = base::crc32c(root.fill);

  ByteWriter header;
  header.bytes(base::viewOfText({kIndexMagic, kMagicBytes}));
  header.u32(kIndexVersion);
  header.u32(kIndexHeaderBytes);
  base::writeFields(header, fieldsOfRoot(root));
  header.bytes(Bytes(8));
  header.u32(base::crc32c(header.view()));
  LUMIGRID_CHECK_EQ(header.size(), kIndexHeaderBytes);
  header.bytes(base::viewOfText(parameters));
  header.bytes(root.fill);
  LUMIGRID_CHECK_EQ(header.size(), root.frontBytes());

  std::copy(header.view().begin(), header.view().end(), out.begin());
  return out;
}

}  // namespace repository
