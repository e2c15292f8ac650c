#pragma once
// Rivals that send pictures show the exact picture laid over grey, as a page's background, so that the edges of the
// model are as smooth as they were drawn. Such pictures have no coverage; that of the drawn picture goes with them at
// no cost, to be judged by.
#include <algorithm>
#include <utility>

#include "base/picture_error.h"
#include "compare/accuracy.h"
#include "compare/painter.h"

namespace compare {

struct RemotePicture {
  base::Bytes coded;
  base::Bytes coverage;  ///< one byte a pixel, 255: all of it is model
};

/// Codes a view's exact picture over grey by `encode`, which gets RGB.
template <class Encode>
base::Result<RemotePicture> remotePicture(Painter& painter, const base::ViewCamera& camera, const Encode& encode) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto rgba, painter.exactPicture(camera));
  LUMIGRID_ASSIGN_OR_RETURN(base::Bytes coded, encode(overMidGrey(*rgba)));
  base::Bytes coverage;
  for (std::size_t i = 3; i < rgba->pixels.size(); i += 4) coverage.push_back(rgba->pixels[i]);
  return RemotePicture{std::move(coded), std::move(coverage)};
}

/// The decoded picture with its coverage: RGBA that is `rgb` again when it is laid over mid-grey.
inline base::Image withCoverage(const base::Image& rgb, const base::Bytes& coverage) {
  base::Image rgba(rgb.width, rgb.height, 4);
  for (std::size_t i = 0; i < coverage.size(); ++i) {
    rgba.pixels[4 * i + 3] = coverage[i];
    if (coverage[i] == 0) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const double beyond = (rgb.pixels[3 * i + c] - base::kMidGrey) * 255.0 / coverage[i];
      rgba.pixels[4 * i + c] = static_cast<std::uint8_t>(std::clamp(base::kMidGrey + beyond + 0.5, 0.0, 255.0));
    }
  }
  return rgba;
}

}  // namespace compare
