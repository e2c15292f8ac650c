#pragma once
// The interface through which a viewer shows a method that streams a file of its own (client::isStreamed): splats,
// points and umbrellas, or triangles and points. It is apart from its implementations, so that a page carries the code
// of its own method alone.
#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "client/source/session.h"
#include "lod/draw/splats.h"
#include "lod/hlod/shadow_options.h"
#include "lod/hlod/stream.h"
#include "lod/pmr/stream.h"
#include "lod/qsplat/stream/stream.h"

namespace client {

/// The options that may change while a scene is shown. Each method uses its own.
struct StreamedQuality {
  lod::draw::SplatKernel kernel = lod::draw::SplatKernel::kCircle;
  float cutoff_px = 1.0F;  ///< splats are refined down to this diameter, pixels; 0: to the leaves
  /// Time that a frame may take while the view moves: it is as coarse as that requires, and gets finer when the view
  /// rests. 0: every frame is as fine as at rest.
  double frame_seconds = 0.1;
  float tolerance = 1.0F;  ///< umbrellas are refined down to about this radius, pixels; at least kMinTolerance
  float error_px = 0.5F;   ///< nodes are refined down to this error on the screen, pixels; at least kMinErrorPx
  /// Shadows of nodes. While view or light move, soft ones are hard, unless every frame is as fine as at rest.
  lod::hlod::Shadows shadows = lod::hlod::Shadows::kNone;
  friend bool operator==(const StreamedQuality&, const StreamedQuality&) = default;
};
inline constexpr float kMinTolerance = 0.25F;
inline constexpr float kMinErrorPx = 0.125F;

struct StreamedOptions : StreamedQuality {
  /// Limit for all that is kept of the file, drawn leaves and splats on the GPU included. When the view wants more than
  /// fits, it stays coarser.
  std::uint64_t memory_bytes = 512'000'000;
  std::function<double()> clock;  ///< seconds, times the frames; empty: every frame counts as if it took frame_seconds

  bool back_faces = false;  ///< splats that face away are drawn as well, for open surfaces that are seen from behind
  lod::qsplat::StreamOrder order = lod::qsplat::StreamOrder::kSweeps;
  /// As lod::qsplat::StreamOptions::idle_bytes, and the limit of lod::hlod::StreamOptions::prefetch_bytes.
  std::uint64_t idle_bytes = 16'000'000;
  lod::qsplat::ForEach for_each;  ///< for splats; empty: one thread

  /// A place from which the light of shadows shines, world; nothing: it is infinitely far in the direction of
  /// StreamedLook::shading. The viewer's own light takes its place.
  std::optional<glm::dvec3> light_position;
  /// Diameter of the light of soft shadows: scene units where it has a place, else radians as seen from the scene. 0 of
  /// one that has a place: as wide as the sun from the middle of the scene.
  float light_size = lod::hlod::kSunSize;

