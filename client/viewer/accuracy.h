#pragma once
// How close a picture is to the true one.
#include <cstdint>

namespace client {

enum class Accuracy : std::uint8_t {
  kNothing,  ///< no surface is here yet
  kCoarse,   ///< patches or splats are coarser than the tolerance asks for, or are being refined
  kBlended,  ///< the cut has reached the tolerance, and is textured by the images that are here
  kExact,    ///< the server's own picture of this very view is shown and has faded in fully
  kFine,     ///< all splats that the cut-off asks for are here
};

}  // namespace client
