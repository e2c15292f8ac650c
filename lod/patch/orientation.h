#pragma once
// Tells from a scene's surface which way is up, and from where it is looked at first.
#include <glm/glm.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "lod/patch/format.h"

namespace lod::patch {

/// Whether people look at a scan from within its rooms or passages.
enum class InteriorChoice { kAuto, kOn, kOff };

struct Orientation {
  glm::vec3 up{0.0F, 1.0F, 0.0F};          ///< unit, along an axis unless it was given
  bool is_sure = false;                    ///< nothing else fits nearly as well
  std::string reason;                      ///< "the ground faces it"; never empty
  glm::vec3 direction{0.0F, 0.0F, -1.0F};  ///< unit, from the eye: where the first view looks
  bool is_enclosed = false;                ///< fronts face fronts everywhere: passages, or an object turned inside out
  bool is_interior = false;                ///< scanned from inside: rooms, or the passages of a cave or mine
  /// Scene units along `up`: of an interior that would be seen from above through the backs of its ceilings, whatever
  /// lies higher hides the rooms. Nothing: it is none, up lies along no axis, or no height opens half of the rooms.
  std::optional<float> section_height;
  std::vector<glm::vec3> hull;  ///< scene-local: findHull() of the surface, which depends on no up
};

/// A guess from a coarse cut of the scene. What speaks for an axis: ground that faces it, a flat base at its lower end,
/// and that a flat scan stands on its shortest side. Where nothing does, it is +y, as glTF says and scanners of objects
/// write. `up`: a unit vector that is known, or null. Errors: those of reading patches.
base::Result<Orientation> findOrientation(const PatchFile& patches, const glm::vec3* up = nullptr,
                                          InteriorChoice interior = InteriorChoice::kAuto);

}  // namespace lod::patch
