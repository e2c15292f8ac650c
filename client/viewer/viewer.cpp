#include "client/viewer/viewer.h"

#include <algorithm>
#include <limits>
#include <utility>

namespace client {
namespace {

/// Assumed upload speed: that of a slow laptop; others are faster.
constexpr double kUploadBytesPerMillisecond = 2e6;
/// Layer size, pixels, of a renderer that will never get a face.
constexpr int kNoFaceSize = 16;
/// So long after its last motion a view with all that it needs has its patches refined. A choice.
constexpr double kRefineAfterSeconds = 0.5;

std::uint64_t recordBytes(const lod::patch::Hierarchy& hierarchy) {
  return hierarchy.groups.capacity() * sizeof(lod::patch::Group) +
         hierarchy.patches.capacity() * sizeof(lod::patch::Patch) +
         hierarchy.parents.capacity() * sizeof(std::uint32_t) + hierarchy.known.capacity();
}

base::Sphere sceneSphere(const protocol::Welcome& welcome) {
  return {0.5F * (welcome.box_min + welcome.box_max), 0.5F * glm::length(welcome.box_max - welcome.box_min)};
}

/// Divides the memory budget, and limits the options by their shares.
MemoryPlan limitByMemory(ViewerOptions& options) {
  options.memory_budget_bytes = std::max(options.memory_budget_bytes, kMinMemory);
  const MemoryPlan plan = planMemory(options.memory_budget_bytes, options.session.cache_bytes, options.gpu_budget_bytes,
                                     options.session.frames, options.samples > 1);
  options.session.cache_bytes = plan.cache;
  options.session.frame_bytes = plan.frames;
  options.session.frame_pixels = framePixelsFor(plan.frame_images);
  const std::uint64_t at_rest = std::uint64_t{base::ViewDefaults::kRefinedFactor} * options.session.max_triangles;
  const std::uint32_t most = trianglesFor(plan.patches);
  options.session.max_triangles = std::min(options.session.max_triangles, most);
  options.session.max_triangles_refined = static_cast<std::uint32_t>(std::min<std::uint64_t>(at_rest, most));
  return plan;
}

}  // namespace

Viewer::Viewer(const ViewerOptions& options, std::unique_ptr<ImageDecoder> decoder)
    : options_(options), plan_(limitByMemory(options_)), session_(options_.session), decoder_(std::move(decoder)) {
  if (options_.method == Method::kPatches) setMethod(options_.method);
}

base::Result<bool> Viewer::update(const base::ViewCamera& camera, double now) {
  if (showsStreamed()) {
    LUMIGRID_TRY(updateStreamed(camera));
    return false;
  }
  session_.setView(viewForServer(camera));
  LUMIGRID_TRY(takeEvents());
  if (!base::showsSameView(view_, camera)) moved_at_ = now;
  more_to_do_ = false;
  view_ = camera;
  takeDecoded();
  if (!renderer_) return false;
  if (session_.mayRefine() && isAtRest(now)) session_.refine();
  camera_ = cameraAt(camera);
  frozen_ = isFrozen(now);
  if (frozen_) return false;
  upload_bytes_left_ = options_.upload_milliseconds > 0.0 ? options_.upload_milliseconds * kUploadBytesPerMillisecond
                                                          : std::numeric_limits<double>::infinity();

  updatePatches();
  if (sight_ && options_.lumigraph.use_images && session_.welcome()->grid.pointCount() != 0) sight_->renew(session_);
  rankImages(now);
  uploadImages(now);
  submitImages();
  markInUse();

  more_to_do_ = patches_.unfinished();
  for (const auto& [id, image] : images_) {
    const bool on_its_way = image.state == ImageState::kDecoding || image.state == ImageState::kDecoded ||
                            (image.state == ImageState::kCached && !gpu_full_);
    if (on_its_way && image.use >= kNeededUse) more_to_do_ = true;
  }
  return more_to_do_;
}

void Viewer::setBackground(const std::array<float, 4>& color) {
  std::copy(color.begin(), color.end(), options_.lumigraph.background);
}

void Viewer::drawBackground() const {
  if (context_lost_) return;
  const float* color = options_.lumigraph.background;
  glClearColor(color[0], color[1], color[2], color[3]);
  glClear(GL_COLOR_BUFFER_BIT);
}

bool Viewer::allHere() const {
  return showsStreamed() ? hasStreamed() && streamed_->complete() : session_.complete() && !session_.mayRefine();
}

std::optional<glm::dvec3> Viewer::surfaceAt(const base::ViewCamera& camera, double x, double y) {
  if (showsStreamed()) {
    if (!hasStreamed()) return std::nullopt;
    const auto point = streamed_->surfaceAt(cameraAt(camera), x, y);
    return point ? std::optional(session_.welcome()->origin + glm::dvec3(*point)) : std::nullopt;
  }
  if (!renderer_ || patches_.drawn().patches.empty()) return std::nullopt;
  if (!picker_) {
    auto picker = Picker::create();
    if (!picker) {
      fault(picker.error().message);
      return std::nullopt;
    }
    picker_ = std::move(*picker);
  }
  const auto point = picker_->surfaceAt(cameraAt(camera), x, y, renderer_->patches(), patches_.drawn().patches);
  if (!point) return std::nullopt;
  return session_.welcome()->origin + glm::dvec3(*point);
}

// ---- modes of display ----

void Viewer::setMethod(Method method) {
  if (showsStreamed() || isStreamed(method)) return;
  const SessionOptions& asked = options_.session;
  const bool images = method == Method::kLumigraph;
  options_.method = method;
  options_.lumigraph.use_images = images && (asked.images || asked.frames);
  session_.setWanted(images && asked.images, images && asked.frames);
}

void Viewer::setPins(std::vector<glm::dvec3> points) {
  pins_ = std::move(points);
  pins_visible_.assign(pins_.size(), false);
  if (auto started = startPins(); !started) fault(started.error().message);
}

const std::vector<bool>& Viewer::pinsVisible() {
  if (!probe_ || context_lost_) return pins_visible_;
  probe_->poll();
  std::copy(probe_->visible().begin(), probe_->visible().end(), pins_visible_.begin());
  return pins_visible_;
}

// ---- a lost context ----

void Viewer::contextLost() {
  if (context_lost_) return;
  context_lost_ = true;
  base::gl::contextLost();
  renderer_.reset();
  picker_.reset();
  picture_ = {};
  target_refused_ = false;
  mean_.reset();
  mean_refused_ = false;
  probe_.reset();
  if (streamed_) streamed_->contextLost();
  frame_.reset();
  candidates_.clear();
  patches_.forget();
  for (auto& [id, image] : images_)
    if (image.state == ImageState::kResident) image.state = ImageState::kCached;
}

base::Result<void> Viewer::contextRestored() {
  if (!context_lost_) return {};
  context_lost_ = false;
  if (session_.welcome() == nullptr) return {};
  if (!showsStreamed()) LUMIGRID_TRY(startRenderer());
  return startPins();
}

// ---- figures ----

ViewerStats Viewer::stats() const {
  ViewerStats stats;
  stats.session = session_.stats();
  if (renderer_) stats.lumigraph = renderer_->stats();
  stats.error_px = errorOf(patches_.drawn());
  stats.bound_px = patches_.drawn().bound_px;
  const lod::patch::Cut& wanted = patches_.wanted();
  stats.tolerance_px = session_.usualPatches().tolerance_px;
  // The server is asked for no more than fits, so when everything has arrived, the drawn picture is as fine as it gets.
  if (wanted.limited || (renderer_ && session_.complete()))
    stats.tolerance_px = std::max(stats.tolerance_px, errorOf(wanted));
  stats.accuracy = accuracy();
  stats.memory = memory();
  stats.memory_budget = options_.memory_budget_bytes;
  for (const auto& [id, image] : images_) {
    stats.samples_cached += image.state != ImageState::kEmpty ? 1 : 0;
    const bool waits = image.state != ImageState::kResident && image.state != ImageState::kEmpty;
    stats.images_requested += waits && image.use >= kNeededUse ? 1 : 0;
  }
  const bool pins_pending = probe_ && probe_->pending();
  const bool effort_pending = effortPending();
  const bool more = more_to_do_ || session_.hasNewFrame() || settling() || frozen_ || shows_older_;
  stats.busy = renderer_ && (more || session_.mayRefine() || pins_pending || effort_pending);
  stats.complete = renderer_ && allHere() && !more && !effort_pending;
  stats.effort_pending = effort_pending && !pins_pending;
  stats.effort = effort_;
  stats.broken = broken_;
  stats.last_fault = last_fault_;
  if (streamed_) addStreamed(stats);
  return stats;
}

// ---- the scene ----

base::Result<void> Viewer::startScene() {
  const protocol::Welcome& welcome = *session_.welcome();
  images_.clear();
  frame_.reset();
  resting_ = {};
  ranked_.clear();
  patches_ = {};
  sight_ = options_.make_sight ? options_.make_sight() : nullptr;
  scene_ = sceneSphere(welcome);
  shading_ = {welcome.unlit, welcome.light_direction};
  if (context_lost_) return {};
  if (!showsStreamed()) LUMIGRID_TRY(startRenderer());
  return startPins();
}

base::Result<void> Viewer::startRenderer() {
  const repository::Grid& grid = session_.welcome()->grid;
  const int face_size = grid.pointCount() != 0 ? static_cast<int>(grid.imageSide()) : kNoFaceSize;
  LUMIGRID_ASSIGN_OR_RETURN(
      auto made, LumigraphRenderer::create(session_.hierarchy().lattice, face_size, plan_.images, plan_.frame_images));
  renderer_ = std::move(made);
  governor_ = DrawGovernor(options_.samples, base::gl::drawsInSoftware(), options_.fps);
  gpu_full_ = false;
  return {};
}

bool Viewer::isAtRest(double now) const {
  return options_.lumigraph.fade_seconds <= 0.0F || now - moved_at_ >= kRefineAfterSeconds;
}

/// Returns the perspective view that the server is asked for, since it knows no other.
base::ViewCamera Viewer::viewForServer(const base::ViewCamera& wanted) const {
  if (session_.welcome() == nullptr || !wanted.orthographic()) {
    base::ViewCamera perspective = wanted;
    perspective.ortho_height = 0.0;
    return perspective;
  }
  const base::Sphere sphere = sceneSphere(*session_.welcome());
  return base::perspectiveStandIn(wanted, session_.welcome()->origin + glm::dvec3(sphere.center),
                                  static_cast<double>(sphere.radius), protocol::kMinFov);
}

void Viewer::fault(const std::string& problem) {
  ++broken_;
  last_fault_ = problem;
}

/// Takes bytes from the frame's upload share. The first item always passes, so that a small share never stops the flow.
bool Viewer::spend(double bytes) {
  if (upload_bytes_left_ <= 0.0) return false;
  upload_bytes_left_ -= bytes;
  return true;
}

// ---- patches ----

/// Whether patches are drawn as fine as they are here: at rest, and as long as a moving view has all effort.
bool Viewer::drawsFinePatches() const {
  if (session_.refined()) return true;
  const bool may = options_.session.refine && session_.usualPatches().measure == base::ErrorMeasure::kShape;
  return may && governor_.isAtMost();
}

/// The largest projected error of a cut by the measure of usualPatches().
float Viewer::errorOf(const lod::patch::Cut& cut) const {
  const base::ErrorMeasure measure = session_.usualPatches().measure;
  return measure == base::ErrorMeasure::kShape ? cut.shape_px : cut.error_px;
}

/// The hierarchy's records count towards the patches' share, but leave them at least a quarter of it.
void Viewer::updatePatches() {
  const std::uint64_t records = std::min(recordBytes(session_.hierarchy()), plan_.patches / 4 * 3);
  lod::patch::CutRequest wanted;
  wanted.camera = camera_;
  wanted.near_plane = base::nearestDistance(camera_.eye, scene_);
  const PatchGoal goal = drawsFinePatches() ? session_.finePatches() : session_.usualPatches();
  wanted.tolerance_px = goal.tolerance_px;
  wanted.measure = goal.measure;
  wanted.max_triangles = goal.max_triangles;
  wanted.max_cost = plan_.patches - records;
  patches_.update(
      wanted, options_.lumigraph.use_images, session_, renderer_->patches(),
      [this](std::uint64_t bytes) { return spend(static_cast<double>(bytes)); },
      [this](const std::string& problem) { fault(problem); });
}

// ---- memory and accuracy ----

MemoryUse Viewer::memory() const {
  MemoryUse use;
  if (streamed_) {
    const StreamedStats stats = streamed_->stats();
    use.cache = stats.file_bytes;
    use.buffers = stats.buffer_bytes;
    use.renderbuffers = picture_.bytes();
    return use;
  }
  if (renderer_) {
    const base::gl::HeldBytes held = renderer_->heldBytes();
    use.textures = held.textures;
    use.buffers = held.buffers;
  }
  if (mean_) use.textures += mean_->bytes();
  use.renderbuffers = picture_.bytes() + (picker_ ? picker_->gpuBytes() : 0);
  use.decoded = waitingBytes();
  use.cache = session_.stats().cache_bytes + session_.stats().frame_bytes;
  use.records = recordBytes(session_.hierarchy());
  return use;
}

/// Whether the blended picture has the cut of the wanted tolerance, and images.
bool Viewer::blendIsFine() const {
  if (patches_.drawn().patches.empty() || errorOf(patches_.drawn()) > session_.usualPatches().tolerance_px)
    return false;
  return !options_.lumigraph.use_images || renderer_->stats().samples_used > 0;
}

Accuracy Viewer::accuracy() const {
  if (showsStreamed()) {
    if (!hasStreamed() || streamed_->stats().drawn == 0) return Accuracy::kNothing;
    return streamed_->complete() ? Accuracy::kFine : Accuracy::kCoarse;
  }
  if (renderer_ && frame_.whole()) return Accuracy::kExact;
  if (!renderer_ || patches_.drawn().patches.empty()) return Accuracy::kNothing;
  return blendIsFine() ? Accuracy::kBlended : Accuracy::kCoarse;
}

}  // namespace client
