#pragma once
// Throws shadows on patches: the casters are those of the scene's hlod.lgh, and surfaces are shaded as its nodes are
// (Guthe et al. 2004, section 4).
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/draw/node_shadows.h"
#include "lod/draw/shadow_map.h"
#include "lod/hlod/stream.h"
#include "lod/patch/hierarchy.h"

namespace server {

/// The patches of a picture in maps' order: each map is drawn and then the patches on which it throws shadows, as
/// lod::draw::NodeRenderer does it. Needs a GL context that is current from create() to the destructor, on one thread.
class PatchShadows {
 public:
  /// A patch under a map, and what shaders/shadow.glsl calls so.
  struct Receiver {
    std::uint32_t patch = 0;
    float reach = 0.0F;
    bool one_of_several = false;
  };

  /// Opens the hlod.lgh of the scene in `directory`. `light`: has shadows. Errors name the file: kNotFound if the scene
  /// was built without (the message says how to), and those of reading it.
  static base::Result<std::unique_ptr<PatchShadows>> create(const std::string& directory, const base::Scene& scene,
                                                            const base::Light& light);

  /// Returns the memory that the shadows of such a light take in a scene of so many triangles, at most; 0 without
  /// shadows.
  static std::uint64_t memoryFor(const base::Light& light, std::uint64_t triangles);

  /// Finds the maps for these patches, the nearest first. `view`: with the tile that is drawn; its tolerance is that of
  /// the patches, pixels, 0 for leaves. `one_of_many`: more pictures will be drawn, for which maps of the whole scene
  /// are kept: patches from whose distance they are fine enough have no maps of the view's own. The last map, which may
  /// have no receivers, is for patches that no shadow reaches.
  base::Result<void> plan(const lod::hlod::TraverseRequest& view, const lod::patch::Hierarchy& hierarchy,
                          std::span<const std::uint32_t> patches, bool one_of_many);
  std::size_t maps() const { return maps_.size(); }
  const std::vector<Receiver>& receivers(std::size_t map) const { return maps_[map].receivers; }

  /// Draws a map. Leaves another framebuffer, viewport and state bound.
  base::Result<void> drawMap(std::size_t map);
  /// Layers of the map that was drawn last.
  int layers() const { return shadow_map_->layers(); }
  /// Sets the uniforms for the map that was drawn last, and binds it. `program`: in use. `origin`: from where the
  /// shader's places count, scene-local.
  void use(const base::gl::Program& program, const glm::vec3& origin) const { shadow_map_->use(program, origin); }

 private:
  PatchShadows(std::string path, const std::shared_ptr<const lod::FileBytes>& file, const base::Scene& scene,
               const base::Light& light);

  /// Slots of the view's own maps, of the one without casters, and the first of the scene's.
  static constexpr std::size_t kOwnSlot = 0, kEmptySlot = 1, kFirstSceneSlot = 2;
  struct Map {
    const lod::draw::NodeShadowMap* map;
    std::size_t slot;
    std::vector<Receiver> receivers;
  };
  struct SceneMap {
    std::optional<lod::draw::NodeShadowMap> map;  ///< none where it would be too large
    std::size_t slot;
  };
  const SceneMap& sceneMap(int level);
  int findSceneMap(const lod::hlod::TraverseRequest& view, const lod::patch::Hierarchy& hierarchy,
                   std::span<const std::uint32_t> patches, std::vector<bool>& served);

  const std::string path_;
  lod::hlod::Stream stream_;
  const lod::draw::NodeLight light_;
  lod::draw::NodeShadows own_;  ///< maps of the view, and at last the one without casters
  /// Those for views in which 2^level pixels are a scene unit long.
  std::map<int, SceneMap> scene_maps_;
  lod::hlod::TraverseRequest scene_request_;  ///< for which they are
  std::vector<Map> maps_;
  std::unique_ptr<lod::draw::ShadowMap> shadow_map_;
};

}  // namespace server
