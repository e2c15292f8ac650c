#include "lod/draw/splats.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <string>

#include "lod/draw/near_fit.h"
#include "lod/draw/shaders.h"
#include "lod/draw/view_modes.h"
#include "lod/qsplat/node.h"

namespace lod::draw {
namespace {

enum SplatAttribute : GLuint { kSphere = 0, kCodes = 1 };

// Small splats well within the picture are GL points: one vertex each, two to three times as fast in software. All
// others are quads: points have a largest size (64 samples on some machines), and some drivers drop them as soon as
// their centre leaves the picture.

// Distance of rims behind centres in radii. The paper's splats are flat: where many overlap, the picture shows an
// arbitrary one, and large splats hide smaller ones that know the surface better (docs/results/qsplat.md has the gain).
// Beyond 16 radii little is gained, and more of what lies behind a surface shows through it.
constexpr float kRimRadii = 16.0F;
// Rasterisers may move a corner by this much: GLES 3.0 guarantees four bits below the pixel.
constexpr float kMarginSamples = 1.0F / 16.0F;

std::array<float, qsplat::kNormalSide> cellMiddles() {
  std::array<float, qsplat::kNormalSide> middles{};
  for (std::size_t i = 0; i < middles.size(); ++i)
    middles[i] = static_cast<float>(
        std::tan(0.78539816339744831 * ((2.0 * static_cast<double>(i) + 1.0) / qsplat::kNormalSide - 1.0)));
  return middles;
}

bool hasHalfFloatTargets() {
  GLint count = 0;
  glGetIntegerv(GL_NUM_EXTENSIONS, &count);
  for (GLint i = 0; i < count; ++i) {
    const auto* name = reinterpret_cast<const char*>(glGetStringi(GL_EXTENSIONS, static_cast<GLuint>(i)));
    if (name == nullptr) continue;
    if (std::strstr(name, "EXT_color_buffer_float") != nullptr ||
        std::strstr(name, "EXT_color_buffer_half_float") != nullptr)
      return true;
  }
  return false;
}

// Describes the attributes of splats from number `first` of the bound buffer on. divisor: 0 per vertex, 1 per instance.
void describeSplats(std::size_t first, GLuint divisor) {
  const auto at = [first](std::size_t bytes) {
    return reinterpret_cast<const void*>(first * sizeof(qsplat::Splat) + bytes);
  };
  glEnableVertexAttribArray(kSphere);
  glVertexAttribPointer(kSphere, 4, GL_FLOAT, GL_FALSE, sizeof(qsplat::Splat), at(0));
  glVertexAttribDivisor(kSphere, divisor);
  glEnableVertexAttribArray(kCodes);
  glVertexAttribIPointer(kCodes, 2, GL_UNSIGNED_SHORT, sizeof(qsplat::Splat), at(offsetof(qsplat::Splat, normal)));
  glVertexAttribDivisor(kCodes, divisor);
}

float samplesPerUnit(const SplatView& view, const SplatTarget& target) {
  const glm::mat4& lens = view.camera.clip_from_eye;
  return 0.5F * std::max(static_cast<float>(target.width) * lens[0][0], static_cast<float>(target.height) * lens[1][1]);
}

/// Selects splats that may be points: the centre is in the picture, and the size is small enough for points and for the
/// shader's formulas.
class PointTest {
 public:
  PointTest(const SplatView& view, const SplatTarget& target, float max_point_samples)
      : clip_(view.camera.clipFromScene()),
        eye_(view.camera.homogeneousEye()),
        size_per_sample_(max_point_samples > kSpareSamples
                             ? 2.0F * samplesPerUnit(view, target) / (max_point_samples - kSpareSamples)
                             : std::numeric_limits<float>::infinity()) {}

  bool operator()(const qsplat::Splat& splat) const {
    const glm::vec4 clip = clip_ * glm::vec4(splat.center, 1.0F);
    const float depth = clip.w;
    if (!(std::abs(clip.x) < depth && std::abs(clip.y) < depth && std::abs(clip.z) < depth)) return false;
    const glm::vec3 to_eye = glm::vec3(eye_) - eye_.w * splat.center;
    const float size = size_per_sample_ * splat.radius;
    return size * size * glm::dot(to_eye, to_eye) <= depth * depth * depth * depth &&
           eye_.w * splat.radius <= kSmall * depth;
  }