  std::uint64_t decode_per_frame = 200'000;  ///< as in lod::pmr::StreamOptions and lod::hlod::StreamOptions
};

/// The appearance of a frame.
struct StreamedLook {
  lod::draw::Shading shading;
  bool own_light = false;  ///< the shading is by a light of the viewer's own
  bool resolution_colors = false;
  std::optional<lod::qsplat::Lens> lens;  ///< of splats
  std::array<float, 4> background{};      ///< RGBA, 0 … 1
};

/// The figures of splats that no other method has.
struct SplatStats {
  std::uint64_t nodes = 0;  ///< visited to find the splats
  float reduction =
      1.0F;  ///< pixels a side for each sample that is drawn; above 1 while the view moves and shortly after
  float lens_px = 0.0F;  ///< error_px inside the magnifying glass; 0 without one
  lod::qsplat::StreamStats stream;
};

/// The figures of points and umbrellas that no other method has.
struct UmbrellaStats {
  std::uint64_t points = 0, triangles = 0;  ///< drawn
  std::uint64_t leaves = 0;                 ///< drawn
  lod::pmr::StreamStats stream;
};

/// The figures of triangles and points that no other method has.
struct HlodStats {
  std::uint64_t triangles = 0, points = 0;                 ///< drawn
  lod::hlod::Shadows shadows = lod::hlod::Shadows::kNone;  ///< of the last picture
  std::uint64_t shadow_maps = 0, casters = 0;              ///< of that; a node counts once for each map
  std::uint64_t shadow_texels = 0;                         ///< of these maps, a layer of each
  lod::hlod::StreamStats stream;
};

/// A line of the statistics overlay.
struct StatisticsLine {
  std::string name;   ///< "images"
  std::string value;  ///< "12 in use, 30 resident, 2 requested"
};

struct StreamedStats {
  std::uint64_t drawn = 0;         ///< splats; points and triangles
  float error_px = 0.0F;           ///< pixels; the diameter, the radius of umbrellas or the error refined down to
  float finest_px = 0.0F;          ///< pixels; the same as it will be at rest
  bool limited = false;            ///< memory does not allow a finer picture
  std::uint64_t buffer_bytes = 0;  ///< bytes of what is drawn on the GPU, and of splats in memory
  std::uint64_t file_bytes = 0;    ///< bytes of memory for what is here of the file
  std::uint64_t bytes_received = 0, requests = 0;
  std::uint64_t present = 0;  ///< blocks of splats, leaves or nodes that are here
  std::uint64_t lacking = 0;  ///< those that the view still needs
  std::uint32_t broken = 0;   ///< parts of the file that are lost
  std::string warning;        ///< names these, one line; mostly empty
  SplatStats splats;          ///< with Method::kQsplat
  UmbrellaStats umbrellas;    ///< with Method::kPmr
  HlodStats hlod;             ///< with Method::kHlod
  /// Describes these figures in the method's words. Null: nothing is streamed.
  std::vector<StatisticsLine> (*describe)(const StreamedStats&) = nullptr;
};

class StreamedView {
 public:
  virtual ~StreamedView() = default;

  /// Acts as the server of a session, as StaticSource does: takes answers in, requests more, sends Welcome when the
  /// front of the file has arrived, and reports failures to the session. Never waits. `now`: seconds, never decreasing.
  /// Returns true when something arrived.
  virtual bool pump(Session& session, double now) = 0;
  /// Bounding sphere of the whole model, scene-local, for the near and far planes. Null until the front of the file has
  /// arrived.
  virtual const base::Sphere* bounds() const = 0;

  /// Selects what to draw for this view from what is present; the next pump() requests what is missing.
  virtual void update(const base::Camera& camera, const StreamedLook& look) = 0;
  /// Draws into the framebuffer bound now, and clears it first. A frame whose camera differs from the last one's counts
  /// as a frame of motion.
  virtual base::Result<void> draw(const base::Camera& camera, const StreamedLook& look) = 0;
  /// The camera of the last draw(), its near plane moved out to what was drawn: the depths in the target are its.
  virtual base::Camera drawnCamera() const = 0;
  /// Whether its pictures gain from several samples a pixel.
  virtual bool isMultisampled() const = 0;
  /// Returns the scene-local point of the foremost surface drawn at (x, y), in pixels from the upper left corner.
  virtual std::optional<glm::vec3> surfaceAt(const base::Camera& camera, double x, double y) const = 0;
  /// Whether all that the last update() needs is present, at its finest.
  virtual bool complete() const = 0;
  /// Whether another draw of the same view would be finer.
  virtual bool busy() const = 0;
  /// Takes effect with the next frame.
  virtual void setQuality(const StreamedQuality& quality) = 0;
  virtual const StreamedQuality& quality() const = 0;
  /// Drops all GL objects, which are gone together with their context.
  virtual void contextLost() = 0;
  virtual StreamedStats stats() const = 0;
};

}  // namespace client
