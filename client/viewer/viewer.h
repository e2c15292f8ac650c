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
#include <unordered_map>
#include <utility>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/gl/multisampled_target.h"
#include "base/image.h"
#include "client/render/lumigraph.h"
#include "client/render/picture_mean.h"
#include "client/source/method.h"
#include "client/source/session.h"
#include "client/source/streamed_view.h"
#include "client/viewer/decode.h"
#include "client/viewer/draw_governor.h"
#include "client/viewer/memory_plan.h"
#include "client/viewer/pick.h"
#include "client/viewer/pins.h"
#include "client/viewer/resident_patches.h"
#include "client/viewer/surface_sight.h"
#include "client/viewer/whole_frame.h"

namespace client {

struct ViewerOptions {
  SessionOptions session;
  LumigraphOptions lumigraph;
  /// kLumigraph or kPatches (the same client without images); with one for which isStreamed() only what setStreamed()
  /// brings is shown.
  Method method = Method::kLumigraph;
  std::uint64_t gpu_budget_bytes = 512'000'000;  ///< limit for images on the GPU
  /// Everything that grows with the scene, on the GPU and off (MemoryUse::total()), stays below this at every frame.
  /// Its shares (client/viewer/memory_plan.h) bound the session's cache and `gpu_budget_bytes` too. Where it does not
  /// suffice, the picture is coarser or has fewer images: see error_px. At least kMinMemory.
  std::uint64_t memory_budget_bytes = 1'000'000'000;
  /// Samples a pixel of patches and images, a power of 2, which are averaged; fewer where their share of the memory
  /// does not hold them or the GL has fewer. Umbrellas and hlod have this number always, splats one.
  int samples = 4;
  /// Each picture is drawn with this. None: a moving view gets the samples, pixels and images that frame times allow
  /// (DrawGovernor), and one at rest all pixels and twice as many samples, unless they are 1.
  std::optional<DrawEffort> effort;
  double fps = DrawGovernor::kUsualRate;  ///< pictures a second that a moving view is to have; 0: no matter
  /// Makes what finds the images of surface in view. Null, for methods without images: patches are looked at instead.
  std::unique_ptr<SurfaceSight> (*make_sight)() = makeSurfaceSight;
  double upload_milliseconds = 4.0;  ///< longest upload per frame, at an assumed 2 MB a millisecond; 0: no limit
};

inline constexpr std::uint64_t kMinMemory = 16'000'000;

/// The bytes that the viewer holds now.
struct MemoryUse {
  std::uint64_t textures = 0;       ///< GPU: images, their mip levels and depth maps
  std::uint64_t buffers = 0;        ///< GPU: patches, uniforms
  std::uint64_t renderbuffers = 0;  ///< GPU: picking, and the samples of the picture
  std::uint64_t decoded = 0;        ///< images decoded or being decoded, not yet on the GPU
  std::uint64_t cache = 0;          ///< compressed images and patches, exact frames
  std::uint64_t records = 0;        ///< records of the hierarchy
  std::uint64_t gpu() const { return textures + buffers + renderbuffers; }
  std::uint64_t total() const { return gpu() + decoded + cache + records; }
};

/// How close a picture is to the true one.
enum class Accuracy : std::uint8_t {
  kNothing,  ///< no surface is here yet
  kCoarse,   ///< the surface is coarser than the tolerance asks for, or is being refined
  kBlended,  ///< the cut has reached the tolerance, and is textured by the images that are here
  kExact,    ///< the server's own picture of this very view is shown, pixel for pixel
  kFine,     ///< all splats, umbrellas or nodes that the options ask for are here
};

struct ViewerStats {
  SessionStats session;
  LumigraphStats lumigraph;
  float error_px = 0.0F;  ///< largest projected error of what is drawn, by the measure of Session::usualPatches()
  float bound_px =
      0.0F;  ///< every point of it is proved to be within this; 0 with streamed methods, which prove nothing
  float tolerance_px = 0.0F;  ///< the wanted tolerance, or more where a budget does not allow it
  Accuracy accuracy = Accuracy::kNothing;
  MemoryUse memory;
  std::uint64_t memory_budget = 0;
  std::uint32_t samples_cached = 0;    ///< images known to the viewer: resident, waiting or being decoded
  std::uint32_t images_requested = 0;  ///< images that this view uses, received but not on the GPU yet
  bool complete = false;               ///< everything for this view was sent, decoded and uploaded, and has faded in
  bool busy = false;                   ///< another draw of the same view would look different without any more data
  /// The only thing to be drawn is a picture with more samples, pixels or images. `busy` then holds, too, but a program
  /// may wait until the view has rested for a moment.
  bool effort_pending = false;
  DrawEffort effort;         ///< of the blended picture that was drawn last
  std::uint32_t broken = 0;  ///< images, groups and parts of a streamed file that could not be decoded
  StreamedStats streamed;    ///< with a method for which isStreamed()
  std::string last_fault;    ///< the error of the latest of them
};

inline constexpr std::size_t kMaxPins = 512;

/// A GL context must be current from the first draw() on.
class Viewer {
 public:
  Viewer(const ViewerOptions& options, std::unique_ptr<ImageDecoder> decoder);
  Session& session() { return session_; }
  const Session& session() const { return session_; }
  /// The options as limited by the memory budget.
  const ViewerOptions& options() const { return options_; }
  /// Takes in data that arrived and uploads decoded images, within the frame's share, without drawing. Returns true
  /// while there is more to do (images being decoded, or left for the next call). Callers that wait for a complete
  /// picture need it; draw() calls it by itself.
  base::Result<bool> update(const base::ViewCamera& camera, double now);
  /// Draws the view into the bound framebuffer with the data that are here now. Never waits for network or decoder.
  /// `now` in seconds. Back faces seen through the camera's section have one flat colour (lod::draw::kSectionColor),
  /// which shows where the model is open. When the server's frame of exactly this view is here, that frame is shown
  /// itself, without the proxy, unless a tint or a light is to alter the picture. Over a transparent background colours
  /// are premultiplied by the alpha of pixels that are covered in part, as browsers have them; splats' are not.
  base::Result<void> draw(const base::ViewCamera& camera, double now);
  /// Does what draw() does but leaves the framebuffer as it is, so that the next draw() shows depth maps and fades as
  /// if this frame had been drawn. A tenth of the time. Streamed methods, whose pictures depend on no earlier ones, are
  /// left out.
  base::Result<void> drawUnseen(const base::ViewCamera& camera, double now);
  /// Tells how long the last picture took, in seconds, if the view moved for it: the interval to the one before where
  /// both were drawn as fast as they could be, or the time of drawing.
  void addFrameTime(double seconds) { governor_.addFrame(asked_effort_, seconds); }
  /// Sets the colour where there is no model, from the next draw on: RGBA, 0 … 1.
  void setBackground(const std::array<float, 4>& color);
  /// Clears the bound framebuffer, before there is a model. Tells the server of no view.
  void drawBackground() const;
  /// Whether everything that the view of the last update() or draw() needs has been received, the finer patches of a
  /// view at rest included; some of it may still have to be decoded.
  bool allHere() const;
  /// Returns the world point of the drawn surface at (x, y), in pixels from the upper left corner; nullopt over
  /// background and where a section plane has cut the surface away. Waits for the GPU.
  std::optional<glm::dvec3> surfaceAt(const base::ViewCamera& camera, double x, double y);

