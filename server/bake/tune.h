#pragma once
// Chooses the JPEG quality and subsampling that reach an asked accuracy on a scene's faces in the fewest bytes
// (`build --tune`).
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/error.h"
#include "base/image.h"
#include "base/jpeg/jpeg.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "server/bake/bake.h"

namespace server {

/// Faces that a choice is made on, up to 1024 pixels a side; fewer of larger ones, so that the sample fits in memory.
inline constexpr std::size_t kTuneFaces = 64;
/// Images that a choice is made on where faces are tiles: as many pixels.
inline constexpr std::size_t kTuneTiles = 1024;

struct TuneChoice {
  int quality = 0;  ///< 1..100
  base::Subsampling subsampling = base::Subsampling::k420;
  double psnr_db = 0.0;          ///< reached on the sample, at least the asked one
  std::uint64_t jpeg_bytes = 0;  ///< bytes of the whole sample; masks are the same at every quality
  std::size_t faces = 0;         ///< images in the sample: faces, or tiles
  friend bool operator==(const TuneChoice&, const TuneChoice&) = default;
};

/// The cost and the accuracy of one quality and subsampling. The PSNR is that of the mean squared error over the red,
/// green and blue of all pixels stored as model, of all faces together: a face weighs what it shows, and filler
/// nothing. 99 dB where every pixel comes back the same.
struct QualityMeasurement {
  std::uint64_t jpeg_bytes = 0;
  double psnr_db = 0.0;
};
base::Result<QualityMeasurement> measureQuality(const std::vector<base::Image>& faces, int quality,
                                                base::Subsampling subsampling, unsigned threads);

/// Finds for each subsampling the lowest quality that reaches `psnr_db` (by bisection: more quality is taken to come
/// nearer), and returns the one of fewest bytes of these; among equals the one with more chroma. `faces`: as
/// RenderedPicture::rgba, each shows something, not none. The same on any number of threads (0: all cores).
/// kInvalidInput when quality 100 does not reach it; the message says how far it comes.
base::Result<TuneChoice> tuneQuality(const std::vector<base::Image>& faces, double psnr_db, unsigned threads);

/// Calls tuneQuality() for a sample of the scene's own faces (sampleFaces, tuneFacesOf) or of their tiles
/// (sampleTiles), drawn as options say; their quality and subsampling do not matter. kInvalidInput when no face shows
/// the model; kNoSpace as bake().
base::Result<TuneChoice> tuneScene(const base::Scene& scene, const lod::patch::PatchFile& patches,
                                   const BakeOptions& options, double psnr_db);

/// Faces of `face_size` pixels in a sample: kTuneFaces, or as many as 64 Mi pixels hold, at least 8.
std::size_t tuneFacesOf(std::uint32_t face_size);

}  // namespace server
