#include "server/bake/face_encoder.h"

#include <algorithm>
#include <cstring>
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
  // The bits of many alphas together tell most empty parts at once: none of them has more than all.
  constexpr std::size_t kPart = 1024;  // bytes
  for (std::size_t begin = 0; begin < rgba.pixels.size(); begin += kPart) {
    const auto part = base::ByteView(rgba.pixels).subspan(begin, std::min(kPart, rgba.pixels.size() - begin));
    std::uint32_t bits = 0;
    for (std::size_t i = 0; i + 4 <= part.size(); i += 4) {
      std::uint32_t pixel = 0;
      std::memcpy(&pixel, &part[i], sizeof(pixel));
      bits |= pixel;
    }
    if (bits >> 24 < least_alpha) continue;
    for (std::size_t i = 3; i < part.size(); i += 4)
      if (part[i] >= least_alpha) return true;
  }
  return false;
}

base::Image withAlpha(const base::Image& rgba, const base::Image& alpha) {
  base::Image result(rgba.width, rgba.height, 4);
  // Most tiles of a closed surface have no gaps.
  const bool has_gaps = std::find(alpha.pixels.begin(), alpha.pixels.end(), 0) != alpha.pixels.end();
  const base::Image filled = has_gaps ? repository::fillBackground(rgba, alpha) : base::Image();
  const base::Image& colors = has_gaps ? filled : rgba;
  const std::uint8_t* from = colors.pixels.data();
  std::uint8_t* to = result.pixels.data();
  for (const std::uint8_t own : alpha.pixels) {
    to[0] = from[0], to[1] = from[1], to[2] = from[2], to[3] = own;
    from += colors.channels, to += 4;
  }
  return result;
}

base::Result<EncodedImage> encodeImage(const base::Image& rgba, int quality, base::Subsampling subsampling,
                                       std::uint8_t children, std::uint8_t least_alpha) {
  LUMIGRID_CHECK(rgba.empty() || rgba.channels == 4);
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
  LUMIGRID_CHECK(rgba.empty() || rgba.channels == 4);
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
  // No coarser level shows model where the finest has none.
  if (!showsModel(rgba)) {
    if (coding.wanted == nullptr || std::binary_search(coding.wanted->begin(), coding.wanted->end(), 0U))
      LUMIGRID_TRY(add({}, {}));
    return face;
  }
  const FacePyramid pyramid(rgba, coding.tile_depth);
  for (const ChosenTile& chosen : chooseTiles(pyramid, kTileThreshold, coding.wanted))
    LUMIGRID_TRY(add(pyramid.imageOf(chosen.tile), chosen));
  return face;
}

}  // namespace server
