#include "repository/packs/pack_store.h"

#include <algorithm>
#include <set>
#include <tuple>
#include <utility>

#include "base/hash/sha256.h"
#include "base/parallel.h"
#include "repository/faces/face_value.h"
#include "repository/packs/prefetch.h"

namespace repository {
namespace {

using base::Bytes;
using base::ByteView;
using base::Error;
using base::ErrorCode;
using base::Result;

Error readOnly(const ObjectSource& source) {
  return {ErrorCode::kUnsupported,
          source.place() + ": published images cannot be changed; build a scene and publish it"};
}

// Pieces of an index that are read at once, and what is read ahead of its check.
constexpr std::uint64_t kPieceBytes = std::uint64_t{4} << 20;
constexpr std::uint64_t kPrefetchBytes = std::uint64_t{128} << 20;

std::vector<FaceKey> keysOf(const PackTable& table) {
  std::vector<FaceKey> keys;
  for (const PackEntry& entry : table.entries)
    if (const auto key = FaceKey::fromCode(entry.code)) keys.push_back(*key);
  return keys;
}

bool isOf(const ObjectId& id, const base::Sha256Digest& digest) {
  return std::equal(id.begin(), id.end(), digest.begin());
}

}  // namespace

Result<std::unique_ptr<PackStore>> PackStore::open(std::shared_ptr<const ObjectSource> source, const std::string& index,
                                                   const PackStoreOptions& options) {
  std::unique_ptr<PackStore> store(new PackStore(std::move(source), index, options));
  auto front = store->source_->read(index, 0, kIndexFrontBytes);
  if (!front) return front.error();
  auto root = decodeIndexRoot(*front);
  if (!root) return store->inIndex(root.error());
  store->root_ = *root;

  const std::uint64_t end = parameterOffset() + root->parameter_bytes;
  if (end > front->size()) {
    front = store->source_->read(index, 0, end);
    if (!front) return front.error();
  }
  const ByteView text = ByteView(*front).subspan(parameterOffset(), root->parameter_bytes);
  if (auto checked = checkParameters(*root, text); !checked) return store->inIndex(checked.error());
  store->parameters_.assign(text.begin(), text.end());
  return store;
}

Error PackStore::inIndex(const Error& error) const {
  return base::within(source_->place() + "/" + index_, error);
}

// --- Finding

Result<PackStore::Block> PackStore::block(std::uint64_t number) const {
  {
    const std::lock_guard guard(mutex_);
    if (const Block* cached = blocks_.find(number)) return *cached;
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, source_->read(index_, root_.blockOffset(number), root_.block_bytes));
  auto decoded = decodeIndexBlock(root_, number, bytes);
  if (!decoded) return inIndex(decoded.error());
  auto block = std::make_shared<const IndexBlock>(std::move(*decoded));

  const std::lock_guard guard(mutex_);
  blocks_.insert(number, block, block->bytes());
  blocks_.evict([](std::uint64_t) { return false; });
  return block;
}

Result<std::optional<FacePlace>> PackStore::find(const FaceKey& key) const {
  LUMIGRID_ASSIGN_OR_RETURN(auto found, block(blockOfCode(root_, key.code())));
  return found->find(key.code());
}

Result<bool> PackStore::contains(const FaceKey& key) const {
  LUMIGRID_ASSIGN_OR_RETURN(auto place, find(key));
  return place.has_value();
}

// --- Reading values

namespace {

Result<std::optional<Bytes>> checkedValue(const ObjectSource& source, const FacePlace& place, const FaceKey& key,
                                          Bytes bytes) {
  if (auto value = decodeFaceValue(bytes); !value) {
    Error error = base::within(source.place() + "/" + packName(place.pack) + ": " + nameOf(key), value.error());
    error.message += "; publish it again with --rewrite";
    return error;
  }
  return std::optional(std::move(bytes));
}

}  // namespace

Result<std::optional<Bytes>> PackStore::get(const FaceKey& key) const {
  auto value = read(key);
  if (!value && error_listener_) error_listener_(value.error());
  return value;
}

Result<std::optional<Bytes>> PackStore::read(const FaceKey& key) const {
  LUMIGRID_ASSIGN_OR_RETURN(auto place, find(key));
  if (!place.has_value()) return std::optional<Bytes>();
  if (place->length == 0) return std::optional(encodeFaceValue({}));
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, source_->read(packName(place->pack), place->offset, place->length));
  return checkedValue(*source_, *place, key, std::move(bytes));
}

