#pragma once
// Draws the nodes of a hlod.lgh with OpenGL ES (Guthe et al. 2004, sections 3.2 and 4), for the server and the client:
// triangles, points where they were small, and lines along the edges where cracks may open.
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "lod/draw/index_buffer.h"
#include "lod/draw/picture_cache.h"
#include "lod/draw/shadow_map.h"
#include "lod/draw/surfaces.h"
#include "lod/hlod/stream.h"

namespace lod::draw {

/// Its resolution is the node's projected error.
using NodeView = SurfaceView;
using NodeTarget = SurfaceTarget;

/// A map, and what throws shadows in it.
struct NodeShadowMap {
  hlod::ShadowMapPlan plan;
  std::vector<DrawnCaster> casters;  ///< those of the plan
};

/// The shadows on nodes that are drawn.
struct NodeShadows {
  hlod::ShadowLight light;
  std::span<const hlod::Node> nodes;  ///< the file's table
  /// Receivers are places in the list of nodes that is drawn. Maps of a node that is in several of them must hold all
  /// of it together; a node that is in none is wholly lit.
  std::vector<NodeShadowMap> maps;
  std::uint64_t kept_bytes = 0;  ///< what maps may take that are kept for the next picture
};

/// How far a surface and that of the casters beside it may be apart, scene units. `error`: how far it may be from the
/// source's; `box` holds it. `nodes`: the casters' table.
float shadowReach(const base::Aabb& box, float error, std::span<const DrawnCaster> casters,
                  std::span<const hlod::Node> nodes);

struct NodeCount {
  std::uint64_t triangles = 0, points = 0, lines = 0;
};

/// Nodes are kept on the GPU as a PictureCache does: 20 bytes a vertex; 6 a triangle and 4 a line, or twice that where
/// the node has more than 65536 vertices.
///
/// With shadows surfaces are shaded by Lambert's law, lit or unlit scenes alike: their colour times 0.35 + 0.65 · n·l ·
/// the share of the light that is seen. The maps are drawn one after the other, each before its receivers, so that
/// memory for one is enough. A shadow begins where its caster is as far away as the errors of both and a texel demand.
///
/// Surfaces that turn their back to the eye are drawn deeper by twice the node's error, so that the far side of a thin
/// wall does not show through the near one, where each is off by as much as the error.
///
/// Points are as large, and lines as wide, as the node's error demands for the surface to have no hole: the cells on
/// both sides of a crack, and points around a place, are off by at most their errors. They span a sample at least:
/// where the picture has several samples a pixel, larger ones would only make silhouettes thicker.
class NodeRenderer {
 public:
  /// Needs a current context, as do the other functions. `gpu_bytes`: limit for nodes on the GPU; those of the frame
  /// that is being drawn stay in any case.
  static base::Result<std::unique_ptr<NodeRenderer>> create(std::uint64_t gpu_bytes);
  /// Brings nodes to the GPU ahead of their drawing.
  void upload(std::span<const hlod::DrawnNode> nodes) { meshes_.beginFrame(nodes, meshOf); }
  /// Draws both sides of all surfaces, with the near plane moved out to them (NearFit). The depth test (less) stays
  /// enabled.
  base::Result<NodeCount> draw(std::span<const hlod::DrawnNode> nodes, const NodeView& view, const NodeTarget& target,
                               const NodeShadows* shadows = nullptr);
  /// Frees the maps and casters of shadows until they are drawn again.
  void dropShadows() { shadow_map_.reset(); }
  /// The camera of the last draw(), by which the depths in its target are made.
  const base::Camera& drawnCamera() const { return drawn_camera_; }
  /// Those of nodes, casters and shadow maps. Casters have the same limit as nodes, and maps have none.
  std::uint64_t gpuBytes() const { return meshes_.bytes() + (shadow_map_ ? shadow_map_->gpuBytes() : 0); }

 private:
  struct Mesh {
    base::gl::VertexArray array;
    base::gl::Buffer vertices;
    IndexBuffer indices;  ///< of the triangles, then of the lines
    base::Aabb box;
    std::uint64_t bytes = 0;
  };
  /// Nodes that are drawn together, and how they are shaded.
  struct Group {
    std::vector<const hlod::DrawnNode*> nodes;
    int shadow_layers = 0;  ///< of the shadow map; 0: no shadows
    struct InShadow {
      float reach = 0.0F;
      bool one_of_several = false;
    };
    std::vector<InShadow> in_shadow;  ///< with shadows: for each node what shaders/shadow.glsl calls so
  };
  explicit NodeRenderer(std::uint64_t gpu_bytes) : gpu_bytes_(gpu_bytes), meshes_(gpu_bytes) {}
  static Mesh meshOf(const hlod::NodePicture& picture);
  base::Camera fitted(const base::Camera& camera, std::span<const hlod::DrawnNode> nodes) const;
  base::Result<void> drawMap(const NodeShadowMap& map, const NodeShadows& shadows, std::size_t slot);
  base::Result<void> drawShadowed(std::span<const hlod::DrawnNode> nodes, const NodeView& view,
                                  const NodeTarget& target, const NodeShadows& shadows, NodeCount& count);
  base::Result<void> drawGroup(const Group& group, const NodeView& view, const NodeTarget& target, NodeCount& count);
  base::Result<std::uint64_t> drawPass(Primitive primitive, const Group& group, const NodeView& view,
                                       const NodeTarget& target);

  const std::uint64_t gpu_bytes_;
  SurfacePrograms programs_{SurfaceStyle{.name = "nodes",
                                         .shade_fragments = true,
                                         .fill_behind = true,
                                         .backs_behind = true,
                                         .shadow_source = ShadowMap::shadingSource()}};
  PictureCache<hlod::NodePicture, Mesh> meshes_;
  base::Camera drawn_camera_;
  std::unique_ptr<ShadowMap> shadow_map_;  ///< null until it is needed
};

}  // namespace lod::draw
