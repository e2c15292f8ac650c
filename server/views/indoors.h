#pragma once
// Where people stand who look at an interior: in its rooms. From around it they would see the backs of its walls.
#include <cstddef>
#include <glm/glm.hpp>
#include <optional>
#include <utility>
#include <vector>

#include "base/error.h"
#include "base/geometry.h"
#include "base/json/scene_file.h"
#include "lod/patch/format.h"
#include "lod/patch/proxy_sight.h"

namespace server {

/// The rooms of a scanned flat, house, mine or cave, as a coarse cut of its surface tells them, and ways through them.
/// All places are scene-local.
class Indoors {
 public:
  /// Nothing where the scene is no interior (base::Scene::interior) or no room is found. Errors: those of reading
  /// patches.
  static base::Result<std::optional<Indoors>> ofScene(const base::Scene& scene, const lod::patch::PatchFile& patches);
  /// `up`: unit. Nothing where no room is found.
  static std::optional<Indoors> find(lod::patch::ProxySight sight, const base::Aabb& box, const glm::vec3& up);

  /// Whether one could stand there: most lines of sight end at the front of a surface, and none of them at once.
  bool contains(const glm::vec3& point) const;

  /// Whether an image from there shows a room: half of the lines of sight end at fronts. Wider than contains(), within
  /// furniture and behind walls it is not so either.
  bool seesRooms(const glm::vec3& point) const;

  /// Places at eye level, the one with the widest view first, each next one far from those before it; at least one.
  const std::vector<glm::vec3>& places() const { return places_; }
  /// How far apart walls are as seen from the middle one of the places: twice the median line of sight; scene units.
  float width() const { return width_; }
  /// A walk that visits the first of them and returns, by straight lines that nothing blocks; numbers of places(), the
  /// first again at the end. One number where the first place has no way to others.
  const std::vector<std::size_t>& walk() const { return walk_; }
  /// The two places with the longest clear line between them; nothing where no two have one.
  std::optional<std::pair<std::size_t, std::size_t>> longestLine() const { return longest_line_; }
  /// The level direction, unit, in which one sees farthest from there.
  glm::vec3 widestDirection(const glm::vec3& from) const;
  /// How far the surface is that way, at most the box's diagonal, scene units. `direction`: unit.
  float distance(const glm::vec3& from, const glm::vec3& direction) const;

  const base::Aabb& box() const { return box_; }
  const glm::vec3& up() const { return up_; }

 private:
  Indoors(lod::patch::ProxySight sight, const base::Aabb& box, const glm::vec3& up);

  struct Outlook;
  Outlook lookAround(const glm::vec3& point) const;
  std::optional<glm::vec3> eyeLevel(const glm::vec3& point) const;
  bool hasWay(const glm::vec3& from, const glm::vec3& to) const;
  void findPlaces();
  void findWalk();

  lod::patch::ProxySight sight_;
  base::Aabb box_;
  glm::vec3 up_{0.0F};
  float width_ = 0.0F;
  float body_ = 0.0F;  ///< half as wide is what walks, scene units
  std::vector<glm::vec3> directions_;
  std::vector<glm::vec3> places_;
  std::vector<std::size_t> walk_;
  std::optional<std::pair<std::size_t, std::size_t>> longest_line_;
};

}  // namespace server
