#include "server/bake/image_bytes.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "server/bake/draw_memory.h"
#include "server/bake/face_encoder.h"
#include "server/bake/face_sample.h"

namespace server {
namespace {

constexpr double kStandardErrors = 2.0;  // above the mean: a normal variable is higher in 2.3 % of cases

// Orders points as if at random, but the same everywhere (SplitMix64's finalizer; Steele, Lea, Flood 2014): the points
// that come first are a random sample of any set, and of its subsets too.
std::uint64_t shuffled(std::uint64_t code) {
  code = (code ^ code >> 30) * 0xBF58476D1CE4E5B9U;
  code = (code ^ code >> 27) * 0x94D049BB133111EBU;
  return code ^ code >> 31;
}

std::vector<glm::uvec3> sampleOf(std::vector<glm::uvec3> points) {
  const std::size_t count = std::min(points.size(), kEstimatePoints);
  std::partial_sort(points.begin(), points.begin() + static_cast<std::ptrdiff_t>(count), points.end(),
                    [](const auto& a, const auto& b) {
                      return shuffled(repository::codeOfPoint(a)) < shuffled(repository::codeOfPoint(b));
                    });
  points.resize(count);
  return points;
}

}  // namespace

base::Result<std::unique_ptr<ImageBytes>> ImageBytes::create(const base::Scene& scene,
                                                             const lod::patch::PatchFile& patches,
                                                             const BakeOptions& options) {
  std::unique_ptr<ImageBytes> bytes(new ImageBytes(options));
  LUMIGRID_ASSIGN_OR_RETURN(bytes->context_, base::HeadlessContext::create());
  LUMIGRID_ASSIGN_OR_RETURN(const auto budget,
                            limitSampling({patches.hierarchy(), options.grid.face_size, renderOptions(options)}, 0,
                                          options.limits.resolved().memory_bytes));
  LUMIGRID_ASSIGN_OR_RETURN(bytes->renderer_, SceneRenderer::create(scene, patches, budget));
  return bytes;
}

base::Result<std::uint64_t> ImageBytes::estimate(const std::vector<glm::uvec3>& points) {
  if (points.empty()) return std::uint64_t{0};
  const std::vector<glm::uvec3> sample = sampleOf(points);
  LUMIGRID_TRY(measure(sample));
  double sum = 0.0;
  double squares = 0.0;
  for (const glm::uvec3& point : sample) {
    const auto bytes = static_cast<double>(bytes_.at(repository::codeOfPoint(point)));
    sum += bytes;
    squares += bytes * bytes;
  }
  if (sample.size() == points.size()) return static_cast<std::uint64_t>(sum);
  // The mean of a sample without replacement (Cochran 1977, section 2.6).
  const auto n = static_cast<double>(sample.size());
  const auto all = static_cast<double>(points.size());
  const double mean = sum / n;
  const double variance = std::max(0.0, (squares - n * mean * mean) / (n - 1.0));
  const double standard_error = std::sqrt(variance / n * (1.0 - n / all));
  return static_cast<std::uint64_t>(all * (mean + kStandardErrors * standard_error));
}

base::Result<void> ImageBytes::measure(const std::vector<glm::uvec3>& points) {
  std::optional<base::Error> failed;
  for (const glm::uvec3& point : points) {
    const auto [bytes, is_new] = bytes_.try_emplace(repository::codeOfPoint(point), 0);
    if (!is_new) continue;
    std::vector<repository::FaceKey> keys;
    for (std::uint32_t d = 0; d < 6; ++d) keys.push_back({point.x, point.y, point.z, d});
    const auto add = [this, &failed, sum = &bytes->second](std::size_t, RenderedPicture rendered) {
      const auto face = encodeFace(rendered.rgba, options_.quality, options_.subsampling);
      if (face)
        *sum += face->value.size();
      else
        failed = face.error();
    };
    LUMIGRID_TRY(renderer_->renderMany(faceCameras(*renderer_, options_.grid, keys), renderOptions(options_), add));
  }
  LUMIGRID_TRY(renderer_->finish());
  return failed ? base::Result<void>(*failed) : base::Result<void>();
}

}  // namespace server
