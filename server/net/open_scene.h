#pragma once
// A scene directory opened for serving: everything that sessions share.
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/file.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "repository/access.h"
#include "repository/objects/objects.h"
#include "repository/packs/pack_store.h"
#include "repository/sampling/grid.h"
#include "repository/sampling/parameters.h"
#include "repository/sampling/tree_text.h"
#include "repository/store.h"
#include "server/session/session.h"

namespace server {

/// What is kept here of a scene that lies elsewhere.
struct RemoteOptions {
  std::string cache_directory;                         ///< empty: defaultCacheDirectory()
  std::uint64_t cache_bytes = std::uint64_t{4} << 30;  ///< of images, index and splats; the hierarchy besides
  std::function<void(const std::string&)> warn;        ///< told in a line what the cache cannot do; null: nobody
};
/// $XDG_CACHE_HOME/lumigrid or ~/.cache/lumigrid; empty where neither is known.
std::string defaultCacheDirectory();

/// Owns what `data` points to; stays where it is.
struct OpenScene {
  base::Scene scene;
  lod::patch::PatchFile patches;               ///< nothing is in it where data.patches is null: splats alone
  std::unique_ptr<repository::Store> images;   ///< null: the scene has no repository
  repository::PackStore* packs = nullptr;      ///< the same, when the scene is a published one
  repository::SampledPoints points;            ///< of the repository
  std::vector<repository::TreeGrowth> growth;  ///< how the tree grew
  base::Bytes scene_json;                      ///< the file, as it is
  std::string directory;                       ///< where it lies; empty: behind a network
  std::string annotations_json;                ///< of a scene behind a network, checked; empty: it has none
  base::MappedFile patch_bytes;                ///< the file, for byte ranges
  base::MappedFile splat_bytes;                ///< qsplat.lgq likewise; empty: not built, or behind a network
  /// Where qsplat.lgq is read by ranges, through the cache; null: not built, or splat_bytes has it.
  std::unique_ptr<repository::ObjectSource> far_splats;
  std::unique_ptr<lod::patch::ProxySight> sight;  ///< null: no images, or the hierarchy's coarse patches are damaged
  SceneData data;  ///< what a Session takes; welcome.can_render_frames is false until somebody renders
};

/// Reads scene.json, patch.lgp and, when it is there, images/ (DESIGN section 3), as `lumigrid build` or `lumigrid
/// publish` left them. Errors name the file. A scene without patches has splats, or it is kNotFound. A built scene's
/// repository is opened for reading: a bake may go on at the same time. Not twice for one scene in one process (LMDB).
/// `place` may also be where a published scene lies behind a network, "https://host/scene" or "s3://bucket/scene"
/// (docs/places.md): its hierarchy is mirrored, for it is memory-mapped; images and splats are read by range through a
/// cache.
base::Result<std::unique_ptr<OpenScene>> openScene(const std::string& place, const RemoteOptions& options = {});

/// The bytes of scene.json at a place. Errors as ObjectSource::read; kInvalidInput where it is too long to be one.
base::Result<base::Bytes> readSceneJson(const repository::ObjectSource& source);
/// The images of a published scene; `index` as scene.json lists it.
base::Result<std::unique_ptr<repository::PackStore>> openPacks(const std::string& directory, const std::string& index);
/// What access counts of the scene belong to.
repository::AccessIdentity accessIdentityOf(const OpenScene& open);

}  // namespace server
