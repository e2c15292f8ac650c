#pragma once
// Divides one budget of bytes into fixed shares rather than one pool: what is held then depends on the view alone, not
// on the order of arrival, so nothing flickers at the limit.
#include <cstdint>

namespace client {

struct MemoryPlan {
  std::uint64_t cache = 0;            ///< compressed images and patches
  std::uint64_t frames = 0;           ///< exact frames, coded
  std::uint64_t patches = 0;          ///< the hierarchy: geometry on the GPU, records, and the blocks in use
  std::uint64_t images = 0;           ///< images on the GPU, depth maps included
  std::uint64_t frame_images = 0;     ///< part of `images` that is reserved for exact frames
  std::uint64_t decoded = 0;          ///< images decoded or being decoded, not on the GPU yet
  std::uint64_t samples = 0;          ///< the picture's pixels where each has several, and what blends each once
  std::uint64_t smaller_picture = 0;  ///< the same of a picture of one sample a pixel, which may have fewer pixels
};

/// Divides `budget` into sixteenths: 8 for images, 2 1/2 for patches, 2 for the cache, 2 for decoding, 1/2 for frames.
/// From 256 MB on and `with_samples`, the images leave 4 of theirs to the picture's samples, and a smaller picture
/// takes their place. Below, it takes 1/4 from decoding and 3/4 of the 1 that else stays free for what is not counted
/// (pixels on their way to the GPU, small objects). The cache and the images get no more than `wanted_cache` and
/// `wanted_images`.
MemoryPlan planMemory(std::uint64_t budget, std::uint64_t wanted_cache, std::uint64_t wanted_images, bool with_frames,
                      bool with_samples);

/// Number of triangles to request from a server so that their patches and those of the coarser levels above them fit
/// into `patch_bytes`.
std::uint32_t trianglesFor(std::uint64_t patch_bytes);

/// Number of pixels that a frame may have, so that four such frames fit into `frame_image_bytes`: two, and as many
/// bytes for frames of another size.
std::uint32_t framePixelsFor(std::uint64_t frame_image_bytes);

}  // namespace client
