#pragma once
// A picture that is drawn tile by tile, averaged over its samples and read back.
#include <cstdint>
#include <functional>
#include <memory>

#include "base/camera.h"
#include "base/error.h"
#include "base/image.h"
#include "server/render/readback.h"
#include "server/render/sample_target.h"
#include "server/render/tiling.h"

namespace server {

struct SampleOptions {
  int supersampling = 1;  ///< n × n samples a pixel, 1 … 8; box-filtered
  /// Limit for the render target in samples; a larger picture is drawn in tiles.
  std::uint64_t max_target_samples = std::uint64_t{1} << 24;
};

/// Needs a GL context that is current from create() to the destructor.
class TiledPicture {
 public:
  static base::Result<std::unique_ptr<TiledPicture>> create();

  /// Draws a tile into the target, which has been cleared; `camera` is the tile's with its border, in pixels.
  using DrawTile = std::function<base::Result<void>(const base::Camera& camera, const SampleTarget& target)>;
  /// Returns RGBA; alpha: 255 where all samples of the pixel saw the model, 0 where none did. Errors: kInvalidInput for
  /// sizes out of range, and those of `draw_tile`. `border`: pixels by which tiles overlap, for what is drawn beside a
  /// place that may lie in another tile.
  base::Result<base::Image> draw(const base::Camera& camera, const SampleOptions& options, const DrawTile& draw_tile,
                                 int border = 0);

 private:
  TiledPicture();
  base::Result<void> drawTiles(const base::Camera& camera, const SampleOptions& options, const DrawTile& draw_tile,
                               int border, const std::shared_ptr<PendingPicture>& pending);

  ResolvePass resolve_;
  SampleTarget target_;
  ReadbackQueue readback_;
  const int max_side_;
};

}  // namespace server
