#include "client/render/lumigraph.h"

#include <algorithm>
#include <array>
#include <optional>
#include <unordered_map>

#include "base/check.h"
#include "client/render/box_index.h"
#include "client/render/choose.h"
#include "client/render/patch_samples.h"
#include "client/render/pixel_blend.h"
#include "client/render/pyramid.h"
#include "client/render/sample_array.h"
#include "client/render/sample_borders.h"
#include "client/render/shaders.h"
#include "client/render/whole_image.h"
#include "lod/draw/near_fit.h"
#include "lod/view_box.h"

namespace client {
namespace {

/// Texels of a sample's depth map at most. A choice: finer maps take four times the memory for each doubling, coarser
/// ones place the edges of occlusion less exactly.
constexpr int kMaxDepthSide = 512;
/// A budget for no more faces than this is allocated at once, since growing needs room for a copy. About as many as a
/// frame blends.
constexpr int kFacesAtOnce = 32;
constexpr int kFewFaces = 24;  ///< as many as a frame blends by default, and half as many arriving
/// Faces up to this size are tiles or as small as those. A frame takes four times as many of them.
constexpr int kTileSize = 256;
constexpr int kTilesForAFace = 4;

/// Returns how many faces of this size take the place of so many whole ones.
int facesOfSize(int face_size, int whole_faces) {
  return face_size <= kTileSize ? kTilesForAFace * whole_faces : whole_faces;
}

/// Where each fragment is blended by itself, one program has all powers.
constexpr const char* kPowersOfFragments =
    "uniform float u_angle_power, u_vote_power, u_half_resolution_power;\n"
    "#define ANGLE_POWER u_angle_power\n"
    "#define VOTE_POWER u_vote_power\n"
    "#define HALF_RESOLUTION_POWER u_half_resolution_power\n";

/// Errors of a proxy for which nobody states typical ones: those of a coarse cut of a coloured scan.
constexpr float kGuessedColorError = 0.1F;
constexpr float kGuessedShareOfBound = 0.1F;

constexpr int kMaxArrays = 3;              ///< image sizes at a time: faces, and exact frames of two sizes
constexpr int kFreeUnit = 2 * kMaxArrays;  ///< the first texture unit that no array takes

/// One sample as the uniform block holds it: std140, `Sample` of blend_samples.glsl.
struct SampleBlock {
  glm::mat4 clip_from_scene{1.0F};
  glm::vec4 eye{0.0F};
  glm::vec4 place{0.0F};
  glm::vec4 depth{0.0F};
  glm::vec4 floors{0.0F};
  glm::vec4 beyond{0.0F};
  glm::vec4 core{0.0F};
};
static_assert(sizeof(SampleBlock) == 10 * sizeof(glm::vec4));
static_assert(kMaxBlended * sizeof(SampleBlock) <= 16384, "the least that GLES 3.0 has for a uniform block");

struct Sample {
  base::Camera camera;
  SampleGeometry geometry;
  int array = 0;
  int layer = 0;
  bool depth_drawn = false;
  std::uint64_t depth_signature = 0;   ///< signature of the patches in its depth map
  std::uint64_t wanted_signature = 0;  ///< and of those that overlap its frustum in this list of occluders
  std::uint64_t occluders_version = 0;
  // Fade in time: from fade_from towards 1 (wanted) or 0, since fade_since.
  bool wanted = false;
  float fade_from = 0.0F;
  double fade_since = 0.0;
  float fade_share = 1.0F, coding_error = 0.0F;  ///< SampleTraits

  float fadeAt(double now, float usual_seconds) const {
    const float seconds = fade_share * usual_seconds;
    const float goal = wanted ? 1.0F : 0.0F;
    if (seconds <= 0.0F) return goal;
    const float gone = static_cast<float>(std::max(0.0, now - fade_since)) / seconds;
    return wanted ? std::min(1.0F, fade_from + gone) : std::max(0.0F, fade_from - gone);
  }
};

std::vector<const SampleGeometry*> geometriesOf(const std::vector<Sample*>& samples) {
  std::vector<const SampleGeometry*> geometries;
  geometries.reserve(samples.size());
  for (const Sample* sample : samples) geometries.push_back(&sample->geometry);
  return geometries;
}

/// Mixes the bits of a patch's number (Steele, Lea, Flood 2014, SplitMix); the sum of these numbers identifies a set of
/// patches, in any order.
std::uint64_t mixed(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15U;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9U;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebU;
  return x ^ (x >> 31);
}

}  // namespace

struct LumigraphRenderer::Impl {
  Impl(const lod::Lattice& lattice, int size, std::uint64_t budget, std::uint64_t others)
      : patches(lattice), face_size(size), budget_bytes(budget), for_other_sizes(std::min(others, budget)) {}

  lod::draw::PatchMeshes patches;
  int face_size;
  std::uint64_t budget_bytes;
  std::uint64_t for_other_sizes;
  base::gl::Program blend;
  std::array<base::gl::Program, 2> depth;  ///< of whole samples, and of those with a section
  std::optional<PixelBlend> pixels;
  std::optional<WholeImageShader> whole;
  base::gl::Buffer block;
  base::gl::Texture no_color;  ///< bound where there is no array, since WebGL requires complete textures
  base::gl::Texture no_depth;
  std::array<std::optional<SampleArray>, kMaxArrays> arrays;
  std::unordered_map<SampleId, Sample> samples;
  LumigraphStats stats;
  base::Camera drawn_camera;
  bool settling = false;

