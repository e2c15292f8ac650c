#pragma once
// Draws the leaves of a pmr.lgm with OpenGL ES (Dey and Hudson 2002, section 3), for the server and the client:
// umbrella triangles, and points where the umbrellas are smaller than a pixel.
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "lod/draw/picture_cache.h"
#include "lod/draw/surfaces.h"
#include "lod/pmr/stream.h"

namespace lod::draw {

/// Its resolution is the projected diameter of the leaf's mean umbrella.
struct UmbrellaView : SurfaceView {
  bool oriented = false;  ///< pmr::Header::oriented; else all normals are turned towards the viewer
};

struct UmbrellaCount {
  std::uint64_t points = 0, triangles = 0;
};

/// Leaves are kept on the GPU as a PictureCache does: 20 bytes a vertex, 2 a point, 6 a triangle.
class UmbrellaRenderer {
 public:
  /// Needs a current context, as do the other functions. `gpu_bytes`: limit for leaves on the GPU; those of the frame
  /// that is being drawn stay in any case.
  static base::Result<std::unique_ptr<UmbrellaRenderer>> create(std::uint64_t gpu_bytes);
  /// Brings leaves to the GPU ahead of their drawing.
  void upload(std::span<const pmr::DrawnLeaf> leaves) { meshes_.beginFrame(leaves, meshOf); }
  /// Draws both sides of all surfaces, with the near plane moved out to them (NearFit). The depth test (less) stays
  /// enabled.
  base::Result<UmbrellaCount> draw(std::span<const pmr::DrawnLeaf> leaves, const UmbrellaView& view,
                                   const SurfaceTarget& target);
  /// The camera of the last draw(), by which the depths in its target are made.
  const base::Camera& drawnCamera() const { return drawn_camera_; }
  std::uint64_t gpuBytes() const { return meshes_.bytes(); }

 private:
  struct Mesh {
    base::gl::VertexArray points_array, triangles_array;
    base::gl::Buffer vertices, points, corners;
    std::vector<float> reaches;  ///< of the triangles, where they are sorted; else they lie as they were coded
    float mean_radius = 0.0F;    ///< of the umbrellas, scene units
    base::Aabb box;
    std::uint64_t bytes = 0;
  };
  explicit UmbrellaRenderer(std::uint64_t gpu_bytes) : meshes_(gpu_bytes) {}
  static Mesh meshOf(const pmr::LeafPicture& picture);
  static pmr::DrawnPart trianglesToDraw(Mesh& mesh, const pmr::DrawnLeaf& leaf);
  base::Camera fitted(const base::Camera& camera, std::span<const pmr::DrawnLeaf> leaves) const;
  base::Result<std::uint64_t> drawPass(Primitive primitive, std::span<const pmr::DrawnLeaf> leaves,
                                       const UmbrellaView& view, const SurfaceTarget& target);

  SurfacePrograms programs_{SurfaceStyle{.name = "umbrellas"}};
  PictureCache<pmr::LeafPicture, Mesh> meshes_;
  base::Camera drawn_camera_;
};

}  // namespace lod::draw
