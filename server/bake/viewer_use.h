#pragma once
// Where viewers have been, from a scene's access counts (docs/formats/access.md): sampling by access frequency (Okamoto
// 2011, future work).
#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "base/error.h"
#include "repository/access.h"

namespace server {

class ViewerUse {
 public:
  /// The counts of a scene's file, on that scene's own grid. `offset` moves its scene-local places to another scene's.
  ViewerUse(const repository::AccessFile& file, const glm::vec3& offset = glm::vec3(0.0F));
  /// Reads SCENE/access.lga and SCENE/scene.json; places become local to `origin`, world. Errors: kNotFound where
  /// nobody has counted; kInvalidInput where no image was ever sent.
  static base::Result<ViewerUse> ofScene(const std::string& directory, const glm::dvec3& origin);

  /// How often images of sampling points in this box, its sides included, were sent.
  double within(const glm::vec3& low, const glm::vec3& high) const;

 private:
  struct Place {
    glm::vec3 position;
    double sent;
  };
  std::vector<Place> places_;
  float slack_ = 0.0F;  // so that points on a side are on it whatever was rounded
};

}  // namespace server