  // One frame.
  struct Frame {
    base::Camera camera;
    const LumigraphOptions& options;
    double now = 0.0;
    std::vector<std::uint32_t> patches;    ///< front to back, without those that the section cuts away
    std::vector<float> errors_px;          ///< beside `patches`
    std::vector<ProxyError> proxy_errors;  ///< beside `patches`
    std::vector<base::Aabb> boxes;         ///< beside `patches`
    std::vector<Sample*> active;           ///< in the uniform block
    std::vector<std::uint32_t> points;     ///< beside `active`; numbers that differ from point to point
  };

  /// The patches that hide things from samples.
  struct Occluders {
    std::vector<std::uint32_t> patches;
    std::vector<base::Aabb> boxes;  ///< beside `patches`
    BoxIndex index{{}};
    std::uint64_t triangles = 0;
    std::uint64_t version = 1;  ///< counts the lists that there have been
  };
  Occluders occluders;

  bool isFaceSize(int width, int height) const { return width == face_size && height == face_size; }
  std::uint64_t textureBytes() const;
  base::gl::HeldBytes heldBytes() const;
  std::uint64_t budgetOf(const SampleArray& array) const;
  int maxDepthSide() const;
  int arrayFor(int width, int height);
  bool freeEmptyArrays(int but);
  void updateSamples(Frame& frame, std::span<const SampleId> candidates);
  std::vector<Sample*> candidateSamples(std::span<const SampleId> candidates);
  void setOccluders(std::span<const std::uint32_t> now);
  std::vector<std::uint32_t> occludersOf(const Sample& sample) const;
  std::uint64_t depthSignature(Sample& sample) const;
  void drawDepthMaps(const Frame& frame, const std::vector<Sample*>& wanted);
  std::uint64_t drawDepthMap(Sample& sample);
  void uploadBlock(Frame& frame);
  SampleBlock blockOf(const Sample& sample, const BlendTuning& tuning) const;
  /// For each patch, the samples that may see it.
  using Lists = std::vector<std::vector<std::uint32_t>>;
  Lists samplesOverPatches(const Frame& frame) const;
  void setList(std::span<const std::uint32_t> list);
  void setUniforms(const base::gl::Program& program, const Frame& frame, const lod::draw::Shading& shading) const;
  std::optional<std::size_t> onlyArray(const Frame& frame) const;
  void bindArrays(const base::gl::Program& program, std::optional<std::size_t> only) const;
  bool drawOnce(const Frame& frame, const Lists& lists, const lod::draw::Shading& shading);
  void blendPixels(const Frame& frame, const Lists& lists, const lod::draw::Shading& shading);
  static void clearTarget(const Frame& frame);
  template <class Draw>
  void withSoftEdges(const Frame& frame, const Draw& draw) const;
  void drawPatches(const Frame& frame, const Lists& lists);
  void countFrame(const Frame& frame);
};

namespace {

base::gl::Texture emptyArray(GLenum format) {
  auto texture = base::gl::Texture::create();
  base::gl::allocate3D(texture, GL_TEXTURE_2D_ARRAY, 1, format, 1, 1, 1);
  glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
  glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
  if (format == GL_DEPTH_COMPONENT24)
    glTexParameteri(GL_TEXTURE_2D_ARRAY, GL_TEXTURE_COMPARE_MODE, GL_COMPARE_REF_TO_TEXTURE);
  return texture;
}

/// Returns the camera whose picture lies by so many pixels elsewhere.
base::Camera shifted(base::Camera camera, const glm::vec2& pixels) {
  const glm::vec2 clip = 2.0F * pixels / glm::vec2(camera.width, camera.height);
  // Clip x over w moves by a constant: through z in perspective, where w = −z.
  if (camera.orthographic())
    camera.clip_from_eye[3] += glm::vec4(clip, 0.0F, 0.0F);
  else
    camera.clip_from_eye[2] -= glm::vec4(clip, 0.0F, 0.0F);
  return camera;
}

/// Sets the uniforms of view.glsl that tell the place of a pixel at a depth.
void setRays(const base::gl::Program& program, const base::Camera& camera) {
  const glm::mat3 scene_from_eye = glm::transpose(glm::mat3(camera.eye_from_scene));
  const glm::mat4& clip = camera.clip_from_eye;
  const bool parallel = camera.orthographic();
  // In perspective a pixel at x has (x + P20) / P00 of the depth beside the axis, in a parallel view (x − P30) / P00.
  const glm::vec2 middle = parallel ? -glm::vec2(clip[3]) : glm::vec2(clip[2]);
  const glm::vec3 right = scene_from_eye[0] / clip[0][0], up = scene_from_eye[1] / clip[1][1];
  const glm::vec3 forward = -scene_from_eye[2];
  const glm::vec3 beside = middle.x * right + middle.y * up;
  const glm::mat3 from = parallel ? glm::mat3(camera.eye + beside, right, up) : glm::mat3(camera.eye, {}, {});
  const glm::mat3 along = parallel ? glm::mat3(forward, {}, {}) : glm::mat3(forward + beside, right, up);
  glUniform3f(program.uniform("u_forward"), forward.x, forward.y, forward.z);
  glUniformMatrix3fv(program.uniform("u_rays_from"), 1, GL_FALSE, &from[0][0]);
  glUniformMatrix3fv(program.uniform("u_rays_along"), 1, GL_FALSE, &along[0][0]);
}

/// Returns the sorting key of a box: the distance of its nearest point, and of its middle for boxes around the eye.
float nearness(const base::Camera& camera, const base::Aabb& box) {
  if (camera.orthographic()) return -glm::dot(camera.towardsViewer(box.center()), box.center());
  const glm::vec3& eye = camera.eye;
  return glm::length(glm::clamp(eye, box.min, box.max) - eye) + 0.01F * glm::length(box.center() - eye);
}

ProxyError guessedError(float bound_px, const base::Camera& camera, const base::Aabb& box) {
  const float units_per_pixel = 1.0F / camera.pixelsPerUnit(box.center());
  return {kGuessedShareOfBound * bound_px * units_per_pixel, kGuessedColorError};
}

/// Moves the near plane out to the boxes.
base::Camera fittedTo(const base::Camera& camera, std::span<const base::Aabb> boxes) {
  lod::draw::NearFit fit(camera);
  for (const base::Aabb& box : boxes)
    if (!fit.add(box)) fit.keepNear();
  return fit.camera();
}

/// Returns the indices of patches of `cut` that the section does not cut away, front to back.
std::vector<std::size_t> frontToBack(std::span<const std::uint32_t> cut, const lod::draw::PatchMeshes& patches,
                                     const base::Camera& camera) {
  std::vector<std::pair<float, std::size_t>> order;
  order.reserve(cut.size());
  for (std::size_t i = 0; i < cut.size(); ++i) {
    const base::Aabb& box = patches.box(cut[i]);
    if (!lod::isBeyond(camera.section, box)) order.emplace_back(nearness(camera, box), i);
  }
  std::sort(order.begin(), order.end());
  std::vector<std::size_t> sorted;
  sorted.reserve(order.size());
  for (const auto& [distance, index] : order) sorted.push_back(index);
  return sorted;
}

}  // namespace

base::Result<std::unique_ptr<LumigraphRenderer>> LumigraphRenderer::create(const lod::Lattice& lattice, int face_size,
                                                                           std::uint64_t gpu_budget_bytes,
                                                                           std::uint64_t for_other_sizes) {
  auto renderer = std::unique_ptr<LumigraphRenderer>(new LumigraphRenderer);
  renderer->impl_ = std::make_unique<Impl>(lattice, face_size, gpu_budget_bytes, for_other_sizes);
  Impl& impl = *renderer->impl_;

  LUMIGRID_ASSIGN_OR_RETURN(
      auto blend, base::gl::Program::link("lumigraph blend", glsl::kBlendVertex,
                                          lod::draw::shadingSource() + lod::draw::seenNormalSource() +
                                              lod::draw::viewModesSource() + glsl::kView + glsl::kProxySurface +
                                              kPowersOfFragments + glsl::kBlendSamples + glsl::kBlendFragment));
  impl.blend = std::move(blend);
  for (const bool section : {false, true}) {
    const std::string define = section ? "#define SECTION\n" : "";
    LUMIGRID_ASSIGN_OR_RETURN(
        impl.depth[section ? 1 : 0],
        base::gl::Program::link("lumigraph depth", define + glsl::kDepthVertex, define + glsl::kDepthFragment));
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto pixels, PixelBlend::create());
  impl.pixels = std::move(pixels);
  LUMIGRID_ASSIGN_OR_RETURN(auto whole, WholeImageShader::create());
  impl.whole = std::move(whole);

  impl.block = base::gl::Buffer::create();
  impl.no_color = emptyArray(GL_RGBA8);
  impl.no_depth = emptyArray(GL_DEPTH_COMPONENT24);
  bindSamples(impl.blend);
  return renderer;
}

LumigraphRenderer::~LumigraphRenderer() = default;

lod::draw::PatchMeshes& LumigraphRenderer::patches() {
  return impl_->patches;
}
const base::Camera& LumigraphRenderer::drawnCamera() const {
  return impl_->drawn_camera;
}
bool LumigraphRenderer::settling() const {
  return impl_->settling;
}
const LumigraphStats& LumigraphRenderer::stats() const {
  return impl_->stats;
}
std::uint64_t LumigraphRenderer::bytesToBlendOnce(int width, int height) {
  return PixelBlend::bytesOf(width, height);
}
base::gl::HeldBytes LumigraphRenderer::heldBytes() const {
  return impl_->heldBytes();
}

base::gl::HeldBytes LumigraphRenderer::Impl::heldBytes() const {
  const std::uint64_t others = no_color.bytes() + no_depth.bytes() + pixels->bytes();
  return {textureBytes() + others, patches.gpuBytes() + block.bytes(), 0};
}

std::uint64_t LumigraphRenderer::Impl::textureBytes() const {
  std::uint64_t bytes = 0;
  for (const auto& array : arrays)
    if (array) bytes += array->bytes();
  return bytes;
}

/// Returns the side of depth maps: half where the budget is so small that more faces help more.
int LumigraphRenderer::Impl::maxDepthSide() const {
  const auto side = static_cast<std::uint64_t>(face_size <= kTileSize ? face_size : kMaxDepthSide);
  const auto few = static_cast<std::uint64_t>(facesOfSize(face_size, kFewFaces));
  const bool small = budget_bytes < few * (pyramidBytes(face_size, face_size) + 4 * side * side);
  return small ? kMaxDepthSide / 2 : kMaxDepthSide;
}

/// Returns the part of the budget that this array may take, its present bytes included. Beside faces there are images
/// of two sizes, each of which leaves the other its half where that holds two images.
std::uint64_t LumigraphRenderer::Impl::budgetOf(const SampleArray& array) const {
  const std::uint64_t others = textureBytes() - array.bytes();
  const std::uint64_t left = budget_bytes > others ? budget_bytes - others : 0;
  if (isFaceSize(array.width(), array.height())) return std::min(left, budget_bytes - for_other_sizes);
  const std::uint64_t half = for_other_sizes / 2;
  return half >= 2 * array.bytesPerLayer() ? std::min(left, half) : left;
}

/// Returns the index of the array for this image size, created or put in the place of an empty one; −1 if there is no
/// place for it.
int LumigraphRenderer::Impl::arrayFor(int width, int height) {
  for (int i = 0; i < kMaxArrays; ++i) {
    const auto& array = arrays[static_cast<std::size_t>(i)];
    if (array && array->width() == width && array->height() == height) return i;
  }
  for (int i = 0; i < kMaxArrays; ++i) {
    auto& array = arrays[static_cast<std::size_t>(i)];
    if (array && array->used() > 0) continue;
    array.reset();
    const int depth_side = maxDepthSide();
    array.emplace(width, height, std::min(width, depth_side), std::min(height, depth_side),
                  isFaceSize(width, height) ? facesOfSize(face_size, kFacesAtOnce) : SampleArray::kFirstLayers);
    return i;
  }
  return -1;
}

bool LumigraphRenderer::addSample(SampleId id, const base::Camera& camera, const base::Image& rgba, double now,
                                  const SampleTraits& traits) {
  LUMIGRID_CHECK(traits.core > 0.0F && traits.core <= 1.0F);
  Impl& impl = *impl_;
  if (rgba.channels != 4 || rgba.empty()) return false;
  removeSample(id);
  const int index = impl.arrayFor(rgba.width, rgba.height);
  if (index < 0) return false;
  SampleArray& array = *impl.arrays[static_cast<std::size_t>(index)];
  int layer = array.add(rgba, impl.budgetOf(array));
  if (layer < 0 && impl.freeEmptyArrays(index)) layer = array.add(rgba, impl.budgetOf(array));
  if (layer < 0) return false;
  Sample sample{camera, SampleGeometry(camera, traits.core)};
  sample.array = index;
  sample.layer = layer;
  sample.fade_since = now;
  sample.fade_share = traits.fade_share;
  sample.coding_error = traits.coding_error;
  impl.samples.emplace(id, sample);
  return true;
}

/// Frees the storage of arrays without images, except array `but`. True if there were any.
bool LumigraphRenderer::Impl::freeEmptyArrays(int but) {
  bool any = false;
  for (int i = 0; i < kMaxArrays; ++i) {
    auto& array = arrays[static_cast<std::size_t>(i)];
    if (i == but || !array || array->used() > 0) continue;
    any = any || array->bytes() > 0;
    array.reset();
  }
  return any;
}

void LumigraphRenderer::removeSample(SampleId id) {
  const auto found = impl_->samples.find(id);
  if (found == impl_->samples.end()) return;
  impl_->arrays[static_cast<std::size_t>(found->second.array)]->release(found->second.layer);
  impl_->samples.erase(found);
}

std::vector<Sample*> LumigraphRenderer::Impl::candidateSamples(std::span<const SampleId> candidates) {
  std::vector<Sample*> result;
  for (const SampleId id : candidates)
    if (const auto found = samples.find(id); found != samples.end()) result.push_back(&found->second);
  if (!candidates.empty()) return result;

  // Sorted by number, so that samples that add the same never change places from frame to frame.
  std::vector<std::pair<SampleId, Sample*>> all;
  for (auto& [id, sample] : samples) all.emplace_back(id, &sample);
  std::sort(all.begin(), all.end());
  for (const auto& [id, sample] : all) result.push_back(sample);
  return result;
}

void LumigraphRenderer::Impl::setOccluders(std::span<const std::uint32_t> now) {
  if (std::equal(now.begin(), now.end(), occluders.patches.begin(), occluders.patches.end())) return;
  occluders.patches.assign(now.begin(), now.end());
  occluders.boxes.clear();
  occluders.triangles = 0;
  for (const std::uint32_t patch : now) {
    occluders.boxes.push_back(patches.box(patch));
    occluders.triangles += patches.triangles(patch);
  }
  occluders.index = BoxIndex(occluders.boxes);
  ++occluders.version;
}

/// Returns the patches that may be seen in the sample's picture, its border included.
std::vector<std::uint32_t> LumigraphRenderer::Impl::occludersOf(const Sample& sample) const {
  std::vector<std::uint32_t> overlapping;
  occluders.index.findOverlapping(base::Frustum(sample.geometry.clip_from_scene), overlapping);
  for (std::uint32_t& place : overlapping) place = occluders.patches[place];
  return overlapping;
}

std::uint64_t LumigraphRenderer::Impl::depthSignature(Sample& sample) const {
  if (sample.occluders_version == occluders.version) return sample.wanted_signature;
  sample.occluders_version = occluders.version;
  sample.wanted_signature = 1;
  for (const std::uint32_t patch : occludersOf(sample)) sample.wanted_signature += mixed(patch);
  return sample.wanted_signature;
}

/// Returns the triangles drawn.
std::uint64_t LumigraphRenderer::Impl::drawDepthMap(Sample& sample) {
  const std::vector<std::uint32_t> overlapping = occludersOf(sample);
  arrays[static_cast<std::size_t>(sample.array)]->beginDepth(sample.layer);
  const glm::vec4& section = sample.camera.section;
  const base::gl::Program& program = depth[sample.camera.hasSection() ? 1 : 0];
  program.use();
  glUniformMatrix4fv(program.uniform("u_clip_from_scene"), 1, GL_FALSE, &sample.geometry.clip_from_scene[0][0]);
  if (sample.camera.hasSection()) glUniform4f(program.uniform("u_section"), section.x, section.y, section.z, section.w);
  patches.draw(overlapping);
  sample.depth_drawn = true;
  sample.depth_signature = depthSignature(sample);
  ++stats.depth_maps_drawn;
  std::uint64_t triangles = 0;
  for (const std::uint32_t patch : overlapping) triangles += patches.triangles(patch);
  return triangles;
}

/// Redraws the depth maps whose patches have changed, first those of samples without any; for a few times the proxy's
/// triangles per frame, or all if the picture must be final.
void LumigraphRenderer::Impl::drawDepthMaps(const Frame& frame, const std::vector<Sample*>& wanted) {
  std::vector<Sample*> stale;
  for (Sample* sample : wanted)
    if (!sample->depth_drawn) stale.push_back(sample);
  for (Sample* sample : wanted)
    if (sample->depth_drawn && sample->depth_signature != depthSignature(*sample)) stale.push_back(sample);
  if (stale.empty()) return;

  GLint framebuffer = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &framebuffer);
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LESS);
  glDepthMask(GL_TRUE);
  glDisable(GL_BLEND);
  glDisable(GL_CULL_FACE);
  const bool all = frame.options.fade_seconds <= 0.0F;
  const std::uint64_t limit = static_cast<std::uint64_t>(frame.options.depth_maps_per_frame) * occluders.triangles;
  std::uint64_t drawn = 0;
  for (Sample* sample : stale) {
    if (!all && drawn > 0 && drawn >= limit) {
      settling = true;
      break;
    }
    drawn += drawDepthMap(*sample);
  }
  glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(framebuffer));
}

