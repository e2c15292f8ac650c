#pragma once
// Tells which sampling points the model encloses, so that nobody looks from there.
#include <glm/glm.hpp>
#include <span>
#include <vector>

#include "base/error.h"
#include "lod/patch/format.h"

namespace server {

/// The generalised winding number (Jacobson, Kavan, Sorkine-Hornung 2013, equation 3) of a coarse cut: 1 inside a
/// closed surface whose normals point outward, 0 outside, in between under and over open ones, −1 in a room whose walls
/// face inward.
class Enclosure {
 public:
  /// Reads the finest cut of at most about `max_triangles`.
  static base::Result<Enclosure> create(const lod::patch::PatchFile& patches, std::uint64_t max_triangles = 20'000);

  double windingNumber(const glm::vec3& point) const;
  /// Whether the point is wholly within: its winding number is over 0.9, which is not reached below an open surface,
  /// and it lies farther from the cut than the cut's error.
  bool encloses(const glm::vec3& point) const;
  /// Whether nobody would look from there: the point is within, or behind an open surface as below a terrain (a winding
  /// number over 0.25).
  bool isBehind(const glm::vec3& point) const;

 private:
  struct Triangle {
    glm::vec3 a, b, c;
  };
  std::vector<Triangle> triangles_;
  float error_ = 0.0F;
};

/// Enclosure::encloses for each point, 1 or 0, on `threads` threads (0: all cores).
std::vector<std::uint8_t> enclosedPoints(const Enclosure& enclosure, std::span<const glm::vec3> points,
                                         unsigned threads);

}  // namespace server
