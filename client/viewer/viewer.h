#pragma once
// The viewer without a window joins session, decoder and renderer; GLFW, headless runs and the browser share it.
//
// Views are perspective or orthographic (base::ViewCamera::ortho_height). For an orthographic view the server is asked
// for the perspective view from afar that stands for it (base::perspectiveStandIn): its pictures join the blend as
// images like any other, and are never called exact.
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "client/render/lumigraph.h"
#include "client/source/method.h"
#include "client/source/session.h"
#include "client/source/splat_view.h"
#include "client/viewer/accuracy.h"
#include "client/viewer/decode.h"

namespace client {

struct ViewerOptions {
  SessionOptions session;
  LumigraphOptions lumigraph;
  /// kLumigraph or kPatches (the same client without images); with kQsplat only what setSplats() brings is shown.
  Method method = Method::kLumigraph;
  std::uint64_t gpu_budget_bytes = 512'000'000;  ///< limit for images on the GPU
  /// Everything that grows with the scene, on the GPU and off (MemoryUse::total()), stays below this at every frame.
  /// Its shares (client/viewer/memory_plan.h) bound the session's cache and `gpu_budget_bytes` too. Where it does not
  /// suffice, the picture is coarser or has fewer images: see error_px. At least kMinMemory.
  std::uint64_t memory_budget_bytes = 1'000'000'000;
  double upload_milliseconds = 4.0;  ///< longest upload per frame, at an assumed 2 MB a millisecond; 0: no limit
};

inline constexpr std::uint64_t kMinMemory = 16'000'000;

/// The bytes that the viewer holds now.
struct MemoryUse {
  std::uint64_t textures = 0;       ///< GPU: images, their mip levels and depth maps
  std::uint64_t buffers = 0;        ///< GPU: patches, uniforms
  std::uint64_t renderbuffers = 0;  ///< GPU: picking
  std::uint64_t decoded = 0;        ///< images decoded or being decoded, not yet on the GPU
  std::uint64_t cache = 0;          ///< compressed images and patches, exact frames
  std::uint64_t records = 0;        ///< records of the hierarchy
  std::uint64_t gpu() const { return textures + buffers + renderbuffers; }
  std::uint64_t total() const { return gpu() + decoded + cache + records; }
};

struct ViewerStats {
  SessionStats session;
  LumigraphStats lumigraph;
  float error_px = 0.0F;      ///< largest projected error of what is drawn
  float tolerance_px = 0.0F;  ///< the wanted tolerance, or more where a budget does not allow it
  Accuracy accuracy = Accuracy::kNothing;
  MemoryUse memory;
  std::uint64_t memory_budget = 0;
  std::uint32_t samples_cached = 0;    ///< images known to the viewer: resident, waiting or being decoded
  std::uint32_t images_requested = 0;  ///< images that this view uses, received but not on the GPU yet
  bool complete = false;               ///< everything for this view was sent, decoded and uploaded, and has faded in
  bool busy = false;                   ///< another draw of the same view would look different without any more data
  std::uint32_t broken = 0;            ///< images, groups and blocks of splats that could not be decoded
  SplatStats splats;                   ///< with kQsplat
  std::string last_fault;              ///< the error of the latest of them
};

inline constexpr std::size_t kMaxPins = 512;

/// A GL context must be current from the first draw() on.
class Viewer {
 public:
  Viewer(const ViewerOptions& options, std::unique_ptr<ImageDecoder> decoder);
  ~Viewer();
  Session& session();
  const Session& session() const;
  const ViewerOptions& options() const;  ///< as limited by the memory budget
  /// Takes in data that arrived and uploads decoded images, within the frame's share, without drawing. Returns true
  /// while there is more to do (images being decoded, or left for the next call). Callers that wait for a complete
  /// picture need it; draw() calls it by itself.
  base::Result<bool> update(const base::ViewCamera& camera, double now);
  /// Draws the view into the bound framebuffer with the data that are here now. Never waits for network or decoder.
  /// `now` in seconds.
  base::Result<void> draw(const base::ViewCamera& camera, double now);
  /// Sets the colour where there is no model, from the next draw on: RGBA, 0 … 1.
  void setBackground(const std::array<float, 4>& color);
  /// Clears the bound framebuffer, before there is a model. Tells the server of no view.
  void drawBackground() const;
  /// Whether everything that the view of the last update() or draw() needs has been received; some of it may still have
  /// to be decoded.
  bool allHere() const;
  /// Returns the world point of the drawn surface at (x, y), in pixels from the upper left corner; nullopt over
  /// background and where a section plane has cut the surface away. Waits for the GPU.
  std::optional<glm::dvec3> surfaceAt(const base::ViewCamera& camera, double x, double y);

  /// Sets the section plane from the next draw on; nullopt cuts nothing. Back faces seen through the cut have one flat
  /// colour (lod::draw::kSectionColor), which shows where the model is open. A normal that is zero or not a number sets
  /// no plane.
  void setSection(const std::optional<base::SectionPlane>& plane);
  /// Tints every fragment by the resolution of what is shown there (lod::draw::kResolutionLegend).
  void setResolutionColors(bool on);
  /// Switches between lumigraph and patches from the next draw on; patches request no images from the server. Images
  /// that ViewerOptions::session turns off stay off. A viewer never changes from or to kQsplat, since splats come from
  /// another place.
  void setMethod(Method method);
  /// Sets the source of splats for kQsplat; the caller pumps it.
  void setSplats(std::shared_ptr<SplatView> splats);
  SplatView* splats();  ///< null while there are none
  /// Places the magnifying glass of kQsplat: what is seen through it comes first and is finer. Framebuffer pixels.
  void setLens(const std::optional<lod::qsplat::Lens>& lens);

  /// Sets the world points whose visibility the next draws test, at most kMaxPins; points beyond that count as
  /// invisible.
  void setPins(std::vector<glm::dvec3> points);
  /// Returns for each pin whether it is in the picture, and neither behind the drawn surface nor cut away. The answer
  /// is a frame or two old, false before the first; never waits. stats().busy holds while a newer answer is on its way.
  const std::vector<bool>& pinsVisible();

  /// Drops all GL objects, since their context is gone. No GL function is called before contextRestored(), and draw()
  /// draws nothing. May be called twice.
  void contextLost();
  /// Makes all GL objects again in the current, new context, from what the session keeps.
  base::Result<void> contextRestored();

  ViewerStats stats() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
