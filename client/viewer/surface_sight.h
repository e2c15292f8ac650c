#pragma once
// Tells which surface a view shows, and from where that is seen, by lines of sight in the coarse patches that are here.
#include <memory>

#include "base/camera.h"
#include "client/render/choose.h"
#include "client/source/session.h"

namespace client {

/// An interface, so that a page that shows no images need not contain the lines of sight, 8 kB of it.
class SurfaceSight {
 public:
  virtual ~SurfaceSight() = default;
  /// Takes in the coarse patches, and does so anew when others have come that make it finer by a quarter.
  virtual void renew(Session& session) = 0;
  /// Looks along rays evenly over the picture. False where there are no patches yet, where none is met, and for
  /// parallel views. `roughly`: what the last look has met will do if it was from a view a little beside this one.
  virtual bool lookFrom(const base::Camera& camera, bool roughly = false) = 0;
  /// Returns what the last lookFrom() has met.
  virtual const VisibleSurface& surface() const = 0;
};

std::unique_ptr<SurfaceSight> makeSurfaceSight();

}  // namespace client
