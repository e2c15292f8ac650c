#include "repository/verify.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "base/parallel.h"
#include "repository/coverage.h"
#include "repository/face_value.h"
#include "repository/jpeg.h"

namespace repository {
namespace {

constexpr std::size_t kPortion = 256;  // values decoded side by side

std::string nameOf(const FaceKey& key) {
  return "face (" + std::to_string(key.x) + ", " + std::to_string(key.y) + ", " + std::to_string(key.z) + ", " +
         std::to_string(key.d) + ")";
}

// What is wrong with one value; nothing when it is well.
std::optional<std::string> faultOf(const FaceKey& key, base::ByteView bytes, std::uint32_t face_size) {
  const auto value = decodeFaceValue(bytes);
  if (!value) return nameOf(key) + ": " + value.error().message;
  if (value->empty) return std::nullopt;

  const int side = static_cast<int>(face_size);
  const auto image = decodeJpeg(value->jpeg, side);
  if (!image) return nameOf(key) + ": " + image.error().message;
  if (image->width != side || image->height != side) {
    return nameOf(key) + ": a picture of " + std::to_string(image->width) + " x " + std::to_string(image->height) +
           " pixels, not " + std::to_string(side);
  }
  const auto mask = decodeCoverage(value->coverage, side, side);
  if (!mask) return nameOf(key) + ": " + mask.error().message;
  return std::nullopt;
}

// Walks the keys that a grid should have beside those that the store has.
class Verifier {
 public:
  Verifier(const Grid& grid, const SampleTree* tree, unsigned threads)
      : grid_(grid),
        tree_(tree),
        threads_(threads),
        points_(tree != nullptr ? tree->points() : pointsInMortonOrder(grid)) {}

  bool take(const FaceKey& key, base::ByteView bytes) {
    if (!grid_.contains(key)) {
      say(nameOf(key) + ": not a face of this grid");
    } else if (tree_ != nullptr && !tree_->hasPoint({key.x, key.y, key.z})) {
      say(nameOf(key) + ": not at a sampling point");
    } else {
      missUpTo(indexOf(key));
      ++expected_;
      portion_.emplace_back(key, base::Bytes(bytes.begin(), bytes.end()));
      if (portion_.size() == kPortion) decodePortion();
    }
    return faults_.size() < kMostFaults;
  }
  std::vector<std::string> finish() {
    decodePortion();
    if (faults_.size() < kMostFaults) missUpTo(6 * points_.size());
    return std::move(faults_);
  }

 private:
  void say(std::string fault) { faults_.push_back(std::move(fault)); }
  FaceKey keyAt(std::uint64_t index) const {
    const glm::uvec3& point = points_[index / 6];
    return {point.x, point.y, point.z, static_cast<std::uint32_t>(index % 6)};
  }
  // Keys come in order, so the place is never before the last one.
  std::uint64_t indexOf(const FaceKey& key) const {
    const auto less = [](const glm::uvec3& a, const FaceKey& b) {
      return FaceKey{a.x, a.y, a.z, 0} < FaceKey{b.x, b.y, b.z, 0};
    };
    const auto from =
        points_.begin() + static_cast<std::ptrdiff_t>(std::min<std::uint64_t>(expected_ / 6, points_.size()));
    const auto at = std::lower_bound(from, points_.end(), key, less);
    return 6 * static_cast<std::uint64_t>(at - points_.begin()) + key.d;
  }
  void missUpTo(std::uint64_t index) {
    if (index <= expected_) return;
    const std::uint64_t count = index - expected_;
    say(nameOf(keyAt(expected_)) +
        (count == 1 ? ": missing" : " and the " + std::to_string(count - 1) + " after it in Morton order: missing"));
    expected_ = index;
  }
  void decodePortion() {
    std::vector<std::optional<std::string>> found(portion_.size());
    base::parallelFor(portion_.size(), threads_, [&](std::size_t i) {
      found[i] = faultOf(portion_[i].first, portion_[i].second, grid_.face_size);
    });
    for (auto& fault : found) {
      if (fault) say(std::move(*fault));
    }
    portion_.clear();
  }

  const Grid& grid_;
  const SampleTree* tree_;
  unsigned threads_;
  std::vector<glm::uvec3> points_;
  std::uint64_t expected_ = 0;  // index, in Morton order, of the next face that should come
  std::vector<std::pair<FaceKey, base::Bytes>> portion_;
  std::vector<std::string> faults_;
};

std::vector<std::string> atMost(std::vector<std::string> faults) {
  if (faults.size() < kMostFaults) return faults;
  faults.resize(kMostFaults);
  faults.emplace_back("and perhaps more: stopped at " + std::to_string(kMostFaults) + " faults");
  return faults;
}

}  // namespace

base::Result<std::vector<std::string>> verify(const Store& store, const Grid& grid, const SampleTree* tree,
                                              unsigned threads) {
  Verifier verifier(grid, tree, threads);
  LUMIGRID_TRY(store.forEach([&](const FaceKey& key, base::ByteView bytes) { return verifier.take(key, bytes); }));
  return atMost(verifier.finish());
}

std::vector<std::string> verify(const PackStore& packs, const Grid& grid, const SampleTree* tree, unsigned threads) {
  Verifier verifier(grid, tree, threads);
  std::vector<std::string> faults;
  packs.check(
      [&](std::string fault) {
        if (faults.size() < kMostFaults) faults.push_back(std::move(fault));
      },
      [&](const FaceKey& key, base::ByteView bytes) { return verifier.take(key, bytes); });
  for (std::string& fault : verifier.finish()) faults.push_back(std::move(fault));
  return atMost(std::move(faults));
}

base::Result<Contents> contentsOf(const Store& store) {
  Contents contents;
  LUMIGRID_TRY(store.forEach([&](const FaceKey&, base::ByteView bytes) {
    ++contents.faces;
    const auto value = decodeFaceValue(bytes);
    if (!value) {
      ++contents.unreadable;
    } else if (value->empty) {
      ++contents.empty;
    } else {
      contents.jpeg_bytes += value->jpeg.size();
      contents.coverage_bytes += value->coverage.size();
    }
    return true;
  }));
  return contents;
}

}  // namespace repository
