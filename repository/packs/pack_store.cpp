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

constexpr std::uint64_t kIndexReadBytes = std::uint64_t{4} << 20;  // a check reads the index in ranges of this size
// A check reads so far ahead: room for eight packs of the usual 16 MB.
constexpr std::uint64_t kPrefetchBytes = std::uint64_t{128} << 20;

std::vector<FaceKey> keysOf(const PackTable& table) {
  std::vector<FaceKey> keys;
  for (const PackEntry& entry : table.entries)
    if (const auto key = FaceKey::fromCode(entry.code)) keys.push_back(*key);
  return keys;
}

bool matchesDigest(const ObjectId& id, const base::Sha256Digest& digest) {
  return std::equal(id.begin(), id.end(), digest.begin());
}

}  // namespace

Result<std::unique_ptr<PackStore>> PackStore::open(std::shared_ptr<const ObjectSource> source, const std::string& index,
                                                   const PackStoreOptions& options) {
  std::unique_ptr<PackStore> store(new PackStore(std::move(source), index, options));
  auto front = store->source_->read(index, 0, kIndexFrontBytes);
  if (!front) return front.error();
  auto root = decodeIndexRoot(*front);
  if (!root) return store->indexError(root.error());
  if (root->frontBytes() > front->size()) {
    front = store->source_->read(index, 0, root->frontBytes());
    if (!front) return front.error();
    root = decodeIndexRoot(*front);
    if (!root) return store->indexError(root.error());
  }
  store->root_ = *root;
  const ByteView text = ByteView(*front).subspan(parameterOffset(), root->parameter_bytes);
  if (auto checked = checkParameters(*root, text); !checked) return store->indexError(checked.error());
  store->parameters_.assign(text.begin(), text.end());
  return store;
}

Error PackStore::indexError(const Error& error) const {
  return base::within(source_->place() + "/" + index_, error);
}

// --- Finding

Result<PackStore::Block> PackStore::loadBlock(std::uint64_t number) const {
  {
    const std::lock_guard guard(mutex_);
    if (const Block* cached = blocks_.find(number)) return *cached;
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, source_->read(index_, root_.blockOffset(number), root_.bytesToRead(number)));
  auto decoded = decodeIndexBlock(root_, number, bytes);
  if (!decoded) return indexError(decoded.error());
  auto block = std::make_shared<const IndexBlock>(std::move(*decoded));

  const std::lock_guard guard(mutex_);
  blocks_.insert(number, block, block->bytes());
  blocks_.evict([](std::uint64_t) { return false; });
  return block;
}

Result<std::optional<FaceLocation>> PackStore::locate(const FaceKey& key) const {
  LUMIGRID_ASSIGN_OR_RETURN(auto found, loadBlock(blockOfCode(root_, key.code())));
  return found->find(key.code());
}

Result<std::optional<std::uint64_t>> PackStore::valueBytes(const FaceKey& key) const {
  LUMIGRID_ASSIGN_OR_RETURN(const auto location, locate(key));
  if (!location) return std::optional<std::uint64_t>();
  return std::optional<std::uint64_t>(location->length != 0 ? location->length : encodeFaceValue({}).size());
}

// --- Reading values

namespace {

Result<std::optional<Bytes>> checkedValue(const ObjectSource& source, const FaceLocation& location, const FaceKey& key,
                                          Bytes bytes) {
  if (auto value = decodeFaceValue(bytes); !value) {
    Error error = base::within(source.place() + "/" + packName(location.pack) + ": " + nameOf(key), value.error());
    error.message += "; publish it again with --rewrite";
    return error;
  }
  return std::optional(std::move(bytes));
}

}  // namespace

Result<std::optional<Bytes>> PackStore::get(const FaceKey& key) const {
  auto value = readValue(key);
  if (!value && error_listener_) error_listener_(value.error());
  return value;
}

