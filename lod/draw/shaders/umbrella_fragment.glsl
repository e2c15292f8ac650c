// Variants as in umbrella_vertex.glsl.
in vec3 v_color;
#ifdef RESOLUTION
uniform float u_hatched;               // 1 where a finer level is still to come, else 0
#endif
#ifdef SECTION
in float v_beyond;
#endif
layout(location = 0) out vec4 out_color;
void main() {
  vec3 color = v_color;
#ifdef RESOLUTION
  color *= 1.0 - 0.5 * u_hatched * step(5.0, mod(gl_FragCoord.x + gl_FragCoord.y, 8.0));
#endif
#ifdef SECTION
  if (v_beyond > 0.0) discard;
#endif
  out_color = vec4(color, 1.0);
}
