#pragma once
// The defaults that clients, server, bake and comparison share, so that sampling points are selected for the views that
// clients have, and pictures of different programs compare.
#include <cstdint>

namespace base {

struct ViewDefaults {
  /// Pixels: the largest projected error of shape of the patches under the images. An orbit over a coloured drone scan
  /// showed 27.9 dB with about that and 27.1 dB with twice as much (docs/lumigraph-tuning.md).
  static constexpr float kPatchTolerance = 1.0F;
  /// The largest visible error where no images lie over them: six scans show 2 to 5 dB more than with four times as
  /// much, in a tenth of the bytes that images take (docs/results.md).
  static constexpr float kAloneTolerance = 1.0F;
  /// Patches are refined no further than this. The same scan has some 245 000 triangles at 1 px.
  static constexpr std::uint32_t kMaxTriangles = 300'000;
  /// At rest, once all else is here, they may have so many times as many triangles (docs/decisions/refine-at-rest.md).
  static constexpr std::uint32_t kRefinedFactor = 4;
  /// Sampling points whose images a view asks for: as many as the cell of a grid has corners.
  static constexpr std::uint16_t kPoints = 8;
  /// Images that are blended in a picture; 24 and 32 gain 0.3 and 0.4 dB there.
  static constexpr int kImages = 16;
  /// Pixels: the tolerance of stored images, finer than a pixel because colours go sooner than shape: the orbit loses
  /// 1.1 dB at 1 px.
  static constexpr float kExactTolerance = 0.25F;
  /// JPEG quality of stored images, 1..100.
  static constexpr int kQuality = 85;
  /// The same of WebP (docs/decisions/tiles.md).
  static constexpr int kWebpQuality = 80;

  // ---- exact frames: pictures of a view at rest (docs/decisions/exact-frames.md, frames-webp.md) ----

  /// Frames show leaves while the view has at most this many triangles, else the finest cut that has.
  static constexpr std::uint64_t kFrameTriangles = 6'000'000;
  /// Pixels of a frame at most: about twice a 4K screen. A larger frame would keep other viewers waiting.
  static constexpr std::int64_t kMaxFramePixels = 16'000'000;
  /// Quality of frames, 1..100, where the client leaves it to the server: as WebP, and as JPEG with 4:4:4.
  static constexpr int kFrameWebpQuality = 95;
  static constexpr int kFrameJpegQuality = 93;
  /// In place of a quality: WebP without loss, so that a view at rest is the model to the last bit
  /// (docs/decisions/frames-without-loss.md).
  static constexpr int kWithoutLoss = 101;
};

}  // namespace base
