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
/// A resident image gives way only to one of this much larger rank, so that near equals do not flicker. A choice: a
/// larger factor keeps worse images longer.
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
    if (session.face(key) == nullptr) dropImage(key.code());
  for (std::uint32_t group : events.groups_evicted)
    if (renderer && !session.hasGroup(group)) patches.drop(group, session.hierarchy(), renderer->patches());
  dropOldFrames();

  for (const repository::FaceKey& key : events.faces_added) addFace(key);
  for (std::uint32_t sequence : events.frames_added) addFrame(sequence);
  for (std::uint32_t group : events.groups_added) patches.arrived(group);
  return {};
}

void Viewer::Impl::addFace(const repository::FaceKey& key) {
  if (images.count(key.code()) != 0 || session.face(key) == nullptr) return;
  const repository::Grid& grid = session.welcome()->grid;
  const base::DepthRange range = base::depthRangeFor(grid.point(key.x, key.y, key.z), scene.center, scene.radius);
  BlendImage image;
  image.camera = repository::faceCamera(grid, key, range.near_plane, range.far_plane);
  images.emplace(key.code(), std::move(image));
}

void Viewer::Impl::addFrame(std::uint32_t sequence) {
  const protocol::Frame* frame = session.frame(sequence);
  if (frame == nullptr) return;
  BlendImage image;
  image.camera = cameraAt(frame->camera);
  dropImage(kFrameTag | sequence);
  images.emplace(kFrameTag | sequence, std::move(image));
}

void Viewer::Impl::dropImage(SampleId id) {
  auto it = images.find(id);
  if (it == images.end()) return;
  if (it->second.state == ImageState::kResident && renderer) {
    renderer->removeSample(id);
    gpu_full = false;
  }
  images.erase(it);
}

/// Drops the images of frames that the session no longer keeps, since it does not report that. Their memory may make
/// room for images that did not fit before.
void Viewer::Impl::dropOldFrames() {
  std::vector<SampleId> old;
  for (const auto& [id, image] : images)
    if ((id & kFrameTag) != 0 && session.frame(static_cast<std::uint32_t>(id & ~kFrameTag)) == nullptr)
      old.push_back(id);
  for (SampleId id : old) dropImage(id);
  if (old.empty()) return;
  for (auto& [id, image] : images)
    if (image.state == ImageState::kUnfit) image.state = ImageState::kCached;
}

void Viewer::Impl::takeDecoded() {
  for (ImageDecoder::DecodedImage& decoded : decoder->takeDecoded()) {
    decoding.erase(decoded.id);
    auto it = images.find(decoded.id);
    if (it == images.end() || it->second.state != ImageState::kDecoding) continue;
    if (!decoded.error.empty()) fault(decoded.error);
    if (decoded.rgba.pixels.size() > decodedBytes(it->second.camera)) {
      fault("an image of " + std::to_string(decoded.rgba.width) + " x " + std::to_string(decoded.rgba.height) +
            " pixels is larger than it was to be");
      decoded.rgba = {};
    }
    it->second.state = decoded.rgba.empty() ? ImageState::kEmpty : ImageState::kDecoded;
    it->second.rgba = std::move(decoded.rgba);
  }
}

// ---- images ----

void Viewer::Impl::rankImages() {
  // Estimate how much the view uses each image.
  std::vector<SampleId> ids;
  std::vector<const base::Camera*> cameras;
  for (const auto& [id, image] : images) {
    if (image.state == ImageState::kEmpty || image.state == ImageState::kUnfit) continue;
    ids.push_back(id);
    cameras.push_back(&image.camera);
  }
  const std::vector<glm::vec3> anchors = anchorsInView(session.hierarchy(), patches.drawn().patches, camera);
  const std::vector<float> use = expectedUse(anchors, camera, cameras);

  // Images of no use now are decoded too, the nearest first, for when the viewer turns.
  for (std::size_t i = 0; i < ids.size(); ++i) {
    BlendImage& image = images[ids[i]];
    const float nearness = scene.radius / (scene.radius + glm::length(image.camera.eye - camera.eye) + 1e-12F);
    image.use = use[i];
    image.rank = use[i] + 1e-6F * nearness;
  }
  std::sort(ids.begin(), ids.end(), [this](SampleId a, SampleId b) {
    const float rank_a = images[a].rank;
    const float rank_b = images[b].rank;
    return rank_a != rank_b ? rank_a > rank_b : a < b;
  });
  ranked = std::move(ids);
}

