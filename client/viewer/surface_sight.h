#pragma once
// Tells which surface a view shows, and from where that is seen, by lines of sight in the coarse patches that are here.
#include <cstdint>
#include <optional>
#include <vector>

#include "base/camera.h"
#include "client/render/choose.h"
#include "client/source/session.h"
#include "lod/patch/proxy_sight.h"
#include "plan/point_choice.h"

namespace client {

class SurfaceSight {
 public:
  /// Takes in the coarse patches, and does so anew when others have come that make it finer by a quarter.
  void renew(Session& session);
  /// Looks along rays evenly over the picture. False where there are no patches yet, where none is met, and for
  /// parallel views.
  bool lookFrom(const base::Camera& camera);
  /// Returns what the last lookFrom() has met.
  const VisibleSurface& surface() const { return surface_; }

 private:
  /// Keeps what is known of an eye, by place: 0 nothing, 1 seen, 2 hidden.
  struct Eye {
    glm::vec3 place;
    std::vector<std::uint8_t> verdicts;
  };

  bool isSeenFrom(const glm::vec3& eye, std::size_t place);
  bool findOut(const glm::vec3& eye, std::size_t place) const;

  std::optional<lod::patch::ProxySight> sight_;
  std::uint64_t groups_ = 0;  ///< that had come at the last renew()
  base::Camera camera_;       ///< of the last look
  std::vector<plan::SurfaceSample> met_;
  VisibleSurface surface_;
  std::vector<Eye> eyes_;  ///< of the last look: a few dozen, since all images of a point have one
};

}  // namespace client
