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
  base::Aabb receivers;  ///< of what the map throws shadows on
  std::array<glm::dvec4, 2> slice{hlod::ShadowMapPlan::kNoEnd, hlod::ShadowMapPlan::kNoEnd};  ///< as the plan's

  /// 1 for a light without size, else 4, 8 or 16: one for each two texels of the widest penumbra.
  int layers() const;
  friend bool operator==(const ShadowMapView& a, const ShadowMapView& b) {
    return base::sameCamera(a.camera, b.camera) && a.light == b.light && a.receivers.min == b.receivers.min &&
           a.receivers.max == b.receivers.max && a.slice == b.slice;
  }
};

struct DrawnCaster {
  std::shared_ptr<const hlod::CasterPicture> picture;  ///< not null
  friend bool operator==(const DrawnCaster&, const DrawnCaster&) = default;
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

/// Shadow maps in slots: one of them is drawn, and shadows are thrown by it, until the next is. A slot keeps its map,
/// so that the same one need not be drawn again, as long as all of them have room. Depth: 24 bits a texel. A texture
/// grows to the largest map of its slot, and takes at most twice the bytes of the map in it. Casters are kept on the
/// GPU as a PictureCache does: 12 bytes a position, 6 or 12 a triangle.
///
/// Neighbouring cells are simplified each by itself, so cracks as wide as their errors are between their casters. Each
/// caster is therefore drawn that much larger than it is, beyond its open edges.
class ShadowMap {
 public:
  /// Needs a current context, as do the other functions. `gpu_bytes`: limit for casters that are kept.
  static base::Result<std::unique_ptr<ShadowMap>> create(std::uint64_t gpu_bytes);
  /// All maps together take so many bytes at most, or the one that was drawn last alone more. 0 at first.
  void setKeptBytes(std::uint64_t bytes) { kept_bytes_ = bytes; }
  /// How many layers may be on their way to the GPU before draw() waits, 0 for any number. Software GL keeps what each
  /// of them is made of until it is drawn, up to 36 MB. Not for browsers, where nothing waits.
  void setLayersQueued(std::size_t layers) { layers_queued_ = layers; }
  /// Leaves another framebuffer and viewport bound. Nothing is drawn where the slot has the very map. Errors:
  /// kUnsupported for a map that is larger than the GL allows, kNoSpace.
  base::Result<void> draw(const ShadowMapView& view, std::span<const DrawnCaster> casters, std::size_t slot = 0);

  /// Layers of the map of the last draw().
  int layers() const { return slots_[slot_].view.layers(); }

  /// GLSL of the fragment shader: `vec3 shadeInLight(vec3 color, vec3 normal, vec3 to_eye, vec3 place)` with
  /// `#define LAYERS` before. The caller sets `u_reach` and `u_one_of_several`: their meanings are in
  /// shaders/shadow.glsl.
  static std::string shadingSource();
  /// Sets the uniforms for the map of the last draw(), and binds it. `program`: in use. `origin`: from where the
  /// shader's places count, scene-local.
  void use(const base::gl::Program& program, const glm::vec3& origin) const;
  /// Frees the units that use() binds.
  static void endUse();

  std::uint64_t gpuBytes() const { return meshes_.bytes() + mapBytes(); }
  /// How many maps draw() has drawn.
  std::uint64_t drawn() const { return drawn_; }

 private:
  using Sampler =
      base::gl::Object<base::gl::NameTraits<glGenSamplers, glDeleteSamplers, base::gl::detail::StorageKind::kNone>>;
  struct Mesh {
    base::gl::VertexArray array;
    base::gl::Buffer positions;
    IndexBuffer indices;
    std::uint64_t bytes = 0;
  };
  struct Slot {
    base::gl::Texture depths;
    base::gl::Framebuffer framebuffer;
    int width = 0, height = 0, layers = 0;  ///< of the texture
    bool is_drawn = false;
    ShadowMapView view;
    std::vector<DrawnCaster> casters;
  };
  explicit ShadowMap(std::uint64_t gpu_bytes) : meshes_(gpu_bytes) {}
  static Mesh upload(const hlod::CasterPicture& picture);
  std::uint64_t mapBytes() const;
  base::Result<void> fit(Slot& slot, int width, int height, int layers) const;
  void makeRoom();
  base::Result<void> drawCasters(const Slot& slot);
  base::Result<void> drawLayer(const Slot& slot, const glm::mat4& layer_from_light, std::size_t layer);

  base::gl::Program program_;
  PictureCache<hlod::CasterPicture, Mesh> meshes_;
  std::vector<Slot> slots_{1};
  std::size_t slot_ = 0;  ///< of the last draw()
  Sampler compared_, plain_;
  std::uint64_t kept_bytes_ = 0, drawn_ = 0;
  std::size_t layers_queued_ = 0;
};

}  // namespace lod::draw
