// At hard edges interpolated normals lean away from the eye. Turned over they would be lit from behind, so they lean no
// farther than to where a surface would vanish.
vec3 seenNormal(vec3 normal, vec3 facet, vec3 toEye) {
  vec3 e = normalize(toEye);
  float squared = dot(normal, normal);
  vec3 n = squared > 1e-12 ? normal * inversesqrt(squared) : e;
  if (dot(n, facet) * dot(e, facet) < 0.0) n = -n;
  return normalize(n + max(1e-3 - dot(n, e), 0.0) * e);
}
