#include "server/bake/image_sizes.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include "repository/sampling/key.h"
#include "repository/sampling/sample_tree.h"
#include "server/bake/draw_memory.h"
#include "server/bake/face_encoder.h"
#include "server/bake/face_sample.h"

namespace server {
namespace {

/// Points that an estimate draws at most, of faces of 512 pixels: 384 faces, which take some seconds with software GL.
/// Tiled faces have many times the pixels, and their sizes are known by the tile.
constexpr std::size_t kEstimatePoints = 64;
constexpr std::size_t kEstimateTiledPoints = 16;
constexpr double kStandardErrors = 2.0;  // above the mean: a normal variable is higher in 2.3 % of cases

// Orders points as if at random, but the same everywhere (SplitMix64's finalizer; Steele, Lea, Flood 2014): the points
// that come first are a random sample of any set, and of its subsets too.
std::uint64_t shuffled(std::uint64_t code) {
  code = (code ^ code >> 30) * 0xBF58476D1CE4E5B9U;
  code = (code ^ code >> 27) * 0x94D049BB133111EBU;
  return code ^ code >> 31;
}

repository::FaceKey faceAt(const glm::uvec3& point, std::uint32_t d) {
  return {point.x, point.y, point.z, d};
}

/// How many images of a point may be stored.
std::uint64_t wantedAt(const glm::uvec3& point, const repository::WantedTiles* wanted) {
  if (wanted == nullptr) return 1;
  std::uint64_t count = 0;
  for (std::uint32_t d = 0; d < 6; ++d) count += wanted->ofFace(faceAt(point, d)).size();
  return count;
}

}  // namespace

base::Result<std::unique_ptr<ImageSizes>> ImageSizes::create(const base::Scene& scene,
                                                             const lod::patch::PatchFile& patches,
                                                             const BakeOptions& options) {
  std::unique_ptr<ImageSizes> sizes(new ImageSizes(options));
  LUMIGRID_ASSIGN_OR_RETURN(sizes->context_, base::HeadlessContext::create());
  DrawDemand demand{patches.hierarchy(), drawnSide(options.grid), renderOptions(options)};
  demand.shadow_bytes = PatchShadows::memoryFor(scene.light, scene.triangles);
  LUMIGRID_ASSIGN_OR_RETURN(const auto budget, limitSampling(demand, 0, options.limits.resolved().memory_bytes));
  LUMIGRID_ASSIGN_OR_RETURN(sizes->renderer_, SceneRenderer::create(scene, patches, budget));
  return sizes;
}

base::Result<std::uint64_t> ImageSizes::estimate(const std::vector<glm::uvec3>& points,
                                                 const repository::WantedTiles* wanted) {
  if (points.empty()) return std::uint64_t{0};
  const std::vector<glm::uvec3> sample = sampleOf(points);
  LUMIGRID_TRY(measure(sample));
  std::vector<double> bytes, counts;
  double sum = 0.0, count = 0.0;
  for (const glm::uvec3& point : sample) {
    double of_point = 0.0;
    for (const auto& [code, size] : sizes_.at(repository::codeOfPoint(point))) {
      const auto key = repository::FaceKey::fromCode(code);
      if (wanted == nullptr || (key && wanted->has(*key))) of_point += static_cast<double>(size);
    }
    bytes.push_back(of_point);
    counts.push_back(static_cast<double>(wantedAt(point, wanted)));
    sum += of_point;
    count += counts.back();
  }
  if (sample.size() == points.size()) return static_cast<std::uint64_t>(sum);

  // The ratio of two sums over a sample without replacement (Cochran 1977, section 6.4): bytes over images that may be
  // stored, which are known of all points. Where every point counts as one it is the mean.
  double all_counts = 0.0;
  for (const glm::uvec3& point : points) all_counts += static_cast<double>(wantedAt(point, wanted));
  const double ratio = sum / count;
  const auto n = static_cast<double>(sample.size());
  const auto all = static_cast<double>(points.size());
  double squares = 0.0;
  for (std::size_t i = 0; i < sample.size(); ++i) squares += std::pow(bytes[i] - ratio * counts[i], 2.0);
  const double standard_error = all * std::sqrt(squares / (n - 1.0) / n * (1.0 - n / all));
  return static_cast<std::uint64_t>(ratio * all_counts + kStandardErrors * standard_error);
}

std::vector<glm::uvec3> ImageSizes::sampleOf(std::vector<glm::uvec3> points) const {
  const std::size_t count = std::min(points.size(), options_.grid.isTiled() ? kEstimateTiledPoints : kEstimatePoints);
  std::partial_sort(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(count), points.end(),
                    [](const auto& a, const auto& b) {
                      return shuffled(repository::codeOfPoint(a)) < shuffled(repository::codeOfPoint(b));
                    });
  points.resize(count);
  return points;
}

base::Result<void> ImageSizes::measure(const std::vector<glm::uvec3>& points) {
  std::optional<base::Error> failed;
  for (const glm::uvec3& point : points) {
    const auto [sizes, is_new] = sizes_.try_emplace(repository::codeOfPoint(point));
    if (!is_new) continue;
    std::vector<repository::FaceKey> keys;
    for (std::uint32_t d = 0; d < 6; ++d) keys.push_back(faceAt(point, d));
    const auto add = [this, &failed, &keys, of_point = &sizes->second](std::size_t i, RenderedPicture rendered) {
      const auto face =
          encodeFace(rendered.rgba, {options_.quality, options_.subsampling, options_.grid.tile_depth, options_.codec});
      if (!face) {
        failed = face.error();
        return;
      }
      for (const EncodedTile& tile : face->tiles)
        of_point->emplace_back(keys[i].code() | tile.tile, std::uint64_t{tile.value.size()});
    };
    LUMIGRID_TRY(renderer_->renderMany(faceCameras(*renderer_, options_.grid, keys), renderOptions(options_), add));
    LUMIGRID_TRY(renderer_->finish());
  }
  return failed ? base::Result<void>(*failed) : base::Result<void>();
}

}  // namespace server
