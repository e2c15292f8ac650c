// A vertex at a hard edge has one normal for all sides, which leans away from each: the triangle's own takes its place
// by and by. It leans away from the eye no farther than to where a surface would vanish: turned over it would be lit
// from behind.
vec3 seenNormal(vec3 normal, vec3 facet, vec3 toEye) {
  float squared = dot(normal, normal);
  vec3 n = squared > 1e-12 ? normal * inversesqrt(squared) : normalize(toEye);
  if (dot(n, facet) < 0.0) n = -n;
  n = mix(facet, n, smoothstep(0.7, 0.95, dot(n, facet)));
  toEye = normalize(toEye);
  return normalize(n + max(1e-3 - dot(n, toEye), 0.0) * toEye);
}