/// Chooses this frame's samples, updates their depth maps and starts fades.
void LumigraphRenderer::Impl::updateSamples(Frame& frame, std::span<const SampleId> candidates) {
  const std::vector<Sample*> all = frame.options.use_images ? candidateSamples(candidates) : std::vector<Sample*>{};
  const std::vector<const SampleGeometry*> geometries = geometriesOf(all);
  const int limit = std::clamp(frame.options.max_samples, 1, kMaxBlended);
  const int more = std::clamp(frame.options.more_samples, 0, kMaxBlended - limit);
  std::vector<Sample*> wanted;
  for (const std::size_t i :
       chooseSamples(geometries, frame.boxes, frame.proxy_errors, frame.camera, static_cast<std::size_t>(limit),
                     frame.options.tuning, frame.options.surface, static_cast<std::size_t>(more)))
    wanted.push_back(all[i]);
  drawDepthMaps(frame, wanted);

  const float seconds = frame.options.fade_seconds;
  const auto turn = [&](Sample& sample, bool to) {
    if (sample.wanted == to) return;
    sample.fade_from = sample.fadeAt(frame.now, seconds);
    sample.fade_since = frame.now;
    sample.wanted = to;
  };
  std::vector<Sample*> leaving;
  for (auto& [id, sample] : samples) {
    if (std::find(wanted.begin(), wanted.end(), &sample) != wanted.end()) continue;
    turn(sample, false);
    if (sample.depth_drawn && sample.fadeAt(frame.now, seconds) > 0.0F) leaving.push_back(&sample);
  }
  for (Sample* sample : wanted)
    if (sample->depth_drawn) turn(*sample, true);

  // Samples that fade out share the remaining places, the strongest first.
  std::sort(leaving.begin(), leaving.end(), [&](const Sample* a, const Sample* b) {
    return a->fadeAt(frame.now, seconds) > b->fadeAt(frame.now, seconds);
  });
  for (Sample* sample : wanted)
    if (sample->depth_drawn) frame.active.push_back(sample);
  for (Sample* sample : leaving)
    if (frame.active.size() < kMaxBlended) frame.active.push_back(sample);
  for (const Sample* sample : frame.active) {
    const float fade = sample->fadeAt(frame.now, seconds);
    settling = settling || (sample->wanted ? fade < 1.0F : fade > 0.0F);
  }
}

