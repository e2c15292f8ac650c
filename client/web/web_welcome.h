#pragma once
// What the page's JavaScript found in scene.json (client/web/site/static_scene.js), as plain values.
#include <string>

#include "protocol/message.h"

namespace client {

/// Origin, box_min, box_max, up (world, 3 each), 1 when unlit, the light's direction (3).
inline constexpr int kWelcomeNumbers = 16;
/// `numbers`: so many.
protocol::Welcome welcomeOf(const std::string& name, const std::string& units, const double* numbers);

}  // namespace client
