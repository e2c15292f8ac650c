#include "client/viewer/viewer.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "client/viewer/viewer_impl.h"

namespace client {
namespace {

/// Assumed upload speed: that of a slow laptop; others are faster.
constexpr double kUploadBytesPerMillisecond = 2e6;
/// Layer size, pixels, of a renderer that will never get a face.
constexpr int kNoFaceSize = 16;

/// Compares with a tolerance where rounding is possible: directions are normalized again where they arrive.
bool showsSameView(const base::ViewCamera& a, const base::ViewCamera& b) {
  const auto near = [](const glm::dvec3& u, const glm::dvec3& v) { return glm::length(u - v) <= 1e-9; };
  return a.position == b.position && near(a.direction, b.direction) &&
         near(glm::normalize(a.up), glm::normalize(b.up)) && a.fov_y == b.fov_y && a.width == b.width &&
         a.height == b.height && a.ortho_height == b.ortho_height;
}

std::uint64_t recordBytes(const lod::patch::Hierarchy& hierarchy) {
  return hierarchy.groups.capacity() * sizeof(lod::patch::Group) +
         hierarchy.patches.capacity() * sizeof(lod::patch::Patch) +
         hierarchy.parents.capacity() * sizeof(std::uint32_t) + hierarchy.known.capacity();
}

base::Sphere sceneSphere(const protocol::Welcome& welcome) {
  return {0.5F * (welcome.box_min + welcome.box_max), 0.5F * glm::length(welcome.box_max - welcome.box_min)};
}

}  // namespace

Viewer::Viewer(const ViewerOptions& options, std::unique_ptr<ImageDecoder> decoder) {
  ViewerOptions wanted = options;
  wanted.memory_budget_bytes = std::max(wanted.memory_budget_bytes, kMinMemory);
  const MemoryPlan plan = planMemory(wanted.memory_budget_bytes, wanted.session.cache_bytes, wanted.gpu_budget_bytes,
                                     wanted.session.frames);
  wanted.session.cache_bytes = plan.cache;
  wanted.session.frame_bytes = plan.frames;
  wanted.session.max_triangles = std::min(wanted.session.max_triangles, trianglesFor(plan.patches));
  impl_ = std::make_unique<Impl>(wanted, plan, std::move(decoder));
  if (wanted.method == Method::kPatches) setMethod(wanted.method);
}
Viewer::~Viewer() = default;

Session& Viewer::session() {
  return impl_->session;
}
const Session& Viewer::session() const {
  return impl_->session;
}
const ViewerOptions& Viewer::options() const {
  return impl_->options;
}

base::Result<bool> Viewer::update(const base::ViewCamera& camera, double now) {
  Impl& s = *impl_;
  if (s.showsSplats()) {
    LUMIGRID_TRY(s.updateSplats(camera));
    return false;
  }
  s.session.setView(s.viewForServer(camera));
  LUMIGRID_TRY(s.takeEvents());
  s.more_to_do = false;
  s.view = camera;
  s.takeDecoded();
  if (!s.renderer) return false;
  s.camera = s.cameraAt(camera);
  s.upload_bytes_left = s.options.upload_milliseconds > 0.0 ? s.options.upload_milliseconds * kUploadBytesPerMillisecond
                                                            : std::numeric_limits<double>::infinity();

  s.updatePatches();
  s.rankImages();
  s.uploadImages(now);
  s.submitImages();
  s.markInUse();

  s.more_to_do = s.patches.unfinished();
  for (const auto& [id, image] : s.images) {
    const bool on_its_way = image.state == Impl::ImageState::kDecoding || image.state == Impl::ImageState::kDecoded ||
                            (image.state == Impl::ImageState::kCached && !s.gpu_full);
    if (on_its_way && image.use >= Impl::kNeededUse) s.more_to_do = true;
  }
  return s.more_to_do;
}

void Viewer::setBackground(const std::array<float, 4>& color) {
  std::copy(color.begin(), color.end(), impl_->options.lumigraph.background);
}

void Viewer::drawBackground() const {
  if (impl_->context_lost) return;
  const float* color = impl_->options.lumigraph.background;
  glClearColor(color[0], color[1], color[2], color[3]);
  glClear(GL_COLOR_BUFFER_BIT);
}

bool Viewer::allHere() const {
  const Impl& s = *impl_;
  return s.showsSplats() ? s.hasSplats() && s.splats->complete() : s.session.complete();
}

base::Result<void> Viewer::draw(const base::ViewCamera& camera, double now) {
  if (impl_->showsSplats()) {
    if (impl_->context_lost) return {};
    if (impl_->hasSplats()) return impl_->drawSplats(camera);
    drawBackground();
    return impl_->takeEvents();
  }
  if (const auto more = update(camera, now); !more) return more.error();
  Impl& s = *impl_;
  s.last_draw = now;
  if (s.context_lost) return {};
  if (!s.renderer) {
    drawBackground();
    return {};
  }

  s.candidates.clear();
  for (SampleId id : s.ranked)
    if (s.images[id].state == Impl::ImageState::kResident) s.candidates.push_back(id);
  const lod::patch::Cut& cut = s.patches.drawn();
  s.options.lumigraph.modes.section = s.sectionHere();
  s.renderer->draw(s.camera, cut.patches, s.candidates, cut.error_px, s.shading, s.options.lumigraph, now,
                   s.patches.occluders(), cut.patch_error_px);
  s.probePins();
  return {};
}

std::optional<glm::dvec3> Viewer::surfaceAt(const base::ViewCamera& camera, double x, double y) {
  Impl& s = *impl_;
  if (s.showsSplats()) {
    if (!s.hasSplats()) return std::nullopt;
    const auto point = s.splats->surfaceAt(s.cameraAt(camera), s.splatLook(), x, y);
    return point ? std::optional(s.session.welcome()->origin + glm::dvec3(*point)) : std::nullopt;
  }
  if (!s.renderer || s.patches.drawn().patches.empty()) return std::nullopt;
  if (!s.picker) {
    auto picker = Picker::create();
    if (!picker) {
      s.fault(picker.error().message);
      return std::nullopt;
    }
    s.picker = std::move(*picker);
  }
  const auto point =
      s.picker->surfaceAt(s.cameraAt(camera), x, y, s.renderer->patches(), s.patches.drawn().patches, s.sectionHere());
  if (!point) return std::nullopt;
  return s.session.welcome()->origin + glm::dvec3(*point);
}

// ---- modes of display ----

void Viewer::setSection(const std::optional<base::SectionPlane>& plane) {
  impl_->section = plane;
}

void Viewer::setResolutionColors(bool on) {
  impl_->options.lumigraph.modes.resolution_colors = on;
}

void Viewer::setMethod(Method method) {
  Impl& s = *impl_;
  if (s.showsSplats() || method == Method::kQsplat) return;
  const SessionOptions& asked = s.options.session;
  const bool images = method == Method::kLumigraph;
  s.options.method = method;
  s.options.lumigraph.use_images = images && (asked.images || asked.frames);
  s.session.setWanted(images && asked.images, images && asked.frames);
}

void Viewer::setSplats(std::shared_ptr<SplatView> splats) {
  impl_->splats = std::move(splats);
}

SplatView* Viewer::splats() {
  return impl_->splats.get();
}

void Viewer::setLens(const std::optional<lod::qsplat::Lens>& lens) {
  impl_->lens = lens;
}

void Viewer::setPins(std::vector<glm::dvec3> points) {
  Impl& s = *impl_;
  s.pins = std::move(points);
  s.pins_visible.assign(s.pins.size(), false);
  if (auto started = s.startPins(); !started) s.fault(started.error().message);
}

const std::vector<bool>& Viewer::pinsVisible() {
  Impl& s = *impl_;
  if (!s.probe || s.context_lost) return s.pins_visible;
  s.probe->poll();
  std::copy(s.probe->visible().begin(), s.probe->visible().end(), s.pins_visible.begin());
  return s.pins_visible;
}

// ---- a lost context ----

void Viewer::contextLost() {
  Impl& s = *impl_;
  if (s.context_lost) return;
  s.context_lost = true;
  base::gl::contextLost();
  s.renderer.reset();
  s.picker.reset();
  s.probe.reset();
  if (s.splats) s.splats->contextLost();
  s.candidates.clear();
  s.patches.forget();
  for (auto& [id, image] : s.images)
    if (image.state == Impl::ImageState::kResident) image.state = Impl::ImageState::kCached;
}

base::Result<void> Viewer::contextRestored() {
  Impl& s = *impl_;
  if (!s.context_lost) return {};
  s.context_lost = false;
  if (s.session.welcome() == nullptr) return {};
  if (!s.showsSplats()) LUMIGRID_TRY(s.startRenderer());
  return s.startPins();
}

// ---- figures ----

ViewerStats Viewer::stats() const {
  const Impl& s = *impl_;
  ViewerStats stats;
  stats.session = s.session.stats();
  if (s.renderer) stats.lumigraph = s.renderer->stats();
  stats.error_px = s.patches.drawn().error_px;
  const lod::patch::Cut& wanted = s.patches.wanted();
  stats.tolerance_px = s.options.session.patch_tolerance_px;
  // The server is asked for no more than fits, so when everything has arrived, the drawn picture is as fine as it gets.
  if (wanted.limited || (s.renderer && s.session.complete()))
    stats.tolerance_px = std::max(stats.tolerance_px, wanted.error_px);
  stats.accuracy = s.accuracy();
  stats.memory = s.memory();
  stats.memory_budget = s.options.memory_budget_bytes;
  for (const auto& [id, image] : s.images) {
    stats.samples_cached += image.state != Impl::ImageState::kEmpty ? 1 : 0;
    const bool waits = image.state != Impl::ImageState::kResident && image.state != Impl::ImageState::kEmpty;
    stats.images_requested += waits && image.use >= Impl::kNeededUse ? 1 : 0;
  }
  const bool pins_pending = s.probe && s.probe->pending();
  stats.busy = s.renderer && (s.more_to_do || s.renderer->settling() || pins_pending);
  stats.complete = s.renderer && s.session.complete() && !s.more_to_do && !s.renderer->settling();
  stats.broken = s.broken;
  stats.last_fault = s.last_fault;
  if (s.splats) s.addSplats(stats);
  return stats;
}

// ---- the scene ----

base::Result<void> Viewer::Impl::startScene() {
  const protocol::Welcome& welcome = *session.welcome();
  images.clear();
  ranked.clear();
  patches = {};
  scene = sceneSphere(welcome);
  shading = {welcome.unlit, welcome.light_direction};
  if (context_lost) return {};
  if (!showsSplats()) LUMIGRID_TRY(startRenderer());
  return startPins();
}

base::Result<void> Viewer::Impl::startRenderer() {
  const repository::Grid& grid = session.welcome()->grid;
  const int face_size = grid.pointCount() != 0 ? static_cast<int>(grid.face_size) : kNoFaceSize;
  LUMIGRID_ASSIGN_OR_RETURN(
      auto made, LumigraphRenderer::create(session.hierarchy().lattice, face_size, plan.images, plan.frame_images));
  renderer = std::move(made);
  gpu_full = false;
  return {};
}

/// Returns the perspective view that the server is asked for, since it knows no other.
base::ViewCamera Viewer::Impl::viewForServer(const base::ViewCamera& wanted) const {
  if (session.welcome() == nullptr || !wanted.orthographic()) {
    base::ViewCamera perspective = wanted;
    perspective.ortho_height = 0.0;
    return perspective;
  }
  const base::Sphere sphere = sceneSphere(*session.welcome());
  return base::perspectiveStandIn(wanted, session.welcome()->origin + glm::dvec3(sphere.center),
                                  static_cast<double>(sphere.radius), protocol::kMinFov);
}

glm::vec4 Viewer::Impl::sectionHere() const {
  return section ? base::sectionInScene(*section, session.welcome()->origin) : base::kNoSection;
}

void Viewer::Impl::fault(const std::string& problem) {
  ++broken;
  last_fault = problem;
}

/// Takes bytes from the frame's upload share. The first item always passes, so that a small share never stops the flow.
bool Viewer::Impl::spend(double bytes) {
  if (upload_bytes_left <= 0.0) return false;
  upload_bytes_left -= bytes;
  return true;
}

// ---- patches ----

/// The hierarchy's records count towards the patches' share, but leave them at least a quarter of it.
void Viewer::Impl::updatePatches() {
  const std::uint64_t records = std::min(recordBytes(session.hierarchy()), plan.patches / 4 * 3);
  ResidentPatches::View wanted;
  wanted.camera = camera;
  wanted.near_plane = base::depthRangeFor(camera.eye, scene.center, scene.radius).near_plane;
  wanted.tolerance_px = options.session.patch_tolerance_px;
  wanted.max_triangles = options.session.max_triangles;
  wanted.max_bytes = plan.patches - records;
  wanted.occluders = options.lumigraph.use_images;
  patches.update(
      wanted, session, renderer->patches(), [this](std::uint64_t bytes) { return spend(static_cast<double>(bytes)); },
      [this](const std::string& problem) { fault(problem); });
}

// ---- memory and accuracy ----

MemoryUse Viewer::Impl::memory() const {
  MemoryUse use;
  if (splats) {
    const SplatStats stats = splats->stats();
    use.cache = stats.stream.memory_bytes;
    use.buffers = stats.buffer_bytes;
    return use;
  }
  if (renderer) {
    const base::gl::HeldBytes held = renderer->heldBytes();
    use.textures = held.textures;
    use.buffers = held.buffers;
  }
  if (picker) use.renderbuffers = picker->gpuBytes();
  use.decoded = waitingBytes();
  use.cache = session.stats().cache_bytes + session.stats().frame_bytes;
  use.records = recordBytes(session.hierarchy());
  return use;
}

/// Whether the server's picture of this very view is shown and has faded in.
bool Viewer::Impl::showsExactFrame() const {
  if (section || !options.lumigraph.use_images || view.orthographic()) return false;
  for (const SampleId id : candidates) {
    if ((id & kFrameTag) == 0) continue;
    const protocol::Frame* frame = session.frame(static_cast<std::uint32_t>(id & ~kFrameTag));
    if (frame != nullptr && showsSameView(frame->camera, view) &&
        renderer->fadeOf(id, last_draw, options.lumigraph.fade_seconds) >= 1.0F)
      return true;
  }
  return false;
}

Accuracy Viewer::Impl::accuracy() const {
  if (showsSplats()) {
    if (!hasSplats() || splats->stats().splats == 0) return Accuracy::kNothing;
    return splats->complete() ? Accuracy::kFine : Accuracy::kCoarse;
  }
  if (!renderer || patches.drawn().patches.empty()) return Accuracy::kNothing;
  if (showsExactFrame()) return Accuracy::kExact;
  const bool fine = patches.drawn().error_px <= options.session.patch_tolerance_px;
  const bool textured = !options.lumigraph.use_images || renderer->stats().samples_used > 0;
  return fine && textured ? Accuracy::kBlended : Accuracy::kCoarse;
}

}  // namespace client
