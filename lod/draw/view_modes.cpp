#include "lod/draw/view_modes.h"

#include "lod/draw/shaders.h"

namespace lod::draw {

std::string tintSource() {
  return glsl::kTint;
}

void setTint(const base::gl::Program& program) {
  std::array<glm::vec4, kResolutionLegend.size()> steps{};
  for (std::size_t i = 0; i < steps.size(); ++i) {
    const ResolutionStep& step = kResolutionLegend[i];
    steps[i] = glm::vec4(glm::vec3(step.color[0], step.color[1], step.color[2]) / 255.0F, step.up_to_px);
  }
  glUniform4fv(program.uniform("u_steps[0]"), static_cast<GLsizei>(steps.size()), &steps[0][0]);
}

std::string viewModesSource() {
  return tintSource() + glsl::kViewModes;
}

void setViewModes(const base::gl::Program& program, const ViewModes& modes, const base::Camera& camera) {
  program.use();
  const glm::vec4& section = camera.section;
  glUniform4f(program.uniform("u_section"), section.x, section.y, section.z, section.w);
  // Where the eye is on the side that stays, so is all that it sees.
  const glm::vec4 eye = camera.homogeneousEye();
  const bool cut_open = glm::dot(glm::vec3(section), glm::vec3(eye)) > section.w * eye.w;
  glUniform1i(program.uniform("u_cut_open"), camera.hasSection() && cut_open ? 1 : 0);
  const glm::vec3 cut_color = glm::vec3(kSectionColor[0], kSectionColor[1], kSectionColor[2]) / 255.0F;
  glUniform3f(program.uniform("u_section_color"), cut_color.r, cut_color.g, cut_color.b);
  glUniform3f(program.uniform("u_own_light"), modes.light.x, modes.light.y, modes.light.z);
  glUniform1i(program.uniform("u_show_resolution"), modes.resolution_colors ? 1 : 0);
  setTint(program);
}

}  // namespace lod::draw