  /// Tints every fragment by the resolution of what is shown there (lod::draw::kResolutionLegend).
  void setResolutionColors(bool on) { options_.lumigraph.modes.resolution_colors = on; }
  /// Shows the model's own colours by a light of the viewer's, towards which `direction` points (world axes, any
  /// length), from the next draw on; nullopt or zero: as the scene says. Images of a scene that light shades, and the
  /// server's frames, are not shown then, since their light is another.
  void setLight(const std::optional<glm::dvec3>& direction);
  /// Switches between lumigraph and patches from the next draw on; patches request no images from the server. Images
  /// that ViewerOptions::session turns off stay off. A viewer never changes from or to a streamed method, whose data
  /// come from another place.
  void setMethod(Method method);
  /// Sets the source of a streamed method; the caller pumps it.
  void setStreamed(std::shared_ptr<StreamedView> view) { streamed_ = std::move(view); }
  StreamedView* streamed() { return streamed_.get(); }  ///< null while there is none
  /// Places the magnifying glass of kQsplat: what is seen through it comes first and is finer. Framebuffer pixels.
  void setLens(const std::optional<lod::qsplat::Lens>& lens) { lens_ = lens; }

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
  /// Exact frames of the server get ids of their own beside the codes of faces (63 bits).
  static constexpr SampleId kFrameTag = SampleId{1} << 63U;
  /// Expected use below which an image does not matter for the present view: a thousandth of the picture.
  static constexpr float kNeededUse = 1e-3F;