struct PackStore::Wanted {
  FacePlace place;
  std::size_t index;  // into the keys
  FaceKey key;
  std::uint64_t end() const { return place.offset + place.length; }
};

// Values of one pack that one read brings. Those of a damaged index may overlap, so the last one need not end last.
struct PackStore::Range {
  std::span<const Wanted> wanted;
  std::uint64_t begin, end;
};

std::vector<PackStore::Range> PackStore::rangesOf(std::span<const Wanted> wanted) const {
  std::vector<Range> ranges;
  for (std::size_t first = 0, next = 0; first < wanted.size(); first = next) {
    const std::uint64_t begin = wanted[first].place.offset;
    std::uint64_t end = wanted[first].end();
    for (next = first + 1; next < wanted.size(); ++next) {
      const Wanted& one = wanted[next];
      if (one.place.pack != wanted[first].place.pack || one.place.offset > end + options_.gap_bytes ||
          one.end() - begin > options_.range_bytes)
        break;
      end = std::max(end, one.end());
    }
    ranges.push_back({wanted.subspan(first, next - first), begin, end});
  }
  return ranges;
}

PackStore::Values PackStore::getMany(const std::vector<FaceKey>& keys) const {
  loadBlocks(keys);
  Values out;
  out.reserve(keys.size());
  std::vector<Wanted> wanted;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    auto place = find(keys[i]);
    if (!place) {
      out.emplace_back(place.error());
    } else if (!place->has_value()) {
      out.emplace_back(std::nullopt);
    } else {
      out.emplace_back(encodeFaceValue({}));
      if ((*place)->length != 0) wanted.push_back({**place, i, keys[i]});
    }
  }
  std::sort(wanted.begin(), wanted.end(), [](const Wanted& a, const Wanted& b) {
    return std::tie(a.place.pack, a.place.offset) < std::tie(b.place.pack, b.place.offset);
  });
  const std::vector<Range> ranges = rangesOf(wanted);
  base::parallelFor(ranges.size(), options_.jobs, [&](std::size_t i) { readRange(ranges[i], out); });
  for (const auto& value : out)
    if (!value && error_listener_) error_listener_(value.error());
  return out;
}

// Reads the blocks that the keys need, side by side; what fails is met again by find.
void PackStore::loadBlocks(const std::vector<FaceKey>& keys) const {
  if (options_.jobs < 2) return;
  std::set<std::uint64_t> numbers;
  for (const FaceKey& key : keys) numbers.insert(blockOfCode(root_, key.code()));
  const std::vector<std::uint64_t> list(numbers.begin(), numbers.end());
  base::parallelFor(list.size(), options_.jobs, [&](std::size_t i) { (void)block(list[i]); });
}

void PackStore::readRange(const Range& range, Values& out) const {
  const auto read_bytes = source_->read(packName(range.wanted[0].place.pack), range.begin, range.end - range.begin);
  for (const Wanted& one : range.wanted) {
    auto& value = out[one.index];
    if (read_bytes) {
      const ByteView bytes = ByteView(*read_bytes).subspan(one.place.offset - range.begin, one.place.length);
      value = checkedValue(*source_, one.place, one.key, Bytes(bytes.begin(), bytes.end()));
    } else if (read_bytes.error().code == ErrorCode::kInvalidInput && range.wanted.size() > 1) {
      value = read(one.key);  // a truncated pack: some of them may be there
    } else {
      value = read_bytes.error();
    }
  }
}

Result<void> PackStore::putBatch(const std::vector<std::pair<FaceKey, Bytes>>&) {
  return readOnly(*source_);
}
Result<void> PackStore::erase(const std::vector<FaceKey>&) {
  return readOnly(*source_);
}
Result<void> PackStore::writeMeta(const std::string&) {
  return readOnly(*source_);
}

// --- Walking over everything

Result<std::vector<PackRow>> PackStore::packs() const {
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, source_->read(index_, root_.rowsOffset(), root_.packs * kPackRowBytes));
  auto rows = decodePackRows(root_, bytes);
  if (!rows) return inIndex(rows.error());
  return rows;
}