Result<std::optional<Bytes>> PackStore::readValue(const FaceKey& key) const {
  LUMIGRID_ASSIGN_OR_RETURN(auto location, locate(key));
  if (!location.has_value()) return std::optional<Bytes>();
  if (location->length == 0) return std::optional(encodeFaceValue({}));
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, source_->read(packName(location->pack), location->offset, location->length));
  return checkedValue(*source_, *location, key, std::move(bytes));
}

struct PackStore::ValueRequest {
  FaceLocation location;
  std::size_t index;  // into the keys
  FaceKey key;
  std::uint64_t end() const { return location.offset + location.length; }
};

// The values of one pack that are read together. Those of a damaged index may overlap, so the last one need not end
// last.
struct PackStore::ValueRange {
  std::span<const ValueRequest> requests;
  std::uint64_t begin, end;
};

std::vector<PackStore::ValueRange> PackStore::rangesOf(std::span<const ValueRequest> requests) const {
  std::vector<ValueRange> ranges;
  for (std::size_t first = 0, next = 0; first < requests.size(); first = next) {
    const std::uint64_t begin = requests[first].location.offset;
    std::uint64_t end = requests[first].end();
    for (next = first + 1; next < requests.size(); ++next) {
      const ValueRequest& request = requests[next];
      if (request.location.pack != requests[first].location.pack ||
          request.location.offset > end + options_.gap_bytes || request.end() - begin > options_.range_bytes)
        break;
      end = std::max(end, request.end());
    }
    ranges.push_back({requests.subspan(first, next - first), begin, end});
  }
  return ranges;
}

PackStore::Values PackStore::getMany(const std::vector<FaceKey>& keys) const {
  loadBlocks(keys);
  Values out;
  out.reserve(keys.size());
  std::vector<ValueRequest> requests;
  for (std::size_t i = 0; i < keys.size(); ++i) {
    auto location = locate(keys[i]);
    if (!location) {
      out.emplace_back(location.error());
    } else if (!location->has_value()) {
      out.emplace_back(std::nullopt);
    } else {
      out.emplace_back(encodeFaceValue({}));
      if ((*location)->length != 0) requests.push_back({**location, i, keys[i]});
    }
  }
  std::sort(requests.begin(), requests.end(), [](const ValueRequest& a, const ValueRequest& b) {
    return std::tie(a.location.pack, a.location.offset) < std::tie(b.location.pack, b.location.offset);
  });
  const std::vector<ValueRange> ranges = rangesOf(requests);
  base::parallelFor(ranges.size(), options_.jobs, [&](std::size_t i) { readRange(ranges[i], out); });
  for (const auto& value : out)
    if (!value && error_listener_) error_listener_(value.error());
  return out;
}

// Loads the blocks that the keys need in parallel. locate() meets and reports the errors of those that fail.
void PackStore::loadBlocks(const std::vector<FaceKey>& keys) const {
  if (options_.jobs < 2) return;
  std::set<std::uint64_t> numbers;
  for (const FaceKey& key : keys) numbers.insert(blockOfCode(root_, key.code()));
  const std::vector<std::uint64_t> list(numbers.begin(), numbers.end());
  base::parallelFor(list.size(), options_.jobs, [&](std::size_t i) { (void)loadBlock(list[i]); });
}

void PackStore::readRange(const ValueRange& range, Values& out) const {
  const auto read_bytes =
      source_->read(packName(range.requests[0].location.pack), range.begin, range.end - range.begin);
  for (const ValueRequest& request : range.requests) {
    auto& value = out[request.index];
    if (read_bytes) {
      const ByteView bytes =
          ByteView(*read_bytes).subspan(request.location.offset - range.begin, request.location.length);
      value = checkedValue(*source_, request.location, request.key, Bytes(bytes.begin(), bytes.end()));
    } else if (read_bytes.error().code == ErrorCode::kInvalidInput && range.requests.size() > 1) {
      value = readValue(request.key);  // the pack is truncated, but some of its values may be whole
    } else {
      value = read_bytes.error();
    }
  }
}

