#include "lod/draw/shadow_map.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/matrix_transform.hpp>
#include <limits>
#include <numeric>

#include "lod/draw/line_copies.h"
#include "lod/draw/shaders.h"
#include "lod/draw/surfaces.h"
#include "lod/surface_vertex.h"

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

/// The largest scale of a length in the box; infinite where the box reaches the viewer's plane.
float largestScale(const base::Aabb& box, const glm::mat4& clip_from_scene) {
  float nearest = std::numeric_limits<float>::max();
  for (const glm::vec4& clip : cornersInClip(box, clip_from_scene)) nearest = std::min(nearest, clip.w);
  return nearest > 0.0F ? 1.0F / nearest : std::numeric_limits<float>::infinity();
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

/// The edges of only one triangle, two vertices each with that triangle's normal.
std::vector<SurfaceVertex> openEdges(const hlod::CasterPicture& picture) {
  const std::vector<std::uint32_t> places = placesOf(picture.positions);
  struct Edge {
    std::uint32_t low, high, triangle;
    bool isAlong(const Edge& other) const { return low == other.low && high == other.high; }
  };
  std::vector<Edge> edges;
  edges.reserve(picture.triangles.size());
  for (std::uint32_t i = 0; i < picture.triangles.size(); ++i) {
    const std::uint32_t a = places[picture.triangles[i]], b = places[picture.triangles[i % 3 == 2 ? i - 2 : i + 1]];
    edges.push_back({std::min(a, b), std::max(a, b), i / 3});
  }
  std::sort(edges.begin(), edges.end(),
            [](const Edge& a, const Edge& b) { return std::pair(a.low, a.high) < std::pair(b.low, b.high); });
  std::vector<SurfaceVertex> lines;
  for (std::size_t i = 0, next = 0; i < edges.size(); i = next) {
    while (next < edges.size() && edges[next].isAlong(edges[i])) ++next;
    if (next != i + 1) continue;
    const auto corner = [&](std::size_t k) {
      return picture.positions[picture.triangles[3 * std::size_t{edges[i].triangle} + k]];
    };
    const glm::vec3 across = glm::cross(corner(1) - corner(0), corner(2) - corner(0));
    const float length = glm::length(across);
    const glm::vec3 normal = length > 0.0F ? across / length : glm::vec3(0.0F, 0.0F, 1.0F);
    for (const std::uint32_t end : {edges[i].low, edges[i].high})
      lines.push_back(surfaceVertex(picture.positions[end], normal, glm::u8vec3(255)));
  }
  return lines;
}

}  // namespace

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
  const std::string vertex = std::string(glsl::kClosing) + glsl::kDepthSlope + glsl::kShadowVertex;
  LUMIGRID_ASSIGN_OR_RETURN(map->triangles_, base::gl::Program::link("casters", vertex, glsl::kShadowFragment));
  LUMIGRID_ASSIGN_OR_RETURN(
      map->lines_, base::gl::Program::link("casters' edges", "#define LINES\n" + vertex, glsl::kShadowFragment));
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
  for (const glm::vec3& position : picture.positions) mesh.box.add(position);
  mesh.array = base::gl::VertexArray::create();
  glBindVertexArray(mesh.array.name());
  mesh.positions = base::gl::Buffer::create();
  base::gl::allocate(mesh.positions, GL_ARRAY_BUFFER, picture.positions.data(),
                     picture.positions.size() * sizeof(glm::vec3), GL_STATIC_DRAW);
  glEnableVertexAttribArray(kPosition);
  glVertexAttribPointer(kPosition, 3, GL_FLOAT, GL_FALSE, sizeof(glm::vec3), nullptr);
  mesh.indices = uploadIndices(picture.positions.size(), {picture.triangles});

  // Leaves have the source's own vertices at their borders, where nothing is open.
  if (picture.error > 0.0F) {
    const std::vector<SurfaceVertex> lines = openEdges(picture);
    mesh.line_vertices = static_cast<GLsizei>(lines.size());
    mesh.line_array = base::gl::VertexArray::create();
    glBindVertexArray(mesh.line_array.name());
    mesh.lines = base::gl::Buffer::create();
    base::gl::allocate(mesh.lines, GL_ARRAY_BUFFER, lines.data(), lines.size() * sizeof(SurfaceVertex), GL_STATIC_DRAW);
    describeSurfaceVertices();
  }
  glBindVertexArray(0);
  mesh.bytes = mesh.positions.bytes() + mesh.indices.buffer.bytes() + mesh.lines.bytes();
  return mesh;
}

base::Result<void> ShadowMap::fit(int width, int height, int layers) {
  GLint limit = 0;
  glGetIntegerv(GL_MAX_TEXTURE_SIZE, &limit);
  if (width < 1 || height < 1 || width > limit || height > limit)
    return base::Error{base::ErrorCode::kUnsupported, "shadow map of " + std::to_string(width) + " x " +
                                                          std::to_string(height) + " texels: each side must be 1 to " +
                                                          std::to_string(limit) + " here"};
  if (width <= width_ && height <= height_ && layers <= layers_) return {};
  width_ = std::max(width, width_), height_ = std::max(height, height_), layers_ = std::max(layers, layers_);
  depths_ = base::gl::Texture();
  depths_ = base::gl::Texture::create();
  base::gl::allocate3D(depths_, GL_TEXTURE_2D_ARRAY, 1, GL_DEPTH_COMPONENT24, width_, height_, layers_);
  glBindTexture(GL_TEXTURE_2D_ARRAY, 0);
  framebuffer_ = base::gl::Framebuffer::create();
  return {};
}

