// Soft light: half-Lambert, (n·l / 2 + 1/2)² (Mitchell, McTaggart, Green 2006, "Shading in Valve's Source Engine",
// section 8.2.2), lifted by a constant so that the darkest surface still shows.
uniform bool u_unlit;
uniform vec3 u_light_direction;
vec3 shadeSurface(vec3 color, vec3 normal, vec3 toEye) {
  if (u_unlit) return color;
  float squared = dot(normal, normal);
  vec3 n = squared > 1e-12 ? normal * inversesqrt(squared) : normalize(toEye);
  if (dot(n, toEye) < 0.0) n = -n;
  float half_lambert = 0.5 * dot(n, u_light_direction) + 0.5;
  return color * (0.15 + 0.85 * half_lambert * half_lambert);
}
