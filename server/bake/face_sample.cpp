#include "server/bake/face_sample.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <utility>

#include "base/check.h"
#include "repository/sampling/cube_face.h"
#include "server/bake/face_encoder.h"

namespace server {

std::vector<base::Camera> faceCameras(const SceneRenderer& renderer, const repository::Grid& grid,
                                      const std::vector<repository::FaceKey>& keys) {
  std::vector<base::Camera> cameras;
  const base::Sphere scene{renderer.sceneCenter(), renderer.sceneRadius()};
  for (const repository::FaceKey& key : keys) cameras.push_back(repository::faceCamera(grid, key, scene));
  return cameras;
}

FaceOrder::FaceOrder(const repository::Grid& grid)
    : points_(repository::pointsInMortonOrder(grid)), count_(grid.faceCount()) {
  // Steps of 0.618 of a whole turn fall into one of the largest gaps that are left.
  step_ = std::max<std::uint64_t>(
      1, static_cast<std::uint64_t>(std::llround(static_cast<double>(count_) / std::numbers::phi)));
  while (std::gcd(step_, count_) > 1) ++step_;
}

repository::FaceKey FaceOrder::face(std::uint64_t n) const {
  LUMIGRID_CHECK_LT(n, count_);
  // Both factors are below 2^29 (a grid that may be baked has at most 2^26 points).
  const std::uint64_t number = n * step_ % count_;
  const glm::uvec3& point = points_[static_cast<std::size_t>(number / 6)];
  return {point.x, point.y, point.z, static_cast<std::uint32_t>(number % 6)};
}

base::Result<std::vector<base::Image>> sampleFaces(SceneRenderer& renderer, const repository::Grid& grid,
                                                   const RenderOptions& options, std::size_t wanted) {
  const FaceOrder order(grid);
  const std::uint64_t tries = std::min(order.count(), kMaxSampleTries);
  std::vector<base::Image> faces;
  const auto keep = [&](std::size_t, RenderedPicture rendered) {
    if (faces.size() < wanted && showsModel(rendered.rgba)) faces.push_back(std::move(rendered.rgba));
  };
  for (std::uint64_t n = 0; n < tries && faces.size() < wanted; ++n)
    LUMIGRID_TRY(renderer.renderMany(faceCameras(renderer, grid, {order.face(n)}), options, keep));
  LUMIGRID_TRY(renderer.finish());
  return faces;
}

}  // namespace server
