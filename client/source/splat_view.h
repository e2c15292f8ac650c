#pragma once
// The interface through which a viewer shows splats (client::Method::kQsplat). It is apart from its implementation, so
// that a page that shows no splats does not carry their code.
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

/// The options that may change while splats are shown.
struct SplatQuality {
  lod::draw::SplatKernel kernel = lod::draw::SplatKernel::kCircle;
  float cutoff_px = 1.0F;  ///< splats are refined down to this diameter, pixels; 0: to the leaves
  /// Time that a frame may take while the view moves: splats are as large as that requires, and get finer when the view
  /// rests. 0: every frame refines down to cutoff_px.
  double frame_seconds = 0.1;
  friend bool operator==(const SplatQuality&, const SplatQuality&) = default;
};

struct SplatOptions : SplatQuality {
  bool back_faces = false;  ///< splats that face away are drawn as well, for open surfaces that are seen from behind
  /// Coded blocks get a quarter of this, and the drawn splats half. When more splats are wanted than fit, the cut-off
  /// grows.
  std::uint64_t memory_bytes = 512'000'000;
  lod::qsplat::StreamOrder order = lod::qsplat::StreamOrder::kSweeps;
  std::uint64_t idle_bytes = 16'000'000;  ///< as lod::qsplat::StreamOptions::idle_bytes
  std::function<double()> clock;  ///< seconds, times the frames; empty: every frame counts as if it took frame_seconds
  lod::qsplat::ForEach for_each;  ///< empty: one thread
};

/// The appearance of a frame.
struct SplatLook {
  lod::draw::Shading shading;
  glm::vec4 section = base::kNoSection;  ///< scene-local
  bool resolution_colors = false;
  std::optional<lod::qsplat::Lens> lens;
  std::array<float, 4> background{};  ///< RGBA, 0 … 1
};

struct SplatStats {
  std::uint64_t splats = 0, nodes = 0;  ///< splats drawn, and nodes visited to find them
  float cutoff_px = 0.0F;               ///< pixels; the diameter down to which splats were refined
  float finest_px = 0.0F;               ///< pixels; the diameter that they will reach at rest
  float reduction =
      1.0F;  ///< pixels a side for each sample that is drawn; above 1 while the view moves and shortly after
  float lens_px = 0.0F;            ///< cutoff_px inside the magnifying glass; 0 without one
  bool limited = false;            ///< memory does not allow finer splats
  std::uint64_t buffer_bytes = 0;  ///< bytes of drawn splats, on the GPU and in memory
  lod::qsplat::StreamStats stream;
  std::string warning;  ///< the blocks of the file that are lost, one line; mostly empty
};

class SplatView {
 public:
  virtual ~SplatView() = default;

  /// Acts as the server of a session, as StaticSource does: takes answers in, requests more, sends Welcome when the
  /// front of the file has arrived, and reports failures to the session. Never waits. `now`: seconds, never decreasing.
  /// Returns true when something arrived.
  virtual bool pump(Session& session, double now) = 0;
  /// Bounding sphere of the whole model, scene-local, for the near and far planes. Null until the front of the file has
  /// arrived.
  virtual const base::Sphere* bounds() const = 0;

  /// Selects splats for this view from the blocks that are present; the next pump() requests the missing ones.
  virtual void update(const base::Camera& camera, const SplatLook& look) = 0;
  /// Draws into the framebuffer bound now, and clears it first. A frame whose camera differs from the last one's counts
  /// as a frame of motion.
  virtual base::Result<void> draw(const base::Camera& camera, const SplatLook& look) = 0;
  /// Returns the scene-local point of the foremost splat drawn at (x, y), in pixels from the upper left corner.
  virtual std::optional<glm::vec3> surfaceAt(const base::Camera& camera, const SplatLook& look, double x,
                                             double y) const = 0;
  /// Whether all blocks that the last update() needs are present, at the finest cut-off.
  virtual bool complete() const = 0;
  /// Whether another draw of the same view would be finer.
  virtual bool busy() const = 0;
  /// Takes effect with the next frame.
  virtual void setQuality(const SplatQuality& quality) = 0;
  virtual const SplatQuality& quality() const = 0;
  /// Drops all GL objects, which are gone together with their context.
  virtual void contextLost() = 0;
  virtual SplatStats stats() const = 0;
};

}  // namespace client
