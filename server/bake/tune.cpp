#include "server/bake/tune.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <string>

#include "base/check.h"
#include "base/egl/headless.h"
#include "base/format_text.h"
#include "base/parallel.h"
#include "base/picture_error.h"
#include "repository/faces/filler.h"
#include "server/bake/draw_memory.h"
#include "server/bake/face_encoder.h"
#include "server/bake/face_sample.h"

namespace server {
namespace {

constexpr std::size_t kSamplePixels = std::size_t{1} << 26;  // 470 MB with their filled copies
constexpr std::size_t kMinTuneFaces = 8;                     // a choice: a mean of fewer faces says little
constexpr int kBestQuality = 100;
// The first of those with equally few bytes is taken, so more chroma comes first.
constexpr std::array kSubsamplings = {base::Subsampling::k444, base::Subsampling::k422, base::Subsampling::k420};

/// A face with its filled background, which does not depend on quality.
struct PreparedFace {
  const base::Image* rgba = nullptr;
  base::Image filled;
};

struct FaceMeasurement {
  std::uint64_t jpeg_bytes = 0;
  base::PictureError error;  ///< sums of whole numbers, so threads may add in any order
};

std::vector<PreparedFace> prepare(const std::vector<base::Image>& faces, unsigned threads) {
  std::vector<PreparedFace> prepared(faces.size());
  base::parallelFor(faces.size(), threads, [&](std::size_t i) {
    prepared[i].rgba = &faces[i];
    prepared[i].filled = repository::fillBackground(faces[i], coverageMask(faces[i]));
  });
  return prepared;
}

base::Result<FaceMeasurement> measureFace(const PreparedFace& face, int quality, base::Subsampling subsampling) {
  LUMIGRID_ASSIGN_OR_RETURN(auto jpeg, base::encodeJpeg(face.filled, quality, subsampling));
  LUMIGRID_ASSIGN_OR_RETURN(auto back, base::decodeJpeg(jpeg));
  return FaceMeasurement{jpeg.size(), base::modelError(*face.rgba, back)};
}

base::Result<QualityMeasurement> measure(const std::vector<PreparedFace>& faces, int quality,
                                         base::Subsampling subsampling, unsigned threads) {
  std::vector<std::optional<base::Result<FaceMeasurement>>> measured(faces.size());
  base::parallelFor(faces.size(), threads,
                    [&](std::size_t i) { measured[i].emplace(measureFace(faces[i], quality, subsampling)); });
  FaceMeasurement sum;
  for (const auto& one : measured) {
    if (!*one) return one->error();
    sum.jpeg_bytes += (*one)->jpeg_bytes;
    sum.error.add((*one)->error);
  }
  return QualityMeasurement{sum.jpeg_bytes, sum.error.psnr()};
}

/// The lowest quality that reaches `psnr_db`; psnr_db of the result is less when none does.
base::Result<TuneChoice> lowestQuality(const std::vector<PreparedFace>& faces, double psnr_db,
                                       base::Subsampling subsampling, unsigned threads) {
  auto best = measure(faces, kBestQuality, subsampling, threads);
  if (!best) return best.error();
  int reaches = kBestQuality;
  int fails = 0;  // quality 0 is none
  while (best->psnr_db >= psnr_db && reaches - fails > 1) {
    const int middle = (reaches + fails) / 2;
    auto tried = measure(faces, middle, subsampling, threads);
    if (!tried) return tried.error();
    if (tried->psnr_db >= psnr_db) {
      reaches = middle;
      best = tried;
    } else {
      fails = middle;
    }
  }
  return TuneChoice{reaches, subsampling, best->psnr_db, best->jpeg_bytes, faces.size()};
}

/// The memory of the sample as it was drawn and as it is encoded, of the list of points that it is taken from, and of
/// the picture that each thread encodes and decodes.
std::uint64_t sampleBytes(const BakeOptions& options, std::size_t faces) {
  const repository::Grid& grid = options.grid;
  const std::uint64_t pixels = std::uint64_t{grid.imageSide()} * grid.imageSide();
  const std::uint64_t images = grid.isTiled() ? kTuneTiles : faces;
  return pixels * (7 * images + 16 * std::uint64_t{threadsOf(options)}) + grid.pointCount() * sizeof(glm::uvec3);
}

base::Result<std::vector<base::Image>> sampleImages(SceneRenderer& renderer, const BakeOptions& options,
                                                    std::size_t faces) {
  const RenderOptions render = renderOptions(options);
  return options.grid.isTiled() ? sampleTiles(renderer, options.grid, render, faces, kTuneTiles / faces)
                                : sampleFaces(renderer, options.grid, render, faces);
}

base::Error outOfReach(double psnr_db, double best_db) {
  return {base::ErrorCode::kInvalidInput,
          base::formatText("JPEG reaches %.2f dB at most on this scene's faces (quality 100, full chroma), not %g; ask "
                           "for less",
                           std::floor(best_db * 100.0) / 100.0, psnr_db)};
}

}  // namespace

std::size_t tuneFacesOf(std::uint32_t face_size) {
  const std::size_t pixels = std::max<std::size_t>(1, std::size_t{face_size} * face_size);
  return std::clamp(kSamplePixels / pixels, kMinTuneFaces, kTuneFaces);
}

base::Result<QualityMeasurement> measureQuality(const std::vector<base::Image>& faces, int quality,
                                                base::Subsampling subsampling, unsigned threads) {
  return measure(prepare(faces, threads), quality, subsampling, threads);
}

base::Result<TuneChoice> tuneQuality(const std::vector<base::Image>& faces, double psnr_db, unsigned threads) {
  LUMIGRID_CHECK(!faces.empty());
  const std::vector<PreparedFace> prepared = prepare(faces, threads);
  std::optional<TuneChoice> chosen;
  double best_db = 0.0;
  for (const base::Subsampling subsampling : kSubsamplings) {
    LUMIGRID_ASSIGN_OR_RETURN(auto lowest, lowestQuality(prepared, psnr_db, subsampling, threads));
    best_db = std::max(best_db, lowest.psnr_db);
    if (lowest.psnr_db >= psnr_db && (!chosen || lowest.jpeg_bytes < chosen->jpeg_bytes)) chosen = lowest;
  }
  if (!chosen) return outOfReach(psnr_db, best_db);
  return *chosen;
}

base::Result<TuneChoice> tuneScene(const base::Scene& scene, const lod::patch::PatchFile& patches,
                                   const BakeOptions& options, double psnr_db) {
  LUMIGRID_TRY(checkBakeOptions(options));
  LUMIGRID_ASSIGN_OR_RETURN(const auto context, base::HeadlessContext::create());
  const std::size_t wanted = tuneFacesOf(drawnSide(options.grid));
  DrawDemand demand{patches.hierarchy(), drawnSide(options.grid), renderOptions(options)};
  demand.shadow_bytes = PatchShadows::memoryFor(scene.light, scene.triangles);
  LUMIGRID_ASSIGN_OR_RETURN(
      const auto budget, limitSampling(demand, sampleBytes(options, wanted), options.limits.resolved().memory_bytes));
  LUMIGRID_ASSIGN_OR_RETURN(auto renderer, SceneRenderer::create(scene, patches, budget));
  LUMIGRID_ASSIGN_OR_RETURN(auto faces, sampleImages(*renderer, options, wanted));
  if (faces.empty())
    return base::Error{base::ErrorCode::kInvalidInput,
                       "none of the faces looked at shows the model; build without --tune, or with another --grid"};
  return tuneQuality(faces, psnr_db, options.limits.threads);
}

}  // namespace server
