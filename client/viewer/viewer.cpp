#include "client/viewer/viewer.h"

#include <algorithm>
#include <limits>
#include <unordered_map>
#include <utility>
#include <vector>

#include "client/viewer/expected_use.h"
#include "client/viewer/memory_plan.h"
#include "client/viewer/pick.h"
#include "client/viewer/pins.h"
#include "client/viewer/resident_patches.h"
#include "repository/sampling/cube_face.h"

namespace client {
namespace {

/// Exact frames of the server get ids of their own beside the codes of faces (63 bits).
constexpr SampleId kFrameTag = SampleId{1} << 63U;
/// Assumed upload speed: that of a slow laptop; others are faster.
constexpr double kUploadBytesPerMillisecond = 2e6;
/// Images handed to the decoder at a time: enough to keep its threads busy, few enough that a new view does not wait
/// behind a queue.
constexpr std::size_t kMaxDecoding = 16;
/// A resident image gives way only to one of this much larger rank, so that near equals do not flicker.
constexpr float kReplaceFactor = 1.2F;
/// Expected use below which an image does not matter for the present view: a thousandth of the picture.
constexpr float kNeededUse = 1e-3F;
/// Layer size, pixels, of a renderer that will never get a face.
constexpr int kNoFaceSize = 16;

enum class SampleState {
  kCached,
  kDecoding,
  kDecoded,
  kResident,
  kEmpty,  ///< is an empty flag, or broken
  kUnfit,  ///< larger than its share of the budget
};

/// Returns the bytes of a decoded image of this camera's size.
std::uint64_t decodedBytes(const base::Camera& camera) {
  return std::uint64_t{4} * static_cast<std::uint64_t>(camera.width) * static_cast<std::uint64_t>(camera.height);
}

/// Compares with a tolerance where rounding is possible: directions are normalized again where they arrive.
bool sameView(const base::ViewCamera& a, const base::ViewCamera& b) {
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

/// A face or an exact frame on its way to the GPU.
struct Sample {
  SampleState state = SampleState::kCached;
  base::Camera camera;
  base::Image rgba;   // only while kDecoded
  float use = 0.0F;   // expected share of the blend in the present view
  float rank = 0.0F;  // use, and among the unused the nearer first
};

base::Sphere sceneSphere(const protocol::Welcome& welcome) {
  return {0.5F * (welcome.box_min + welcome.box_max), 0.5F * glm::length(welcome.box_max - welcome.box_min)};
}

}  // namespace

struct Viewer::Impl {
  Impl(const ViewerOptions& wanted, const MemoryPlan& shares, std::unique_ptr<ImageDecoder> image_decoder)
      : options(wanted), plan(shares), session(wanted.session), decoder(std::move(image_decoder)) {}

  ViewerOptions options;
  MemoryPlan plan;
  Session session;
  std::unique_ptr<ImageDecoder> decoder;
  std::unique_ptr<LumigraphRenderer> renderer;
  bool context_lost = false;
  std::optional<Picker> picker;
  lod::draw::Shading shading;
  base::Sphere scene;
  std::optional<base::SectionPlane> section;

  std::unordered_map<SampleId, Sample> samples;
  std::unordered_map<SampleId, std::uint64_t> decoding;  // id -> bytes, dropped images included
  std::vector<SampleId> ranked;                          // best first
  std::vector<SampleId> candidates;                      // the resident ones among them
  bool gpu_full = false;
  ResidentPatches patches;
  base::ViewCamera view;
  base::Camera camera;
  bool more_to_do = false;
  double upload_bytes_left = 0.0;
  std::uint32_t broken = 0;
  std::string last_fault;

  std::shared_ptr<SplatView> splats;  // for kQsplat; null until its link has them
  std::optional<lod::qsplat::Lens> lens;

  std::vector<glm::dvec3> pins;  // world
  std::optional<PinProbe> probe;
  std::vector<bool> pins_visible;
  std::uint64_t drawn_signature = 0;  // of the picture against which the pins were tested

