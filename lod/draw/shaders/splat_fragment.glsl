// Variants as in splat_vertex.glsl.
flat in vec3 v_color;
#ifdef RESOLUTION
flat in float v_hatched;
#endif
#ifndef POINTS
in vec3 v_place;
#endif
#ifdef ROUND
uniform float u_rim;
flat in vec2 v_depth;
#endif
#ifdef SECTION
in float v_beyond;
#endif
layout(location = 0) out vec4 out_color;
void main() {
  vec3 color = v_color;
#ifdef RESOLUTION
  color *= 1.0 - 0.5 * v_hatched * step(5.0, mod(gl_FragCoord.x + gl_FragCoord.y, 8.0));
#endif
#ifdef SECTION
  if (v_beyond > 0.0) discard;
#endif
#ifdef POINTS
  vec3 v_place = vec3(REACH * (2.0 * gl_PointCoord - 1.0), 1.0);
#endif
#ifdef FUZZY
  float t = 0.5 * length(v_place.xy) / v_place.z;
  if (v_place.z <= 0.0 || t >= 1.0) discard;
  float opacity = 1.0 - t * t * (3.0 - 2.0 * t);
  out_color = vec4(color * opacity, opacity);
#else
#ifdef ROUND
  float off = dot(v_place.xy, v_place.xy) / (v_place.z * v_place.z);
  if (v_place.z <= 0.0 || off > 1.0) discard;
  // Depth rises from the centre to the rim like a bell that points to the viewer. Where splats overlap, the one whose
  // centre is nearest is seen, and rims that stick out lie behind splats that know the surface there better.
  float bell = (sqrt(off) + u_rim * off * off) / (1.0 + u_rim);
#ifdef ELLIPSE
  float depth = gl_FragCoord.z;
#else
  float depth = v_depth.x;
#endif
  gl_FragDepth = min(depth + v_depth.y * bell, 0.9999998);
#endif
  out_color = vec4(color, 1.0);
#endif
}
