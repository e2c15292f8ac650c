#pragma once
// What a picture stands before.
#include <array>
#include <cstdint>

#include "base/image.h"

namespace server {

using Rgb = std::array<std::uint8_t, 3>;

/// A picture with alpha (4 channels) laid over an opaque colour: 3 channels.
base::Image compositeOver(const base::Image& rgba, const Rgb& background);

}  // namespace server
