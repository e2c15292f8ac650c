#pragma once
// Draws shadow maps of the casters of a hlod.lgh with OpenGL ES, and says how surfaces are shaded by them (Guthe et al.
// 2004, section 4.2).
//
// A light without size has one map. That of an area light has a layer for each of some samples of its disc. The paper
// estimates penumbrae from the silhouettes of one map (its penumbra quads); the layers' mean is right for any casters.
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/geometry.h"
#include "base/gl/gl.h"
#include "lod/draw/index_buffer.h"
#include "lod/draw/picture_cache.h"
#include "lod/hlod/shadow_cut.h"
#include "lod/hlod/stream.h"

namespace lod::draw {

/// The most samples of a light.
inline constexpr int kMaxLightLayers = 16;

/// How a map is drawn.
struct ShadowMapView {
  base::Camera camera;  ///< from the light's middle; width and height: of each layer, texels
  hlod::ShadowLight light;
  base::Aabb receivers;    ///< of what the map throws shadows on
  bool one_sided = false;  ///< triangles that turn their back to the light throw no shadow

  /// 1 for a light without size, else 4, 8 or 16: one for each two texels of the widest penumbra.
  int layers() const;
};

struct DrawnCaster {
  std::shared_ptr<const hlod::CasterPicture> picture;  ///< not null
};

/// The layers of a light in normalized device coordinates of the view from its middle: sheared by depth, so that what
/// has a certain depth stays in its place, and shrunk, so that all receivers are in every layer.
struct LightLayers {
  std::vector<glm::vec2> shears;  ///< one for each layer; x and y for a depth
  glm::vec2 cell{0.0F};           ///< shear of the radius of a sample's share of the light
  glm::vec2 window{1.0F};         ///< the factor that shrinks
  float middle = 0.0F;            ///< the depth that stays

  static LightLayers of(const ShadowMapView& view);
  /// Clip coordinates in the layer from those in the light's view.
  glm::mat4 layerFromLight(std::size_t layer) const;
};

/// One shadow map, which is drawn anew for each group of receivers. Depth: 24 bits a texel. The texture grows to the
/// largest map, and takes at most twice that one's bytes. Casters are kept on the GPU as a PictureCache does: 12 bytes
/// a position, 6 or 12 a triangle.
///
/// Neighbouring cells are simplified each by itself, so cracks as wide as their errors are between their casters. Each
/// caster is therefore drawn that much larger than it is, beyond its open edges.
class ShadowMap {
 public:
  /// Needs a current context, as do the other functions. `gpu_bytes`: limit for casters that are kept.
  static base::Result<std::unique_ptr<ShadowMap>> create(std::uint64_t gpu_bytes);
  /// Leaves another framebuffer and viewport bound. Errors: kUnsupported for a map
  /// that is larger than the GL allows, kNoSpace.
  base::Result<void> draw(const ShadowMapView& view, std::span<const DrawnCaster> casters);

  /// Layers of the map that was drawn last.
  int layers() const { return view_.layers(); }

  /// GLSL of the fragment shader: `vec3 shadeInLight(vec3 color, vec3 normal, vec3 to_eye, vec3 place)` with
  /// `#define LAYERS` before. The caller sets `u_reach` and `u_one_of_several`: their meanings are in
  /// shaders/shadow.glsl.
  static std::string shadingSource();
  /// Sets the uniforms for the map that was drawn last, and binds it. `program`: in use. `origin`: from where the
  /// shader's places count, scene-local.
  void use(const base::gl::Program& program, const glm::vec3& origin) const;
  /// Frees the units that use() binds.
  static void endUse();

  std::uint64_t gpuBytes() const { return meshes_.bytes() + depths_.bytes(); }

 private:
  using Sampler =
      base::gl::Object<base::gl::NameTraits<glGenSamplers, glDeleteSamplers, base::gl::detail::StorageKind::kNone>>;
  struct Mesh {
    base::gl::VertexArray array;
    base::gl::Buffer positions;
    IndexBuffer indices;
    std::uint64_t bytes = 0;
  };
  explicit ShadowMap(std::uint64_t gpu_bytes) : meshes_(gpu_bytes) {}
  static Mesh upload(const hlod::CasterPicture& picture);
  base::Result<void> fit(int width, int height, int layers);
  base::Result<void> drawLayer(const glm::mat4& layer_from_light, std::size_t layer,
                               std::span<const DrawnCaster> casters);

  base::gl::Program program_;
  PictureCache<hlod::CasterPicture, Mesh> meshes_;
  base::gl::Texture depths_;
  base::gl::Framebuffer framebuffer_;
  Sampler compared_, plain_;
  int width_ = 0, height_ = 0, layers_ = 0;  ///< of the texture
  ShadowMapView view_;                       ///< of the map that was drawn last
};

}  // namespace lod::draw
