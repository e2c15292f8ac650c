#include <algorithm>
#include <string>

#include "client/viewer/expected_use.h"
#include "client/viewer/viewer_impl.h"
#include "repository/sampling/cube_face.h"

namespace client {
namespace {

/// Images handed to the decoder at a time: enough to keep its threads busy, few enough that a new view does not wait
/// behind a queue.
constexpr std::size_t kMaxDecoding = 16;
/// A resident image gives way only to one of this much larger rank, so that near equals do not flicker.
constexpr float kReplaceFactor = 1.2F;

/// Returns the bytes of a decoded image of this camera's size.
std::uint64_t decodedBytes(const base::Camera& camera) {
  return std::uint64_t{4} * static_cast<std::uint64_t>(camera.width) * static_cast<std::uint64_t>(camera.height);
}

}  // namespace

// ---- arrivals and evictions ----

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
const Viewer::Impl::Sample* Viewer::Impl::worstResident(SampleId* id, const base::Camera* of_size_like) const {
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

}  // namespace client
