#include "lod/draw/surfaces.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "lod/draw/shaders.h"
#include "lod/draw/view_modes.h"
#include "lod/surface_vertex.h"

namespace lod::draw {
namespace {

static_assert(sizeof(SurfaceVertex) == kSurfaceVertexBytes);

constexpr std::array kPrimitiveDefines{"", "#define POINTS\n", "#define LINES\n"};

/// The samples that a length of 1 covers at depth 1, along the side of the target where they are more.
float samplesPerUnit(const SurfaceView& view, const SurfaceTarget& target) {
  const glm::mat4& lens = view.camera.clip_from_eye;
  return 0.5F * std::max(static_cast<float>(target.width) * lens[0][0], static_cast<float>(target.height) * lens[1][1]);
}

std::string shadowDefines(const SurfacePass& pass) {
  if (pass.shadow_layers == 0) return "";
  return "#define SHADOWS\n#define LAYERS " + std::to_string(pass.shadow_layers) + "\n";
}

}  // namespace

float SurfaceTarget::samplesPerPixel(const base::Camera& camera) const {
  return static_cast<float>(height) / static_cast<float>(std::max(camera.height, 1));
}

SurfacePass SurfacePass::of(Primitive primitive, const SurfaceView& view) {
  return {primitive, view.resolution_colors, view.camera.hasSection()};
}

std::size_t SurfacePass::number() const {
  const auto shadows = static_cast<std::size_t>(std::bit_width(static_cast<unsigned>(shadow_layers)));
  return 12 * shadows + 4 * static_cast<std::size_t>(primitive) + (resolution ? 2U : 0U) + (section ? 1U : 0U);
}

base::Result<const base::gl::Program*> SurfacePrograms::link(const SurfacePass& pass) {
  base::gl::Program& program = programs_[pass.number()];
  if (program.name() != 0) return &program;
  const bool fills = pass.primitive != Primitive::kTriangles;
  const std::string defines =
      std::string(kPrimitiveDefines[static_cast<std::size_t>(pass.primitive)]) +
      (style_.shade_fragments ? "#define SHADE_FRAGMENTS\n" : "") +
      (fills && style_.fill_behind ? "#define BEHIND\n" : "") + (style_.backs_behind ? "#define BACKS_BEHIND\n" : "") +
      (pass.resolution ? "#define RESOLUTION\n" : "") + (pass.section ? "#define SECTION\n" : "") + shadowDefines(pass);
  const std::string shading = (pass.shadow_layers > 0 ? style_.shadow_source : shadingSource()) + tintSource();
  const std::string vertex = defines + (style_.shade_fragments ? "" : shading) + glsl::kSurfaceVertex;
  const std::string fragment = defines + (style_.shade_fragments ? shading : "") + glsl::kSurfaceFragment;
  LUMIGRID_ASSIGN_OR_RETURN(program, base::gl::Program::link(style_.name, vertex, fragment));
  return &program;
}

base::Result<const base::gl::Program*> SurfacePrograms::use(const SurfacePass& pass, const SurfaceView& view,
                                                            const SurfaceTarget& target) {
  LUMIGRID_ASSIGN_OR_RETURN(const base::gl::Program* linked, link(pass));
  const base::gl::Program& program = *linked;
  if (pass.shadow_layers == 0) setShading(program, view.shading);
  program.use();
  const glm::mat4 clip_from_scene = view.camera.clipFromScene();
  const glm::vec4 eye = view.camera.homogeneousEye();
  glUniformMatrix4fv(program.uniform("u_clip_from_scene"), 1, GL_FALSE, &clip_from_scene[0][0]);
  glUniform4f(program.uniform("u_eye"), eye.x, eye.y, eye.z, eye.w);
  const glm::vec4& section = view.camera.section;
  glUniform4f(program.uniform("u_section"), section.x, section.y, section.z, section.w);
  glUniform1f(program.uniform("u_samples"), samplesPerUnit(view, target));
  glUniform2f(program.uniform("u_sample_size"), 2.0F / static_cast<float>(target.width),
              2.0F / static_cast<float>(target.height));
  if (pass.resolution) {
    setTint(program);
    glUniform1f(program.uniform("u_pixels"), view.camera.pixelsPerUnitAtOne());
  }
  return linked;
}

void beginSurfaces(const SurfaceTarget& target) {
  glDisable(GL_SCISSOR_TEST);
  glDisable(GL_CULL_FACE);
  glDisable(GL_BLEND);
  glEnable(GL_DEPTH_TEST);
  glDepthFunc(GL_LESS);
  glDepthMask(GL_TRUE);
  glColorMask(GL_TRUE, GL_TRUE, GL_TRUE, GL_TRUE);
  glBindFramebuffer(GL_FRAMEBUFFER, target.framebuffer);
  glViewport(0, 0, target.width, target.height);
}

}  // namespace lod::draw
