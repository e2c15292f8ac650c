uniform float u_patch_error;           // error of the patch being drawn, pixels
in vec3 v_color;
layout(location = 0) out vec4 out_color;
void main() {
  if (isCutAway(v_position)) discard;
  vec3 base = SURFACE_COLOR(v_color);
  vec3 color = u_own_light == vec3(0.0) ? SHADED(base) : litByViewer(base, seenNormalHere());
  if (u_show_resolution) color = tinted(color, u_patch_error);
  out_color = vec4(u_cut_open && !gl_FrontFacing ? u_section_color : color, 1.0);
}
