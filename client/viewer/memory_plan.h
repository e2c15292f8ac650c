#pragma once
// How one budget of bytes is shared out. Fixed shares rather than one pot: what is held then depends on the view alone,
// not on what came first, so nothing flickers at the limit.
#include <cstdint>

namespace client {

struct MemoryPlan {
  std::uint64_t cache = 0;         ///< compressed images and patches
  std::uint64_t frames = 0;        ///< exact frames as they came
  std::uint64_t patches = 0;       ///< of the hierarchy: on the GPU, as records, and the blocks in use
  std::uint64_t images = 0;        ///< on the GPU, depth maps included
  std::uint64_t frame_images = 0;  ///< part of `images` that faces leave to exact frames
  std::uint64_t decoded = 0;       ///< decoded or being decoded, not on the GPU yet
};

/// Sixteenths of `budget`: 8 to images, 2 1/2 to patches, 2 to the cache, 2 to what is being decoded, 1/2 to frames; 1
/// stays free for what is not counted (pixels on their way to the GPU, small objects). The cache and the images take no
/// more than they are wanted to have.
MemoryPlan planMemory(std::uint64_t budget, std::uint64_t wanted_cache, std::uint64_t wanted_images, bool with_frames);

/// Triangles to ask a server for, so that their patches and those of the coarser levels above them fit into `patches`
/// bytes.
std::uint32_t trianglesFor(std::uint64_t patch_bytes);

}  // namespace client
