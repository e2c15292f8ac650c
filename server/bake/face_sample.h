#pragma once
// Renders a few faces that stand for all of a grid.
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/image.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/key.h"
#include "server/render/scene_renderer.h"

namespace server {

/// Pixels along one side of the pictures that a bake draws.
inline std::uint32_t drawnSide(const repository::Grid& grid) {
  return grid.isTiled() ? repository::kTileSide << grid.tile_depth : grid.face_size;
}

/// The cameras with which these faces are baked: each shows a whole face, also where that is to be cut into tiles.
std::vector<base::Camera> faceCameras(const SceneRenderer& renderer, const repository::Grid& grid,
                                      const std::vector<repository::FaceKey>& keys);

/// Lists every face of the grid once, so that each beginning of the list is spread evenly over the Morton order and the
/// six directions. It steps by the golden section of all faces: the n-th face is number n · step mod faceCount(),
/// counted by point in Morton order, then by d; step has no divisor in common with faceCount().
class FaceOrder {
 public:
  explicit FaceOrder(const repository::Grid& grid);
  std::uint64_t count() const { return count_; }
  repository::FaceKey face(std::uint64_t n) const;

 private:
  std::vector<glm::uvec3> points_;  // in Morton order
  std::uint64_t count_ = 0;
  std::uint64_t step_ = 1;
};

/// A sample renders so many faces at most: a scene that most faces miss is not searched to its end.
inline constexpr std::uint64_t kMaxSampleTries = 4096;  // some 30 s of software GL

/// Renders faces in FaceOrder until `wanted` of them show something (a pixel that is stored as model), or
/// kMaxSampleTries were looked at. The same faces, and bytes, as a bake of these options draws. Images as
/// RenderedPicture::rgba; none when nothing is seen.
base::Result<std::vector<base::Image>> sampleFaces(SceneRenderer& renderer, const repository::Grid& grid,
                                                   const RenderOptions& options, std::size_t wanted);

/// The images of a grid of tiles that stand for all of them: of each of sampleFaces() at most `tiles_of_face`, evenly
/// over those that are worth storing and show something.
base::Result<std::vector<base::Image>> sampleTiles(SceneRenderer& renderer, const repository::Grid& grid,
                                                   const RenderOptions& options, std::size_t wanted_faces,
                                                   std::size_t tiles_of_face);

}  // namespace server
