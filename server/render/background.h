#pragma once
// Compositing of pictures over a background.
#include "base/image.h"

namespace server {

using base::Rgb;

/// Composites a picture with alpha (4 channels) over an opaque colour; returns 3 channels.
base::Image compositeOver(const base::Image& rgba, const Rgb& background);

}  // namespace server
