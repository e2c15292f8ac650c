#include "repository/verify.h"

#include <functional>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "repository/faces/face_image.h"
#include "repository/faces/face_value.h"
#include "repository/sampling/expected_points.h"
#include "repository/sampling/face_tiles.h"

namespace repository {
namespace {

constexpr std::size_t kPortion = 256;  // values decoded in parallel: enough for every core, a few MB of memory

// A line that says why the value cannot be decoded; nothing when it can.
std::optional<std::string> decodingFault(const FaceKey& key, base::ByteView bytes, std::uint32_t face_size) {
  const auto pixels = decodeFacePixels(bytes, static_cast<int>(face_size));
  if (!pixels) return nameOf(key) + ": " + pixels.error().message;
  return std::nullopt;
}

// A line that says why the store should not hold this key; nothing when it should.
std::optional<std::string> orphanFault(const FaceKey& key, const Grid& grid, const Shard& shard,
                                       const ExpectedPoints& points) {
  if (!grid.contains(key)) return nameOf(key) + ": not a face of this grid";
  if (points.placeOf({key.x, key.y, key.z})) return std::nullopt;
  if (shard.count == 1) return nameOf(key) + ": not at a sampling point";
  return nameOf(key) + ": does not belong to shard " + std::to_string(shard.index) + " of " +
         std::to_string(shard.count);
}

enum class FaultKind { kOrphan, kDamaged, kMissing };
using ReportFault = std::function<void(const FaceKey&, FaultKind, std::string)>;

// Reports tiles that no stored tile of their face names, and those that are named and not stored. Faces with a damaged
// value are left out, since nobody knows what it named.
class TileChecker {
 public:
  explicit TileChecker(ReportFault report) : report_(std::move(report)) {}

  /// Keys come in ascending order.
  void addTile(const FaceKey& key, base::ByteView bytes) {
    if (!face_ || *face_ != key.face()) {
      finish();
      face_ = key.face();
    }
    const auto value = decodeFaceValue(bytes);
    if (!value) sound_ = false;
    if (!sound_ || tiles_.add(key.tile, value->children)) return;
    report_(key, FaultKind::kOrphan, nameOf(key) + ": no other tile of its face names it");
  }
  void finish() {
    if (face_ && sound_)
      for (const std::uint32_t tile : tiles_.missing()) {
        FaceKey key = *face_;
        key.tile = tile;
        report_(key, FaultKind::kMissing, nameOf(key) + ": missing, others of its face are here");
      }
    face_.reset();
    tiles_ = {};
    sound_ = true;
  }

 private:
  const ReportFault report_;
  std::optional<FaceKey> face_;
  FaceTiles tiles_;
  bool sound_ = true;
};

// Receives every value of a store in the order of keys, decodes them in parallel and reports faults to `report`.
class ValueChecker {
 public:
  ValueChecker(const Grid& grid, const Shard& shard, const ExpectedPoints& points, unsigned threads, ReportFault report)
      : grid_(grid), shard_(shard), points_(points), threads_(threads), report_(std::move(report)), tiles_(report_) {}

  /// Returns whether this store should have the key.
  bool addValue(const FaceKey& key, base::ByteView bytes) {
    if (auto orphan = orphanFault(key, grid_, shard_, points_)) {
      report_(key, FaultKind::kOrphan, std::move(*orphan));
      return false;
    }
    tiles_.addTile(key, bytes);
    portion_.emplace_back(key, base::Bytes(bytes.begin(), bytes.end()));
    if (portion_.size() == kPortion) decodePortion();
    return true;
  }
  void finish() {
    decodePortion();
    tiles_.finish();
  }

 private:
  void decodePortion() {
    std::vector<std::optional<std::string>> faults(portion_.size());
    base::parallelFor(portion_.size(), threads_, [&](std::size_t i) {
      faults[i] = decodingFault(portion_[i].first, portion_[i].second, grid_.imageSide());
    });
    for (std::size_t i = 0; i < faults.size(); ++i) {
      if (faults[i]) report_(portion_[i].first, FaultKind::kDamaged, std::move(*faults[i]));
    }
    portion_.clear();
  }