Error PackStore::readOnlyError() const {
  return {ErrorCode::kUnsupported,
          source_->place() + ": published images cannot be changed; build a scene and publish it"};
}

// --- Walking over everything

Result<std::vector<PackRow>> PackStore::readPackRows() const {
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, source_->read(index_, root_.rowsOffset(), root_.packs * kPackRowBytes));
  auto rows = decodePackRows(root_, bytes);
  if (!rows) return indexError(rows.error());
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
  LUMIGRID_ASSIGN_OR_RETURN(auto rows, readPackRows());
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

// Checks the hash of the index, its counts and every block.
void PackStore::checkIndex(const ReportFault& fault) const {
  // The first range ends where the blocks begin, the next ones hold whole blocks, and the last one holds the rows.
  struct ByteRange {
    std::uint64_t offset, length;
  };
  std::vector<ByteRange> ranges{{0, root_.blocks_offset}};
  const std::uint64_t blocks_at_once = std::max<std::uint64_t>(1, kIndexReadBytes / root_.block_bytes);
  for (std::uint64_t number = 0; number < root_.blocks; number += blocks_at_once)
    ranges.push_back({root_.blockOffset(number), std::min(blocks_at_once, root_.blocks - number) * root_.block_bytes});
  ranges.push_back({root_.rowsOffset(), root_.packs * kPackRowBytes});

  base::Sha256 hash;
  std::uint64_t number = 0;
  std::uint64_t keys = 0;
  std::uint64_t empty = 0;
  std::uint64_t value_bytes = 0;
  bool blocks_are_good = true;
  bool all_was_read = true;
  const auto checkRange = [&](std::size_t i, const Result<Bytes>& bytes) {
    if (!bytes) fault(bytes.error().message);
    if (!bytes) return all_was_read = false;
    hash.add(*bytes);
    if (i == 0 || i + 1 == ranges.size()) return true;
    for (std::uint64_t at = 0; at < bytes->size(); at += root_.block_bytes) {
      const auto block = decodeIndexBlock(root_, number++, ByteView(*bytes).subspan(at, root_.block_bytes));
      if (block) {
        keys += block->keys();
        empty += block->emptyFlags();
        value_bytes += block->valueBytes();
      } else {
        fault(indexError(block.error()).message);
        blocks_are_good = false;
      }
    }
    return true;
  };
  prefetchInOrder(
      ranges.size(), prefetchLimits(), [&](std::size_t i) { return ranges[i].length; },
      [&](std::size_t i) { return source_->read(index_, ranges[i].offset, ranges[i].length); }, checkRange);
  if (!all_was_read) return;

  const std::string name = source_->place() + "/" + index_;
  if (blocks_are_good && (keys != root_.keys || empty != root_.empty))
    fault(name + ": its blocks hold " + std::to_string(keys) + " keys with " + std::to_string(empty) +
          " empty flags, its root says " + std::to_string(root_.keys) + " and " + std::to_string(root_.empty));
  if (blocks_are_good) checkTotals(value_bytes, fault);
  if (const auto id = idOfIndexName(index_); !id || !matchesDigest(*id, hash.finish()))
    fault(name + ": its SHA-256 is not the one in its name; publish it again with --rewrite");
  if (auto size = source_->size(index_); size && *size != root_.object_bytes)
    fault(name + ": has " + std::to_string(*size) + " bytes, its root says " + std::to_string(root_.object_bytes));
}

