#pragma once
// Draws the leaves of a pmr.lgm with OpenGL ES (Dey and Hudson 2002, section 3), for the server and the client:
// umbrella triangles, and points where the umbrellas are smaller than a pixel.
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <unordered_map>

#include "base/camera.h"
#include "base/gl/gl.h"
#include "lod/draw/triangles.h"
#include "lod/pmr/stream.h"

namespace lod::draw {

struct UmbrellaView {
  base::Camera camera;  ///< perspective, off-axis too, or parallel
  Shading shading;
  glm::vec4 section = base::kNoSection;  ///< everything beyond it is cut away
  bool oriented = false;                 ///< pmr::Header::oriented; else all normals are turned towards the viewer
  /// kResolutionLegend by the projected diameter of the leaf's mean umbrella, hatched with dark lines where a finer
  /// level is still to come; otherwise the colours of the scan, shaded.
  bool resolution_colors = false;
};

struct UmbrellaTarget {
  GLuint framebuffer = 0;  ///< colour and depth, cleared or with a picture to draw into
  int width = 0;           ///< samples; the camera's picture covers all of them
  int height = 0;
};

struct UmbrellaCount {
  std::uint64_t points = 0, triangles = 0;
};

/// Leaves are uploaded when first drawn: 20 bytes a vertex, 2 a point, 6 a triangle. Those whose picture nobody holds
/// any more are dropped with the next draw, and those that no draw has used for the longest time where the limit asks
/// for it.
class UmbrellaRenderer {
 public:
  /// Needs a current context, as do the other functions. `gpu_bytes`: limit for leaves on the GPU; those of the frame
  /// that is being drawn stay in any case.
  static base::Result<std::unique_ptr<UmbrellaRenderer>> create(std::uint64_t gpu_bytes);
  /// Draws both sides of all surfaces. The depth test (less) stays enabled.
  base::Result<UmbrellaCount> draw(std::span<const pmr::DrawnLeaf> leaves, const UmbrellaView& view,
                                   const UmbrellaTarget& target);
  std::uint64_t gpuBytes() const { return bytes_; }

 private:
  struct Pass;
  struct Mesh {
    std::weak_ptr<const pmr::LeafPicture> picture;
    base::gl::VertexArray points_array, triangles_array;
    base::gl::Buffer vertices, points, corners;
    float mean_radius = 0.0F;  ///< of the umbrellas, scene units
    std::uint64_t bytes = 0;
    std::uint64_t last_use = 0;  ///< frame
  };
  UmbrellaRenderer() = default;
  base::Result<const base::gl::Program*> program(const Pass& pass);
  Mesh upload(const std::shared_ptr<const pmr::LeafPicture>& picture);
  void prepare(std::span<const pmr::DrawnLeaf> leaves);
  void dropUnused();
  base::Result<std::uint64_t> drawPass(const Pass& pass, std::span<const pmr::DrawnLeaf> leaves,
                                       const UmbrellaView& view, const UmbrellaTarget& target);

  std::array<base::gl::Program, 8> programs_;  ///< by Pass::number(), linked when first needed
  std::unordered_map<const pmr::LeafPicture*, Mesh> meshes_;
  std::uint64_t gpu_bytes_ = 0;
  std::uint64_t bytes_ = 0;
  std::uint64_t frame_ = 0;
};

}  // namespace lod::draw
