#include "server/bake/viewer_places.h"

#include <algorithm>

#include "base/check.h"
#include "base/file.h"
#include "base/json/scene_file.h"
#include "repository/sampling/cube_face.h"

namespace server {

base::Result<ViewerPlaces> ViewerPlaces::ofScene(const std::string& directory, const glm::dvec3& origin) {
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
  return ViewerPlaces(*file, glm::vec3(scene.origin - origin));
}

ViewerPlaces::ViewerPlaces(const repository::AccessFile& file, const glm::vec3& offset)
    : spacing_(file.identity.grid.spacing) {
  LUMIGRID_CHECK(!file.counts.faces.empty());
  std::uint64_t sent = 0;
  for (const auto& [key, count] : file.counts.faces) {
    sent += count;
    faces_.push_back({file.identity.grid.point(key.x, key.y, key.z) + offset, key.d, sent});
  }
}

ViewerPlaces::Pose ViewerPlaces::draw(UnitRandom& random) const {
  const auto number = static_cast<std::uint64_t>(random() * static_cast<double>(faces_.back().sent_until));
  const auto face = std::upper_bound(faces_.begin(), faces_.end() - 1, number,
                                     [](std::uint64_t n, const SentFace& f) { return n < f.sent_until; });
  const auto symmetric = [&](double half) { return static_cast<float>((2.0 * random() - 1.0) * half); };
  Pose pose{face->point, repository::faceDirection(face->d)};
  for (int axis = 0; axis < 3; ++axis) pose.position[axis] += symmetric(0.5) * spacing_;
  const glm::vec3 up = repository::faceUp(face->d);
  const glm::vec3 right = glm::cross(pose.direction, up);
  const float u = symmetric(1.0);
  const float v = symmetric(1.0);
  pose.direction = glm::normalize(pose.direction + u * right + v * up);
  return pose;
}

}  // namespace server
