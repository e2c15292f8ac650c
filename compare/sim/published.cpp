#include "compare/sim/published.h"

#include <utility>

#include "base/hash/sha256.h"
#include "base/json/scene_file.h"
#include "base/parallel.h"
#include "client/native/published_scene.h"
#include "compare/sim/fetcher.h"
#include "lod/patch/group_records.h"
#include "plan/opening_ranges.h"
#include "protocol/welcome.h"
#include "repository/packs/publish.h"

namespace compare {
namespace {

base::Result<client::StaticObject> publishInto(const std::string& directory, const repository::Store& images) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto sink, repository::openDirectorySink(directory));
  repository::PublishOptions options;
  options.jobs = base::coreCount();
  LUMIGRID_ASSIGN_OR_RETURN(const auto published, repository::publishImages(images, *sink, options));
  return client::StaticObject{published.index, published.index_bytes, {{0, published.index_front_bytes}}};
}

}  // namespace

base::Result<std::unique_ptr<PublishedObjects>> PublishedObjects::create(const server::OpenScene& scene,
                                                                         const std::string& directory) {
  if (scene.patch_file == nullptr || scene.directory.empty())
    return base::Error{base::ErrorCode::kUnsupported, "the method static needs a scene on this machine, with patches"};
  LUMIGRID_ASSIGN_OR_RETURN(const auto patches, scene.patch_file->readAll());
  std::unique_ptr<PublishedObjects> objects(new PublishedObjects(scene));
  client::StaticScene& description = objects->description_;
  description.place = "scene";
  description.welcome = protocol::welcomeOf(scene.scene, "scene");
  description.patches = {base::publishedName("patch.lgp", base::hexOf(base::sha256(patches))), patches.size()};
  objects->records_ = lod::patch::encodeRecords(scene.patches.hierarchy(), patches.size());
  description.records = {base::publishedName("records.lgr", base::hexOf(base::sha256(objects->records_))),
                         objects->records_.size()};
  LUMIGRID_ASSIGN_OR_RETURN(auto opening, plan::openingRanges(scene.patches.hierarchy(), objects->records_));
  description.records.opening = {opening.records};
  description.patches.opening = std::move(opening.blocks);
  if (!scene.images) return objects;
  std::string place = scene.directory;
  if (scene.packs == nullptr) {
    place = directory;
    LUMIGRID_ASSIGN_OR_RETURN(description.index, publishInto(directory, *scene.images));
  } else {
    description.index = client::objectOfPart(scene.scene, "images/index", ".lgi");
  }
  LUMIGRID_ASSIGN_OR_RETURN(objects->images_, repository::openDirectorySource(place));
  return objects;
}

base::Result<base::Bytes> PublishedObjects::read(const std::string& name, std::uint64_t offset,
                                                 std::uint64_t length) const {
  if (name == description_.patches.name) return scene_.patch_file->read(name, offset, length);
  if (name == description_.records.name && offset <= records_.size() && length <= records_.size() - offset) {
    const auto first = records_.begin() + static_cast<std::ptrdiff_t>(offset);
    return base::Bytes(first, first + static_cast<std::ptrdiff_t>(length));
  }
  if (images_) return images_->read(name, offset, length);
  return base::Error{base::ErrorCode::kNotFound, name + ": there is no such object"};
}

}  // namespace compare