/// Sets what does not depend on the other samples.
SampleBlock LumigraphRenderer::Impl::blockOf(const Sample& sample, const BlendTuning& tuning) const {
  const SampleArray& array = *arrays[static_cast<std::size_t>(sample.array)];
  const glm::mat4& projection = sample.camera.clip_from_eye;
  SampleBlock result;
  result.clip_from_scene = sample.geometry.clip_from_scene;
  result.eye = glm::vec4(sample.geometry.eye, 0.0F);
  result.place = glm::vec4(sample.array, sample.layer, 1.0F / static_cast<float>(array.depthWidth()),
                           1.0F / static_cast<float>(array.depthHeight()));
  // Clip z = P22 z + P32 with w = −z: depth = P32 / w − P22.
  const float texel = std::max(2.0F / (projection[0][0] * static_cast<float>(array.depthWidth())),
                               2.0F / (projection[1][1] * static_cast<float>(array.depthHeight())));
  result.depth = glm::vec4(projection[2][2], projection[3][2], texel, sample.geometry.pixels_per_unit_at_one);
  result.core.x = 1.0F / sample.geometry.core;
  const float noise2 = tuning.image_noise * tuning.image_noise;
  result.core.w = std::max(0.0F, tuning.coding_share * sample.coding_error * sample.coding_error - noise2);
  return result;
}

