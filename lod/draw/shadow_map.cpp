#include "lod/draw/shadow_map.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <glm/gtc/matrix_transform.hpp>
#include <numeric>

#include "lod/draw/shaders.h"
#include "lod/draw/triangles.h"

namespace lod::draw {
namespace {

// Texture units of the map: where depths are compared, and where they are read.
constexpr GLint kComparedUnit = 0, kPlainUnit = 1;
constexpr float kGoldenAngle = 2.3999632F;  // π (3 − √5)

/// Places spread evenly over the unit disc (Vogel 1979, "A better way to construct the sunflower head").
glm::vec2 discSample(int i, int count) {
  const float radius = std::sqrt((static_cast<float>(i) + 0.5F) / static_cast<float>(count));
  const float angle = kGoldenAngle * static_cast<float>(i);
  return radius * glm::vec2(std::cos(angle), std::sin(angle));
}

/// The shear of the edge of the light's disc.
glm::vec2 edgeShear(const ShadowMapView& view) {
  const glm::mat4& lens = view.camera.clip_from_eye;
  const glm::vec2 scale(lens[0][0], lens[1][1]);
  if (view.camera.orthographic()) return scale * std::tan(0.5F * view.light.size) / -lens[2][2];
  return scale * (0.5F * view.light.size) / -lens[3][2];
}

/// The corners of the box in clip coordinates.
std::array<glm::vec4, 8> cornersInClip(const base::Aabb& box, const glm::mat4& clip_from_scene) {
  std::array<glm::vec4, 8> corners{};
  for (std::size_t i = 0; i < corners.size(); ++i)
    corners[i] = clip_from_scene * glm::vec4(box.corner(static_cast<int>(i)), 1.0F);
  return corners;
}

/// The least and the largest depth of the box within the view; normalized device coordinates.
glm::vec2 depthsOf(const base::Aabb& box, const base::Camera& camera) {
  glm::vec2 range(1.0F, -1.0F);
  for (const glm::vec4& clip : cornersInClip(box, camera.clipFromScene())) {
    const float depth = clip.w > 0.0F ? std::clamp(clip.z / clip.w, -1.0F, 1.0F) : -1.0F;
    range = {std::min(range.x, depth), std::max(range.y, depth)};
  }
  return range.x <= range.y ? range : glm::vec2(0.0F);
}

/// The same number for corners at one place: that of the first of them.
std::vector<std::uint32_t> placesOf(const std::vector<glm::vec3>& positions) {
  std::vector<std::uint32_t> order(positions.size()), places(positions.size());
  std::iota(order.begin(), order.end(), 0U);
  const auto key = [&](std::uint32_t v) {
    const glm::vec3& p = positions[v];
    return std::array{p.x, p.y, p.z};
  };
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) { return key(a) < key(b); });
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool is_first = i == 0 || positions[order[i - 1]] != positions[order[i]];
    places[order[i]] = is_first ? order[i] : places[order[i - 1]];
  }
  return places;
}

/// An edge of a triangle between two places.
struct Edge {
  std::uint32_t low, high, corner;  ///< the corner at which it begins
  bool isAlong(const Edge& other) const { return low == other.low && high == other.high; }
};

/// The edges of only one triangle.
std::vector<Edge> openEdges(const std::vector<std::uint32_t>& triangles, const std::vector<std::uint32_t>& places) {
  std::vector<Edge> edges;
  edges.reserve(triangles.size());
  for (std::uint32_t i = 0; i < triangles.size(); ++i) {
    const std::uint32_t a = places[triangles[i]], b = places[triangles[i % 3 == 2 ? i - 2 : i + 1]];
    edges.push_back({std::min(a, b), std::max(a, b), i});
  }
  std::sort(edges.begin(), edges.end(),
            [](const Edge& a, const Edge& b) { return std::pair(a.low, a.high) < std::pair(b.low, b.high); });
  std::size_t kept = 0;
  for (std::size_t i = 0, next = 0; i < edges.size(); i = next) {
    while (next < edges.size() && edges[next].isAlong(edges[i])) ++next;
    if (next == i + 1) edges[kept++] = edges[i];
  }
  edges.resize(kept);
  return edges;
}

