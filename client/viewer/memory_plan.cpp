#include "client/viewer/memory_plan.h"

#include <algorithm>
#include <limits>

namespace client {
namespace {

/// Bytes of a triangle that is drawn: 17 on the GPU (20 a vertex, 6 a triangle, 0.55 vertices a triangle) and 3 in its
/// block. Coarser levels add two thirds (each keeps two fifths of the finer one), and groups just out of view half of
/// that sum again.
constexpr std::uint64_t kBytesPerTriangle = 50;

/// Bytes of a pixel of a frame on the GPU: 4, a third more of mip levels, and a depth map of 512 x 512 texels at most.
constexpr std::uint64_t kBytesPerFramePixel = 6;
constexpr std::uint64_t kFramesKept = 4;

std::uint32_t atMost32Bits(std::uint64_t number) {
  return static_cast<std::uint32_t>(std::min<std::uint64_t>(number, std::numeric_limits<std::uint32_t>::max()));
}

/// The least budget that samples have a share of. A choice: a phone's page of two megapixels takes 125 MB for four
/// samples each and what blends them, which its images need more.
constexpr std::uint64_t kLeastForSamples = 256'000'000;

}  // namespace

MemoryPlan planMemory(std::uint64_t budget, std::uint64_t wanted_cache, std::uint64_t wanted_images, bool with_frames,
                      bool with_samples) {
  const std::uint64_t sixteenth = budget / 16;
  MemoryPlan plan;
  plan.cache = std::min(wanted_cache, 2 * sixteenth);
  plan.frames = sixteenth / 2;
  plan.patches = 2 * sixteenth + sixteenth / 2;
  plan.decoded = 2 * sixteenth;
  if (with_samples && budget >= kLeastForSamples) plan.samples = 4 * sixteenth;
  if (plan.samples == 0) plan.decoded -= sixteenth / 4;
  plan.smaller_picture = std::max(plan.samples, sixteenth);
  plan.images = std::min(wanted_images, 8 * sixteenth - plan.samples);
  plan.frame_images = with_frames ? plan.images / 3 : 0;
  return plan;
}

std::uint32_t trianglesFor(std::uint64_t patch_bytes) {
  return atMost32Bits(patch_bytes / kBytesPerTriangle);
}

std::uint32_t framePixelsFor(std::uint64_t frame_image_bytes) {
  return atMost32Bits(frame_image_bytes / (kFramesKept * kBytesPerFramePixel));
}

}  // namespace client
