#pragma once
// What a viewer may lay over any picture: a section plane, and colours by resolution. One piece of GLSL for
// the client's renderer and the server's, so that both show the same.
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <string>

#include "base/camera.h"
#include "base/geometry.h"
#include "base/gl/gl.h"

namespace lod::draw {

/// Colours by resolution: each fragment is tinted by how many screen pixels the detail shown there spans. From images,
/// their texels (with what the proxy's error shifts); from patches, their projected error; splats, their diameter.
struct ResolutionStep {
  float up_to_px;                     ///< the last step has no end
  std::array<std::uint8_t, 3> color;  ///< sRGB
};
/// Fine to coarse, told apart by colour-blind people too (ColorBrewer's RdYlBu).
inline constexpr std::array<ResolutionStep, 5> kResolutionLegend{{{1.0F, {0x2c, 0x7b, 0xb6}},
                                                                  {2.0F, {0xab, 0xd9, 0xe9}},
                                                                  {4.0F, {0xff, 0xff, 0xbf}},
                                                                  {8.0F, {0xfd, 0xae, 0x61}},
                                                                  {1e30F, {0xd7, 0x19, 0x1c}}}};
/// Back faces seen through what a section plane cuts away, sRGB.
inline constexpr std::array<std::uint8_t, 3> kSectionColor{0xc8, 0x6a, 0x45};

struct ViewModes {
  glm::vec4 section = base::kNoSection;  ///< scene-local (base::sectionInScene)
  bool resolution_colors = false;
  bool any() const { return section != base::kNoSection || resolution_colors; }
};

/// Fragment GLSL and its uniforms: `bool isCutAway(vec3 position)`; `bool u_cut_open`: view rays come through what is
/// cut away, so back faces are the inside of what is left and have `u_section_color`; `bool u_show_resolution`; and
/// tintSource().
std::string viewModesSource();
/// Sets them; leaves `program` in use.
void setViewModes(const base::gl::Program& program, const ViewModes& modes, const base::Camera& camera);

/// For shaders of both kinds: `vec3 tinted(vec3 color, float pixels)`, the legend's colour with the picture's light and
/// dark.
std::string tintSource();
/// Sets its uniforms; `program` is in use.
void setTint(const base::gl::Program& program);

/// True when all of the box is on the side that the section cuts away.
bool isCutAway(const glm::vec4& section, const base::Aabb& box);

}  // namespace lod::draw
