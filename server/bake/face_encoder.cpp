#include "server/bake/face_encoder.h"

#include "base/check.h"
#include "base/picture_error.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"
#include "repository/faces/filler.h"

namespace server {

base::Image coverageMask(const base::Image& rgba) {
  base::Image mask(rgba.width, rgba.height, 1);
  for (std::size_t i = 0; i < mask.pixels.size(); ++i)
    mask.pixels[i] = rgba.pixels[4 * i + 3] >= base::kCoverageThreshold ? 255 : 0;
  return mask;
}

bool showsModel(const base::Image& rgba) {
  for (std::size_t i = 3; i < rgba.pixels.size(); i += 4)
    if (rgba.pixels[i] >= base::kCoverageThreshold) return true;
  return false;
}

base::Result<EncodedFace> encodeFace(const base::Image& rgba, int quality, repository::Subsampling subsampling) {
  LUMIGRID_CHECK_EQ(rgba.channels, 4);
  EncodedFace face;
  face.empty = !showsModel(rgba);
  if (face.empty) {
    face.value = repository::encodeFaceValue({});
    return face;
  }

  const base::Image mask = coverageMask(rgba);
  LUMIGRID_ASSIGN_OR_RETURN(auto jpeg,
                            repository::encodeJpeg(repository::fillBackground(rgba, mask), quality, subsampling));
  const base::Bytes coverage = repository::encodeCoverage(mask);
  face.jpeg_bytes = jpeg.size();
  face.coverage_bytes = coverage.size();
  face.value = repository::encodeFaceValue({false, jpeg, coverage});
  return face;
}

}  // namespace server
