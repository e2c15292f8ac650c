#include "server/bake/face_encoder.h"

#include <algorithm>
#include <utility>

#include "base/check.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"
#include "repository/faces/filler.h"
#include "repository/faces/webp.h"
#include "server/bake/face_pyramid.h"

namespace server {

std::uint64_t EncodedFace::valueBytes() const {
  std::uint64_t bytes = 0;
  for (const EncodedTile& tile : tiles) bytes += tile.value.size();
  return bytes;
}

base::Image coverageMask(const base::Image& rgba, std::uint8_t least_alpha) {
  base::Image mask(rgba.width, rgba.height, 1);
  for (std::size_t i = 0; i < mask.pixels.size(); ++i) mask.pixels[i] = rgba.pixels[4 * i + 3] >= least_alpha ? 255 : 0;
  return mask;
}

bool showsModel(const base::Image& rgba, std::uint8_t least_alpha) {
  for (std::size_t i = 3; i < rgba.pixels.size(); i += 4)
    if (rgba.pixels[i] >= least_alpha) return true;
  return false;
}

base::Image withAlpha(const base::Image& rgba, const base::Image& alpha) {
  const base::Image filled = repository::fillBackground(rgba, alpha);
  base::Image result(rgba.width, rgba.height, 4);
  for (std::size_t i = 0; i < alpha.pixels.size(); ++i) {
    std::copy_n(&filled.pixels[3 * i], 3, &result.pixels[4 * i]);
    result.pixels[4 * i + 3] = alpha.pixels[i];
  }
  return result;
}

base::Result<EncodedImage> encodeImage(const base::Image& rgba, int quality, base::Subsampling subsampling,
                                       std::uint8_t children, std::uint8_t least_alpha) {
  LUMIGRID_CHECK_EQ(rgba.channels, 4);
  EncodedImage image;
  // Lines too thin to be stored as model here may be model in a child, and only an image can have children.
  image.empty = children == 0 && !showsModel(rgba, least_alpha);
  if (image.empty) {
    image.value = repository::encodeFaceValue({});
    return image;
  }

  const base::Image mask = coverageMask(rgba, least_alpha);
  LUMIGRID_ASSIGN_OR_RETURN(auto jpeg, base::encodeJpeg(repository::fillBackground(rgba, mask), quality, subsampling));
  const base::Bytes coverage = repository::encodeCoverage(mask);
  image.jpeg_bytes = jpeg.size();
  image.coverage_bytes = coverage.size();
  image.value = repository::encodeFaceValue({false, jpeg, coverage, children});
  return image;
}

base::Result<EncodedImage> encodeWebpImage(const base::Image& rgba, int quality, std::uint8_t children) {
  LUMIGRID_CHECK_EQ(rgba.channels, 4);
  EncodedImage image;
  image.empty = children == 0 && !showsModel(rgba);
  if (image.empty) {
    image.value = repository::encodeFaceValue({});
    return image;
  }

  LUMIGRID_ASSIGN_OR_RETURN(const auto webp, repository::encodeWebp(withAlpha(rgba, coverageMask(rgba)), quality));
  image.jpeg_bytes = webp.size();
  image.value = repository::encodeFaceValue({.empty = false, .picture = webp, .coverage = {}, .children = children});
  return image;
}

base::Result<EncodedFace> encodeFace(const base::Image& rgba, const FaceCoding& coding) {
  EncodedFace face;
  const auto add = [&](const base::Image& picture, const ChosenTile& chosen) -> base::Result<void> {
    LUMIGRID_ASSIGN_OR_RETURN(auto image,
                              coding.codec == repository::ImageCodec::kWebp
                                  ? encodeWebpImage(picture, coding.quality, chosen.children)
                                  : encodeImage(picture, coding.quality, coding.subsampling, chosen.children));
    if (chosen.tile == 0) face.empty = image.empty;
    face.jpeg_bytes += image.jpeg_bytes;
    face.coverage_bytes += image.coverage_bytes;
    face.tiles.push_back({chosen.tile, std::move(image.value)});
    return {};
  };
  if (coding.tile_depth == 0) {
    LUMIGRID_TRY(add(rgba, {}));
    return face;
  }
  const FacePyramid pyramid(rgba, coding.tile_depth);
  for (const ChosenTile& chosen : chooseTiles(pyramid, kTileThreshold, coding.wanted))
    LUMIGRID_TRY(add(pyramid.imageOf(chosen.tile), chosen));
  return face;
}

}  // namespace server
