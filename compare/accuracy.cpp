#include "compare/accuracy.h"

#include <algorithm>
#include <cmath>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <string>
#include <vector>

#include "base/picture_error.h"

namespace compare {
namespace {

// Wang et al. 2004: window of section III-C, constants (0.01 · 255)² and (0.03 · 255)² of section III-B.
const cv::Size kWindow(11, 11);
constexpr double kSigma = 1.5;
constexpr double kC1 = 6.5025, kC2 = 58.5225;
using base::kMidGrey;

/// OpenCV's view of an image, without a copy.
cv::Mat viewOf(const base::Image& image) {
  return {image.height, image.width, CV_8UC(image.channels), const_cast<std::uint8_t*>(image.pixels.data())};
}

cv::Mat coverage(const cv::Mat& rgba) {
  cv::Mat alpha;
  cv::extractChannel(rgba, alpha, 3);
  return alpha;
}

/// Where the picture covers at least half of a pixel: 255, elsewhere 0.
cv::Mat coveredPixels(const cv::Mat& rgba) {
  return coverage(rgba) >= base::kCoverageThreshold;
}

/// Where the picture covers so much of a pixel that it is compared: 255, elsewhere 0.
cv::Mat foregroundOf(const cv::Mat& rgba) {
  return coverage(rgba) >= base::kForegroundThreshold;
}

/// RGB laid over mid-grey, 0..255 in float: (a · c + (255 − a) · grey) / 255, exact but for the division.
cv::Mat overGrey(const cv::Mat& rgba) {
  cv::Mat rgb, alpha;
  cv::cvtColor(rgba, rgb, cv::COLOR_RGBA2RGB);
  cv::cvtColor(coverage(rgba), alpha, cv::COLOR_GRAY2RGB);
  rgb.convertTo(rgb, CV_32F);
  alpha.convertTo(alpha, CV_32F);
  const cv::Mat sum = alpha.mul(rgb - cv::Scalar::all(kMidGrey)) + cv::Scalar::all(255.0 * kMidGrey);
  return sum / 255.0;
}

double psnr(const cv::Mat& a, const cv::Mat& b, const cv::Mat& mask, double samples) {
  const double squares = cv::norm(a, b, cv::NORM_L2SQR, mask);
  if (squares <= 0.0) return base::kEqualDb;
  return std::min(base::kEqualDb, 10.0 * std::log10(255.0 * 255.0 * samples / squares));
}

/// The mean over the window around each pixel; at the picture's edge, over the part of the window that is inside.
cv::Mat windowMean(const cv::Mat& values) {
  cv::Mat sum, weight;
  cv::GaussianBlur(values, sum, kWindow, kSigma, kSigma, cv::BORDER_CONSTANT);
  cv::GaussianBlur(cv::Mat::ones(values.size(), values.type()), weight, kWindow, kSigma, kSigma, cv::BORDER_CONSTANT);
  return sum / weight;
}

/// SSIM at every pixel (Wang et al. 2004, equation 13).
cv::Mat ssimMap(const cv::Mat& x, const cv::Mat& y) {
  const cv::Mat mx = windowMean(x), my = windowMean(y);
  const cv::Mat mean_product = mx.mul(my), mean_squares = mx.mul(mx) + my.mul(my);
  const cv::Mat covariance = windowMean(x.mul(y)) - mean_product;
  const cv::Mat variances = windowMean(x.mul(x)) + windowMean(y.mul(y)) - mean_squares;
  const cv::Mat above = (2.0 * mean_product + kC1).mul(2.0 * covariance + kC2);
  const cv::Mat below = (mean_squares + kC1).mul(variances + kC2);
  return above / below;
}

/// BT.601 luma in double: variances are small differences of large squares.
cv::Mat luma(const cv::Mat& rgb) {
  cv::Mat grey;
  cv::cvtColor(rgb, grey, cv::COLOR_RGB2GRAY);
  grey.convertTo(grey, CV_64F);
  return grey;
}

/// The covered pixels that have an uncovered neighbour; beyond the picture's edge all is covered.
cv::Mat silhouette(const cv::Mat& covered) {
  cv::Mat inner;
  cv::erode(covered, inner, cv::getStructuringElement(cv::MORPH_CROSS, cv::Size(3, 3)));
  return covered & ~inner;
}

/// Measures how far the silhouettes' pixels lie from the other silhouette. 0 where either has none, as there is nothing
/// to measure: missing_share and excess_share tell of that.
void measureSilhouettes(const cv::Mat& covered_a, const cv::Mat& covered_b, Accuracy& result) {
  const cv::Mat a = silhouette(covered_a), b = silhouette(covered_b);
  if (cv::countNonZero(a) == 0 || cv::countNonZero(b) == 0) return;
  cv::Mat to_a, to_b;
  cv::distanceTransform(~a, to_a, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  cv::distanceTransform(~b, to_b, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  result.silhouette_px = 0.5 * (cv::mean(to_b, a)[0] + cv::mean(to_a, b)[0]);

  std::vector<float> distances;
  const auto collect = [&distances](const cv::Mat& at, const cv::Mat& distance) {
    for (int y = 0; y < at.rows; ++y)
      for (int x = 0; x < at.cols; ++x)
        if (at.at<std::uint8_t>(y, x) != 0) distances.push_back(distance.at<float>(y, x));
  };
  collect(a, to_b);
  collect(b, to_a);
  const auto p95 = distances.begin() + static_cast<std::ptrdiff_t>(0.95 * static_cast<double>(distances.size() - 1));
  std::nth_element(distances.begin(), p95, distances.end());
  result.silhouette_p95_px = static_cast<double>(*p95);
}

base::Error sizeError(const base::Image& truth, const base::Image& picture) {
  const auto size = [](const base::Image& image) {
    return std::to_string(image.width) + " x " + std::to_string(image.height);
  };
  return {base::ErrorCode::kInvalidInput, "pictures differ in size: " + size(truth) + " against " + size(picture)};
}

}  // namespace

base::Result<Accuracy> measureAccuracy(const base::Image& truth, const base::Image& picture) {
  if (truth.width != picture.width || truth.height != picture.height || truth.channels != 4 || picture.channels != 4)
    return sizeError(truth, picture);
  const cv::Mat in_truth = coveredPixels(viewOf(truth)), in_picture = coveredPixels(viewOf(picture));
  const cv::Mat foreground = foregroundOf(viewOf(truth)) | foregroundOf(viewOf(picture));
  Accuracy result;
  result.foreground = static_cast<std::uint64_t>(cv::countNonZero(foreground));
  if (result.foreground == 0)
    return base::Error{base::ErrorCode::kInvalidInput, "neither picture shows anything; move the camera"};

  const cv::Mat a = overGrey(viewOf(truth)), b = overGrey(viewOf(picture));
  const double samples = 3.0 * static_cast<double>(result.foreground);
  result.psnr_db = psnr(a, b, foreground, samples);
  result.mean_abs = cv::norm(a, b, cv::NORM_L1, foreground) / samples;
  result.ssim = cv::mean(ssimMap(luma(a), luma(b)), foreground)[0];

  const double truth_pixels = std::max(1, cv::countNonZero(in_truth));
  result.missing_share = cv::countNonZero(in_truth & ~in_picture) / truth_pixels;
  result.excess_share = cv::countNonZero(in_picture & ~in_truth) / truth_pixels;
  measureSilhouettes(in_truth, in_picture, result);
  return result;
}

Flicker measureFlicker(const JudgedPicture& before, const JudgedPicture& after) {
  const auto change = [](const base::Image& from, const base::Image& to) {
    cv::Mat difference;
    cv::absdiff(overGrey(viewOf(from)), overGrey(viewOf(to)), difference);
    return difference;
  };
  cv::Mat foreground = foregroundOf(viewOf(before.truth));
  for (const base::Image* image : {&before.picture, &after.truth, &after.picture})
    foreground |= foregroundOf(viewOf(*image));
  cv::Mat beyond = change(before.picture, after.picture) - change(before.truth, after.truth);
  cv::threshold(beyond, beyond, 0.0, 0.0, cv::THRESH_TOZERO);
  const cv::Scalar mean = cv::mean(beyond, foreground);
  cv::Mat largest;
  cv::reduce(beyond.reshape(1, static_cast<int>(beyond.total())), largest, 1, cv::REDUCE_MAX);
  const cv::Mat visible = (largest.reshape(1, beyond.rows) > Flicker::kVisible) & foreground;
  return {(mean[0] + mean[1] + mean[2]) / 3.0,
          cv::countNonZero(visible) / std::max(1.0, 1.0 * cv::countNonZero(foreground))};
}

base::Image overMidGrey(const base::Image& rgba) {
  base::Image out(rgba.width, rgba.height, 3);
  cv::Mat pixels = viewOf(out);
  overGrey(viewOf(rgba)).convertTo(pixels, CV_8U);
  return out;
}

base::Image differencePicture(const base::Image& truth, const base::Image& picture) {
  base::Image out(truth.width, truth.height, 3);
  cv::Mat difference;
  cv::absdiff(overGrey(viewOf(truth)), overGrey(viewOf(picture)), difference);
  cv::Mat pixels = viewOf(out);
  cv::Mat(4.0 * difference - cv::Scalar::all(0.4999)).convertTo(pixels, CV_8U);  // convertTo rounds; this truncates
  return out;
}

}  // namespace compare
