uniform vec4 u_section;                // positions with dot(xyz, position) > w are cut away
uniform bool u_cut_open;
uniform vec3 u_section_color;
uniform bool u_show_resolution;
bool isCutAway(vec3 position) {
  return dot(u_section.xyz, position) > u_section.w;
}