/// Moves open edges outwards by the caster's error, each in the plane of its triangle. Where edges meet at a sharp
/// angle the corner moves by twice that at most.
std::vector<glm::vec3> grownPositions(const hlod::CasterPicture& picture) {
  if (!(picture.error > 0.0F)) return picture.positions;
  const std::vector<std::uint32_t> places = placesOf(picture.positions);
  struct Outwards {
    glm::vec3 sum{0.0F};
    float edges = 0.0F;
  };
  std::vector<Outwards> outwards(places.size());
  const auto position = [&](std::size_t corner) { return picture.positions[picture.triangles[corner]]; };
  for (const Edge& edge : openEdges(picture.triangles, places)) {
    const std::size_t first = edge.corner / 3 * 3, k = edge.corner - first;
    const glm::vec3 from = position(edge.corner), along = position(first + (k + 1) % 3) - from;
    const glm::vec3 across = glm::cross(along, glm::cross(along, position(first + (k + 2) % 3) - from));
    const float length = glm::length(across);
    if (!(length > 0.0F)) continue;
    for (const std::uint32_t end : {edge.low, edge.high}) {
      outwards[end].sum += across / length;
      outwards[end].edges += 1.0F;
    }
  }
  std::vector<glm::vec3> grown = picture.positions;
  for (std::size_t v = 0; v < grown.size(); ++v) {
    const Outwards& out = outwards[places[v]];
    const float length = glm::length(out.sum);
    if (length > 0.0F) grown[v] += picture.error / std::max(length / out.edges, 0.5F) * (out.sum / length);
  }
  return grown;
}

/// Layers that may not be drawn yet.
class LayerQueue {
 public:
  /// `most`: 0 for any number.
  explicit LayerQueue(std::size_t most) : most_(most) {}
  LayerQueue(const LayerQueue&) = delete;
  LayerQueue& operator=(const LayerQueue&) = delete;
  ~LayerQueue() {
    for (GLsync layer : queued_) glDeleteSync(layer);
  }
  /// Adds what was drawn since the last one, and waits while there are too many.
  void add() {
    if (most_ == 0) return;
    queued_.push_back(glFenceSync(GL_SYNC_GPU_COMMANDS_COMPLETE, 0));
    if (queued_.size() <= most_) return;
    constexpr GLuint64 kNanoseconds = 1'000'000'000;
    glClientWaitSync(queued_.front(), GL_SYNC_FLUSH_COMMANDS_BIT, kNanoseconds);
    glDeleteSync(queued_.front());
    queued_.pop_front();
  }

 private:
  const std::size_t most_;
  std::deque<GLsync> queued_;
};

}  // namespace

int ShadowMapView::layers() const {
  if (!(light.size > 0.0F)) return 1;
  // Depths are 2 apart at most, and half a map is 1 wide. Filtering smooths a step of two texels.
  const glm::vec2 widest = 2.0F * edgeShear(*this) * glm::vec2(camera.width, camera.height);
  int layers = 4;
  while (layers < kMaxLightLayers && 2.0F * static_cast<float>(layers) < std::max(widest.x, widest.y)) layers *= 2;
  return layers;
}

LightLayers LightLayers::of(const ShadowMapView& view) {
  LightLayers layers;
  const int count = view.layers();
  if (count == 1) {
    layers.shears.emplace_back(0.0F);
    return layers;
  }
  const glm::vec2 edge = edgeShear(view);
  glm::vec2 largest(0.0F);
  for (int i = 0; i < count; ++i) {
    layers.shears.push_back(edge * discSample(i, count));
    largest = glm::max(largest, glm::abs(layers.shears.back()));
  }
  layers.cell = edge / std::sqrt(static_cast<float>(count));
  const glm::vec2 depths = depthsOf(view.receivers, view.camera);
  layers.middle = 0.5F * (depths.x + depths.y);
  layers.window = 1.0F / (1.0F + 0.5F * (depths.y - depths.x) * largest);
  return layers;
}