/// Returns the least useful image on the GPU; with `of_size_like` only among those whose place an image of that
/// camera's size can take.
const Viewer::Impl::BlendImage* Viewer::Impl::worstResident(SampleId* id, const base::Camera* of_size_like) const {
  for (auto it = ranked.rbegin(); it != ranked.rend(); ++it) {
    const BlendImage& image = images.at(*it);
    if (image.state != ImageState::kResident) continue;
    if (of_size_like != nullptr &&
        (image.camera.width != of_size_like->width || image.camera.height != of_size_like->height))
      continue;
    if (id != nullptr) *id = *it;
    return &image;
  }
  return nullptr;
}

/// Removes the least useful image of this size from the GPU when it is worth less than `image`.
bool Viewer::Impl::makeRoomFor(const BlendImage& image) {
  SampleId worst_id = 0;
  const BlendImage* worst = worstResident(&worst_id, &image.camera);
  if (worst == nullptr || worst->rank * kReplaceFactor >= image.rank) return false;
  renderer->removeSample(worst_id);
  images[worst_id].state = ImageState::kCached;
  return true;
}

void Viewer::Impl::uploadImages(double now) {
  for (SampleId id : ranked) {
    BlendImage& image = images[id];
    if (image.state != ImageState::kDecoded) continue;
    if (!spend(static_cast<double>(image.rgba.pixels.size()))) return;
    bool added = renderer->addSample(id, image.camera, image.rgba, now);
    while (!added && makeRoomFor(image)) added = renderer->addSample(id, image.camera, image.rgba, now);
    // The GPU has no place for its size at all; it would be decoded again and again.
    const bool unfit = !added && worstResident(nullptr, &image.camera) == nullptr;
    gpu_full = gpu_full || (!added && !unfit);
    image.state = added ? ImageState::kResident : unfit ? ImageState::kUnfit : ImageState::kCached;
    image.rgba = {};
  }
}

const base::Bytes* Viewer::Impl::codedImage(SampleId id) {
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
  for (const auto& [id, image] : images) bytes += image.rgba.pixels.size();
  return bytes;
}

/// Hands the best images that are not on the GPU to the decoder, as many as may wait. When the GPU is full, only those
/// that would get a place.
void Viewer::Impl::submitImages() {
  std::uint64_t waiting = waitingBytes();
  for (SampleId id : ranked) {
    if (decoder->pending() >= kMaxDecoding) return;
    BlendImage& image = images[id];
    if (image.state != ImageState::kCached || decoding.count(id) != 0) continue;
    if (gpu_full) {
      const BlendImage* worst = worstResident(nullptr, &image.camera);
      if (worst != nullptr && worst->rank * kReplaceFactor >= image.rank) continue;
    }
    const std::uint64_t bytes = decodedBytes(image.camera);
    if (bytes > plan.decoded) image.state = ImageState::kUnfit;
    if (waiting + bytes > plan.decoded) {
      if (bytes > plan.decoded) continue;
      return;
    }
    const base::Bytes* coded = codedImage(id);
    if (coded == nullptr) continue;
    waiting += bytes;
    decoding[id] = bytes;
    image.state = ImageState::kDecoding;
    decoder->submit(id, *coded);
  }
}

/// Keeps the present picture's faces and groups in the cache, whatever arrives.
void Viewer::Impl::markInUse() {
  std::vector<repository::FaceKey> faces;
  for (SampleId id : ranked) {
    if (faces.size() >= static_cast<std::size_t>(options.lumigraph.max_samples)) break;
    const BlendImage& image = images.at(id);
    if (image.state != ImageState::kResident || image.use < kNeededUse || (id & kFrameTag) != 0) continue;
    if (auto key = repository::FaceKey::fromCode(id)) faces.push_back(*key);
  }
  session.setInUse(faces, patches.drawn().expanded);
}

}  // namespace client
