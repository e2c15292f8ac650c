layout(location = 0) in vec3 a_position;
uniform mat4 u_clip_from_scene;
#ifdef SECTION
uniform vec4 u_section;
out float v_beyond;
#endif
void main() {
#ifdef SECTION
  v_beyond = dot(u_section.xyz, a_position) - u_section.w;
#endif
  gl_Position = u_clip_from_scene * vec4(a_position, 1.0);
}