  const Grid& grid_;
  const Shard shard_;
  const ExpectedPoints& points_;
  const unsigned threads_;
  const ReportFault report_;
  TileChecker tiles_;
  std::vector<std::pair<FaceKey, base::Bytes>> portion_;
};

std::string describeGap(const Gap& gap) {
  return nameOf(gap.first) + (gap.faces == 1
                                  ? ": missing"
                                  : " and the " + std::to_string(gap.faces - 1) + " after it in Morton order: missing");
}

// Collects the faults of a store as lines: first those of its values, then its missing faces.
class Verifier {
 public:
  Verifier(const Grid& grid, const Shard& shard, const SampleTree* tree, unsigned threads)
      : points_(grid, shard, tree),
        checker_(grid, shard, points_, threads,
                 [this](const FaceKey&, FaultKind, std::string fault) { faults_.push_back(std::move(fault)); }),
        gaps_(points_) {}

  /// Returns false when there are enough faults.
  bool addValue(const FaceKey& key, base::ByteView bytes) {
    if (checker_.addValue(key, bytes)) gaps_.addPresentKey(key);
    return !enough();
  }
  std::vector<std::string> finish() {
    checker_.finish();
    if (!enough()) gaps_.finish();
    for (const Gap& gap : gaps_.gaps()) faults_.push_back(describeGap(gap));
    return std::move(faults_);
  }

 private:
  bool enough() const { return faults_.size() + gaps_.found() >= kMaxFaults; }

  const ExpectedPoints points_;
  std::vector<std::string> faults_;
  ValueChecker checker_;
  GapFinder gaps_;
};

std::vector<std::string> limitFaults(std::vector<std::string> faults) {
  if (faults.size() < kMaxFaults) return faults;
  faults.resize(kMaxFaults);
  faults.emplace_back("and perhaps more: stopped at " + std::to_string(kMaxFaults) + " faults");
  return faults;
}

}  // namespace

base::Result<std::vector<std::string>> verify(const Store& store, const Grid& grid, const SampleTree* tree,
                                              unsigned threads, const Shard& shard) {
  Verifier verifier(grid, shard, tree, threads);
  LUMIGRID_TRY(store.forEach([&](const FaceKey& key, base::ByteView bytes) { return verifier.addValue(key, bytes); }));
  return limitFaults(verifier.finish());
}

std::vector<std::string> verify(const PackStore& packs, const Grid& grid, const SampleTree* tree, unsigned threads,
                                const std::function<bool(std::uint64_t values)>& progress) {
  Verifier verifier(grid, {0, 1}, tree, threads);
  std::vector<std::string> faults;
  std::uint64_t values = 0;
  packs.check(
      [&](std::string fault) {
        faults.push_back(std::move(fault));
        return faults.size() < kMaxFaults;
      },
      [&](const FaceKey& key, base::ByteView bytes) {
        return verifier.addValue(key, bytes) && (++values % kPortion != 0 || !progress || progress(values));
      });
  for (std::string& fault : verifier.finish()) faults.push_back(std::move(fault));
  return limitFaults(std::move(faults));
}

base::Result<RemovalCounts> removeFaulty(Store& store, const Grid& grid, const Shard& shard, const SampleTree* tree,
                                         unsigned threads) {
  RemovalCounts removed;
  std::vector<FaceKey> keys;
  const ExpectedPoints points(grid, shard, tree);
  ValueChecker checker(grid, shard, points, threads, [&](const FaceKey& key, FaultKind kind, const std::string&) {
    if (kind == FaultKind::kMissing) return;
    keys.push_back(key);
    ++(kind == FaultKind::kOrphan ? removed.orphans : removed.damaged);
  });
  LUMIGRID_TRY(store.forEach([&](const FaceKey& key, base::ByteView bytes) {
    checker.addValue(key, bytes);
    return true;
  }));
  checker.finish();
  if (!keys.empty()) LUMIGRID_TRY(store.erase(keys));
  return removed;
}

base::Result<StoreContents> contentsOf(const Store& store) {
  StoreContents contents;
  std::optional<FaceKey> face;
  LUMIGRID_TRY(store.forEach([&](const FaceKey& key, base::ByteView bytes) {
    ++contents.values;
    contents.faces += face != key.face() ? 1U : 0U;
    face = key.face();
    const auto value = decodeFaceValue(bytes);
    if (!value) {
      ++contents.unreadable;
    } else if (value->empty) {
      ++contents.empty;
    } else {
      contents.jpeg_bytes += value->picture.size();
      contents.coverage_bytes += value->coverage.size();
    }
    return true;
  }));
  return contents;
}

}  // namespace repository