  base::Result<void> startScene();
  base::Result<void> startRenderer();
  base::Result<void> takeEvents();
  void addFace(const repository::FaceKey& key);
  void addFrame(std::uint32_t sequence);
  void dropSample(SampleId id);
  void dropOldFrames();
  void takeDecoded();
  void updatePatches();
  void rankSamples();
  void uploadSamples(double now);
  bool makeRoomFor(const Sample& sample);
  const Sample* worstResident(SampleId* id, const base::Camera* of_size_like) const;
  void submitSamples();
  void markInUse();
  base::Result<void> startPins();
  void probePins();
  std::uint64_t pictureSignature() const;
  bool showsSplats() const { return options.method == Method::kQsplat; }
  bool hasSplats() const { return splats && splats->bounds() != nullptr && session.welcome() != nullptr; }
  SplatLook splatLook() const;
  void addSplats(ViewerStats& stats) const;
  base::Result<void> updateSplats(const base::ViewCamera& wanted);
  base::Result<void> drawSplats(const base::ViewCamera& wanted);
  base::Camera cameraAt(const base::ViewCamera& wanted) const {
    return base::cameraForScene(wanted, session.welcome()->origin, scene);
  }
  base::ViewCamera viewForServer(const base::ViewCamera& wanted) const;
  glm::vec4 sectionHere() const;
  const base::Bytes* valueOf(SampleId id);
  void fault(const std::string& what);
  bool spend(double bytes);
  MemoryUse memory() const;
  std::uint64_t waitingBytes() const;
  bool showsExactFrame() const;
  Accuracy accuracy() const;
  double last_draw = 0.0;
};

// ---- arrivals and evictions ----

base::Result<void> Viewer::Impl::startScene() {
  const protocol::Welcome& welcome = *session.welcome();
  samples.clear();
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

base::Result<void> Viewer::Impl::takeEvents() {
  SessionEvents events = session.takeEvents();
  if (events.welcomed) LUMIGRID_TRY(startScene());
  if (session.welcome() == nullptr) return {};

  // Handle evictions first: an item that was evicted and arrived again is among the added ones, too.
  for (const repository::FaceKey& key : events.faces_evicted)
    if (session.face(key) == nullptr) dropSample(key.code());
  for (std::uint32_t group : events.groups_evicted)
    if (renderer && !session.hasGroup(group)) patches.drop(group, session.hierarchy(), renderer->patches());
  dropOldFrames();

  for (const repository::FaceKey& key : events.faces_added) addFace(key);
  for (std::uint32_t sequence : events.frames_added) addFrame(sequence);
  for (std::uint32_t group : events.groups_added) patches.arrived(group);
  return {};
}

void Viewer::Impl::addFace(const repository::FaceKey& key) {
  if (samples.count(key.code()) != 0 || session.face(key) == nullptr) return;
  const repository::Grid& grid = session.welcome()->grid;
  const base::DepthRange range = base::depthRangeFor(grid.point(key.x, key.y, key.z), scene.center, scene.radius);
  Sample sample;
  sample.camera = repository::faceCamera(grid, key, range.near_plane, range.far_plane);
  samples.emplace(key.code(), std::move(sample));
}

void Viewer::Impl::addFrame(std::uint32_t sequence) {
  const protocol::Frame* frame = session.frame(sequence);
  if (frame == nullptr) return;
  Sample sample;
  sample.camera = cameraAt(frame->camera);
  dropSample(kFrameTag | sequence);
  samples.emplace(kFrameTag | sequence, std::move(sample));
}

void Viewer::Impl::dropSample(SampleId id) {
  auto it = samples.find(id);
  if (it == samples.end()) return;
  if (it->second.state == SampleState::kResident && renderer) {
    renderer->removeSample(id);
    gpu_full = false;
  }
  samples.erase(it);
}

/// Drops the images of frames that the session no longer keeps, since it does not report that. Their memory may make
/// room for images that did not fit before.
void Viewer::Impl::dropOldFrames() {
  std::vector<SampleId> old;
  for (const auto& [id, sample] : samples)
    if ((id & kFrameTag) != 0 && session.frame(static_cast<std::uint32_t>(id & ~kFrameTag)) == nullptr)
      old.push_back(id);
  for (SampleId id : old) dropSample(id);
  if (old.empty()) return;
  for (auto& [id, sample] : samples)
    if (sample.state == SampleState::kUnfit) sample.state = SampleState::kCached;
}

void Viewer::Impl::takeDecoded() {
  for (ImageDecoder::DecodedImage& decoded : decoder->takeDecoded()) {
    decoding.erase(decoded.id);
    auto it = samples.find(decoded.id);
    if (it == samples.end() || it->second.state != SampleState::kDecoding) continue;
    if (!decoded.error.empty()) fault(decoded.error);
    if (decoded.rgba.pixels.size() > decodedBytes(it->second.camera)) {
      fault("an image of " + std::to_string(decoded.rgba.width) + " x " + std::to_string(decoded.rgba.height) +
            " pixels is larger than it was to be");
      decoded.rgba = {};
    }
    it->second.state = decoded.rgba.empty() ? SampleState::kEmpty : SampleState::kDecoded;
    it->second.rgba = std::move(decoded.rgba);
  }
}

void Viewer::Impl::fault(const std::string& what) {
  ++broken;
  last_fault = what;
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
      [this](const std::string& what) { fault(what); });
}

// ---- images ----

void Viewer::Impl::rankSamples() {
  // Estimate how much the view uses each image.
  std::vector<SampleId> ids;
  std::vector<const base::Camera*> cameras;
  for (const auto& [id, sample] : samples) {
    if (sample.state == SampleState::kEmpty || sample.state == SampleState::kUnfit) continue;
    ids.push_back(id);
    cameras.push_back(&sample.camera);
  }
  const std::vector<glm::vec3> anchors = anchorsInView(session.hierarchy(), patches.drawn().patches, camera);
  const std::vector<float> use = expectedUse(anchors, camera, cameras);

  // Images of no use now are decoded too, the nearest first, for when the viewer turns.
  for (std::size_t i = 0; i < ids.size(); ++i) {
    Sample& sample = samples[ids[i]];
    const float nearness = scene.radius / (scene.radius + glm::length(sample.camera.eye - camera.eye) + 1e-12F);
    sample.use = use[i];
    sample.rank = use[i] + 1e-6F * nearness;
  }
  std::sort(ids.begin(), ids.end(), [this](SampleId a, SampleId b) {
    const float rank_a = samples[a].rank;
    const float rank_b = samples[b].rank;
    return rank_a != rank_b ? rank_a > rank_b : a < b;
  });
  ranked = std::move(ids);
}

/// Returns the least useful image on the GPU; with `of_size_like` only among those whose place an image of that
/// camera's size can take.
const Sample* Viewer::Impl::worstResident(SampleId* id, const base::Camera* of_size_like) const {
  for (auto it = ranked.rbegin(); it != ranked.rend(); ++it) {
    const Sample& sample = samples.at(*it);
    if (sample.state != SampleState::kResident) continue;
    if (of_size_like != nullptr &&
        (sample.camera.width != of_size_like->width || sample.camera.height != of_size_like->height))
      continue;
    if (id != nullptr) *id = *it;
    return &sample;
  }
  return nullptr;
}

/// Removes the least useful image of this size from the GPU when it is worth less than `sample`.
bool Viewer::Impl::makeRoomFor(const Sample& sample) {
  SampleId worst_id = 0;
  const Sample* worst = worstResident(&worst_id, &sample.camera);
  if (worst == nullptr || worst->rank * kReplaceFactor >= sample.rank) return false;
  renderer->removeSample(worst_id);
  samples[worst_id].state = SampleState::kCached;
  return true;
}

void Viewer::Impl::uploadSamples(double now) {
  for (SampleId id : ranked) {
    Sample& sample = samples[id];
    if (sample.state != SampleState::kDecoded) continue;
    if (!spend(static_cast<double>(sample.rgba.pixels.size()))) return;
    bool added = renderer->addSample(id, sample.camera, sample.rgba, now);
    while (!added && makeRoomFor(sample)) added = renderer->addSample(id, sample.camera, sample.rgba, now);
    // The GPU has no place for its size at all; it would be decoded again and again.
    const bool unfit = !added && worstResident(nullptr, &sample.camera) == nullptr;
    gpu_full = gpu_full || (!added && !unfit);
    sample.state = added ? SampleState::kResident : unfit ? SampleState::kUnfit : SampleState::kCached;
    sample.rgba = {};
  }
}

const base::Bytes* Viewer::Impl::valueOf(SampleId id) {
  if ((id & kFrameTag) != 0) {
    const protocol::Frame* frame = session.frame(static_cast<std::uint32_t>(id & ~kFrameTag));
    return frame == nullptr ? nullptr : &frame->value;
  }
  auto key = repository::FaceKey::fromCode(id);
  return key ? session.face(*key) : nullptr;
}

/// Returns the bytes of images that are being decoded or wait for their upload.
std::uint64_t Viewer::Impl::waitingBytes() const {
  std::uint64_t bytes = 0;
  for (const auto& [id, size] : decoding) bytes += size;
  for (const auto& [id, sample] : samples) bytes += sample.rgba.pixels.size();
  return bytes;
}

/// Hands the best images that are not on the GPU to the decoder, as many as may wait. When the GPU is full, only those
/// that would get a place.
void Viewer::Impl::submitSamples() {
  std::uint64_t waiting = waitingBytes();
  for (SampleId id : ranked) {
    if (decoder->pending() >= kMaxDecoding) return;
    Sample& sample = samples[id];
    if (sample.state != SampleState::kCached || decoding.count(id) != 0) continue;
    if (gpu_full) {
      const Sample* worst = worstResident(nullptr, &sample.camera);
      if (worst != nullptr && worst->rank * kReplaceFactor >= sample.rank) continue;
    }
    const std::uint64_t bytes = decodedBytes(sample.camera);
    if (bytes > plan.decoded) sample.state = SampleState::kUnfit;
    if (waiting + bytes > plan.decoded) {
      if (bytes > plan.decoded) continue;
      return;
    }
    const base::Bytes* value = valueOf(id);
    if (value == nullptr) continue;
    waiting += bytes;
    decoding[id] = bytes;
    sample.state = SampleState::kDecoding;
    decoder->submit(id, *value);
  }
}

/// Keeps the present picture's faces and groups in the cache, whatever arrives.
void Viewer::Impl::markInUse() {
  std::vector<repository::FaceKey> faces;
  for (SampleId id : ranked) {
    if (faces.size() >= static_cast<std::size_t>(options.lumigraph.max_samples)) break;
    const Sample& sample = samples.at(id);
    if (sample.state != SampleState::kResident || sample.use < kNeededUse || (id & kFrameTag) != 0) continue;
    if (auto key = repository::FaceKey::fromCode(id)) faces.push_back(*key);
  }
  session.setInUse(faces, patches.drawn().expanded);
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

// ---- pins ----

base::Result<void> Viewer::Impl::startPins() {
  probe.reset();
  drawn_signature = 0;
  if (pins.empty() || session.welcome() == nullptr || context_lost) return {};
  LUMIGRID_ASSIGN_OR_RETURN(auto made, PinProbe::create());
  probe = std::move(made);
  std::vector<glm::vec3> local;
  for (std::size_t i = 0; i < std::min(pins.size(), kMaxPins); ++i)
    local.emplace_back(pins[i] - session.welcome()->origin);
  probe->setPoints(std::move(local));
  return {};
}

/// Hashes everything that decides what hides what; pins are tested again only when the hash changes (FNV-1a, Fowler,
/// Noll and Vo 1991).
std::uint64_t Viewer::Impl::pictureSignature() const {
  std::uint64_t sum = 0xcbf29ce484222325U;
  const auto mix = [&sum](const void* data, std::size_t bytes) {
    const auto* byte = static_cast<const std::uint8_t*>(data);
    for (std::size_t i = 0; i < bytes; ++i) sum = (sum ^ byte[i]) * 0x100000001b3U;
  };
  const glm::mat4 clip = camera.clipFromScene();
  const glm::vec4 cut_plane = sectionHere();
  const std::vector<std::uint32_t>& drawn = patches.drawn().patches;
  mix(&clip, sizeof(clip));
  mix(&cut_plane, sizeof(cut_plane));
  mix(drawn.data(), drawn.size() * sizeof(std::uint32_t));
  if (hasSplats()) {
    const SplatStats stats = splats->stats();
    mix(&stats.nodes, sizeof(stats.nodes));
    mix(&stats.cutoff_px, sizeof(stats.cutoff_px));
  }
  return sum;
}

void Viewer::Impl::probePins() {
  if (!probe) return;
  probe->poll();
  const std::uint64_t signature = pictureSignature();
  if (signature != drawn_signature) probe->invalidate();
  drawn_signature = signature;
  probe->draw(camera, sectionHere(), showsSplats() ? splats->stats().cutoff_px : patches.drawn().error_px);
}

// ---- splats ----

void Viewer::Impl::addSplats(ViewerStats& stats) const {
  const bool pins_pending = probe && probe->pending();
  stats.splats = splats->stats();
  stats.error_px = stats.splats.cutoff_px;
  stats.tolerance_px = stats.splats.finest_px;
  stats.busy = hasSplats() && (splats->busy() || pins_pending);
  stats.complete = hasSplats() && splats->complete();
  stats.session.bytes_received = stats.splats.stream.bytes_received;
  stats.broken += static_cast<std::uint32_t>(stats.splats.stream.given_up);
  if (!stats.splats.warning.empty()) stats.last_fault = stats.splats.warning;
}

SplatLook Viewer::Impl::splatLook() const {
  SplatLook look;
  look.shading = shading;
  look.section = sectionHere();
  look.resolution_colors = options.lumigraph.modes.resolution_colors;
  look.lens = lens;
  std::copy_n(options.lumigraph.background, look.background.size(), look.background.begin());
  return look;
}

/// Updates the splats; the server is told of no view, since they come by ranges of the file.
base::Result<void> Viewer::Impl::updateSplats(const base::ViewCamera& wanted) {
  LUMIGRID_TRY(takeEvents());
  view = wanted;
  if (!hasSplats()) return {};
  scene = *splats->bounds();
  camera = cameraAt(wanted);
  splats->update(camera, splatLook());
  return {};
}

base::Result<void> Viewer::Impl::drawSplats(const base::ViewCamera& wanted) {
  LUMIGRID_TRY(takeEvents());
  view = wanted;
  if (!hasSplats()) return {};
  scene = *splats->bounds();
  camera = cameraAt(wanted);
  LUMIGRID_TRY(splats->draw(camera, splatLook()));
  probePins();
  return {};
}

// ---- figures ----

MemoryUse Viewer::Impl::memory() const {
  MemoryUse use;
  if (splats) {
    const SplatStats stats = splats->stats();
    use.cache = stats.stream.memory_bytes;
    use.buffers = stats.buffer_bytes;
    return use;
  }
  if (renderer) {
    const base::gl::HeldBytes held = renderer->held();
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
    if (frame != nullptr && sameView(frame->camera, view) &&
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

// ---- the public functions ----

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
  s.rankSamples();
  s.uploadSamples(now);
  s.submitSamples();
  s.markInUse();

  s.more_to_do = s.patches.unfinished();
  for (const auto& [id, sample] : s.samples) {
    const bool on_its_way = sample.state == SampleState::kDecoding || sample.state == SampleState::kDecoded ||
                            (sample.state == SampleState::kCached && !s.gpu_full);
    if (on_its_way && sample.use >= kNeededUse) s.more_to_do = true;
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
  LUMIGRID_TRY(update(camera, now));
  Impl& s = *impl_;
  s.last_draw = now;
  if (s.context_lost) return {};
  if (!s.renderer) {
    drawBackground();
    return {};
  }

  s.candidates.clear();
  for (SampleId id : s.ranked)
    if (s.samples[id].state == SampleState::kResident) s.candidates.push_back(id);
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
  for (auto& [id, sample] : s.samples)
    if (sample.state == SampleState::kResident) sample.state = SampleState::kCached;
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
  for (const auto& [id, sample] : s.samples) {
    stats.samples_cached += sample.state != SampleState::kEmpty ? 1 : 0;
    const bool waits = sample.state != SampleState::kResident && sample.state != SampleState::kEmpty;
    stats.images_requested += waits && sample.use >= kNeededUse ? 1 : 0;
  }
  const bool pins_pending = s.probe && s.probe->pending();
  stats.busy = s.renderer && (s.more_to_do || s.renderer->settling() || pins_pending);
  stats.complete = s.renderer && s.session.complete() && !s.more_to_do && !s.renderer->settling();
  stats.broken = s.broken;
  stats.last_fault = s.last_fault;
  if (s.splats) s.addSplats(stats);
  return stats;
}

}  // namespace client
