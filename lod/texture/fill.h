#pragma once
// Gives texels that no triangle needs the colours of those near them. Private to lod/texture.
#include "lod/texture/coverage.h"

namespace lod::texture {

/// A rectangle of an image, and which of its texels are covered (1) and which are not (0).
struct FillView {
  std::uint8_t* pixels = nullptr;
  std::ptrdiff_t stride = 0;  ///< bytes from a row to the next
  int channels = 3;           ///< 3 or 4
  MaskView mask;
};

/// Fills texels that are not covered: beside covered ones by their mean, farther away from half the resolution, where
/// they are nearer, and so on. So mip levels mix covered texels with what they would mix them with if the surface went
/// on. Texels that were filled are 2 in the mask afterwards. Leaves the view alone where none is covered.
void fillUncovered(const FillView& view);

}  // namespace lod::texture
