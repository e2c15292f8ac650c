#pragma once
// Splats in a viewer (Method::kQsplat). What the viewer knows of them is here, without the code: a page that shows
// none does not carry it.
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "base/camera.h"
#include "base/error.h"
#include "client/source/session.h"
#include "lod/draw/splats.h"
#include "lod/qsplat/stream/stream.h"

namespace client {

/// What may change while splats are shown.
struct SplatQuality {
  lod::draw::SplatKernel kernel = lod::draw::SplatKernel::kCircle;
  float cutoff_px = 1.0F;  ///< splats are refined down to this diameter, pixels; 0: to the leaves
  /// That a frame may take while the view moves: splats are as large as that asks for, and get finer when it rests. 0:
  /// each frame goes down to cutoff_px.
  double frame_seconds = 0.1;
  friend bool operator==(const SplatQuality&, const SplatQuality&) = default;
};

struct SplatOptions : SplatQuality {
  bool back_faces = false;  ///< drawn, too: for open surfaces that are seen from behind
  /// Blocks as they came get a quarter of it, and what is drawn two quarters: with more splats than fit, the cut-off
  /// grows.
  std::uint64_t memory_bytes = 512'000'000;
  lod::qsplat::StreamOrder order = lod::qsplat::StreamOrder::kSweeps;
  std::uint64_t idle_bytes = 16'000'000;  ///< lod::qsplat::StreamOptions has it
  std::function<double()> clock;          ///< seconds, to time frames with; empty: as if each took frame_seconds
  lod::qsplat::ForEach for_each;          ///< empty: one thread
};

/// How a frame is to look.
struct SplatLook {
  lod::draw::Shading shading;
  glm::vec4 section = base::kNoSection;  ///< scene-local
  bool resolution_colors = false;
  std::optional<lod::qsplat::Lens> lens;
  std::array<float, 4> background{};  ///< RGBA, 0 … 1
};

struct SplatStats {
  std::uint64_t splats = 0, nodes = 0;  ///< drawn, and looked at for that
  float cutoff_px = 0.0F;               ///< they were refined down to
  float finest_px = 0.0F;               ///< … and will be at rest
  float reduction = 1.0F;               ///< pixels a side for each sample: above 1 while the view moves and just after
  float lens_px = 0.0F;            ///< as cutoff_px, of what is seen through the magnifying glass; 0: there is none
  bool limited = false;            ///< memory forbids finer ones
  std::uint64_t buffer_bytes = 0;  ///< of them, on the GPU and off
  lod::qsplat::StreamStats stream;
  std::string warning;  ///< what is lost of the file, one line; mostly empty
};

class SplatView {
 public:
  virtual ~SplatView() = default;

  /// Plays the server's part for a session, as StaticSource does: takes in what came, asks for more; says Welcome when
  /// the front of the file is here; tells the session what is wrong. Never waits. `now`: seconds, never falling. True
  /// when something came.
  virtual bool pump(Session& session, double now) = 0;
  /// Of the whole model, scene-local: what near and far planes hold. Null until the front of the file is here.
  virtual const base::Sphere* bounds() const = 0;

  /// Chooses the splats for this view of what is here; what it lacks is asked for by the next pump().
  virtual void update(const base::Camera& camera, const SplatLook& look) = 0;
  /// Into the framebuffer bound now, which it clears. A frame from another camera than the last one's is one of motion.
  virtual base::Result<void> draw(const base::Camera& camera, const SplatLook& look) = 0;
  /// The scene-local point of the splat that was drawn foremost at (x, y), pixels from the upper left corner.
  virtual std::optional<glm::vec3> surfaceAt(const base::Camera& camera, const SplatLook& look, double x,
                                             double y) const = 0;
  /// All is here that the last update() asked for, at the finest cut-off.
  virtual bool complete() const = 0;
  /// Another draw of the same view would be finer.
  virtual bool busy() const = 0;
  /// From the next frame on.
  virtual void setQuality(const SplatQuality& quality) = 0;
  virtual const SplatQuality& quality() const = 0;
  /// The GL context is gone, with all that was in it.
  virtual void contextLost() = 0;
  virtual SplatStats stats() const = 0;
};

}  // namespace client
