#pragma once
// Rivals that send pictures show the exact picture laid over grey, as a page's background, so that the edges of the
// model are as smooth as they were drawn. Such pictures have no coverage; that of the drawn picture goes with them at
// no cost, to be judged by.
#include <algorithm>
#include <utility>

#include "compare/accuracy.h"
#include "compare/painter.h"
#include "server/bake/face_encoder.h"

namespace compare {

struct RemotePicture {
  base::Bytes coded;
  base::Bytes mask;  ///< one byte a pixel, 255: model
};

/// Codes a view's exact picture over grey by `encode`, which gets RGB.
template <class Encode>
base::Result<RemotePicture> remotePicture(Painter& painter, const base::ViewCamera& camera, const Encode& encode) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto rgba, painter.exactPicture(camera));
  LUMIGRID_ASSIGN_OR_RETURN(base::Bytes coded, encode(overMidGrey(*rgba)));
  return RemotePicture{std::move(coded), server::coverageMask(*rgba).pixels};
}

/// The decoded picture with its coverage: RGBA.
inline base::Image withCoverage(const base::Image& rgb, const base::Bytes& mask) {
  base::Image rgba(rgb.width, rgb.height, 4);
  for (std::size_t i = 0; i < mask.size(); ++i) {
    std::copy_n(rgb.pixels.data() + 3 * i, 3, rgba.pixels.data() + 4 * i);
    rgba.pixels[4 * i + 3] = mask[i];
  }
  return rgba;
}

}  // namespace compare