Result<PackTable> PackStore::tableOf(const PackRow& row, ByteView pack) const {
  const auto wrong = [&](const Error& error) { return base::within(source_->place() + "/" + packName(row.id), error); };
  auto table = decodePack(pack);
  if (!table) return wrong(table.error());
  if (table->entries.size() != row.keys || table->entries.front().code != row.first_code ||
      table->entries.back().code != row.last_code)
    return wrong({ErrorCode::kInvalidInput, "holds other keys than the index says; publish it again with --rewrite"});
  return table;
}

Result<bool> PackStore::visitPack(const PackTable& table, ByteView pack, const Visit& visit) const {
  const Bytes empty = encodeFaceValue({});
  for (std::size_t i = 0; i < table.entries.size(); ++i) {
    LUMIGRID_ASSIGN_OR_RETURN(auto key, FaceKey::fromCode(table.entries[i].code));
    const std::uint32_t length = table.entries[i].length;
    if (!visit(key, length == 0 ? ByteView(empty) : pack.subspan(table.offsets[i], length))) return false;
  }
  return true;
}

Result<void> PackStore::forEach(const Visit& visit) const {
  LUMIGRID_ASSIGN_OR_RETURN(auto rows, packs());
  for (const PackRow& row : rows) {
    LUMIGRID_ASSIGN_OR_RETURN(auto pack, source_->read(packName(row.id), 0, row.bytes));
    LUMIGRID_ASSIGN_OR_RETURN(auto table, tableOf(row, pack));
    LUMIGRID_ASSIGN_OR_RETURN(auto more, visitPack(table, pack, visit));
    if (!more) return {};
  }
  return {};
}

// --- Checking

PrefetchLimits PackStore::prefetchLimits() const {
  return {options_.jobs, kPrefetchBytes};
}

// The index: its own hash, its counts, every block.
void PackStore::checkIndex(const Fault& fault) const {
  // In pieces of whole blocks behind what lies before the first, and the rows as the last.
  struct Piece {
    std::uint64_t offset, length;
  };
  std::vector<Piece> pieces{{0, root_.blocks_offset}};
  const std::uint64_t blocks_at_once = std::max<std::uint64_t>(1, kPieceBytes / root_.block_bytes);
  for (std::uint64_t number = 0; number < root_.blocks; number += blocks_at_once)
    pieces.push_back({root_.blockOffset(number), std::min(blocks_at_once, root_.blocks - number) * root_.block_bytes});
  pieces.push_back({root_.rowsOffset(), root_.packs * kPackRowBytes});

  base::Sha256 hash;
  std::uint64_t number = 0;
  std::uint64_t keys = 0;
  std::uint64_t empty = 0;
  std::uint64_t value_bytes = 0;
  bool sound = true;
  bool whole = true;
  const auto takePiece = [&](std::size_t i, const Result<Bytes>& bytes) {
    if (!bytes) fault(bytes.error().message);
    if (!bytes) return whole = false;
    hash.add(*bytes);
    if (i == 0 || i + 1 == pieces.size()) return true;
    for (std::uint64_t at = 0; at < bytes->size(); at += root_.block_bytes) {
      const auto block = decodeIndexBlock(root_, number++, ByteView(*bytes).subspan(at, root_.block_bytes));
      if (block) {
        keys += block->keys();
        empty += block->emptyFlags();
        value_bytes += block->valueBytes();
      } else {
        fault(inIndex(block.error()).message);
        sound = false;
      }
    }
    return true;
  };
  prefetchInOrder(
      pieces.size(), prefetchLimits(), [&](std::size_t i) { return pieces[i].length; },
      [&](std::size_t i) { return source_->read(index_, pieces[i].offset, pieces[i].length); }, takePiece);
  if (!whole) return;

  const std::string name = source_->place() + "/" + index_;
  if (sound && (keys != root_.keys || empty != root_.empty))
    fault(name + ": its blocks hold " + std::to_string(keys) + " keys with " + std::to_string(empty) +
          " empty flags, its root says " + std::to_string(root_.keys) + " and " + std::to_string(root_.empty));
  if (sound) checkTotals(value_bytes, fault);
  if (const auto id = idOfIndexName(index_); !id || !isOf(*id, hash.finish()))
    fault(name + ": its SHA-256 is not the one in its name; publish it again with --rewrite");
  if (auto size = source_->size(index_); size && *size != root_.object_bytes)
    fault(name + ": has " + std::to_string(*size) + " bytes, its root says " + std::to_string(root_.object_bytes));
}

