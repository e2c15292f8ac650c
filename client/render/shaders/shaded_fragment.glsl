// Draws the proxy by its own colours. Software GL would run blended_fragment.glsl to its end where nothing is blended.
out vec4 o_color;
void main() {
  if (isCutAway(v_position)) discard;
  if (u_cut_open && !gl_FrontFacing) {
    o_color = vec4(u_section_color, 1.0);
    return;
  }
  Surface surface = surfaceHere();
  o_color = vec4(litByViewer(surface.shaded, surface.normal), 1.0);
}