  /// The state of an image on its way from the cache to the GPU.
  enum class ImageState {
    kCached,
    kDecoding,
    kDecoded,
    kResident,
    kEmpty,  ///< is an empty flag, or broken
    kUnfit,  ///< larger than its share of the budget
  };

  /// A face or an exact frame on its way to the GPU.
  struct BlendImage {
    ImageState state = ImageState::kCached;
    base::Camera camera;
    SampleTraits traits;
    base::Image rgba;   // only while kDecoded
    float use = 0.0F;   // expected share of the blend in the present view
    float rank = 0.0F;  // use, and among the unused the nearer and wider first
  };

  base::Result<void> startScene();
  base::Result<void> startRenderer();
  base::Result<void> takeEvents();
  void addFace(const repository::FaceKey& key);
  void addFrame(std::uint32_t number);
  void dropImage(SampleId id);
  void dropOldFrames();
  void takeDecoded();
  bool isAtRest(double now) const;
  bool drawsFinePatches() const;
  float errorOf(const lod::patch::Cut& cut) const;
  void updatePatches();
  void rankImages(double now);
  bool looksRoughly(double now) const;
  void uploadImages(double now);
  std::optional<SampleId> oldestFrameBefore(SampleId id) const;
  std::optional<SampleId> replacedBy(SampleId id) const;
  bool makeRoomFor(SampleId id);
  void removeResident(SampleId id);
  bool removeFramesBut(std::initializer_list<base::Camera> sizes);
  const BlendImage* worstResident(SampleId* id, const base::Camera* of_size_like) const;
  void submitImages();
  bool decoderIsBusy() const;
  int imagesBlended() const;
  int moreAtRest() const;
  void markInUse();
  base::Result<void> startPins();
  void probePins();
  std::uint64_t pictureSignature() const;
  bool showsStreamed() const { return isStreamed(options_.method); }
  bool hasStreamed() const { return streamed_ && streamed_->bounds() != nullptr && session_.welcome() != nullptr; }
  lod::draw::Shading shadingHere() const;
  StreamedLook streamedLook() const;
  void addStreamed(ViewerStats& stats) const;
  base::Result<bool> setStreamedView(const base::ViewCamera& wanted);
  base::Result<void> updateStreamed(const base::ViewCamera& wanted);
  base::Result<void> drawStreamed(const base::ViewCamera& wanted);
  base::Camera cameraAt(const base::ViewCamera& wanted) const {
    return base::cameraForScene(wanted, session_.welcome()->origin, scene_);
  }
  base::ViewCamera viewForServer(const base::ViewCamera& wanted) const;
  const base::Bytes* codedImage(SampleId id);
  void fault(const std::string& problem);
  bool spend(double bytes);
  MemoryUse memory() const;
  std::uint64_t waitingBytes() const;
  bool mayShowFrames() const;
  bool showsThisView(SampleId id) const;
  std::vector<SampleId> framesOfThisView() const;
  void drawBlended(bool moved, double now);
  void drawProxy(const base::Camera& camera, const LumigraphOptions& options, double now);
  DrawEffort effortWanted(bool moved, double now) const;
  bool hasAll() const;
  DrawEffort effortAtRest() const;
  bool prepareMean();
  LumigraphOptions optionsAtRest(LumigraphOptions options) const;
  void drawMean(const LumigraphOptions& options, DrawEffort& effort, GLuint target, double now);
  int beginMean(const LumigraphOptions& options, int wanted, double now);
  bool hasMean(const LumigraphOptions& options) const;
  void showMean(GLuint target);
  bool isFrozen(double now) const;
  bool blendsOnce(int width, int height, int samples) const;
  DrawEffort fittingEffort(DrawEffort wanted) const;
  bool bindTarget(int width, int height, const DrawEffort& effort);
  bool effortPending() const;
  bool settling() const;
  bool blendIsFine() const;
  void drawFrames();
  std::vector<ProxyError> proxyErrors() const;
  Accuracy accuracy() const;

