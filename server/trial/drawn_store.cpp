#include "server/trial/drawn_store.h"

#include <utility>

#include "server/bake/face_encoder.h"
#include "server/bake/face_sample.h"

namespace server {

base::Result<std::optional<base::Bytes>> DrawnStore::get(const repository::FaceKey& key) const {
  if (const auto found = drawn_.find(key); found != drawn_.end()) return std::optional(found->second);
  const auto cameras = faceCameras(renderer_, options_.grid, {key});
  LUMIGRID_ASSIGN_OR_RETURN(const auto picture,
                            gl_.use([&] { return renderer_.render(cameras.front(), renderOptions(options_)); }));
  LUMIGRID_ASSIGN_OR_RETURN(auto face, encodeFace(picture.rgba, options_.quality, options_.subsampling));
  return std::optional(drawn_.emplace(key, std::move(face.value)).first->second);
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
