#pragma once
// How near the truth a picture is.
#include <cstdint>

namespace client {

enum class Accuracy : std::uint8_t {
  kNothing,  ///< no surface is here yet
  kCoarse,   ///< patches whose error is above the tolerance, or being refined; splats likewise
  kBlended,  ///< the cut that the tolerance asks for, with the images that are here
  kExact,    ///< the server's own picture of this very view is among the images, come in fully
  kFine,     ///< splats: all is here that the cut-off asks for
};

}  // namespace client
