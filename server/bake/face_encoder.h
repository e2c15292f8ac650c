#pragma once
// Encodes rendered faces as the values that are stored (repository/faces/face_image.h decodes them).
#include <cstdint>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"
#include "base/jpeg/jpeg.h"
#include "base/view_defaults.h"
#include "repository/faces/face_value.h"

namespace server {

/// One image as it is stored.
struct EncodedImage {
  base::Bytes value;  ///< repository::encodeFaceValue
  bool empty = true;
  std::uint64_t jpeg_bytes = 0;  ///< of the picture, whatever its codec
  std::uint64_t coverage_bytes = 0;
};

/// Alpha from which a pixel of a face is stored as model. Images carve the proxy where they agree on background, so a
/// pixel is background only where nothing crosses it: with half of a pixel, as pictures have it, lines thinner than a
/// texel vanished from the proxy (docs/decisions/edges.md). Coarse tiles average 4 × 4 pixels of finer ones at least.
inline constexpr std::uint8_t kStoredCoverage = 16;

/// How a bake encodes its faces.
struct FaceCoding {
  int quality = base::ViewDefaults::kQuality;               ///< 1..100
  base::Subsampling subsampling = base::Subsampling::k420;  ///< of JPEG
  std::uint32_t tile_depth = 0;                             ///< depth of the finest tiles; 0: a face is one image
  repository::ImageCodec codec = repository::ImageCodec::kJpeg;
  const std::vector<std::uint32_t>* wanted = nullptr;  ///< as chooseTiles() has it
};

struct EncodedTile {
  std::uint32_t tile = 0;
  base::Bytes value;
};

/// A face as it is stored: its tiles, ascending by number, of which a plain face has number 0 alone.
struct EncodedFace {
  std::vector<EncodedTile> tiles;
  bool empty = true;
  std::uint64_t jpeg_bytes = 0;  ///< of all tiles together
  std::uint64_t coverage_bytes = 0;

  std::uint64_t valueBytes() const;
};

/// A mask of one channel: 255 where a pixel of `rgba` (as RenderedPicture::rgba) has `least_alpha`, else 0.
base::Image coverageMask(const base::Image& rgba, std::uint8_t least_alpha = kStoredCoverage);
/// Tells whether any pixel is stored as model. If not, an image is an empty flag.
bool showsModel(const base::Image& rgba, std::uint8_t least_alpha = kStoredCoverage);

/// `rgba` with another alpha (one channel), and filler where that is 0 (repository/faces/filler.h): as WebP is coded.
base::Image withAlpha(const base::Image& rgba, const base::Image& alpha);

/// `rgba`: as RenderedPicture::rgba; `children`: as repository::FaceValue::children; `least_alpha`: from which on a
/// pixel is model. Without a pixel of model and without children the value is an empty flag. The same picture gives the
/// same bytes on every thread and machine with the same libjpeg-turbo.
base::Result<EncodedImage> encodeImage(const base::Image& rgba, int quality, base::Subsampling subsampling,
                                       std::uint8_t children = 0, std::uint8_t least_alpha = kStoredCoverage);

/// The same as WebP, whose alpha, without loss, is the mask.
base::Result<EncodedImage> encodeWebpImage(const base::Image& rgba, int quality, std::uint8_t children = 0);

/// `rgba`: a face as it was drawn, that of repository::wholeFaceCamera() where it is to be cut into tiles; then those
/// tiles are encoded that chooseTiles() chooses. An image without pixels shows nothing. As reproducible as
/// encodeImage().
base::Result<EncodedFace> encodeFace(const base::Image& rgba, const FaceCoding& coding);

}  // namespace server
