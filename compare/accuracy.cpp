#include "compare/accuracy.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/picture_error.h"

namespace compare {
namespace {

constexpr std::size_t kRadius = 5;  // 11 × 11 window, Wang et al. 2004, section III-B
constexpr double kSigma = 1.5;
constexpr double kC1 = 6.5025, kC2 = 58.5225;  // (0.01 · 255)², (0.03 · 255)², ibid. equation 13

using Plane = std::vector<float>;

std::array<Plane, 3> overGrey(const base::Image& image) {
  std::array<Plane, 3> planes;
  const std::size_t count = image.pixels.size() / 4;
  for (std::size_t c = 0; c < 3; ++c) {
    planes[c].resize(count);
    for (std::size_t i = 0; i < count; ++i) planes[c][i] = base::overGrey(&image.pixels[4 * i], static_cast<int>(c));
  }
  return planes;
}

Plane luma(const std::array<Plane, 3>& rgb) {
  Plane y(rgb[0].size());
  for (std::size_t i = 0; i < y.size(); ++i)
    y[i] = 0.299F * rgb[0][i] + 0.587F * rgb[1][i] + 0.114F * rgb[2][i];  // BT.601
  return y;
}

// Separable Gaussian; the window is cut at the picture's edge and renormalised.
Plane blur(const Plane& in, int width, int height) {
  std::array<float, 2 * kRadius + 1> kernel{};
  for (std::size_t k = 0; k < kernel.size(); ++k) {
    const double distance = static_cast<double>(k) - kRadius;
    kernel[k] = static_cast<float>(std::exp(-0.5 * distance * distance / (kSigma * kSigma)));
  }
  auto pass = [&](const Plane& source, std::size_t across, std::size_t along, std::size_t stride_across,
                  std::size_t stride_along) {
    Plane out(source.size());
    for (std::size_t a = 0; a < across; ++a)
      for (std::size_t i = 0; i < along; ++i) {
        float sum = 0.0F;
        float weight = 0.0F;
        const std::size_t last = std::min(along - 1, i + kRadius);
        for (std::size_t j = i < kRadius ? 0 : i - kRadius; j <= last; ++j) {
          const float w = kernel[j + kRadius - i];
          sum += w * source[a * stride_across + j * stride_along];
          weight += w;
        }
        out[a * stride_across + i * stride_along] = sum / weight;
      }
    return out;
  };
  const auto columns = static_cast<std::size_t>(width);
  const auto rows = static_cast<std::size_t>(height);
  return pass(pass(in, rows, columns, columns, 1), columns, rows, 1, columns);
}

Plane product(const Plane& a, const Plane& b) {
  Plane out(a.size());
  for (std::size_t i = 0; i < a.size(); ++i) out[i] = a[i] * b[i];
  return out;
}

// Equation 13 of Wang et al. 2004 at every pixel.
Plane ssimMap(const Plane& x, const Plane& y, int width, int height) {
  const Plane mx = blur(x, width, height);
  const Plane my = blur(y, width, height);
  const Plane xx = blur(product(x, x), width, height);
  const Plane yy = blur(product(y, y), width, height);
  const Plane xy = blur(product(x, y), width, height);
  Plane map(x.size());
  for (std::size_t i = 0; i < map.size(); ++i) {
    const double ux = mx[i];
    const double uy = my[i];
    const double vx = xx[i] - ux * ux;
    const double vy = yy[i] - uy * uy;
    const double vxy = xy[i] - ux * uy;
    map[i] = static_cast<float>((2 * ux * uy + kC1) * (2 * vxy + kC2) / ((ux * ux + uy * uy + kC1) * (vx + vy + kC2)));
  }
  return map;
}

}  // namespace

base::Result<Accuracy> measureAccuracy(const base::Image& truth, const base::Image& picture) {
  if (truth.width != picture.width || truth.height != picture.height || truth.channels != 4 || picture.channels != 4)
    return base::Error{base::ErrorCode::kInvalidInput, "pictures differ in size: " + std::to_string(truth.width) +
                                                           " x " + std::to_string(truth.height) + " against " +
                                                           std::to_string(picture.width) + " x " +
                                                           std::to_string(picture.height)};
  const Plane ssim = ssimMap(luma(overGrey(truth)), luma(overGrey(picture)), truth.width, truth.height);

  Accuracy result;
  double similarity = 0.0;
  std::uint64_t in_truth = 0;
  std::uint64_t missing = 0;
  std::uint64_t excess = 0;
  for (std::size_t i = 0; i < ssim.size(); ++i) {
    const bool there = truth.pixels[4 * i + 3] >= base::kCoverageThreshold;
    const bool shown = picture.pixels[4 * i + 3] >= base::kCoverageThreshold;
    if (!there && !shown) continue;
    ++result.foreground;
    in_truth += there ? 1U : 0U;
    missing += there && !shown ? 1U : 0U;
    excess += shown && !there ? 1U : 0U;
    similarity += ssim[i];
  }
  if (result.foreground == 0)
    return base::Error{base::ErrorCode::kInvalidInput, "neither picture shows anything; move the camera"};
  const base::PictureError error = base::pictureError(truth, picture);
  result.psnr_db = error.psnr();
  result.mean_abs = error.absolute / static_cast<double>(error.samples);
  result.ssim = similarity / static_cast<double>(result.foreground);
  result.missing_share = static_cast<double>(missing) / static_cast<double>(std::max<std::uint64_t>(1, in_truth));
  result.excess_share = static_cast<double>(excess) / static_cast<double>(std::max<std::uint64_t>(1, in_truth));
  return result;
}

base::Image differencePicture(const base::Image& truth, const base::Image& picture) {
  const auto a = overGrey(truth);
  const auto b = overGrey(picture);
  base::Image out(truth.width, truth.height, 3);
  for (std::size_t i = 0; i < a[0].size(); ++i)
    for (std::size_t c = 0; c < 3; ++c)
      out.pixels[3 * i + c] = static_cast<std::uint8_t>(std::min(255.0F, 4.0F * std::abs(a[c][i] - b[c][i])));
  return out;
}

}  // namespace compare
