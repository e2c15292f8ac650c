#include "client/viewer.h"

#include <algorithm>
#include <deque>
#include <limits>
#include <unordered_map>
#include <unordered_set>
#include <utility>
#include <vector>

#include "client/expected_use.h"
#include "client/pick.h"
#include "lod/patch/codec.h"
#include "lod/patch/traverse.h"
#include "repository/cube_face.h"

namespace client {
namespace {

/// Frames of the server get ids of their own beside the codes of faces (63 bits).
constexpr SampleId kFrameTag = SampleId{1} << 63U;
/// Upload speed assumed when milliseconds become bytes: a slow laptop's; real ones are faster.
constexpr double kUploadBytesPerMillisecond = 2e6;
/// Images handed to the decoder at a time: enough to keep its threads busy, few enough that a new view is not behind a
/// queue.
constexpr std::size_t kMaxDecoding = 16;
/// A resident image gives way only to one expected to be used this much more: no flicker between near equals.
constexpr float kReplaceFactor = 1.2F;
/// Expected use below which an image does not matter for the present view (a thousandth of the picture).
constexpr float kNeededUse = 1e-3F;
/// Layer size of a renderer that will never get a face.
constexpr int kNoFaceSize = 16;

enum class SampleState { kCached, kDecoding, kDecoded, kResident, kEmpty };

/// A face or an exact frame on its way to the GPU.
struct Sample {
  SampleState state = SampleState::kCached;
  base::Camera camera;
  base::Image rgba;   // only while kDecoded
  float use = 0.0F;   // expected share of the blend in the present view
  float rank = 0.0F;  // use, and among the unused the nearer first
};

bool sameCamera(const base::Camera& a, const base::Camera& b) {
  return a.clip_from_eye == b.clip_from_eye && a.eye_from_scene == b.eye_from_scene && a.width == b.width &&
         a.height == b.height;
}

base::Sphere sceneSphere(const protocol::Welcome& welcome) {
  return {0.5F * (welcome.box_min + welcome.box_max), 0.5F * glm::length(welcome.box_max - welcome.box_min)};
}

}  // namespace

struct Viewer::State {
  State(const ViewerOptions& wanted, std::unique_ptr<ImageDecoder> image_decoder)
      : options(wanted), session(wanted.session), decoder(std::move(image_decoder)) {}

  ViewerOptions options;
  Session session;
  std::unique_ptr<ImageDecoder> decoder;
  std::unique_ptr<LumigraphRenderer> renderer;
  std::optional<Picker> picker;
  lod::draw::Shading shading;
  base::Sphere scene;

  std::unordered_map<SampleId, Sample> samples;
  std::vector<SampleId> ranked;  // best first
  bool use_images = true;        // where the method has any
  bool gpu_full = false;
  std::deque<std::uint32_t> groups_to_upload;
  std::unordered_set<std::uint32_t> groups_ready;  // all consumed patches uploaded
  lod::patch::Cut cut;                             // what is in view
  std::vector<std::uint32_t> occluders;            // the same cut with what is outside the view
  base::Camera camera;
  bool more_to_do = false;
  double upload_bytes_left = 0.0;
  std::uint32_t broken = 0;
  std::string last_fault;

