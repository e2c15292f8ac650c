// A vertex at a hard edge has one normal for all sides, which leans away from each: the triangle's own takes its place
// by and by. It leans away from the eye no farther than to where a surface would vanish: turned over it would be lit
// from behind.
vec3 seenNormal(vec3 normal, vec3 facet, vec3 toEye) {
  vec3 e = normalize(toEye);
  vec3 f = facet * (dot(e, facet) < 0.0 ? -1.0 : 1.0) * inversesqrt(max(dot(facet, facet), 1e-30));
  float squared = dot(normal, normal);
  vec3 n = squared > 1e-12 ? normal * inversesqrt(squared) : f;
  float along = dot(n, f);
  n = mix(f, along < 0.0 ? -n : n, smoothstep(0.7, 0.95, abs(along)));
  return normalize(n + max(1e-3 - dot(n, e), 0.0) * e);
}