base::Result<void> ShadowMap::draw(const ShadowMapView& view, std::span<const DrawnCaster> casters) {
  LUMIGRID_TRY(fit(view.camera.width, view.camera.height, view.layers()));
  view_ = view;
  meshes_.beginFrame(casters, upload);
  glBindFramebuffer(GL_FRAMEBUFFER, framebuffer_.name());
  const GLenum no_color = GL_NONE;
  glDrawBuffers(1, &no_color);
  glViewport(0, 0, view.camera.width, view.camera.height);
  glDisable(GL_CULL_FACE);
  glDisable(GL_BLEND);
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LESS);
  glDepthMask(GL_TRUE);
  // The map may be smaller than the texture.
  glEnable(GL_SCISSOR_TEST);
  glScissor(0, 0, view.camera.width, view.camera.height);
  const LightLayers layers = LightLayers::of(view);
  base::Result<void> done{};
  for (std::size_t layer = 0; layer < layers.shears.size() && done; ++layer) done = drawLayer(layers, layer, casters);
  glDisable(GL_SCISSOR_TEST);
  glBindVertexArray(0);
  return done;
}

base::Result<void> ShadowMap::drawLayer(const LightLayers& layers, std::size_t layer,
                                        std::span<const DrawnCaster> casters) {
  glFramebufferTextureLayer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, depths_.name(), 0, static_cast<GLint>(layer));
  if (glCheckFramebufferStatus(GL_FRAMEBUFFER) != GL_FRAMEBUFFER_COMPLETE)
    return base::Error{base::ErrorCode::kNoSpace,
                       "shadow map of " + std::to_string(width_) + " x " + std::to_string(height_) + " texels in " +
                           std::to_string(layers_) + " layers: the GL refuses it (" + base::gl::takeError() + ")"};
  glClear(GL_DEPTH_BUFFER_BIT);
  const glm::mat4 clip_from_scene = layers.layerFromLight(layer) * view_.camera.clipFromScene();
  drawTriangles(clip_from_scene, casters);
  drawLines(layers, clip_from_scene, casters);
  return {};
}

void ShadowMap::drawTriangles(const glm::mat4& clip_from_scene, std::span<const DrawnCaster> casters) const {
  triangles_.use();
  glUniformMatrix4fv(triangles_.uniform("u_clip_from_scene"), 1, GL_FALSE, &clip_from_scene[0][0]);
  for (const DrawnCaster& caster : casters) {
    const Mesh& mesh = meshes_.mesh(*caster.picture);
    glBindVertexArray(mesh.array.name());
    glDrawElements(GL_TRIANGLES, static_cast<GLsizei>(caster.picture->triangles.size()), mesh.indices.type, nullptr);
  }
}

/// A line is as wide as the cell's caster and its neighbour's may be apart.
void ShadowMap::drawLines(const LightLayers& layers, const glm::mat4& clip_from_scene,
                          std::span<const DrawnCaster> casters) const {
  const base::Camera& camera = view_.camera;
  const glm::vec4 eye = camera.homogeneousEye();
  const float samples =
      std::max(layers.window.x, layers.window.y) * samplesPerUnit(camera, camera.width, camera.height);
  lines_.use();
  glUniformMatrix4fv(lines_.uniform("u_clip_from_scene"), 1, GL_FALSE, &clip_from_scene[0][0]);
  glUniform4f(lines_.uniform("u_eye"), eye.x, eye.y, eye.z, eye.w);
  glUniform1f(lines_.uniform("u_samples"), samples);
  glUniform2f(lines_.uniform("u_sample_size"), 2.0F / static_cast<float>(camera.width),
              2.0F / static_cast<float>(camera.height));
  for (const DrawnCaster& caster : casters) {
    const Mesh& mesh = meshes_.mesh(*caster.picture);
    if (mesh.line_vertices == 0) continue;
    const float width = closingLineWidth(caster.picture->error);
    const int copies = lineCopies(width * samples * largestScale(mesh.box, clip_from_scene));
    glBindVertexArray(mesh.line_array.name());
    glUniform1f(lines_.uniform("u_closing"), width);
    glUniform1i(lines_.uniform("u_copies"), copies);
    glDrawArraysInstanced(GL_LINES, 0, mesh.line_vertices, lineInstances(copies));
  }
}

std::string ShadowMap::shadingSource() {
  return std::string(glsl::kDepthSlope) + glsl::kShadow;
}

void ShadowMap::use(const base::gl::Program& program, const glm::vec3& origin) const {
  const base::Camera& camera = view_.camera;
  const glm::mat4& lens = camera.clip_from_eye;
  const glm::mat4 map_from_place(
      glm::translate(glm::dmat4(camera.clip_from_eye) * glm::dmat4(camera.eye_from_scene), glm::dvec3(origin)));
  const glm::vec4& light = view_.light.place;
  glUniformMatrix4fv(program.uniform("u_map_from_place"), 1, GL_FALSE, &map_from_place[0][0]);
  glUniform4f(program.uniform("u_light"), light.x - light.w * origin.x, light.y - light.w * origin.y,
              light.z - light.w * origin.z, light.w);
  glUniform1f(program.uniform("u_depth_per_length"), std::abs(camera.orthographic() ? lens[2][2] : lens[3][2]));
  const glm::vec2 size(camera.width, camera.height);
  glUniform2f(program.uniform("u_used_half"), 0.5F * size.x / static_cast<float>(width_),
              0.5F * size.y / static_cast<float>(height_));
  glUniform2f(program.uniform("u_texel"), 2.0F / size.x, 2.0F / size.y);

  const LightLayers layers = LightLayers::of(view_);
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
    glBindTexture(GL_TEXTURE_2D_ARRAY, depths_.name());
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
