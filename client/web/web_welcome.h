#pragma once
// The values that the page's JavaScript read from scene.json (client/web/site/static_scene.js).
#include <string>

#include "protocol/message.h"

namespace client {

/// Count of numbers: origin, box_min, box_max, up (world, 3 each), 1 when unlit, the light's direction (3).
inline constexpr int kWelcomeNumbers = 16;
/// `numbers` points to kWelcomeNumbers of them.
protocol::Welcome welcomeOf(const std::string& name, const std::string& units, const double* numbers);

}  // namespace client