/// Orders the frame's samples as the shader needs them, and uploads them.
void LumigraphRenderer::Impl::uploadBlock(Frame& frame) {
  const std::vector<const SampleGeometry*> geometries = geometriesOf(frame.active);
  std::vector<float> fades;
  for (const Sample* sample : frame.active) fades.push_back(sample->fadeAt(frame.now, frame.options.fade_seconds));
  const SampleNesting nesting = nestingOf(geometries);
  const std::vector<SampleBorders> borders = bordersOf(geometries, fades, nesting);
  std::vector<std::uint32_t> groups;
  const std::vector<std::uint32_t> order = finestFirst(geometries, nesting, &groups);

  std::array<SampleBlock, kMaxBlended> blocks{};
  std::vector<Sample*> ordered;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const std::uint32_t from = order[i];
    ordered.push_back(frame.active[from]);
    blocks[i] = blockOf(*ordered.back(), frame.options.tuning);
    blocks[i].eye.w = fades[from];
    blocks[i].floors = borders[from].floors;
    blocks[i].beyond = borders[from].beyond;
    blocks[i].core.y = static_cast<float>(groups[i]);
    blocks[i].core.z = borders[from].under;
  }
  frame.active = std::move(ordered);
  frame.points = std::move(groups);
  base::gl::allocate(block, GL_UNIFORM_BUFFER, blocks.data(), sizeof(blocks), GL_DYNAMIC_DRAW);
  glBindBufferBase(GL_UNIFORM_BUFFER, kSamplesBinding, block.name());
}