  ViewerOptions options_;
  MemoryPlan plan_;
  Session session_;
  std::unique_ptr<ImageDecoder> decoder_;
  std::unique_ptr<LumigraphRenderer> renderer_;
  bool context_lost_ = false;
  std::optional<Picker> picker_;
  lod::draw::Shading shading_;
  base::Sphere scene_;

  std::unordered_map<SampleId, BlendImage> images_;
  std::unordered_map<SampleId, std::uint64_t> decoding_;  // id -> bytes, dropped images included
  std::vector<SampleId> ranked_;                          // best first
  std::vector<SampleId> candidates_;                      // the resident ones among them
  bool gpu_full_ = false;
  ResidentPatches patches_;
  std::unique_ptr<SurfaceSight> sight_;  // null: see ViewerOptions::make_sight
  base::ViewCamera view_;
  base::Camera camera_;
  base::ViewCamera drawn_view_;
  WholeFrame frame_;
  DrawGovernor governor_{1, false};
  base::gl::MultisampledTarget picture_;  // of several samples a pixel, or of fewer pixels than are shown
  bool target_refused_ = false;           // by the GL
  std::optional<PictureMean> mean_;
  /// The view and the manner in which it is to be shown, and how many pictures the mean is to have.
  struct Look {
    base::ViewCamera view;
    LumigraphOptions options;
    lod::draw::Shading shading;
    int pictures = 0;

    friend bool operator==(const Look&, const Look&) = default;
  };
  /// All that they are drawn from.
  struct Resting {
    Look look;
    std::vector<std::uint32_t> patches, occluders;
    std::vector<SampleId> images;

    friend bool operator==(const Resting&, const Resting&) = default;
  };
  Resting resting_;
  double resting_since_ = 0.0;  // seconds
  bool shows_older_ = false;    // the last picture was of older data than are here
  bool frozen_ = false;         // data wait until the mean of the earlier ones is whole
  bool mean_refused_ = false;   // by the GL
  DrawEffort effort_;           // of the last picture
  DrawEffort asked_effort_;     // for it, whatever memory and GL allowed
  double moved_at_ = -1e9;      // when the view last moved, seconds
  bool more_to_do_ = false;
  double upload_bytes_left_ = 0.0;
  std::uint32_t broken_ = 0;
  std::string last_fault_;

  std::shared_ptr<StreamedView> streamed_;  // null until its link has it
  std::optional<lod::qsplat::Lens> lens_;

  std::vector<glm::dvec3> pins_;  // world
  std::optional<PinProbe> probe_;
  std::vector<bool> pins_visible_;
  std::uint64_t drawn_signature_ = 0;  // signature of the picture against which the pins were tested
};

/// Reads the picture that the viewer drew into the target: RGBA, not premultiplied.
base::Image readPicture(const base::gl::RenderTarget& target, const Viewer& viewer);

}  // namespace client
