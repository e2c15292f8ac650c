#pragma once
// Where the viewers of a scene were and which way they looked, from its access counts (docs/formats/access.md). Okamoto
// 2011 names sampling by access frequency as future work.
//
// The counts tell which faces were sent, not where eyes were. Faces are sent of points around an eye and between it and
// the surface that it sees, so a view from a face's point into that face shows what some viewer looked at.
#include <cstdint>
#include <glm/glm.hpp>
#include <random>
#include <string>
#include <vector>

#include "base/error.h"
#include "repository/access.h"

namespace server {

/// Random numbers that are the same with every standard library, uniform in [0, 1). std::uniform_real_distribution is
/// another in every library; std::mt19937 is not.
class UnitRandom {
 public:
  explicit UnitRandom(std::uint32_t seed) : random_(seed) {}
  double operator()() { return static_cast<double>(random_()) / 4294967296.0; }

 private:
  std::mt19937 random_;
};

class ViewerPlaces {
 public:
  /// The counts of a scene's file, on that scene's own grid; at least one face was sent. `offset` moves its scene-local
  /// places to another scene's.
  explicit ViewerPlaces(const repository::AccessFile& file, const glm::vec3& offset = glm::vec3(0.0F));
  /// Reads SCENE/access.lga and SCENE/scene.json; places become local to `origin`, world. Errors: kNotFound where
  /// nobody has counted; kInvalidInput where no image was ever sent.
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
    std::uint32_t d = 0;
    std::uint64_t sent_until = 0;  ///< sum of what was sent of this face and of those before it
  };
  std::vector<SentFace> faces_;
  float spacing_ = 0.0F;
};

}  // namespace server