/// Returns the array that all samples of the frame are in, if there is one.
std::optional<std::size_t> LumigraphRenderer::Impl::onlyArray(const Frame& frame) const {
  const auto array = static_cast<std::size_t>(frame.active.front()->array);
  const auto is_there = [&](const Sample* sample) { return static_cast<std::size_t>(sample->array) == array; };
  return std::all_of(frame.active.begin(), frame.active.end(), is_there) ? std::optional(array) : std::nullopt;
}

/// Binds all arrays, or the only one that a program of one array looks into.
void LumigraphRenderer::Impl::bindArrays(const base::gl::Program& program, std::optional<std::size_t> only) const {
  static constexpr std::array<const char*, kMaxArrays> kColor{"u_color0", "u_color1", "u_color2"};
  static constexpr std::array<const char*, kMaxArrays> kDepth{"u_depth0", "u_depth1", "u_depth2"};
  for (std::size_t i = 0; i < (only ? 1 : kMaxArrays); ++i) {
    const auto& array = arrays[only.value_or(i)];
    const bool filled = array && array->color() != 0;
    const auto unit = static_cast<GLint>(2 * i);
    glActiveTexture(GL_TEXTURE0 + static_cast<GLenum>(unit));
    glBindTexture(GL_TEXTURE_2D_ARRAY, filled ? array->color() : no_color.name());
    glActiveTexture(GL_TEXTURE0 + static_cast<GLenum>(unit) + 1);
    glBindTexture(GL_TEXTURE_2D_ARRAY, filled ? array->depth() : no_depth.name());
    glUniform1i(program.uniform(kColor[i]), unit);
    glUniform1i(program.uniform(kDepth[i]), unit + 1);
  }
  glActiveTexture(GL_TEXTURE0);
}

