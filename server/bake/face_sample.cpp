#include "server/bake/face_sample.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <numeric>
#include <utility>

#include "base/check.h"
#include "repository/sampling/cube_face.h"
#include "server/bake/face_encoder.h"
#include "server/bake/face_pyramid.h"

namespace server {

std::vector<base::Camera> faceCameras(const SceneRenderer& renderer, const repository::Grid& grid,
                                      const std::vector<repository::FaceKey>& keys) {
  std::vector<base::Camera> cameras;
  const base::Sphere scene{renderer.sceneCenter(), renderer.sceneRadius()};
  for (const repository::FaceKey& key : keys)
    cameras.push_back(grid.isTiled() ? repository::wholeFaceCamera(grid, key, scene)
                                     : repository::faceCamera(grid, key, scene));
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

namespace {

/// Calls `keep` for faces in FaceOrder that show something, until it has had `wanted`.
base::Result<void> visitSample(SceneRenderer& renderer, const repository::Grid& grid, const RenderOptions& options,
                               std::size_t wanted, const std::function<void(base::Image)>& keep) {
  const FaceOrder order(grid);
  const std::uint64_t tries = std::min(order.count(), kMaxSampleTries);
  std::size_t kept = 0;
  const auto look = [&](std::size_t, RenderedPicture rendered) {
    if (kept == wanted || !showsModel(rendered.rgba)) return;
    ++kept;
    keep(std::move(rendered.rgba));
  };
  for (std::uint64_t n = 0; n < tries && kept < wanted; ++n)
    LUMIGRID_TRY(renderer.renderMany(faceCameras(renderer, grid, {order.face(n)}), options, look));
  return renderer.finish();
}

std::vector<std::uint32_t> tilesThatShowModel(const FacePyramid& pyramid) {
  std::vector<std::uint32_t> tiles;
  for (const ChosenTile& chosen : chooseTiles(pyramid))
    if (pyramid.showsModel(chosen.tile)) tiles.push_back(chosen.tile);
  return tiles;
}

}  // namespace

base::Result<std::vector<base::Image>> sampleFaces(SceneRenderer& renderer, const repository::Grid& grid,
                                                   const RenderOptions& options, std::size_t wanted) {
  std::vector<base::Image> faces;
  LUMIGRID_TRY(
      visitSample(renderer, grid, options, wanted, [&](base::Image face) { faces.push_back(std::move(face)); }));
  return faces;
}

base::Result<std::vector<base::Image>> sampleTiles(SceneRenderer& renderer, const repository::Grid& grid,
                                                   const RenderOptions& options, std::size_t wanted_faces,
                                                   std::size_t tiles_of_face) {
  std::vector<base::Image> images;
  LUMIGRID_TRY(visitSample(renderer, grid, options, wanted_faces, [&](const base::Image& face) {
    const FacePyramid pyramid(face, grid.tile_depth);
    const std::vector<std::uint32_t> tiles = tilesThatShowModel(pyramid);
    const std::size_t taken = std::min(tiles.size(), tiles_of_face);
    for (std::size_t i = 0; i < taken; ++i) images.push_back(pyramid.imageOf(tiles[i * tiles.size() / taken]));
  }));
  return images;
}

}  // namespace server
