#include "repository/faces/webp.h"

#include <webp/decode.h>
#include <webp/encode.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "base/check.h"
#include "repository/faces/face_value.h"

namespace repository {
namespace {

base::Error webpError(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "WebP: " + problem};
}

/// Frees what libwebp allocates for a picture.
struct PictureToEncode {
  WebPPicture webp{};
  ~PictureToEncode() { WebPPictureFree(&webp); }
};

int appendBytes(const std::uint8_t* data, std::size_t size, const WebPPicture* picture) {
  auto& out = *static_cast<base::Bytes*>(picture->custom_ptr);
  out.insert(out.end(), data, data + size);
  return 1;
}

/// Libwebp's level of effort without loss, 0..9. Of five scans 1 takes 2 to 24 per cent more bytes in half the time,
/// and 6 takes 0 to 4 per cent less in one and a half times of it.
constexpr int kEffortWithoutLoss = 2;

/// Libwebp's default quality for photographs, but for colours under alpha 0, which stay as they are.
WebPConfig baseConfig() {
  WebPConfig config;
  LUMIGRID_CHECK(WebPConfigInit(&config) != 0);
  config.exact = 1;
  config.thread_level = 1;  // alpha is encoded beside the colours; the bytes stay the same
  return config;
}

/// Returns the root mean square error, 0..1, of red, green and blue over the pixels that are not transparent, under
/// which there is nothing to err. Luma of VP8 has 219 levels, chroma 224 for a range of -1/2..1/2, and colours follow
/// from both as in ITU-R BT.601: red lacks 1.402 of what Cr does, and so on.
float errorOf(const WebPAuxStats& stats, const base::Image& rgba) {
  constexpr double kLuma = 255.0 / 219.0, kChroma = 255.0 / 224.0;
  constexpr double kOfCb = (0.344 * 0.344 + 1.772 * 1.772) / 3.0, kOfCr = (1.402 * 1.402 + 0.714 * 0.714) / 3.0;
  const auto square = [&](int plane) { return std::pow(10.0, -0.1 * static_cast<double>(stats.PSNR[plane])); };
  const double sum = kLuma * kLuma * square(0) + kChroma * kChroma * (kOfCb * square(1) + kOfCr * square(2));
  std::size_t shown = 0;
  for (std::size_t i = 3; i < rgba.pixels.size(); i += 4) shown += rgba.pixels[i] != 0 ? 1 : 0;
  const double share = static_cast<double>(shown) / static_cast<double>(rgba.pixels.size() / 4);
  return static_cast<float>(std::min(1.0, std::sqrt(sum / std::max(share, 1e-9))));
}

base::Result<base::Bytes> encode(const base::Image& rgba, const WebPConfig& config, float* error = nullptr) {
  LUMIGRID_CHECK_EQ(rgba.channels, 4);
  if (rgba.empty()) return webpError("an image without pixels cannot be encoded");
  if (rgba.width > kMaxWebpSide || rgba.height > kMaxWebpSide)
    return webpError("a side of more than 16383 pixels cannot be encoded");

  base::Bytes bytes;
  PictureToEncode picture;
  LUMIGRID_CHECK(WebPPictureInit(&picture.webp) != 0);
  picture.webp.use_argb = config.lossless;
  picture.webp.width = rgba.width;
  picture.webp.height = rgba.height;
  picture.webp.writer = appendBytes;
  picture.webp.custom_ptr = &bytes;
  WebPAuxStats stats;
  if (error != nullptr) picture.webp.stats = &stats;
  if (WebPPictureImportRGBA(&picture.webp, rgba.pixels.data(), 4 * rgba.width) == 0 ||
      WebPEncode(&config, &picture.webp) == 0)
    return base::Error{base::ErrorCode::kNoSpace,
                       "WebP: cannot be encoded (libwebp's error " + std::to_string(picture.webp.error_code) + ")"};
  if (error != nullptr) *error = errorOf(stats, rgba);
  return bytes;
}

}  // namespace

base::Result<base::Bytes> encodeWebp(const base::Image& rgba, int quality, float* error) {
  LUMIGRID_CHECK(quality >= 1 && quality <= 100);
  WebPConfig config = baseConfig();
  config.quality = static_cast<float>(quality);
  return encode(rgba, config, error);
}

base::Result<base::Bytes> encodeWebpWithoutLoss(const base::Image& rgba) {
  WebPConfig config = baseConfig();
  LUMIGRID_CHECK(WebPConfigLosslessPreset(&config, kEffortWithoutLoss) != 0);
  return encode(rgba, config);
}

base::Result<base::Image> decodeWebp(base::ByteView bytes, std::int64_t max_pixels) {
  WebPBitstreamFeatures features;
  if (!isWebp(bytes) || WebPGetFeatures(bytes.data(), bytes.size(), &features) != VP8_STATUS_OK)
    return webpError("not one, or its header is broken");
  if (features.has_animation != 0) return webpError("an animation, not a picture");
  if (features.width < 1 || features.height < 1 || std::int64_t{features.width} * features.height > max_pixels)
    return webpError(std::to_string(features.width) + " x " + std::to_string(features.height) + " pixels; at most " +
                     std::to_string(max_pixels) + " are taken");

  base::Image image(features.width, features.height, 4);
  if (WebPDecodeRGBAInto(bytes.data(), bytes.size(), image.pixels.data(), image.pixels.size(), 4 * image.width) ==
      nullptr)
    return webpError("its data is broken or cut short");
  return image;
}

}  // namespace repository
