#pragma once
// View modes that apply to any picture: a camera's section, colours by resolution, and a light of the viewer's. Client
// and server use the same GLSL, so that both show the same.
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <string>

#include "base/camera.h"
#include "base/gl/gl.h"

namespace lod::draw {

/// Colours by resolution: each fragment is tinted by how many screen pixels the detail shown there spans. For images
/// that is a texel (and the shift by the proxy's error), for patches their projected error, for splats their diameter.
struct ResolutionStep {
  float up_to_px;                     ///< upper end; the last step has none
  std::array<std::uint8_t, 3> color;  ///< sRGB
};
/// From fine to coarse, in colours that colour-blind people can tell apart, too (ColorBrewer's RdYlBu).
inline constexpr std::array<ResolutionStep, 5> kResolutionLegend{{{1.0F, {0x2c, 0x7b, 0xb6}},
                                                                  {2.0F, {0xab, 0xd9, 0xe9}},
                                                                  {4.0F, {0xff, 0xff, 0xbf}},
                                                                  {8.0F, {0xfd, 0xae, 0x61}},
                                                                  {1e30F, {0xd7, 0x19, 0x1c}}}};
/// Colour of back faces that a section plane exposes, sRGB.
inline constexpr std::array<std::uint8_t, 3> kSectionColor{0x6f, 0x74, 0x80};

struct ViewModes {
  bool resolution_colors = false;
  /// Towards a light of the viewer's own, unit length, in whose light colours are shown in place of the scene's: those
  /// must come unlit. Zero: none.
  glm::vec3 light{0.0F};
  bool hasLight() const { return light != glm::vec3(0.0F); }
  /// Whether a picture from this camera differs from the scene as it is.
  bool alter(const base::Camera& camera) const { return camera.hasSection() || resolution_colors || hasLight(); }
  friend bool operator==(const ViewModes&, const ViewModes&) = default;
};

/// Returns fragment GLSL that defines `bool isCutAway(vec3 position)`, `vec3 litByViewer(vec3 color, vec3 normal)` with
/// the unit normal of the seen side, their uniforms, and those of tintSource(). `bool u_cut_open`: view rays come
/// through the half that is cut away, so back faces show the inside of the rest in `u_section_color`. `bool
/// u_show_resolution`: colours by resolution are on.
std::string viewModesSource();
/// Sets the uniforms of viewModesSource(), with the camera's section; leaves `program` in use.
void setViewModes(const base::gl::Program& program, const ViewModes& modes, const base::Camera& camera);

/// Returns GLSL for vertex and fragment shaders that defines `vec3 tinted(vec3 color, float pixels)`: the legend's
/// colour with the brightness of `color`.
std::string tintSource();
/// Sets the uniforms of tintSource(); `program` must be in use.
void setTint(const base::gl::Program& program);

}  // namespace lod::draw
