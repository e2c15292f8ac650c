#pragma once
// The viewer without a window: session, decoder and renderer put together; the same for GLFW, headless and the browser.
//
// Views are perspective or orthographic (base::ViewCamera::ortho_height). The server is asked for the perspective view
// from afar that stands for an orthographic one (base::perspectiveStandIn): its pictures join the blend as images like
// any other and are never called exact.
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
#include "client/viewer/statistics.h"

namespace client {

struct ViewerOptions {
  SessionOptions session;
  LumigraphOptions lumigraph;
  /// kLumigraph or kPatches (same client, images off); kQsplat: what setSplats() brings, and nothing else.
  Method method = Method::kLumigraph;
  std::uint64_t gpu_budget_bytes = 512'000'000;  ///< images on the GPU at most
  /// All that grows with the scene, GPU and memory together (MemoryUse::total()) stays below this at every frame. Its
  /// shares (client/memory_plan.h) bound the session's cache and `gpu_budget_bytes` too. What does not fit is drawn
  /// coarser or with fewer images: see error_px. At least kMinMemory.
  std::uint64_t memory_budget_bytes = 1'000'000'000;
  double upload_milliseconds =
      4.0;  ///< decoded data uploaded per frame at most, at an assumed 2 MB a millisecond (0: no limit)
};

inline constexpr std::uint64_t kPhoneMemory = 64'000'000;  ///< memory_budget_bytes for a phone
inline constexpr std::uint64_t kMinMemory = 16'000'000;

/// Bytes that the viewer holds now.
struct MemoryUse {
  std::uint64_t textures = 0;       ///< GPU: images, their mip levels and depth maps
  std::uint64_t buffers = 0;        ///< GPU: patches, uniforms
  std::uint64_t renderbuffers = 0;  ///< GPU: picking
  std::uint64_t decoded = 0;        ///< images decoded or being decoded, not yet on the GPU
  std::uint64_t cache = 0;          ///< compressed images and patches, exact frames
  std::uint64_t records = 0;        ///< what is known of the hierarchy
  std::uint64_t gpu() const { return textures + buffers + renderbuffers; }
  std::uint64_t total() const { return gpu() + decoded + cache + records; }
};

struct ViewerStats {
  SessionStats session;
  LumigraphStats lumigraph;
  float error_px = 0.0F;      ///< largest projected error of what is drawn
  float tolerance_px = 0.0F;  ///< what it should be: the wanted tolerance, higher where a budget forbids that
  Accuracy accuracy = Accuracy::kNothing;
  MemoryUse memory;
  std::uint64_t memory_budget = 0;
  std::uint32_t samples_cached = 0;    ///< images known to the viewer: resident, waiting or being decoded
  std::uint32_t images_requested = 0;  ///< images of use in this view that are here but not on the GPU yet
  bool complete = false;     ///< the server sent all for this view and all of it is decoded, uploaded and faded in
  bool busy = false;         ///< another draw at the same view would look different, with no byte more from the server
  std::uint32_t broken = 0;  ///< images, groups and blocks of splats whose bytes could not be decoded
  SplatStats splats;         ///< with kQsplat
  std::string last_fault;    ///< what was wrong with the latest of them
};

inline constexpr std::size_t kMaxPins = 512;

/// Needs a current GL context from first draw() on.
class Viewer {
 public:
  Viewer(const ViewerOptions& options, std::unique_ptr<ImageDecoder> decoder);
  ~Viewer();
  Session& session();
  const Session& session() const;
  const ViewerOptions& options() const;  ///< with what the memory budget made of them
  /// Takes in what arrived and uploads what was decoded, within the frame's share; draws nothing. True while there is
  /// more of it to do (being decoded, or left for the next call). For callers that wait for a picture; draw() does it
  /// by itself.
  base::Result<bool> update(const base::ViewCamera& camera, double now);
  /// Draws the view into the bound framebuffer with what is here now. Never waits for network or decoder. `now` in
  /// seconds.
  base::Result<void> draw(const base::ViewCamera& camera, double now);
  /// Where there is no model, from the next draw on: RGBA, 0 … 1.
  void setBackground(const std::array<float, 4>& color);
  /// The bound framebuffer without a model, as long as there is none. Tells the server of no view.
  void drawBackground() const;
  /// All is here that the view of the last update() or draw() asks for; some of it may still have to be decoded.
  bool allHere() const;
  /// The world point of the drawn surface at (x, y), pixels from the upper left corner; nullopt over background. Waits
  /// for the GPU. Sees what is drawn: the cut-away side of a section plane is not there.
  std::optional<glm::dvec3> surfaceAt(const base::ViewCamera& camera, double x, double y);

  /// From the next draw on. nullopt: nothing is cut. Back faces seen through what is cut
  /// away have one flat colour (lod::draw::kSectionColor), which shows what is cut open. A normal that is zero or not a
  /// number sets none.
  void setSection(const std::optional<base::SectionPlane>& plane);
  /// Tints every fragment by the resolution of what is shown there; lod::draw::kResolutionLegend says how.
  void setResolutionColors(bool on);
  /// lumigraph or patches, from the next draw on; patches ask the server for no images. Images that
  /// ViewerOptions::session turns off stay off. A viewer that began with kQsplat stays with it, and no other comes to
  /// it: the two are fed from different places.
  void setMethod(Method method);
  /// Where the splats of kQsplat come from; somebody pumps it.
  void setSplats(std::shared_ptr<SplatView> splats);
  SplatView* splats();  ///< null while there are none
  /// The magnifying glass of kQsplat: what is seen through it comes first and is finer. Framebuffer pixels.
  void setLens(const std::optional<lod::qsplat::Lens>& lens);

  /// World points whose visibility the next draws find out, at most kMaxPins (what is beyond is not visible).
  void setPins(std::vector<glm::dvec3> points);
  /// Beside them: in the picture and not behind the drawn surface nor cut away. The answer is that of a frame or two
  /// ago, all false before the first; never waits. stats().busy while a newer one is on its way.
  const std::vector<bool>& pinsVisible();

  /// The GL context is gone with all that was in it: nothing of GL is called before contextRestored(), draw() draws
  /// nothing. No error when said twice.
  void contextLost();
  /// A new context is current: everything is made again from what the session keeps.
  base::Result<void> contextRestored();

  ViewerStats stats() const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
