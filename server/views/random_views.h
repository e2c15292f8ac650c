#pragma once
// Random views of a scene, from anywhere or from where its viewers were: the held-out views of `lumigrid tour
// --random`, and the views for which sampling points are selected.
#include <cstdint>
#include <glm/glm.hpp>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/json/scene_file.h"
#include "repository/access.h"
#include "server/views/enclosed.h"
#include "server/views/indoors.h"
#include "server/views/unit_random.h"

namespace server {

/// Where the viewers of a scene were and which way they looked, from its access counts (docs/formats/access.md).
/// Okamoto 2011 names sampling by access frequency as future work.
///
/// The counts tell which faces were sent, not where eyes were. Faces are sent of points around an eye and between it
/// and the surface that it sees, so a view from a face's point into that face shows what some viewer looked at.
class ViewerPlaces {
 public:
  /// The counts of a scene's files, each on its own grid; at least one face was sent. `offset` moves its scene-local
  /// places to another scene's.
  explicit ViewerPlaces(const std::vector<repository::AccessFile>& files, const glm::vec3& offset = glm::vec3(0.0F));
  /// Reads the scene's access counts and SCENE/scene.json; places become local to `origin`, world. Errors: kNotFound
  /// where nobody has counted; kInvalidInput where no image was ever sent.
  static base::Result<ViewerPlaces> ofScene(const std::string& directory, const glm::dvec3& origin);

  struct Pose {
    glm::vec3 position{0.0F};   ///< scene-local
    glm::vec3 direction{0.0F};  ///< unit
  };
  /// A face is drawn as often as it was sent; the position lies within half a grid step of its point along each axis,
  /// the direction within its 90° square.
  Pose draw(UnitRandom& random) const;

 private:
  struct SentFace {
    glm::vec3 point;
    float spacing = 0.0F;  ///< of the grid
    std::uint32_t d = 0;
    std::uint64_t sent_until = 0;  ///< sum of what was sent of this face and of those before it
  };
  std::vector<SentFace> faces_;
};

struct RandomViews {
  std::size_t count = 16;
  std::uint32_t seed = 1;
  double margin = 0.5;  ///< viewing box beyond the model on every side, in longest sides of the model
  int width = 1280, height = 720;
  const Indoors* indoors = nullptr;  ///< rooms to look at from inside; null: the scene is seen from around it
};

/// Eyes lie anywhere in the viewing box but within or behind the model; each looks at some place in the middle half of
/// the model's box. With options.indoors they lie anywhere in its rooms and look any way, up to 35 degrees down and 20
/// up; the margin does not matter. The same seed gives the same views on every machine. Fewer views where the model
/// leaves no room.
std::vector<base::ViewCamera> randomViews(const base::Scene& scene, const Enclosure& enclosure,
                                          const RandomViews& options);

/// Views of an interior, as randomViews() has them, of no size.
std::vector<base::ViewCamera> indoorViews(const base::Scene& scene, const Indoors& indoors, std::size_t count,
                                          std::uint32_t seed);

/// The same from where viewers were and in the directions in which they looked; options.margin does not matter.
std::vector<base::ViewCamera> randomViewerViews(const base::Scene& scene, const Enclosure& enclosure,
                                                const ViewerPlaces& places, const RandomViews& options);

}  // namespace server
