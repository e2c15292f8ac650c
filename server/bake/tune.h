#pragma once
// Which JPEG quality and subsampling reaches an asked accuracy on a scene's faces in the fewest bytes (`build --tune`).
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/error.h"
#include "base/image.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "repository/faces/jpeg.h"
#include "server/bake/bake.h"

namespace server {

/// Faces of 512 or 1024 pixels that a choice is made on; fewer of larger ones, so that the sample fits in memory.
inline constexpr std::size_t kTuneFaces = 64;

struct TuneChoice {
  int quality = 0;  ///< 1..100
  repository::Subsampling subsampling = repository::Subsampling::k420;
  double psnr_db = 0.0;          ///< reached on the sample, at least the asked one
  std::uint64_t jpeg_bytes = 0;  ///< of the whole sample; masks are the same at every quality
  std::size_t faces = 0;         ///< in the sample
  friend bool operator==(const TuneChoice&, const TuneChoice&) = default;
};

/// What one quality and subsampling costs, and how near it comes. The PSNR is that of the mean squared error over the
/// red, green and blue of all pixels stored as model, of all faces together: a face weighs what it shows, and filler
/// nothing. 99 dB where every pixel comes back the same.
struct TunePoint {
  std::uint64_t jpeg_bytes = 0;
  double psnr_db = 0.0;
};
base::Result<TunePoint> measureQuality(const std::vector<base::Image>& faces, int quality,
                                       repository::Subsampling subsampling, unsigned threads);

/// For each subsampling the lowest quality that reaches `psnr_db` (by bisection: more quality is taken to come nearer),
/// of these the one of fewest bytes; among equals the one with more chroma. `faces`: as RenderedPicture::rgba, each
/// shows something, not none. The same on any number of threads (0: all cores). kInvalidInput when quality 100 does not
/// reach it; the message says how far it comes.
base::Result<TuneChoice> tuneQuality(const std::vector<base::Image>& faces, double psnr_db, unsigned threads);

/// tuneQuality() on a sample of the scene's own faces (sampleFaces, tuneFacesOf), drawn as options say; their quality
/// and subsampling are not looked at. kInvalidInput when no face shows the model; kNoSpace as bake().
base::Result<TuneChoice> tuneScene(const base::Scene& scene, const lod::patch::PatchFile& patches,
                                   const BakeOptions& options, double psnr_db);

/// Faces of `face_size` pixels in a sample: kTuneFaces, or as many as 64 Mi pixels hold, at least 8.
std::size_t tuneFacesOf(std::uint32_t face_size);

}  // namespace server
