#include "client/viewer/memory_plan.h"

#include <algorithm>
#include <limits>

namespace client {
namespace {

/// On the GPU 17 bytes (20 a vertex, 6 a triangle, 0.55 vertices a triangle), 3 as they came; levels above add two
/// thirds (each keeps two fifths), and what is just out of view as much again as half of it.
constexpr std::uint64_t kBytesPerTriangle = 50;

}  // namespace

MemoryPlan planMemory(std::uint64_t budget, std::uint64_t wanted_cache, std::uint64_t wanted_images, bool with_frames) {
  const std::uint64_t sixteenth = budget / 16;
  MemoryPlan plan;
  plan.cache = std::min(wanted_cache, 2 * sixteenth);
  plan.frames = sixteenth / 2;
  plan.patches = 2 * sixteenth + sixteenth / 2;
  plan.decoded = 2 * sixteenth;
  plan.images = std::min(wanted_images, 8 * sixteenth);
  plan.frame_images = with_frames ? plan.images / 3 : 0;
  return plan;
}

std::uint32_t trianglesFor(std::uint64_t patch_bytes) {
  return static_cast<std::uint32_t>(
      std::min<std::uint64_t>(patch_bytes / kBytesPerTriangle, std::numeric_limits<std::uint32_t>::max()));
}

}  // namespace client
