#include "client/viewer/viewer.h"

#include <algorithm>
#include <string>

#include "client/viewer/expected_use.h"
#include "repository/sampling/cube_face.h"

namespace client {
namespace {

/// Images handed to the decoder at a time: enough to keep its threads busy, few enough that a new view does not wait
/// behind a queue. Small ones may be more, until they have as many bytes as so many faces of 512 × 512.
constexpr std::size_t kMaxDecoding = 16;
constexpr std::uint64_t kMaxDecodingBytes = kMaxDecoding * 4 * 512 * 512;
/// Tiles that count as one image where a number of images is given: a tile has a quarter of the pixels of a face of
/// 512 × 512.
constexpr int kTilesPerImage = 4;
/// A picture at rest has time for so many more. Without them, places that one tile alone shows, along borders of tiles
/// and of the picture, get the colours of vertices (docs/decisions/choice-by-rays.md).
constexpr int kMoreTilesPerImage = 2;
/// A resident image gives way only to one of this much larger rank, so that near equals do not flicker. A choice: a
/// larger factor keeps worse images longer.
constexpr float kReplaceFactor = 1.2F;
/// The same of images that the view does not use, whose ranks change with every step of the eye.
constexpr float kReplaceUnusedFactor = 3.0F;
/// A moving eye gets a frame every twentieth of a second or so, which would be old before it had faded in as slowly as
/// a face does.
constexpr float kFrameFadeShare = 0.25F;

bool haveSameSize(const base::Camera& a, const base::Camera& b) {
  return a.width == b.width && a.height == b.height;
}

/// Returns the bytes of a decoded image of this camera's size.
std::uint64_t decodedBytes(const base::Camera& camera) {
  return std::uint64_t{4} * static_cast<std::uint64_t>(camera.width) * static_cast<std::uint64_t>(camera.height);
}

}  // namespace

// ---- arrivals and evictions ----

base::Result<void> Viewer::takeEvents() {
  SessionEvents events = session_.takeEvents();
  if (events.welcomed) LUMIGRID_TRY(startScene());
  if (session_.welcome() == nullptr) return {};

  // Handle evictions first: an item that was evicted and arrived again is among the added ones, too.
  for (const repository::FaceKey& key : events.faces_evicted)
    if (session_.face(key) == nullptr) dropImage(key.code());
  for (std::uint32_t group : events.groups_evicted)
    if (renderer_ && !session_.hasGroup(group)) patches_.drop(group, session_.hierarchy(), renderer_->patches());
  dropOldFrames();

  for (const repository::FaceKey& key : events.faces_added) addFace(key);
  for (std::uint32_t number : events.frames_added) addFrame(number);
  for (std::uint32_t group : events.groups_added) patches_.arrived(group);
  return {};
}

void Viewer::addFace(const repository::FaceKey& key) {
  if (images_.count(key.code()) != 0 || session_.face(key) == nullptr) return;
  BlendImage image;
  const repository::Grid& grid = session_.welcome()->grid;
  image.camera = repository::faceCamera(grid, key, scene_);
  if (grid.isTiled())
    image.traits.core = static_cast<float>(repository::kTileCore) / static_cast<float>(repository::kTileSide);
  images_.emplace(key.code(), std::move(image));
}

void Viewer::addFrame(std::uint32_t number) {
  const protocol::Frame* frame = session_.frame(number);
  if (frame == nullptr) return;
  BlendImage image;
  image.camera = cameraAt(frame->camera);
  image.traits = {.fade_share = kFrameFadeShare, .coding_error = frame->coding_error};
  images_.emplace(kFrameTag | number, std::move(image));
}

void Viewer::dropImage(SampleId id) {
  auto it = images_.find(id);
  if (it == images_.end()) return;
  if (it->second.state == ImageState::kResident && renderer_) {
    renderer_->removeSample(id);
    gpu_full_ = false;
  }
  images_.erase(it);
}

/// Drops the images of frames that the session no longer keeps, since it does not report that. Their memory may make
/// room for images that did not fit before.
void Viewer::dropOldFrames() {
  std::vector<SampleId> old;
  for (const auto& [id, image] : images_)
    if ((id & kFrameTag) != 0 && session_.frame(static_cast<std::uint32_t>(id & ~kFrameTag)) == nullptr)
      old.push_back(id);
  for (SampleId id : old) dropImage(id);
  if (old.empty()) return;
  for (auto& [id, image] : images_)
    if (image.state == ImageState::kUnfit) image.state = ImageState::kCached;
}

void Viewer::takeDecoded() {
  for (ImageDecoder::DecodedImage& decoded : decoder_->takeDecoded()) {
    decoding_.erase(decoded.id);
    auto it = images_.find(decoded.id);
    if (it == images_.end() || it->second.state != ImageState::kDecoding) continue;
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

void Viewer::rankImages(double now) {
  // Estimate how much the view uses each image.
  std::vector<SampleId> ids;
  std::vector<const base::Camera*> cameras;
  for (const auto& [id, image] : images_) {
    if (image.state == ImageState::kEmpty || image.state == ImageState::kUnfit) continue;
    ids.push_back(id);
    cameras.push_back(&image.camera);
  }
  std::vector<float> use;
  if (sight_ && sight_->lookFrom(camera_, looksRoughly(now))) {
    const VisibleSurface& surface = sight_->surface();
    use = expectedUse(surface.places, camera_, cameras, surface.is_seen_from);
  } else {
    use = expectedUse(anchorsInView(session_.hierarchy(), patches_.drawn().patches, camera_), camera_, cameras);
  }

  // Images of no use now are decoded too, the nearest first, for when the viewer turns; of tiles, the widest.
  std::vector<std::pair<float, SampleId>> order;  // the best first
  for (std::size_t i = 0; i < ids.size(); ++i) {
    BlendImage& image = images_[ids[i]];
    const float nearness = scene_.radius / (scene_.radius + glm::length(image.camera.eye - camera_.eye) + 1e-12F);
    image.use = mayShowFrames() && showsThisView(ids[i]) ? 1.0F : use[i];
    const float width = image.traits.core < 1.0F ? 1.0F / image.camera.clip_from_eye[0][0] : 1.0F;
    image.rank = image.use + 1e-6F * nearness * width;
    order.emplace_back(-image.rank, ids[i]);
  }
  std::sort(order.begin(), order.end());
  ranked_.clear();
  for (const auto& [rank, id] : order) ranked_.push_back(id);
}

/// Returns the least useful image on the GPU; with `of_size_like` only among those whose place an image of that
/// camera's size can take.
const Viewer::BlendImage* Viewer::worstResident(SampleId* id, const base::Camera* of_size_like) const {
  for (auto it = ranked_.rbegin(); it != ranked_.rend(); ++it) {
    const BlendImage& image = images_.at(*it);
    if (image.state != ImageState::kResident) continue;
    if (of_size_like != nullptr && !haveSameSize(image.camera, *of_size_like)) continue;
    if (id != nullptr) *id = *it;
    return &image;
  }
  return nullptr;
}

/// Returns the frame that is the oldest on the GPU, of those before this one and of its size.
std::optional<SampleId> Viewer::oldestFrameBefore(SampleId id) const {
  std::optional<SampleId> oldest;
  const base::Camera& camera = images_.at(id).camera;
  for (const auto& [other, image] : images_) {
    if ((other & kFrameTag) == 0 || other >= oldest.value_or(id)) continue;
    if (image.state == ImageState::kResident && haveSameSize(image.camera, camera)) oldest = other;
  }
  return oldest;
}

/// Returns the image on the GPU that gives its place to this one: to a frame the oldest one, since a newer frame is
/// better or of a newer view, else the least useful of its size if it is worth less. Nothing: none does.
std::optional<SampleId> Viewer::replacedBy(SampleId id) const {
  if ((id & kFrameTag) != 0)
    if (const auto frame = oldestFrameBefore(id)) return frame;
  const BlendImage& image = images_.at(id);
  SampleId worst_id = 0;
  const BlendImage* worst = worstResident(&worst_id, &image.camera);
  const float factor = image.use < kNeededUse ? kReplaceUnusedFactor : kReplaceFactor;
  if (worst == nullptr || worst->rank * factor >= image.rank) return std::nullopt;
  return worst_id;
}

bool Viewer::makeRoomFor(SampleId id) {
  if (const auto replaced = replacedBy(id)) {
    removeResident(*replaced);
    return true;
  }
  if ((id & kFrameTag) == 0) return false;
  // Frames of a window of another size go, and for the present view's own those of moving eyes, too.
  const base::Camera& own = images_.at(id).camera;
  return removeFramesBut({own, camera_}) || (showsThisView(id) && removeFramesBut({own}));
}

void Viewer::removeResident(SampleId id) {
  renderer_->removeSample(id);
  images_[id].state = (id & kFrameTag) != 0 ? ImageState::kUnfit : ImageState::kCached;
}

/// Removes the frames on the GPU that have none of these cameras' sizes. False where there are none.
bool Viewer::removeFramesBut(std::initializer_list<base::Camera> sizes) {
  bool any = false;
  for (const auto& [id, image] : images_) {
    if ((id & kFrameTag) == 0 || image.state != ImageState::kResident) continue;
    const auto is_alike = [&camera = image.camera](const base::Camera& size) { return haveSameSize(camera, size); };
    if (std::any_of(sizes.begin(), sizes.end(), is_alike)) continue;
    removeResident(id);
    any = true;
  }
  return any;
}

void Viewer::uploadImages(double now) {
  for (SampleId id : ranked_) {
    BlendImage& image = images_[id];
    if (image.state != ImageState::kDecoded) continue;
    if (!spend(static_cast<double>(image.rgba.pixels.size()))) return;
    const auto add = [&] { return renderer_->addSample(id, image.camera, image.rgba, now, image.traits); };
    bool added = add();
    while (!added && makeRoomFor(id)) added = add();
    // The GPU has no place for its size at all; it would be decoded again and again.
    const bool unfit = !added && worstResident(nullptr, &image.camera) == nullptr;
    gpu_full_ = gpu_full_ || (!added && !unfit);
    image.state = added ? ImageState::kResident : unfit ? ImageState::kUnfit : ImageState::kCached;
    image.rgba = {};
  }
}

const base::Bytes* Viewer::codedImage(SampleId id) {
  if ((id & kFrameTag) != 0) {
    const protocol::Frame* frame = session_.frame(static_cast<std::uint32_t>(id & ~kFrameTag));
    return frame == nullptr ? nullptr : &frame->value;
  }
  auto key = repository::FaceKey::fromCode(id);
  return key ? session_.face(*key) : nullptr;
}

/// Returns the bytes of images that are being decoded or wait for their upload.
std::uint64_t Viewer::waitingBytes() const {
  std::uint64_t bytes = 0;
  for (const auto& [id, size] : decoding_) bytes += size;
  for (const auto& [id, image] : images_) bytes += image.rgba.pixels.size();
  return bytes;
}

bool Viewer::decoderIsBusy() const {
  std::uint64_t bytes = 0;
  for (const auto& [id, size] : decoding_) bytes += size;
  return decoder_->pending() >= kMaxDecoding && bytes >= kMaxDecodingBytes;
}

/// Hands the best images that are not on the GPU to the decoder, as many as may wait. When the GPU is full, only those
/// that would get a place.
void Viewer::submitImages() {
  std::uint64_t waiting = waitingBytes();
  bool faces_fit = true;
  for (SampleId id : ranked_) {
    if (decoderIsBusy()) return;
    BlendImage& image = images_[id];
    if (image.state != ImageState::kCached || decoding_.count(id) != 0) continue;
    const bool is_face = (id & kFrameTag) == 0;
    if (gpu_full_ && is_face && !faces_fit) continue;
    if (gpu_full_ && worstResident(nullptr, &image.camera) != nullptr && !replacedBy(id)) {
      if (is_face) faces_fit = false;  // nor does one that is worth less, since all have one size
      continue;
    }
    const std::uint64_t bytes = decodedBytes(image.camera);
    if (bytes > plan_.decoded) {
      image.state = ImageState::kUnfit;
      continue;
    }
    if (waiting + bytes > plan_.decoded) return;
    const base::Bytes* coded = codedImage(id);
    if (coded == nullptr) continue;
    waiting += bytes;
    decoding_[id] = bytes;
    image.state = ImageState::kDecoding;
    decoder_->submit(id, *coded);
  }
}

/// Returns how many images a picture is blended from at most.
int Viewer::imagesBlended() const {
  const int images = options_.lumigraph.max_samples;
  return session_.welcome()->grid.isTiled() ? std::min(kTilesPerImage * images, kMaxBlended) : images;
}

/// Returns how many images come to those at most when nothing moves and all that the view needs is here.
int Viewer::moreAtRest() const {
  const int more = kMoreTilesPerImage * options_.lumigraph.max_samples;
  return session_.welcome()->grid.isTiled() ? std::min(more, kMaxBlended - imagesBlended()) : 0;
}

/// Keeps the present picture's faces and groups in the cache, whatever arrives.
void Viewer::markInUse() {
  std::vector<repository::FaceKey> faces;
  for (SampleId id : ranked_) {
    if (faces.size() >= static_cast<std::size_t>(imagesBlended() + moreAtRest())) break;
    const BlendImage& image = images_.at(id);
    if (image.state != ImageState::kResident || image.use < kNeededUse || (id & kFrameTag) != 0) continue;
    if (auto key = repository::FaceKey::fromCode(id)) faces.push_back(*key);
  }
  session_.setInUse(faces, patches_.drawn().expanded);
}

}  // namespace client