void LumigraphRenderer::Impl::setUniforms(const base::gl::Program& program, const Frame& frame,
                                          const lod::draw::Shading& shading) const {
  lod::draw::setShading(program, shading);
  const base::Camera camera = shifted(frame.camera, frame.options.shift);
  const glm::mat4 clip_from_scene = camera.clipFromScene();
  const auto set = [&](const char* name, float value) { glUniform1f(program.uniform(name), value); };
  glUniformMatrix4fv(program.uniform("u_clip_from_scene"), 1, GL_FALSE, &clip_from_scene[0][0]);
  const glm::vec4 eye = camera.homogeneousEye();
  glUniform4f(program.uniform("u_eye"), eye.x, eye.y, eye.z, eye.w);
  glUniform2f(program.uniform("u_viewport"), static_cast<float>(camera.width), static_cast<float>(camera.height));
  set("u_pixels_per_unit", camera.pixelsPerUnitAtOne());
  setRays(program, camera);
  glUniform1i(program.uniform("u_carve"), frame.options.carve ? 1 : 0);
  glUniform1i(program.uniform("u_show_disagreement"), frame.options.show_disagreement ? 1 : 0);
  set("u_soft", frame.options.multisampled ? 1.0F : 0.0F);
  glUniform1i(program.uniform("u_fill"), frame.options.fill_holes || !frame.options.use_images ? 1 : 0);
  lod::draw::setViewModes(program, frame.options.modes, camera);
  const float* background = frame.options.background;
  glUniform4f(program.uniform("u_background"), background[0], background[1], background[2], background[3]);

  const BlendTuning& tuning = frame.options.tuning;
  set("u_angle_floor", tuning.angle_floor);
  set("u_angle_power", tuning.angle_power);
  set("u_vote_power", tuning.vote_power);
  set("u_half_resolution_power", 0.5F * tuning.resolution_power);
  set("u_shift", tuning.shift);
  set("u_border", tuning.border);
  set("u_side_low", tuning.side_low);
  set("u_side_high", tuning.side_high);
  set("u_bias_texels", tuning.bias_texels);
  set("u_bias_error", tuning.bias_error);
  set("u_carve_below", tuning.carve_below);
  set("u_shade_blur", tuning.shade_blur);
  set("u_shade_weight", tuning.shade_weight);
  set("u_image_noise", tuning.image_noise);
  set("u_proxy_noise", tuning.proxy_noise);
  set("u_near", tuning.near_errors);
  set("u_outlier", tuning.outlier);
  set("u_lit_outlier", tuning.lit_outlier);
  set("u_agreement", tuning.agreement);
  set("u_sharpen", tuning.sharpen);
  set("u_footprint", tuning.footprint);
  set("u_disagreement", tuning.disagreement);
  set("u_even_error", tuning.even_error);
  const auto step = static_cast<float>(patches.lattice().step);
  set("u_step", step);
  glUniform2f(program.uniform("u_edge"), step, 127.0F / lod::draw::kEdgeCodesPerOctave);
}

/// Returns for each patch the samples that may see it.
LumigraphRenderer::Impl::Lists LumigraphRenderer::Impl::samplesOverPatches(const Frame& frame) const {
  const std::vector<const SampleGeometry*> geometries = geometriesOf(frame.active);
  const auto most = static_cast<std::size_t>(std::max(1, frame.options.max_points_a_patch));
  return samplesOfPatches(geometries, frame.points, frame.boxes, frame.proxy_errors, frame.camera, most,
                          frame.options.tuning);
}

void LumigraphRenderer::Impl::setList(std::span<const std::uint32_t> list) {
  std::array<GLint, kMaxBlended> indices{};
  std::transform(list.begin(), list.end(), indices.begin(), [](std::uint32_t s) { return static_cast<GLint>(s); });
  const auto quads = static_cast<GLsizei>((list.size() + 3) / 4);
  if (quads > 0) glUniform4iv(blend.uniform("u_list[0]"), quads, indices.data());
  glUniform1i(blend.uniform("u_count"), static_cast<GLint>(list.size()));
}

/// Draws a picture of colours alone, blending the surfaces of each pixel once. False where that cannot be done.
bool LumigraphRenderer::Impl::drawOnce(const Frame& frame, const Lists& lists, const lod::draw::Shading& shading) {
  const LumigraphOptions& options = frame.options;
  const base::Camera& camera = frame.camera;
  const bool colors = !options.show_disagreement && !options.modes.resolution_colors;
  const bool all = options.fill_holes || !options.use_images;
  const bool images = !frame.active.empty();
  const bool fits = options.blend_once && frame.patches.size() <= PixelBlend::kMostPatches;
  const bool blends = images && fits && colors && all;
  // Where nothing is blended, the memory is given back.
  const bool ready = pixels->prepare(blends ? camera.width : 1, blends ? camera.height : 1);
  if (!ready || images != blends || !colors || !all) return false;
  if (blends && !pixels->chooseBlend(options.tuning, onlyArray(frame).has_value())) return false;

  stats.blended_once = blends;
  if (blends) blendPixels(frame, lists, shading);
  if (blends && !options.multisampled) return true;
  clearTarget(frame);
  setUniforms(blends ? pixels->show() : pixels->shade(), frame, shading);
  if (blends) pixels->setResult(kFreeUnit);
  withSoftEdges(frame, [&] { patches.draw(frame.patches); });
  return true;
}

/// Blends the surfaces of each pixel, and draws them where the target has one sample a pixel.
void LumigraphRenderer::Impl::blendPixels(const Frame& frame, const Lists& lists, const lod::draw::Shading& shading) {
  GLint target = 0;
  glGetIntegerv(GL_FRAMEBUFFER_BINDING, &target);
  pixels->setLists(frame.proxy_errors, cellsOfPatches(lists, geometriesOf(frame.active), frame.boxes, frame.camera));
  for (std::size_t layer = 0; layer < PixelBlend::kLayers; ++layer) {
    if (layer > 0 && !frame.options.carve) {
      pixels->clearSurface(layer);
      break;
    }
    setUniforms(pixels->surface(), frame, shading);
    pixels->beginSurface(layer, kFreeUnit);
    for (std::size_t i = 0; i < frame.patches.size(); ++i) {
      pixels->setPatch(i);
      patches.draw(std::span(frame.patches).subspan(i, 1));
    }
    setUniforms(pixels->blend(), frame, shading);
    bindArrays(pixels->blend(), onlyArray(frame));
    pixels->blendPixels(layer, kFreeUnit);
    glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(target));
    if (frame.options.multisampled) continue;
    if (layer == 0) clearTarget(frame);
    setUniforms(pixels->picture(), frame, shading);
    pixels->compose(layer, kFreeUnit);
  }
  glBindFramebuffer(GL_FRAMEBUFFER, static_cast<GLuint>(target));
}

