// Surfaces as bytes of textures, written by surface_fragment.glsl.
uniform float u_step;                  // length of a lattice step, scene units
const float kCodesPerOctave = 8.0;

// A direction on the octahedron, its lower half folded outwards (Cigolle et al. 2014, "A Survey of Efficient
// Representations for Independent Unit Vectors", section 3.2), 0..1.
vec2 octahedral(vec3 direction) {
  vec3 n = direction / (abs(direction.x) + abs(direction.y) + abs(direction.z));
  vec2 signs = vec2(n.x < 0.0 ? -1.0 : 1.0, n.y < 0.0 ? -1.0 : 1.0);
  vec2 place = n.z < 0.0 ? (1.0 - abs(n.yx)) * signs : n.xy;
  return 0.5 * place + 0.5;
}
vec3 fromOctahedral(vec2 code) {
  vec2 place = 2.0 * code - 1.0;
  vec3 n = vec3(place, 1.0 - abs(place.x) - abs(place.y));
  vec2 signs = vec2(place.x < 0.0 ? -1.0 : 1.0, place.y < 0.0 ? -1.0 : 1.0);
  if (n.z < 0.0) n.xy = (1.0 - abs(n.yx)) * signs;
  return normalize(n);
}
float edgeCode(float edge) {
  return log2(max(edge / u_step, 1.0)) * kCodesPerOctave / 255.0;
}
float fromEdgeCode(float code) {
  return u_step * exp2(255.0 * code / kCodesPerOctave);
}
