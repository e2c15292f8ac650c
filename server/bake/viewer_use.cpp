#include "server/bake/viewer_use.h"

#include "base/file.h"
#include "base/json/scene_file.h"

namespace server {

ViewerUse::ViewerUse(const repository::AccessFile& file, const glm::vec3& offset)
    : slack_(1e-3F * file.identity.grid.spacing) {
  for (const repository::PointUse& use : repository::rankPoints(file.counts))
    places_.push_back(
        {file.identity.grid.point(use.point.x, use.point.y, use.point.z) + offset, static_cast<double>(use.sent)});
}

base::Result<ViewerUse> ViewerUse::ofScene(const std::string& directory, const glm::dvec3& origin) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene, base::readScene(directory));
  const std::string path = repository::accessFileOf(directory);
  const auto bytes = base::readFile(path);
  if (!bytes) {
    base::Error error = bytes.error();
    error.message += "; `lumigrid serve` counts there what viewers are sent";
    return error;
  }
  const auto file = repository::decodeAccess(*bytes);
  if (!file) return base::within(path, file.error());
  if (file->counts.faces.empty())
    return base::Error{base::ErrorCode::kInvalidInput, path + ": no image was sent to any viewer yet"};
  return ViewerUse(*file, glm::vec3(scene.origin - origin));
}

double ViewerUse::within(const glm::vec3& low, const glm::vec3& high) const {
  double sent = 0.0;
  for (const Place& place : places_)
    if (glm::all(glm::greaterThanEqual(place.position, low - slack_)) &&
        glm::all(glm::lessThanEqual(place.position, high + slack_)))
      sent += place.sent;
  return sent;
}

}  // namespace server
