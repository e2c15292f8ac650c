#include "server/trial/drawn_store.h"

#include <utility>

#include "server/bake/face_encoder.h"
#include "server/bake/face_sample.h"

namespace server {

base::Result<std::optional<base::Bytes>> DrawnStore::get(const repository::FaceKey& key) const {
  if (const auto found = drawn_.find(key); found != drawn_.end()) return std::optional(found->second);
  if (drawn_.contains(key.face())) return std::optional<base::Bytes>();
  const auto cameras = faceCameras(renderer_, options_.grid, {key.face()});
  LUMIGRID_ASSIGN_OR_RETURN(const auto picture,
                            gl_.use([&] { return renderer_.render(cameras.front(), renderOptions(options_)); }));
  LUMIGRID_ASSIGN_OR_RETURN(auto face, encodeFace(picture.rgba, {options_.quality, options_.subsampling,
                                                                 options_.grid.tile_depth, options_.codec}));
  repository::FaceKey tile_key = key.face();
  for (EncodedTile& tile : face.tiles) {
    tile_key.tile = tile.tile;
    drawn_.emplace(tile_key, std::move(tile.value));
  }
  const auto found = drawn_.find(key);
  return found != drawn_.end() ? std::optional(found->second) : std::nullopt;
}

base::Result<void> DrawnStore::forEach(
    const std::function<bool(const repository::FaceKey&, base::ByteView)>& visit) const {
  for (const auto& [key, value] : drawn_)
    if (!visit(key, value)) break;
  return {};
}

base::Error DrawnStore::readOnlyError() const {
  return {base::ErrorCode::kUnsupported, "faces that are drawn for a trial are not kept"};
}

}  // namespace server