glm::mat4 LightLayers::layerFromLight(std::size_t layer) const {
  glm::mat4 matrix(1.0F);
  for (int axis = 0; axis < 2; ++axis) {
    matrix[axis][axis] = window[axis];
    matrix[2][axis] = window[axis] * shears[layer][axis];
    matrix[3][axis] = -matrix[2][axis] * middle;
  }
  return matrix;
}

base::Result<std::unique_ptr<ShadowMap>> ShadowMap::create(std::uint64_t gpu_bytes) {
  std::unique_ptr<ShadowMap> map(new ShadowMap(gpu_bytes));
  LUMIGRID_ASSIGN_OR_RETURN(map->program_,
                            base::gl::Program::link("casters", glsl::kShadowVertex, glsl::kShadowFragment));
  map->compared_ = Sampler::create();
  map->plain_ = Sampler::create();
  for (const Sampler* sampler : {&map->compared_, &map->plain_}) {
    glSamplerParameteri(sampler->name(), GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
    glSamplerParameteri(sampler->name(), GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
    const GLint filter = sampler == &map->compared_ ? GL_LINEAR : GL_NEAREST;
    glSamplerParameteri(sampler->name(), GL_TEXTURE_MIN_FILTER, filter);
    glSamplerParameteri(sampler->name(), GL_TEXTURE_MAG_FILTER, filter);
  }
  glSamplerParameteri(map->compared_.name(), GL_TEXTURE_COMPARE_MODE, GL_COMPARE_REF_TO_TEXTURE);
  glSamplerParameteri(map->compared_.name(), GL_TEXTURE_COMPARE_FUNC, GL_LEQUAL);
  return map;
}

ShadowMap::Mesh ShadowMap::upload(const hlod::CasterPicture& picture) {
  Mesh mesh;
  mesh.array = base::gl::VertexArray::create();
  glBindVertexArray(mesh.array.name());
  mesh.positions = base::gl::Buffer::create();
  const std::vector<glm::vec3> positions = grownPositions(picture);
  base::gl::allocate(mesh.positions, GL_ARRAY_BUFFER, positions.data(), positions.size() * sizeof(glm::vec3),
                     GL_STATIC_DRAW);
  glEnableVertexAttribArray(kPosition);
  glVertexAttribPointer(kPosition, 3, GL_FLOAT, GL_FALSE, sizeof(glm::vec3), nullptr);
  mesh.indices = uploadIndices(picture.positions.size(), {picture.triangles});
  glBindVertexArray(0);
  mesh.bytes = mesh.positions.bytes() + mesh.indices.buffer.bytes();
  return mesh;
}

std::uint64_t ShadowMap::mapBytes() const {
  return std::accumulate(slots_.begin(), slots_.end(), std::uint64_t{0},
                         [](std::uint64_t sum, const Slot& slot) { return sum + slot.depths.bytes(); });
}

base::Result<void> ShadowMap::fit(Slot& slot, int width, int height, int layers) const {
  GLint limit = 0;
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &limit);
  if (width < 1 || height < 1 || width > limit || height > limit)
    return base::Error{base::ErrorCode::kUnsupported, "shadow map of " + std::to_string(width) + " x " +
                                                          std::to_string(height) + " texels: each side must be 1 to " +
                                                          std::to_string(limit) + " here"};
  const auto texels = [](int w, int h, int l) { return std::uint64_t(w) * std::uint64_t(h) * std::uint64_t(l); };
  const std::uint64_t most = 2 * texels(width, height, layers);
  const bool fits = width <= slot.width && height <= slot.height && layers <= slot.layers;
  if (fits && texels(slot.width, slot.height, slot.layers) <= most) return {};
  const int w = std::max(width, slot.width), h = std::max(height, slot.height), l = std::max(layers, slot.layers);
  const bool grows = texels(w, h, l) <= most;
  slot.width = grows ? w : width, slot.height = grows ? h : height, slot.layers = grows ? l : layers;
  slot.depths = base::gl::Texture();
  slot.depths = base::gl::Texture::create();
  base::gl::allocate3D(slot.depths, GL_TEXTURE_2D_ARRAY, 1, GL_DEPTH_COMPONENT24, slot.width, slot.height, slot.layers);
  glBindTexture(GL_TEXTURE_2D_ARRAY, 0);
  slot.framebuffer = base::gl::Framebuffer::create();
  return {};
}

/// Empties other slots, the last ones first, while maps take too many bytes.
void ShadowMap::makeRoom() {
  for (std::size_t i = slots_.size(); i-- > 0 && mapBytes() > kept_bytes_;)
    if (i != slot_) slots_[i] = Slot();
}

base::Result<void> ShadowMap::draw(const ShadowMapView& view, std::span<const DrawnCaster> casters, std::size_t slot) {
  if (slot >= slots_.size()) slots_.resize(slot + 1);
  slot_ = slot;
  Slot& map = slots_[slot];
  if (map.is_drawn && map.view == view &&
      std::equal(map.casters.begin(), map.casters.end(), casters.begin(), casters.end()))
    return {};
  map.is_drawn = false;
  LUMIGRID_TRY(fit(map, view.camera.width, view.camera.height, view.layers()));
  makeRoom();
  map.view = view;
  map.casters.assign(casters.begin(), casters.end());
  meshes_.beginFrame(casters, upload);
  LUMIGRID_TRY(drawCasters(map));
  map.is_drawn = true;
  ++drawn_;
  return {};
}

base::Result<void> ShadowMap::drawCasters(const Slot& slot) {
  const ShadowMapView& view = slot.view;
  glBindFramebuffer(GL_FRAMEBUFFER, slot.framebuffer.name());
  const GLenum no_color = GL_NONE;
  glDrawBuffers(1, &no_color);
  glViewport(0, 0, view.camera.width, view.camera.height);
  glDisable(GL_CULL_FACE);
  glDisable(GL_BLEND);
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LESS);
  glDepthMask(GL_TRUE);
  // A place is compared with texels that are a texel away along both axes, where a plane is deeper or less deep by
  // twice the larger of its slopes.
  glEnable(GL_POLYGON_OFFSET_FILL);
  glPolygonOffset(2.0F, 2.0F);
  // The map may be smaller than the texture.
  glEnable(GL_SCISSOR_TEST);
  glScissor(0, 0, view.camera.width, view.camera.height);
  const LightLayers layers = LightLayers::of(view);
  base::Result<void> done{};
  program_.use();
  LayerQueue queue(layers_queued_);
  for (std::size_t layer = 0; layer < layers.shears.size() && done; ++layer) {
    done = drawLayer(slot, layers.layerFromLight(layer), layer);
    queue.add();
  }
  glDisable(GL_POLYGON_OFFSET_FILL);
  glDisable(GL_SCISSOR_TEST);
  glBindVertexArray(0);
  return done;
}