// Compares the root's totals, which `lumigrid info` shows, with the sum over the blocks.
void PackStore::checkTotals(std::uint64_t value_bytes, const ReportFault& fault) const {
  const ValueTotals& said = root_.totals;
  const bool parts_fit =
      said.jpeg_bytes <= said.value_bytes && said.coverage_bytes <= said.value_bytes - said.jpeg_bytes &&
      said.value_bytes - said.jpeg_bytes - said.coverage_bytes == kImageHeaderBytes * (root_.keys - root_.empty);
  if (said.value_bytes == value_bytes && parts_fit) return;
  fault(indexError({ErrorCode::kInvalidInput,
                    "its blocks hold " + std::to_string(value_bytes) + " bytes of values, its root says " +
                        std::to_string(said.value_bytes) + ", of them " + std::to_string(said.jpeg_bytes) +
                        " in JPEGs and " + std::to_string(said.coverage_bytes) +
                        " in masks; publish it again with --rewrite"})
            .message);
}

// Compares the location of each of a pack's faces in the index with the one in the pack's table.
void PackStore::compareLocations(const PackRow& row, const PackTable& table, const ReportFault& fault) const {
  std::uint64_t differ = 0;
  FaceKey first;
  loadBlocks(keysOf(table));
  for (std::size_t i = 0; i < table.entries.size(); ++i) {
    const auto key = FaceKey::fromCode(table.entries[i].code);
    if (!key) continue;
    const auto location = locate(*key);
    if (!location) continue;  // checkIndex has reported the block
    const PackEntry& entry = table.entries[i];
    const bool same = location->has_value() && (*location)->pack == row.id && (*location)->length == entry.length &&
                      (entry.length == 0 || (*location)->offset == table.offsets[i]);
    if (!same && differ++ == 0) first = *key;
  }
  if (differ != 0)
    fault(source_->place() + "/" + packName(row.id) + ": the index and this pack differ about " +
          std::to_string(differ) + " faces, the first is " + nameOf(first) + "; publish it again with --rewrite");
}

// Checks a pack's hash, table and values. Returns false when the check cannot go on.
bool PackStore::checkPack(const PackRow& row, const PackContent& pack, const ReportFault& fault,
                          const Visit& visit) const {
  const std::string name = source_->place() + "/" + packName(row.id);
  if (!pack.bytes) {
    fault(pack.bytes.error().message);
    if (pack.bytes.error().code != ErrorCode::kNetwork) return true;
    fault(source_->place() + ": what comes after that was not looked at; try again later");
    return false;
  }
  if (!pack.matches_name) fault(name + ": its SHA-256 is not the one in its name; publish it again with --rewrite");
  if (pack.size && *pack.size != row.bytes)
    fault(name + ": has " + std::to_string(*pack.size) + " bytes, the index says " + std::to_string(row.bytes));
  auto table = tableOf(row, *pack.bytes);
  if (!table) {
    fault(table.error().message);
    return true;
  }
  compareLocations(row, *table, fault);
  auto visited = visitPack(*table, *pack.bytes, visit);
  if (!visited) fault(visited.error().message);
  return !visited || *visited;
}

// Reads and hashes a pack; runs ahead of checkPack on other threads.
PackStore::PackContent PackStore::fetchPack(const PackRow& row) const {
  PackContent pack{source_->read(packName(row.id), 0, row.bytes), false, source_->size(packName(row.id))};
  pack.matches_name = pack.bytes && matchesDigest(row.id, base::sha256(*pack.bytes));
  return pack;
}

void PackStore::check(const std::function<bool(std::string)>& fault, const Visit& visit) const {
  bool enough = false;
  const ReportFault report = [&](std::string line) {
    if (!enough) enough = !fault(std::move(line));
  };
  checkIndex(report);
  if (enough) return;
  auto rows = readPackRows();
  if (!rows) return report(rows.error().message);
  prefetchInOrder(
      rows->size(), prefetchLimits(), [&](std::size_t i) { return (*rows)[i].bytes; },
      [&](std::size_t i) { return fetchPack((*rows)[i]); },
      [&](std::size_t i, const PackContent& pack) { return checkPack((*rows)[i], pack, report, visit) && !enough; });
}

}  // namespace repository
