uniform vec4 u_section;                // positions with dot(xyz, position) > w are cut away
uniform bool u_cut_open;
uniform vec3 u_section_color;
uniform bool u_show_resolution;
uniform vec3 u_own_light;              // towards a light of the viewer's own; zero: none
// Lambert's law, with a fifth from everywhere, so that what the light does not reach still shows. Surfaces are lit on
// the side that is seen.
vec3 litByViewer(vec3 color, vec3 normal) {
  if (u_own_light == vec3(0.0)) return color;
  return color * (0.2 + 0.8 * max(dot(normal, u_own_light), 0.0));
}
bool isCutAway(vec3 position) {
  return dot(u_section.xyz, position) > u_section.w;
}