base::Result<void> ShadowMap::drawLayer(const Slot& slot, const glm::mat4& layer_from_light, std::size_t layer) {
  glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, slot.depths.name(), 0, static_cast<GLint>(layer));
  if (glCheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
    return base::Error{base::ErrorCode::kNoSpace, "shadow map of " + std::to_string(slot.width) + " x " +
                                                      std::to_string(slot.height) + " texels in " +
                                                      std::to_string(slot.layers) + " layers: the GL refuses it (" +
                                                      base::gl::takeError() + ")"};
  glClear(GL_DEPTH_BUFFER_BIT);
  const glm::mat4 clip_from_scene = layer_from_light * slot.view.camera.clipFromScene();
  glUniformMatrix4fv(program_.uniform("u_clip_from_scene"), 1, GL_FALSE, &clip_from_scene[0][0]);
  for (const DrawnCaster& caster : slot.casters) {
    const Mesh& mesh = meshes_.mesh(*caster.picture);
    glBindVertexArray(mesh.array.name());
    glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(caster.picture->triangles.size()), mesh.indices.type, nullptr);
  }
  return {};
}

std::string ShadowMap::shadingSource() {
  return glsl::kShadow;
}

void ShadowMap::use(const base::gl::Program& program, const glm::vec3& origin) const {
  const Slot& slot = slots_[slot_];
  const base::Camera& camera = slot.view.camera;
  const glm::mat4& lens = camera.clip_from_eye;
  const glm::mat4 map_from_place(
      glm::translate(glm::dmat4(camera.clip_from_eye) * glm::dmat4(camera.eye_from_scene), glm::dvec3(origin)));
  const glm::vec4& light = slot.view.light.place;
  glUniformMatrix4fv(program.uniform("u_map_from_place"), 1, GL_FALSE, &map_from_place[0][0]);
  glUniform4f(program.uniform("u_light"), light.x - light.w * origin.x, light.y - light.w * origin.y,
              light.z - light.w * origin.z, light.w);
  glUniform1f(program.uniform("u_depth_per_length"), std::abs(camera.orthographic() ? lens[2][2] : lens[3][2]));
  const glm::vec2 size(camera.width, camera.height);
  glUniform2f(program.uniform("u_used_half"), 0.5F * size.x / static_cast<float>(slot.width),
              0.5F * size.y / static_cast<float>(slot.height));

  std::array<glm::vec4, 2> slice;
  for (std::size_t i = 0; i < slice.size(); ++i) {
    const glm::dvec4& plane = slot.view.slice[i];
    slice[i] = glm::vec4(glm::vec3(plane), plane.w + glm::dot(glm::dvec3(plane), glm::dvec3(origin)));
  }
  glUniform4fv(program.uniform("u_slice"), 2, &slice[0].x);

  const LightLayers layers = LightLayers::of(slot.view);
  glUniform1f(program.uniform("u_middle"), layers.middle);
  glUniform2f(program.uniform("u_window"), layers.window.x, layers.window.y);
  glUniform2f(program.uniform("u_cell"), layers.cell.x, layers.cell.y);
  std::vector<glm::vec4> uniform;
  for (std::size_t i = 0; i < layers.shears.size(); ++i) {
    const float turn = kGoldenAngle * static_cast<float>(i);
    uniform.emplace_back(layers.shears[i], std::cos(turn), std::sin(turn));
  }
  glUniform4fv(program.uniform("u_layers"), static_cast<GLsizei>(uniform.size()), &uniform.front().x);

  for (const auto& [unit, sampler, name] :
       {std::tuple(kComparedUnit, &compared_, "u_shadow_map"), std::tuple(kPlainUnit, &plain_, "u_shadow_depth")}) {
    glActiveTexture(GL_TEXTURE0 + static_cast<GLenum>(unit));
    glBindTexture(GL_TEXTURE_2D_ARRAY, slot.depths.name());
    glBindSampler(static_cast<GLuint>(unit), sampler->name());
    glUniform1i(program.uniform(name), unit);
  }
  glActiveTexture(GL_TEXTURE0);
}

void ShadowMap::endUse() {
  for (const GLint unit : {kPlainUnit, kComparedUnit}) {
    glActiveTexture(GL_TEXTURE0 + static_cast<GLenum>(unit));
    glBindTexture(GL_TEXTURE_2D_ARRAY, 0);
    glBindSampler(static_cast<GLuint>(unit), 0);
  }
}

}  // namespace lod::draw