  base::Result<void> startScene();
  base::Result<void> takeEvents();
  void addFace(const repository::FaceKey& key);
  void addFrame(std::uint32_t sequence);
  void dropSample(SampleId id);
  void dropGroup(std::uint32_t group);
  void dropOldFrames();
  void takeDecoded();
  void uploadGroups();
  bool uploadGroup(std::uint32_t group);
  void selectCut();
  void rankSamples();
  void uploadSamples(double now);
  bool makeRoomFor(const Sample& sample);
  const Sample* worstResident(SampleId* id = nullptr) const;
  void submitSamples();
  void markInUse();
  base::Camera cameraAt(const base::ViewCamera& view) const;
  const base::Bytes* valueOf(SampleId id);
  void fault(const std::string& what);
  bool spend(double bytes);
};

// ---- what arrived and what went ----

base::Result<void> Viewer::State::startScene() {
  const protocol::Welcome& welcome = *session.welcome();
  samples.clear();
  ranked.clear();
  gpu_full = false;
  groups_to_upload.clear();
  groups_ready.clear();
  cut = {};
  occluders.clear();
  scene = sceneSphere(welcome);
  shading = {welcome.unlit, welcome.light_direction};

  const int face_size = welcome.grid.pointCount() != 0 ? static_cast<int>(welcome.grid.face_size) : kNoFaceSize;
  auto made = LumigraphRenderer::create(session.hierarchy().lattice, face_size, options.gpu_budget_bytes);
  if (!made) return made.error();
  renderer = std::move(*made);
  return {};
}

base::Result<void> Viewer::State::takeEvents() {
  SessionEvents events = session.takeEvents();
  if (events.welcomed) LUMIGRID_TRY(startScene());
  if (!renderer) return {};

  // Gone first: what was evicted and came again is among the added, too.
  for (const repository::FaceKey& key : events.faces_evicted)
    if (session.face(key) == nullptr) dropSample(key.code());
  for (std::uint32_t group : events.groups_evicted)
    if (!session.hasGroup(group)) dropGroup(group);
  dropOldFrames();

  for (const repository::FaceKey& key : events.faces_added) addFace(key);
  for (std::uint32_t sequence : events.frames_added) addFrame(sequence);
  for (std::uint32_t group : events.groups_added) groups_to_upload.push_back(group);
  return {};
}

void Viewer::State::addFace(const repository::FaceKey& key) {
  if (samples.count(key.code()) != 0 || session.face(key) == nullptr) return;
  const repository::Grid& grid = session.welcome()->grid;
  const base::DepthRange range = base::depthRangeFor(grid.point(key.x, key.y, key.z), scene.center, scene.radius);
  Sample sample;
  sample.camera = repository::faceCamera(grid, key, range.near_plane, range.far_plane);
  samples.emplace(key.code(), std::move(sample));
}

void Viewer::State::addFrame(std::uint32_t sequence) {
  const protocol::Frame* frame = session.frame(sequence);
  if (frame == nullptr) return;
  Sample sample;
  sample.camera = cameraAt(frame->camera);
  dropSample(kFrameTag | sequence);
  samples.emplace(kFrameTag | sequence, std::move(sample));
}

void Viewer::State::dropSample(SampleId id) {
  auto it = samples.find(id);
  if (it == samples.end()) return;
  if (it->second.state == SampleState::kResident) {
    renderer->removeSample(id);
    gpu_full = false;
  }
  samples.erase(it);
}

void Viewer::State::dropGroup(std::uint32_t group) {
  groups_ready.erase(group);
  const lod::patch::Group& record = session.hierarchy().groups[group];
  for (std::uint32_t i = 0; i < record.patch_count; ++i) renderer->patches().remove(record.first_patch + i);
}

/// The session keeps the few newest frames and says nothing when one goes.
void Viewer::State::dropOldFrames() {
  std::vector<SampleId> old;
  for (const auto& [id, sample] : samples)
    if ((id & kFrameTag) != 0 && session.frame(static_cast<std::uint32_t>(id & ~kFrameTag)) == nullptr)
      old.push_back(id);
  for (SampleId id : old) dropSample(id);
}

void Viewer::State::takeDecoded() {
  for (ImageDecoder::Decoded& decoded : decoder->take()) {
    auto it = samples.find(decoded.id);
    if (it == samples.end() || it->second.state != SampleState::kDecoding) continue;
    if (!decoded.error.empty()) fault(decoded.error);
    it->second.state = decoded.rgba.empty() ? SampleState::kEmpty : SampleState::kDecoded;
    it->second.rgba = std::move(decoded.rgba);
  }
}

void Viewer::State::fault(const std::string& what) {
  ++broken;
  last_fault = what;
}

/// Takes from the frame's share; the first piece always goes, so that a small share never stops the flow.
bool Viewer::State::spend(double bytes) {
  if (upload_bytes_left <= 0.0) return false;
  upload_bytes_left -= bytes;
  return true;
}

// ---- patches ----

void Viewer::State::uploadGroups() {
  while (!groups_to_upload.empty()) {
    const std::uint32_t group = groups_to_upload.front();
    if (session.hasGroup(group) && groups_ready.count(group) == 0) {
      const lod::patch::Hierarchy& hierarchy = session.hierarchy();
      const lod::patch::Group& record = hierarchy.groups[group];
      double bytes = 0.0;
      for (std::uint32_t i = 0; i < record.patch_count; ++i) {
        const lod::patch::Patch& patch = hierarchy.patches[record.first_patch + i];
        bytes += static_cast<double>(lod::draw::PatchMeshes::bytesFor(patch.vertices, patch.triangles));
      }
      if (!spend(bytes)) return;
      if (uploadGroup(group)) groups_ready.insert(group);
    }
    groups_to_upload.pop_front();
  }
}

/// Decodes and uploads all that the group consumes; false, and nothing of it kept, when a patch is broken.
bool Viewer::State::uploadGroup(std::uint32_t group) {
  const lod::patch::Hierarchy& hierarchy = session.hierarchy();
  const lod::patch::Group& record = hierarchy.groups[group];
  const base::ByteView block(*session.block(group));
  for (std::uint32_t i = 0; i < record.patch_count; ++i) {
    const std::uint32_t number = record.first_patch + i;
    const lod::patch::Patch& patch = hierarchy.patches[number];
    if (patch.block_offset > block.size() || patch.block_bytes > block.size() - patch.block_offset) {
      fault("group " + std::to_string(group) + ": patch " + std::to_string(number) + " lies outside its block");
      dropGroup(group);
      return false;
    }
    auto geometry = lod::patch::decodePatch(block.subspan(patch.block_offset, patch.block_bytes));
    if (!geometry) {
      fault("patch " + std::to_string(number) + ": " + geometry.error().message);
      dropGroup(group);
      return false;
    }
    renderer->patches().upload(number, *geometry);
  }
  return true;
}

void Viewer::State::selectCut() {
  cut = {};
  occluders.clear();
  if (groups_ready.count(0) == 0) return;
  lod::patch::CutRequest request;
  request.camera = camera;
  request.near_plane = base::depthRangeFor(camera.eye, scene.center, scene.radius).near_plane;
  request.tolerance_px = options.session.patch_tolerance_px;
  request.max_triangles = options.session.max_triangles;
  cut = lod::patch::selectCut(session.hierarchy(), request,
                              [this](std::uint32_t group) { return groups_ready.count(group) != 0; });

  // What hides a surface from a sampling point may lie outside the view: the same expanded groups again, nothing left
  // out.
  if (!options.lumigraph.use_images) return;
  const std::unordered_set<std::uint32_t> expanded(cut.expanded.begin(), cut.expanded.end());
  request.cull = false;
  request.max_triangles = std::numeric_limits<std::uint64_t>::max();
  occluders = lod::patch::selectCut(session.hierarchy(), request, [&expanded](std::uint32_t group) {
                return expanded.count(group) != 0;
              }).patches;
}

// ---- images ----

void Viewer::State::rankSamples() {
  // Expected use by the surface in view.
  std::vector<SampleId> ids;
  std::vector<const base::Camera*> cameras;
  for (const auto& [id, sample] : samples) {
    if (sample.state == SampleState::kEmpty) continue;
    ids.push_back(id);
    cameras.push_back(&sample.camera);
  }
  const std::vector<glm::vec3> anchors = anchorsInView(session.hierarchy(), cut.patches, camera);
  const std::vector<float> use = expectedUse(anchors, camera, cameras);

  // Those of no use now are decoded too, nearest first, for when the viewer turns.
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

const Sample* Viewer::State::worstResident(SampleId* id) const {
  for (auto it = ranked.rbegin(); it != ranked.rend(); ++it) {
    const Sample& sample = samples.at(*it);
    if (sample.state != SampleState::kResident) continue;
    if (id != nullptr) *id = *it;
    return &sample;
  }
  return nullptr;
}

/// Takes the least useful image off the GPU when it is worth less than this one.
bool Viewer::State::makeRoomFor(const Sample& sample) {
  SampleId worst_id = 0;
  const Sample* worst = worstResident(&worst_id);
  if (worst == nullptr || worst->rank * kReplaceFactor >= sample.rank) return false;
  renderer->removeSample(worst_id);
  samples[worst_id].state = SampleState::kCached;
  return true;
}

void Viewer::State::uploadSamples(double now) {
  for (SampleId id : ranked) {
    Sample& sample = samples[id];
    if (sample.state != SampleState::kDecoded) continue;
    if (!spend(static_cast<double>(sample.rgba.pixels.size()))) return;
    bool added = renderer->addSample(id, sample.camera, sample.rgba, now);
    while (!added && makeRoomFor(sample)) added = renderer->addSample(id, sample.camera, sample.rgba, now);
    gpu_full = !added;
    sample.state = added ? SampleState::kResident : SampleState::kCached;
    sample.rgba = {};
  }
}

const base::Bytes* Viewer::State::valueOf(SampleId id) {
  if ((id & kFrameTag) != 0) {
    const protocol::Frame* frame = session.frame(static_cast<std::uint32_t>(id & ~kFrameTag));
    return frame == nullptr ? nullptr : &frame->value;
  }
  auto key = repository::FaceKey::fromCode(id);
  return key ? session.face(*key) : nullptr;
}

/// Hands the best ones that are not on the GPU to the decoder. With a full GPU only those that would get a place.
void Viewer::State::submitSamples() {
  const Sample* worst = gpu_full ? worstResident() : nullptr;
  for (SampleId id : ranked) {
    if (decoder->pending() >= kMaxDecoding) return;
    Sample& sample = samples[id];
    if (sample.state != SampleState::kCached) continue;
    if (gpu_full && (worst == nullptr || worst->rank * kReplaceFactor >= sample.rank)) return;
    const base::Bytes* value = valueOf(id);
    if (value == nullptr) continue;
    sample.state = SampleState::kDecoding;
    decoder->submit(id, *value);
  }
}

/// The present picture's faces and groups stay in the cache whatever arrives.
void Viewer::State::markInUse() {
  std::vector<repository::FaceKey> faces;
  for (SampleId id : ranked) {
    if (faces.size() >= static_cast<std::size_t>(options.lumigraph.max_samples)) break;
    const Sample& sample = samples.at(id);
    if (sample.state != SampleState::kResident || sample.use < kNeededUse || (id & kFrameTag) != 0) continue;
    if (auto key = repository::FaceKey::fromCode(id)) faces.push_back(*key);
  }
  session.setInUse(faces, cut.expanded);
}

base::Camera Viewer::State::cameraAt(const base::ViewCamera& view) const {
  const glm::dvec3& origin = session.welcome()->origin;
  const base::DepthRange range = base::depthRangeFor(glm::vec3(view.position - origin), scene.center, scene.radius);
  return base::cameraFromView(view, origin, range.near_plane, range.far_plane);
}

// ---- the public face ----

Viewer::Viewer(const ViewerOptions& options, std::unique_ptr<ImageDecoder> decoder) {
  state_ = std::make_unique<State>(options, std::move(decoder));
  state_->use_images = options.lumigraph.use_images;
  setMethod(options.method);
}
Viewer::~Viewer() = default;

Session& Viewer::session() {
  return state_->session;
}
const Session& Viewer::session() const {
  return state_->session;
}
const ViewerOptions& Viewer::options() const {
  return state_->options;
}

void Viewer::setMethod(lod::Method method) {
  State& s = *state_;
  const bool images = method == lod::Method::kLumigraph;
  s.options.method = method;
  s.options.lumigraph.use_images = images && s.use_images;
  s.session.setWanted(images && s.options.session.images, images && s.options.session.frames);
}

base::Result<bool> Viewer::update(const base::ViewCamera& camera, double now) {
  State& s = *state_;
  s.session.setView(camera);
  LUMIGRID_TRY(s.takeEvents());
  s.more_to_do = false;
  if (!s.renderer) return false;
  s.camera = s.cameraAt(camera);
  s.upload_bytes_left = s.options.upload_milliseconds > 0.0 ? s.options.upload_milliseconds * kUploadBytesPerMillisecond
                                                            : std::numeric_limits<double>::infinity();

  s.takeDecoded();
  s.uploadGroups();
  s.selectCut();
  s.rankSamples();
  s.uploadSamples(now);
  s.submitSamples();
  s.markInUse();

  s.more_to_do = !s.groups_to_upload.empty();
  for (const auto& [id, sample] : s.samples) {
    const bool on_its_way = sample.state == SampleState::kDecoding || sample.state == SampleState::kDecoded ||
                            (sample.state == SampleState::kCached && !s.gpu_full);
    if (on_its_way && sample.use >= kNeededUse) s.more_to_do = true;
  }
  return s.more_to_do;
}

base::Result<void> Viewer::draw(const base::ViewCamera& camera, double now) {
  auto updated = update(camera, now);
  if (!updated) return updated.error();
  State& s = *state_;
  if (!s.renderer) {
    const float* color = s.options.lumigraph.background;
    glClearColor(color[0], color[1], color[2], color[3]);
    glClear(GL_COLOR_BUFFER_BIT);
    return {};
  }

  std::vector<SampleId> candidates;
  for (SampleId id : s.ranked)
    if (s.samples[id].state == SampleState::kResident) candidates.push_back(id);
  s.renderer->draw(s.camera, s.cut.patches, candidates, s.cut.error_px, s.shading, s.options.lumigraph, now,
                   s.occluders);
  return {};
}

std::optional<glm::dvec3> Viewer::surfaceAt(const base::ViewCamera& camera, double x, double y) {
  State& s = *state_;
  if (!s.renderer || s.cut.patches.empty()) return std::nullopt;
  if (!s.picker) {
    auto picker = Picker::create();
    if (!picker) {
      s.fault(picker.error().message);
      return std::nullopt;
    }
    s.picker = std::move(*picker);
  }
  const auto point = s.picker->surfaceAt(s.cameraAt(camera), x, y, s.renderer->patches(), s.cut.patches);
  if (!point) return std::nullopt;
  return s.session.welcome()->origin + glm::dvec3(*point);
}

ViewerStats Viewer::stats() const {
  const State& s = *state_;
  ViewerStats stats;
  stats.session = s.session.stats();
  if (s.renderer) stats.lumigraph = s.renderer->stats();
  stats.error_px = s.cut.error_px;
  stats.busy = s.renderer && (s.more_to_do || s.renderer->settling());
  stats.complete = s.renderer && s.session.complete() && !stats.busy;
  for (const auto& [id, sample] : s.samples) {
    const bool waits = sample.state != SampleState::kResident && sample.state != SampleState::kEmpty;
    if (waits && sample.use >= kNeededUse) ++stats.images_requested;
    const bool frame = (id & kFrameTag) != 0 && sample.state == SampleState::kResident;
    if (frame && s.options.lumigraph.use_images && sameCamera(sample.camera, s.camera)) stats.exact = true;
  }
  stats.broken = s.broken;
  stats.last_fault = s.last_fault;
  return stats;
}

}  // namespace client