// What its root says of all values, which `info` shows, against what its blocks say.
void PackStore::checkTotals(std::uint64_t value_bytes, const Fault& fault) const {
  const ValueTotals& said = root_.totals;
  const bool parts_fit =
      said.jpeg_bytes <= said.value_bytes && said.coverage_bytes <= said.value_bytes - said.jpeg_bytes &&
      said.value_bytes - said.jpeg_bytes - said.coverage_bytes == kImageHeaderBytes * (root_.keys - root_.empty);
  if (said.value_bytes == value_bytes && parts_fit) return;
  fault(inIndex({ErrorCode::kInvalidInput, "its blocks hold " + std::to_string(value_bytes) +
                                               " bytes of values, its root says " + std::to_string(said.value_bytes) +
                                               ", of them " + std::to_string(said.jpeg_bytes) + " in JPEGs and " +
                                               std::to_string(said.coverage_bytes) +
                                               " in masks; publish it again with --rewrite"})
            .message);
}

// What the index says of each of a pack's faces.
void PackStore::comparePlaces(const PackRow& row, const PackTable& table, const Fault& fault) const {
  std::uint64_t differ = 0;
  FaceKey first;
  loadBlocks(keysOf(table));
  for (std::size_t i = 0; i < table.entries.size(); ++i) {
    const auto key = FaceKey::fromCode(table.entries[i].code);
    if (!key) continue;
    const auto place = find(*key);
    if (!place) continue;  // checkIndex has told of the block
    const PackEntry& entry = table.entries[i];
    const bool same = place->has_value() && (*place)->pack == row.id && (*place)->length == entry.length &&
                      (entry.length == 0 || (*place)->offset == table.offsets[i]);
    if (!same && differ++ == 0) first = *key;
  }
  if (differ != 0)
    fault(source_->place() + "/" + packName(row.id) + ": the index and this pack differ about " +
          std::to_string(differ) + " faces, the first is " + nameOf(first) + "; publish it again with --rewrite");
}

// A pack's hash, table and values. False when there is no use in going on.
bool PackStore::checkPack(const PackRow& row, const FarPack& pack, const Fault& fault, const Visit& visit) const {
  const std::string name = source_->place() + "/" + packName(row.id);
  if (!pack.bytes) {
    fault(pack.bytes.error().message);
    if (pack.bytes.error().code != ErrorCode::kNetwork) return true;
    fault(source_->place() + ": what comes after that was not looked at; try again later");
    return false;
  }
  if (!pack.is_of_its_name) fault(name + ": its SHA-256 is not the one in its name; publish it again with --rewrite");
  if (pack.size && *pack.size != row.bytes)
    fault(name + ": has " + std::to_string(*pack.size) + " bytes, the index says " + std::to_string(row.bytes));
  auto table = tableOf(row, *pack.bytes);
  if (!table) {
    fault(table.error().message);
    return true;
  }
  comparePlaces(row, *table, fault);
  auto visited = visitPack(*table, *pack.bytes, visit);
  if (!visited) fault(visited.error().message);
  return !visited || *visited;
}

// What checkPack needs from afar, and what takes time.
PackStore::FarPack PackStore::fetchPack(const PackRow& row) const {
  FarPack pack{source_->read(packName(row.id), 0, row.bytes), false, source_->size(packName(row.id))};
  pack.is_of_its_name = pack.bytes && isOf(row.id, base::sha256(*pack.bytes));
  return pack;
}

void PackStore::check(const std::function<bool(std::string)>& fault, const Visit& visit) const {
  bool enough = false;
  const Fault tell = [&](std::string line) {
    if (!enough) enough = !fault(std::move(line));
  };
  checkIndex(tell);
  if (enough) return;
  auto rows = packs();
  if (!rows) return tell(rows.error().message);
  prefetchInOrder(
      rows->size(), prefetchLimits(), [&](std::size_t i) { return (*rows)[i].bytes; },
      [&](std::size_t i) { return fetchPack((*rows)[i]); },
      [&](std::size_t i, const FarPack& pack) { return checkPack((*rows)[i], pack, tell, visit) && !enough; });
}

}  // namespace repository