 private:
  // Spare size for margins and for the offset of the ellipse's middle.
  static constexpr float kSpareSamples = 3.0F;
  // The largest radius as a share of the depth, a choice: below it the shader's formulas for points hold closely.
  static constexpr float kSmall = 0.1F;
  glm::mat4 clip_;
  glm::vec4 eye_;
  float size_per_sample_;
};

base::Camera fitted(const base::Camera& camera, std::span<const qsplat::Splat> splats) {
  NearFit fit(camera);
  for (const qsplat::Splat& splat : splats) {
    if (fit.isKept()) break;
    if (!fit.add(base::Sphere{splat.center, splat.radius})) fit.keepNear();
  }
  return fit.camera();
}

}  // namespace

// ---- Splats in memory ----

void SplatRenderer::upload(std::span<const qsplat::Splat> splats, float max_point_samples, const SplatView& view,
                           const SplatTarget& target) {
  const PointTest isPoint(view, target, max_point_samples);
  sorted_.resize(splats.size());
  points_ = 0;
  std::size_t quads_begin = splats.size();
  for (const qsplat::Splat& splat : splats) sorted_[isPoint(splat) ? points_++ : --quads_begin] = splat;

  // Storage is kept while it is large enough and not much too large.
  const bool fits = splats.size() <= capacity_ && splats.size() >= capacity_ / 4;
  if (!fits) {
    capacity_ = splats.size() + splats.size() / 4;
    base::gl::allocate(buffer_, GL_ARRAY_BUFFER, nullptr, capacity_ * sizeof(qsplat::Splat), GL_DYNAMIC_DRAW);
  }
  glBindBuffer(GL_ARRAY_BUFFER, buffer_.name());
  glBufferSubData(GL_ARRAY_BUFFER, 0, static_cast<GLsizeiptr>(splats.size_bytes()), sorted_.data());
  glBindVertexArray(as_points_.name());
  describeSplats(0, 0);
  glBindVertexArray(as_quads_.name());
  describeSplats(points_, 1);
  glBindVertexArray(0);
}

// ---- Programs ----

struct SplatRenderer::Pass {
  enum class Shape : std::uint8_t { kSquare, kRound, kFuzzy, kEllipse };
  Shape shape = Shape::kSquare;
  bool points = false;
  bool resolution = false;  ///< coloured by resolution
  bool section = false;
  float push = 0.0F;  ///< depth is taken at a point this many radii behind the centre

  std::size_t number() const {
    return static_cast<std::size_t>(shape) * 8 + (points ? 4U : 0U) + (resolution ? 2U : 0U) + (section ? 1U : 0U);
  }
  std::string defines() const {
    constexpr std::array<const char*, 4> kShapes{"", "#define ROUND\n", "#define FUZZY\n",
                                                 "#define ROUND\n#define ELLIPSE\n"};
    return std::string(kShapes[static_cast<std::size_t>(shape)]) + (points ? "#define POINTS\n" : "") +
           (resolution ? "#define RESOLUTION\n" : "") + (section ? "#define SECTION\n" : "") +
           (shape == Shape::kFuzzy ? "#define REACH 2.0\n" : "#define REACH 1.0\n") +
           (shape == Shape::kSquare ? "#define WIDEST 0.999\n" : "#define WIDEST 0.8\n");
  }
};

base::Result<std::unique_ptr<SplatRenderer>> SplatRenderer::create() {
  std::unique_ptr<SplatRenderer> renderer(new SplatRenderer);
  renderer->whole_ = base::gl::WholeTarget::create();
  renderer->as_points_ = base::gl::VertexArray::create();
  renderer->as_quads_ = base::gl::VertexArray::create();
  renderer->buffer_ = base::gl::Buffer::create();
  std::array<float, 2> sizes{1.0F, 1.0F};
  glGetFloatv(GL_ALIASED_POINT_SIZE_RANGE, sizes.data());
  // Larger points are no faster than quads.
  renderer->largest_point_ = std::min(sizes[1], 64.0F);
  if (const auto program = renderer->program({}); !program) return program.error();
  return renderer;
}

base::Result<const base::gl::Program*> SplatRenderer::program(const Pass& pass) {
  base::gl::Program& cached = programs_[pass.number()];
  if (cached.name() != 0) return &cached;
  const std::string defines = pass.defines();
  const std::string vertex = defines + shadingSource() + tintSource() + glsl::kSplatVertex;
  LUMIGRID_ASSIGN_OR_RETURN(cached, base::gl::Program::link("splats", vertex, defines + glsl::kSplatFragment));
  cached.use();
  const auto cells = cellMiddles();
  glUniform1fv(cached.uniform("u_cells"), static_cast<GLsizei>(cells.size()), cells.data());
  return &cached;
}

// ---- Drawing ----

base::Result<void> SplatRenderer::draw(std::span<const qsplat::Splat> splats, SplatKernel kernel, const SplatView& from,
                                       const SplatTarget& target) {
  SplatView view = from;
  view.camera = drawn_camera_ = fitted(from.camera, splats);
  if (splats.empty() || target.width <= 0 || target.height <= 0) return {};
  glDisable(GL_SCISSOR_TEST);
  glDisable(GL_CULL_FACE);
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LESS);
  glDepthMask(GL_TRUE);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glDisable(GL_BLEND);
  // Fuzzy splats are twice as wide; ellipses and splats that a section cuts are always quads.
  const bool quads = kernel == SplatKernel::kEllipse || view.camera.hasSection();
  const float max_point_samples = quads ? 0.0F : kernel == SplatKernel::kFuzzy ? 0.5F * largest_point_ : largest_point_;
  const bool fuzzy = kernel == SplatKernel::kFuzzy;
  const bool direct = !fuzzy && !(target.reduction > 1.0F);
  SplatTarget drawn = target;
  if (!direct) {
    LUMIGRID_TRY(prepareCanvas(fuzzy ? GL_RGBA16F : GL_RGBA8, target.width, target.height));
    const auto reducedSide = [&](int samples) {
      return static_cast<int>(std::ceil(static_cast<float>(samples) / std::max(target.reduction, 1.0F)));
    };
    drawn = {canvas_.framebuffer.name(), reducedSide(target.width), reducedSide(target.height), false};
    glBindFramebuffer(GL_FRAMEBUFFER, drawn.framebuffer);
    glClearColor(0.0F, 0.0F, 0.0F, 0.0F);
    glClearDepthf(1.0F);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
  }
  upload(splats, max_point_samples, view, drawn);

