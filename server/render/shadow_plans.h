#pragma once
// Finds the shadow maps of a picture, and what throws shadows in them, for all that is drawn with the casters of a
// scene's hlod.lgh: its nodes, and its patches (Guthe et al. 2004, section 4.1).
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "base/error.h"
#include "base/json/scene_file.h"
#include "lod/draw/hlod_nodes.h"
#include "lod/hlod/shadow_cut.h"
#include "lod/hlod/stream.h"

namespace server {

enum class Shadows : std::uint8_t { kNone, kHard, kSoft };

struct ShadowOptions {
  Shadows shadows = Shadows::kNone;
  /// The light of shadows, scene-local. Hard ones ignore its size, soft ones need one.
  lod::hlod::ShadowLight light;
};

/// The shadows that a scene's light throws. `origin`: the scene's.
ShadowOptions shadowsOf(const base::Light& light, const glm::dvec3& origin);
/// kInvalidInput for soft shadows of a light without size.
base::Result<void> checkShadows(const ShadowOptions& options);

/// `stream`: that of the casters' file, which is here whole, after an update() for this picture. `view`: with the tile
/// that is drawn. `receivers`: what is drawn of it. `closed`: the surface has no border. A damaged file is told by the
/// stream.
lod::draw::NodeShadows planShadows(lod::hlod::Stream& stream, const lod::hlod::TraverseRequest& view,
                                   std::span<const lod::hlod::ShadowReceiver> receivers, const ShadowOptions& options,
                                   bool closed);

}  // namespace server
