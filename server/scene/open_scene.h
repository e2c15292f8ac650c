#pragma once
// A scene opened for serving, with everything that its sessions share.
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
#include "repository/store.h"
#include "server/scene/open_file.h"
#include "server/scene/read_errors.h"
#include "server/session/session.h"

namespace server {

/// The local cache of a remote scene.
struct RemoteOptions {
  std::string cache_directory;  ///< empty: defaultCacheDirectory()
  std::uint64_t cache_bytes = std::uint64_t{4}
                              << 30;             ///< for images, index and streamed files; the hierarchy comes on top
  std::function<void(const std::string&)> warn;  ///< gets a line for each failure of the cache; may be null
};
/// $XDG_CACHE_HOME/lumigrid or ~/.cache/lumigrid; empty where neither is known.
std::string defaultCacheDirectory();

/// The file of a method that viewers stream by ranges: qsplat.lgq, pmr.lgm, hlod.lgh.
struct StreamedFile {
  base::StreamedMethod method{};
  std::uint64_t bytes = 0;
  std::unique_ptr<repository::ObjectSource> source;  ///< not null; reads a remote file through the cache
};

/// Owns everything that `data` points to, and so must not be moved.
struct OpenScene : std::enable_shared_from_this<OpenScene> {
  base::Scene scene;
  lod::patch::PatchFile patches;              ///< empty where data.patches is null
  std::unique_ptr<repository::Store> images;  ///< null: the scene has no repository
  repository::PackStore* packs = nullptr;     ///< `images` of a published scene; null for a built one
  repository::SampledPoints points;           ///< points of the repository
  base::Bytes scene_json;                     ///< the bytes of the file
  std::string directory;                      ///< directory of a local scene; empty: remote
  std::uint64_t images_identity = 0;          ///< tells the images' stores from others of the same names
  std::string name;                           ///< the scene's by its place
  std::string annotations_json;               ///< annotations of a remote scene, checked; empty: it has none
  std::unique_ptr<OpenFile> patch_file;       ///< patch.lgp, or its mirror, for byte ranges; null: no patches
  std::vector<StreamedFile> streamed;         ///< of the methods that the scene has, in the order of kStreamedMethods
  std::unique_ptr<lod::patch::ProxySight> sight;  ///< null: no images, or the hierarchy's coarse patches are damaged
  std::unique_ptr<plan::SightCache> sight_cache;  ///< of `sight`
  std::unique_ptr<MessageCache> messages;         ///< null: none
  const std::unique_ptr<ReadErrors> read_errors = std::make_unique<ReadErrors>();  ///< of all that reads the scene
  SceneData data;  ///< for sessions; can_render_frames is false until a renderer runs
};

/// Null: the scene has no such file.
const StreamedFile* streamedFile(const OpenScene& open, const base::StreamedMethod& method);

/// Opens scene.json, patch.lgp, the files of kStreamedMethods and images/, as far as they are there, as `lumigrid
/// build` or `lumigrid publish` left them (docs/formats/scene.md). Errors name the file; kNotFound without any of them.
/// A built scene's repository is opened for reading, while a bake may write to it; LMDB forbids to open it twice in one
/// process. `place` may also be a published scene behind a network, "https://host/scene" or "s3://bucket/scene"
/// (docs/places.md): its hierarchy is mirrored, since blocks are read all the time; the rest is read by range
/// through a cache.
base::Result<std::unique_ptr<OpenScene>> openScene(const std::string& place, const RemoteOptions& options = {});

/// Whether two documents describe the same files and differ in nothing that a running server has made use of.
bool isSameBuild(const base::Scene& a, const base::Scene& b);
/// Whether the place from which a scene was opened holds another one by now. One that cannot be read, as while it is
/// being replaced, does not.
bool isReplaced(const OpenScene& open, const std::string& place);

/// Reads scene.json at a place. Errors as ObjectSource::read; kInvalidInput for a file over 16 MiB, which no scene.json
/// reaches.
base::Result<base::Bytes> readSceneJson(const repository::ObjectSource& source);
/// Whether the source's textures belong to the scene and are not there: it was published without them. Its leaves then
/// have colours of vertices only, so that no frame would be exact.
bool lacksTextures(const OpenScene& open);
/// Whether the scene's light throws shadows and the nodes that do are not there.
bool lacksShadows(const OpenScene& open);
/// Opens the images of a published scene; `index` as scene.json lists it.
base::Result<std::unique_ptr<repository::PackStore>> openPacks(const std::string& directory, const std::string& index);
/// Identifies the scene in a file of access counts.
repository::AccessIdentity accessIdentityOf(const OpenScene& open);

}  // namespace server