  if (fuzzy) {
    LUMIGRID_TRY(drawFuzzy(view, drawn));
  } else {
    Pass pass;
    pass.shape = kernel == SplatKernel::kSquare   ? Pass::Shape::kSquare
                 : kernel == SplatKernel::kCircle ? Pass::Shape::kRound
                                                  : Pass::Shape::kEllipse;
    LUMIGRID_TRY(drawPass(pass, view, drawn));
  }
  if (!direct) compose(drawn, target);
  return {};
}

base::Result<void> SplatRenderer::drawPass(Pass pass, const SplatView& view, const SplatTarget& target) {
  pass.resolution = view.colors == SplatColors::kResolution;
  pass.section = view.camera.hasSection();
  glBindFramebuffer(GL_FRAMEBUFFER, target.framebuffer);
  glViewport(0, 0, target.width, target.height);
  if (points_ < sorted_.size()) LUMIGRID_TRY(drawShape(pass, view, target));
  pass.points = true;
  return points_ > 0 ? drawShape(pass, view, target) : base::Result<void>();
}

base::Result<void> SplatRenderer::drawShape(const Pass& pass, const SplatView& view, const SplatTarget& target) {
  LUMIGRID_ASSIGN_OR_RETURN(auto found, program(pass));
  const base::gl::Program& used = *found;
  setShading(used, view.shading);

  const glm::mat4 clip_from_scene = view.camera.clipFromScene();
  const glm::vec4 eye = view.camera.homogeneousEye();
  const glm::mat3 turn(view.camera.eye_from_scene);
  const glm::mat4& lens = view.camera.clip_from_eye;
  const auto setVector = [&](const char* name, const glm::vec3& in_eye) {
    const glm::vec3 v = in_eye * turn;  // from the eye's frame into the scene's, by the transpose
    glUniform3f(used.uniform(name), v.x, v.y, v.z);
  };
  setVector("u_up", {0.0F, 1.0F, 0.0F});
  setVector("u_ray", {lens[2][0] / lens[0][0], lens[2][1] / lens[1][1], -1.0F});
  setVector("u_ray_right", {1.0F / lens[0][0], 0.0F, 0.0F});
  setVector("u_ray_up", {0.0F, 1.0F / lens[1][1], 0.0F});
  glUniformMatrix4fv(used.uniform("u_clip_from_scene"), 1, GL_FALSE, &clip_from_scene[0][0]);
  glUniform4f(used.uniform("u_eye"), eye.x, eye.y, eye.z, eye.w);
  const float samples = samplesPerUnit(view, target);
  glUniform1f(used.uniform("u_samples"), samples);
  glUniform1f(used.uniform("u_margin"), kMarginSamples / samples);
  glUniform1f(used.uniform("u_push"), pass.push);
  glUniform1f(used.uniform("u_rim"), kRimRadii);
  glUniform1i(used.uniform("u_two_sided"), view.two_sided ? 1 : 0);
  if (pass.resolution) {
    setTint(used);
    glUniform1f(used.uniform("u_pixels"), view.camera.pixelsPerUnitAtOne());
  }
  const glm::vec4& section = view.camera.section;
  glUniform4f(used.uniform("u_section"), section.x, section.y, section.z, section.w);

  glBindVertexArray(pass.points ? as_points_.name() : as_quads_.name());
  if (pass.points)
    glDrawArrays(GL_POINTS, 0, static_cast<GLsizei>(points_));
  else
    glDrawArraysInstanced(GL_TRIANGLE_STRIP, 0, 4, static_cast<GLsizei>(sorted_.size() - points_));
  glBindVertexArray(0);
  return {};
}