void LumigraphRenderer::Impl::clearTarget(const Frame& frame) {
  const float* background = frame.options.background;
  glViewport(0, 0, frame.camera.width, frame.camera.height);
  glClearColor(background[0], background[1], background[2], background[3]);
  glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
}

/// Draws so that fragments which a carved edge crosses cover a part of their pixels' samples.
template <class Draw>
void LumigraphRenderer::Impl::withSoftEdges(const Frame& frame, const Draw& draw) const {
  const bool soft = frame.options.multisampled && frame.options.carve && frame.options.use_images;
  if (soft) glEnable(GL_SAMPLE_ALPHA_TO_COVERAGE);
  draw();
  if (!soft) return;
  glDisable(GL_SAMPLE_ALPHA_TO_COVERAGE);
  whole->makeOpaque(no_color.name());
}

/// Draws patches front to back. Runs of patches that the same samples may see share a list, so that a fragment tries
/// only those.
void LumigraphRenderer::Impl::drawPatches(const Frame& frame, const Lists& lists) {
  const GLint error_location = blend.uniform("u_patch_error");
  const GLint proxy_error_location = blend.uniform("u_proxy_error");
  for (std::size_t i = 0; i < frame.patches.size(); ++i) {
    if (i == 0 || lists[i] != lists[i - 1]) setList(lists[i]);
    glUniform1f(error_location, frame.errors_px[i]);
    glUniform2f(proxy_error_location, frame.proxy_errors[i].shapeForShader(), frame.proxy_errors[i].color);
    patches.draw(std::span(frame.patches).subspan(i, 1));
  }
}

void LumigraphRenderer::draw(const base::Camera& camera, std::span<const std::uint32_t> cut,
                             std::span<const SampleId> candidates, float cut_error_px,
                             const lod::draw::Shading& shading, const LumigraphOptions& options, double now,
                             std::span<const std::uint32_t> occluders, std::span<const float> patch_error_px,
                             std::span<const ProxyError> proxy_errors) {
  Impl& impl = *impl_;
  impl.settling = false;
  impl.stats = {};

  // Collect the frame's patches and samples.
  Impl::Frame frame{camera, options, now, {}, {}, {}, {}, {}, {}};
  for (const std::size_t i : frontToBack(cut, impl.patches, camera)) {
    frame.patches.push_back(cut[i]);
    frame.errors_px.push_back(i < patch_error_px.size() ? patch_error_px[i] : cut_error_px);
    frame.boxes.push_back(impl.patches.box(cut[i]));
    frame.proxy_errors.push_back(i < proxy_errors.size() ? proxy_errors[i]
                                                         : guessedError(cut_error_px, camera, frame.boxes.back()));
  }
  impl.setOccluders(occluders.empty() ? cut : occluders);
  impl.updateSamples(frame, candidates);
  if (options.unseen) return impl.countFrame(frame);
  frame.camera = impl.drawn_camera = fittedTo(camera, frame.boxes);
  impl.uploadBlock(frame);
  const Impl::Lists lists = impl.samplesOverPatches(frame);

  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LESS);
  glDepthMask(GL_TRUE);
  glDisable(GL_BLEND);
  glDisable(GL_CULL_FACE);
  if (!impl.drawOnce(frame, lists, shading)) {
    impl.clearTarget(frame);
    impl.setUniforms(impl.blend, frame, shading);
    impl.bindArrays(impl.blend, std::nullopt);
    impl.withSoftEdges(frame, [&] { impl.drawPatches(frame, lists); });
  }
  impl.countFrame(frame);
}

void LumigraphRenderer::Impl::countFrame(const Frame& frame) {
  stats.samples_used = static_cast<std::uint32_t>(frame.active.size());
  stats.samples_resident = static_cast<std::uint32_t>(samples.size());
  stats.patches = static_cast<std::uint32_t>(frame.patches.size());
  for (const std::uint32_t patch : frame.patches) stats.triangles += patches.triangles(patch);
  stats.gpu_bytes = heldBytes().total();
}

bool LumigraphRenderer::canDrawWhole(SampleId id, const base::Camera& camera) const {
  const auto found = impl_->samples.find(id);
  if (found == impl_->samples.end()) return false;
  const SampleArray& array = *impl_->arrays[static_cast<std::size_t>(found->second.array)];
  return array.width() == camera.width && array.height() == camera.height;
}

void LumigraphRenderer::drawWhole(SampleId id, const base::Camera& camera, const std::array<float, 4>& background,
                                  float opacity) {
  LUMIGRID_CHECK(canDrawWhole(id, camera));
  const Sample& sample = impl_->samples.at(id);
  const SampleArray& array = *impl_->arrays[static_cast<std::size_t>(sample.array)];
  impl_->whole->draw(array.color(), sample.layer, camera.width, camera.height, background, opacity);
}

}  // namespace client
