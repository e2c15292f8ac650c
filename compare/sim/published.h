#pragma once
// A scene as a static host has it: the objects that `lumigrid publish` writes (docs/formats/packs.md).
#include <cstdint>
#include <memory>
#include <string>

#include "base/error.h"
#include "client/source/static_source.h"
#include "repository/objects/objects.h"
#include "server/scene/open_scene.h"

namespace compare {

class PublishedObjects {
 public:
  /// Writes the images of a scene that `lumigrid build` made as packs into `directory`, as far as they are not there.
  /// A scene that is published already is read where it lies. `scene` outlives it. Errors: kUnsupported for a scene
  /// without patches or behind a network; those of repository::publishImages.
  static base::Result<std::unique_ptr<PublishedObjects>> create(const server::OpenScene& scene,
                                                                const std::string& directory);

  /// Returns bytes offset … offset + length − 1 of an object. Errors as repository::ObjectSource::read.
  base::Result<base::Bytes> read(const std::string& name, std::uint64_t offset, std::uint64_t length) const;
  const client::StaticScene& description() const { return description_; }

 private:
  explicit PublishedObjects(const server::OpenScene& scene) : scene_(scene) {}

  const server::OpenScene& scene_;
  client::StaticScene description_;
  base::Bytes records_;
  std::unique_ptr<repository::ObjectSource> images_;  // null: the scene has none
};

}  // namespace compare
