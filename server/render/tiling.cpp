#include "server/render/tiling.h"

#include <algorithm>
#include <limits>

namespace server {
namespace {

// Limit for a picture's side, so that a camera file can't ask for more memory than any machine has.
constexpr int kMaxPictureSide = 32768;

base::Error wrongPicture(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "render: " + problem};
}

}  // namespace

base::Result<void> checkPicture(const base::Camera& camera, int supersampling) {
  if (camera.width < 1 || camera.height < 1 || camera.width > kMaxPictureSide || camera.height > kMaxPictureSide)
    return wrongPicture("a picture of " + std::to_string(camera.width) + " x " + std::to_string(camera.height) +
                        " pixels; each side must be 1 to " + std::to_string(kMaxPictureSide));
  if (supersampling < 1 || supersampling > 8)
    return wrongPicture("supersampling " + std::to_string(supersampling) + "; it must be 1 to 8");
  return {};
}

TilePlan planTiles(int width, int height, int supersampling, int max_side, std::uint64_t max_samples, int border) {
  TilePlan plan{width, height, 0, {}};
  const auto samples = [&](int pixels) { return std::int64_t{pixels + 2 * plan.border} * supersampling; };
  const auto fits = [&] {
    return samples(plan.tile_width) <= max_side && samples(plan.tile_height) <= max_side &&
           static_cast<std::uint64_t>(samples(plan.tile_width) * samples(plan.tile_height)) <= max_samples;
  };

  // Divide the longer side into one more part until the parts fit.
  int columns = 1;
  int rows = 1;
  while (!fits() && (plan.tile_width > 1 || plan.tile_height > 1)) {
    plan.border = border;
    (plan.tile_width >= plan.tile_height ? columns : rows) += 1;
    plan.tile_width = (width + columns - 1) / columns;
    plan.tile_height = (height + rows - 1) / rows;
  }
  for (int y = 0; y < height; y += plan.tile_height)
    for (int x = 0; x < width; x += plan.tile_width)
      plan.tiles.push_back({x, y, std::min(plan.tile_width, width - x), std::min(plan.tile_height, height - y)});
  return plan;
}

base::Camera tileCamera(const base::Camera& camera, int x, int y, int tile_width, int tile_height) {
  if (x == 0 && y == 0 && tile_width == camera.width && tile_height == camera.height) return camera;

  // The pixel column at X of W has NDC 2 X / W − 1; in the tile it is at X − x of w. So x_tile = x_ndc · W / w +
  // (W − 2 x − w) / w, which in clip space is a scale, and a shift by w_clip. Rows are alike, counted from the bottom.
  const auto full = glm::dvec2(camera.width, camera.height);
  const auto part = glm::dvec2(tile_width, tile_height);
  const auto corner = glm::dvec2(x, camera.height - y - tile_height);
  const glm::dvec2 scale = full / part;
  const glm::dvec2 shift = (full - 2.0 * corner - part) / part;
  glm::dmat4 tile_from_clip(1.0);
  tile_from_clip[0][0] = scale.x;
  tile_from_clip[1][1] = scale.y;
  tile_from_clip[3][0] = shift.x;
  tile_from_clip[3][1] = shift.y;

  base::Camera tile = camera;
  tile.clip_from_eye = glm::mat4(tile_from_clip * glm::dmat4(camera.clip_from_eye));
  tile.width = tile_width;
  tile.height = tile_height;
  return tile;
}

PixelBounds::PixelBounds(const base::Camera& camera)
    : clip_from_scene_(glm::dmat4(camera.clip_from_eye) * glm::dmat4(camera.eye_from_scene)),
      size_(camera.width, camera.height),
      min_(std::numeric_limits<double>::infinity()),
      max_(-std::numeric_limits<double>::infinity()) {}

void PixelBounds::add(const base::Aabb& box) {
  for (int i = 0; i < 8; ++i) {
    const glm::dvec4 clip = clip_from_scene_ * glm::dvec4(glm::dvec3(box.corner(i)), 1.0);
    if (!(clip.w > 0.0)) {
      min_ = glm::dvec2(0.0);
      max_ = size_;
      return;
    }
    // In front of the eye the hull of the corners contains the box's picture. NDC's y counts upwards, rows downwards.
    const glm::dvec2 pixel = size_ * (0.5 + glm::dvec2(0.5, -0.5) * glm::dvec2(clip) / clip.w);
    min_ = glm::min(min_, pixel);
    max_ = glm::max(max_, pixel);
  }
}

Tile PixelBounds::within(int width, int height) const {
  const glm::dvec2 limit(width, height);
  const glm::ivec2 from(glm::clamp(glm::floor(min_) - 1.0, glm::dvec2(0.0), limit));
  const glm::ivec2 to(glm::clamp(glm::ceil(max_) + 1.0, glm::dvec2(0.0), limit));
  if (from.x >= to.x || from.y >= to.y) return {};
  return {from.x, from.y, to.x - from.x, to.y - from.y};
}

}  // namespace server
