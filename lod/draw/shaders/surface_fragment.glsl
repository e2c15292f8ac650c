// Variants as in surface_vertex.glsl.
centroid in vec3 v_color;
#ifdef SHADE_FRAGMENTS
centroid in vec3 v_normal;
centroid in vec3 v_to_eye;
uniform float u_pixels;                // pixels that a length of 1 spans at depth 1
uniform float u_detail;                // size of the detail that is shown, scene units
#endif
#ifdef SHADOWS
in vec3 v_place;
#endif
#ifdef RESOLUTION
uniform float u_hatched;               // 1 where a finer level is still to come, else 0
#endif
#ifdef SECTION
in float v_beyond;
#endif
layout(location = 0) out vec4 out_color;
void main() {
  vec3 color = v_color;
#ifdef SHADE_FRAGMENTS
#ifdef SHADOWS
  color = shadeInLight(color, v_normal, v_to_eye, v_place);
#else
  color = shadeSurface(color, v_normal, v_to_eye);
#endif
#ifdef RESOLUTION
  color = tinted(color, u_detail * u_pixels * gl_FragCoord.w);
#endif
#endif
#ifdef RESOLUTION
  color *= 1.0 - 0.5 * u_hatched * step(5.0, mod(gl_FragCoord.x + gl_FragCoord.y, 8.0));
#endif
#ifdef SECTION
  if (v_beyond > 0.0) discard;
#endif
  out_color = vec4(color, 1.0);
}
