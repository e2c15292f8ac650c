#pragma once
// Pictures of a scene at any size (docs/formats/http.md, /render). The painter works in steps that are short enough for
// viewers' frames to come between; it holds one band of pixels and the bytes of the encoded picture.
#include <cstdint>
#include <memory>
#include <optional>
#include <utility>

#include "base/camera.h"
#include "base/error.h"
#include "base/image_rows.h"
#include "base/jpeg/jpeg.h"
#include "base/json/scene_file.h"
#include "base/view_defaults.h"
#include "server/net/http_text.h"
#include "server/render/background.h"
#include "server/render/scene_renderer.h"

namespace server {

struct PictureRequest {
  enum class Format { kPng, kJpeg };
  base::ViewCamera camera;
  Format format = Format::kPng;
  int quality = 90;                                           ///< quality of a JPEG, 1..100
  int supersampling = 2;                                      ///< n × n samples a pixel, 1..4
  std::optional<Rgb> background;                              ///< none: transparent
  base::ErrorMeasure measure = base::ErrorMeasure::kVisible;  ///< of the tolerance
  float tolerance_px = base::ViewDefaults::kExactTolerance;   ///< projected error of the patches
  bool resolution_colors = false;                             ///< tinted by the patches' projected errors
  std::optional<glm::dvec3> light;  ///< unit, world's axes: towards one that shades in place of the scene's
};

const char* contentTypeOf(PictureRequest::Format format);
/// From quality 90 on a JPEG's chroma has full resolution (4:4:4), as its loss would be visible.
base::Subsampling subsamplingFor(int quality);

/// `max_pixels`: of the picture, width times height. `background`: the scene's, which a JPEG has where the query names
/// none; without one it is white. Errors are one line for the visitor, with the name that is wrong.
base::Result<PictureRequest> parsePictureRequest(const Query& query, std::uint64_t max_pixels,
                                                 const std::optional<Rgb>& background = std::nullopt);

class PicturePainter {
 public:
  /// `band_pixels`: about how many one step draws.
  static base::Result<std::unique_ptr<PicturePainter>> begin(const PictureRequest& request, const base::Scene& scene,
                                                             const SceneRenderer& renderer,
                                                             std::uint64_t band_pixels = std::uint64_t{1} << 20);
  /// Draws and encodes the next band, from the top. True: that was the last one.
  base::Result<bool> drawNextBand(SceneRenderer& renderer);
  /// Moves the encoded picture out, once, after the last band.
  base::Bytes takePicture() { return std::move(bytes_); }

 private:
  explicit PicturePainter(const PictureRequest& request) : request_(request) {}
  base::Result<std::unique_ptr<base::ImageRows>> beginRows();

  const PictureRequest request_;
  base::Camera camera_;
  RenderOptions options_;
  int band_height_ = 1;
  int next_row_ = 0;
  base::Bytes bytes_;
  std::unique_ptr<base::ImageRows> rows_;  // writes into bytes_
};

}  // namespace server
