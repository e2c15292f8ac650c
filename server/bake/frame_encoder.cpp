#include "server/bake/frame_encoder.h"

#include <algorithm>
#include <utility>

#include "base/check.h"
#include "base/picture_error.h"
#include "base/view_defaults.h"
#include "repository/faces/face_value.h"
#include "repository/faces/webp.h"
#include "server/bake/face_encoder.h"

namespace server {
namespace {

constexpr int kFullChromaQuality = 90;  // from here on a JPEG's loss of chroma would be visible

/// Alpha as a mask of one channel, not 0 where a pixel shows any model.
base::Image alphaOf(const base::Image& rgba) {
  base::Image alpha(rgba.width, rgba.height, 1);
  for (std::size_t i = 0; i < alpha.pixels.size(); ++i) alpha.pixels[i] = rgba.pixels[4 * i + 3];
  return alpha;
}

/// Without loss as long as a message holds it.
base::Result<base::Bytes> encodeWebpPicture(const base::Image& rgba, int quality, float& error) {
  if (quality != base::ViewDefaults::kWithoutLoss) return repository::encodeWebp(rgba, quality, &error);
  LUMIGRID_ASSIGN_OR_RETURN(auto exact, repository::encodeWebpWithoutLoss(rgba));
  if (exact.size() + repository::kImageHeaderBytes <= protocol::kMaxPayload) return exact;
  return repository::encodeWebp(rgba, base::ViewDefaults::kFrameWebpQuality, &error);
}

base::Result<protocol::EncodedFrame> encodeWebpFrame(const base::Image& rgba, int quality) {
  const base::Image alpha = alphaOf(rgba);
  const bool is_empty = std::all_of(alpha.pixels.begin(), alpha.pixels.end(), [](auto a) { return a == 0; });
  protocol::EncodedFrame frame;
  if (is_empty) {
    frame.value = repository::encodeFaceValue({});
    return frame;
  }
  LUMIGRID_ASSIGN_OR_RETURN(const auto webp, encodeWebpPicture(withAlpha(rgba, alpha), quality, frame.coding_error));
  frame.value = repository::encodeFaceValue({.empty = false, .picture = webp, .coverage = {}});
  return frame;
}

base::Result<protocol::EncodedFrame> encodeJpegFrame(const base::Image& rgba, int quality) {
  const auto subsampling = quality < kFullChromaQuality ? base::Subsampling::k420 : base::Subsampling::k444;
  LUMIGRID_ASSIGN_OR_RETURN(auto image, encodeImage(rgba, quality, subsampling, 0, base::kCoverageThreshold));
  return protocol::EncodedFrame{std::move(image.value)};
}

}  // namespace

base::Result<protocol::EncodedFrame> encodeFrame(const base::Image& rgba, protocol::FrameCodec codec, int quality) {
  LUMIGRID_CHECK_EQ(rgba.channels, 4);
  const bool fits_webp = std::max(rgba.width, rgba.height) <= repository::kMaxWebpSide;
  if (codec == protocol::FrameCodec::kWebp && fits_webp)
    return encodeWebpFrame(rgba, quality == protocol::kServersChoice ? base::ViewDefaults::kFrameWebpQuality : quality);
  const bool has_quality = quality != protocol::kServersChoice && quality != base::ViewDefaults::kWithoutLoss;
  return encodeJpegFrame(rgba, has_quality ? quality : base::ViewDefaults::kFrameJpegQuality);
}

}  // namespace server