// ---- Fuzzy splats, and pictures of fewer samples ----

base::Result<void> SplatRenderer::prepareCanvas(GLenum format, int width, int height) {
  if (canvas_.format == format && canvas_.width == width && canvas_.height == height) return {};
  if (format == GL_RGBA16F && !hasHalfFloatTargets())
    return base::Error{
        base::ErrorCode::kUnsupported,
        "fuzzy splats need half-float targets (EXT_color_buffer_float), which this GL lacks; use circle"};
  if (compose_.name() == 0) {
    LUMIGRID_ASSIGN_OR_RETURN(compose_,
                              base::gl::Program::link("compose splats", glsl::kComposeVertex, glsl::kComposeFragment));
  }
  canvas_ = {};
  canvas_.color = base::gl::Texture::create();
  base::gl::allocate2D(canvas_.color, GL_TEXTURE_2D, 1, format, width, height);
  canvas_.depth = base::gl::unfilteredTexture(GL_DEPTH_COMPONENT24, width, height);
  if (!base::gl::attachTextures(canvas_.framebuffer, {&canvas_.color}, &canvas_.depth)) {
    canvas_ = {};
    return base::Error{base::ErrorCode::kUnsupported, "splats: the GL refuses a target of " + std::to_string(width) +
                                                          " x " + std::to_string(height) + " samples"};
  }
  canvas_.format = format;
  canvas_.width = width;
  canvas_.height = height;
  return {};
}

// The paper's two passes: the first draws depth alone, pushed away from the viewer, so that the second adds up all
// splats within that distance of the nearest one. compose() then divides the sums by the opacities.
base::Result<void> SplatRenderer::drawFuzzy(const SplatView& view, const SplatTarget& reduced) {
  // Two radii: neighbours on a surface that is seen at 45 degrees still mix.
  constexpr float kPushRadii = 2.0F;
  Pass pass;
  pass.shape = Pass::Shape::kRound;
  pass.push = kPushRadii;
  glColorMask(GL_FALSE, GL_FALSE, GL_FALSE, GL_FALSE);
  LUMIGRID_TRY(drawPass(pass, view, reduced));

  pass.shape = Pass::Shape::kFuzzy;
  pass.push = 0.0F;
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glDepthMask(GL_FALSE);
  glDepthFunc(GL_LEQUAL);
  glEnable(GL_BLEND);
  glBlendEquation(GL_FUNC_ADD);
  glBlendFunc(GL_ONE, GL_ONE);
  const auto added = drawPass(pass, view, reduced);
  glDepthMask(GL_TRUE);
  glDepthFunc(GL_LESS);
  glDisable(GL_BLEND);
  return added;
}

void SplatRenderer::compose(const SplatTarget& reduced, const SplatTarget& target) {
  glBindFramebuffer(GL_FRAMEBUFFER, target.framebuffer);
  glViewport(0, 0, target.width, target.height);
  if (target.mix) glEnable(GL_BLEND);
  glBlendFuncSeparate(GL_SRC_ALPHA, GL_ONE_MINUS_SRC_ALPHA, GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
  compose_.use();
  glUniform1i(compose_.uniform("u_sums"), 0);
  glUniform1i(compose_.uniform("u_depth"), 1);
  const glm::vec2 size(canvas_.width, canvas_.height);
  const glm::vec2 drawn(reduced.width, reduced.height);
  const glm::vec2 scale = drawn / (size * size);
  const glm::vec2 last = (drawn - 0.51F) / size;  // even rounded it is not interpolated with the next sample
  glUniform2f(compose_.uniform("u_scale"), scale.x, scale.y);
  glUniform2f(compose_.uniform("u_last"), last.x, last.y);
  const auto bind = [](GLenum unit, GLuint texture) {
    glActiveTexture(unit);
    glBindTexture(GL_TEXTURE_2D, texture);
  };
  bind(GL_TEXTURE1, canvas_.depth.name());
  bind(GL_TEXTURE0, canvas_.color.name());
  const GLint filter = target.reduction > 1.0F ? GL_LINEAR : GL_NEAREST;
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, filter);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, filter);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_S, GL_CLAMP_TO_EDGE);
  glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_WRAP_T, GL_CLAMP_TO_EDGE);
  whole_.draw();
  bind(GL_TEXTURE1, 0);
  bind(GL_TEXTURE0, 0);
  glDisable(GL_BLEND);
}

}  // namespace lod::draw
