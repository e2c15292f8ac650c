// A vertex at a hard edge has one normal for all sides, which leans away from each: the triangle's own takes its place.
// Before it is made a unit vector, the interpolated normal tells how far those of the corners lean: its part along the
// triangle's own is the mean of their cosines, so that all of a side whose corners lean alike is shaded alike. The
// normal leans away from the eye no farther than to where a surface would vanish: turned over it would be lit from
// behind.
const float kHard = 0.90, kSmooth = 0.985;

vec3 seenNormal(vec3 normal, vec3 facet, vec3 toEye) {
  float cosine = dot(normal, facet);
  vec3 n = normal * sign(cosine) * inversesqrt(max(dot(normal, normal), 1e-12));
  n = mix(facet, n, smoothstep(kHard, kSmooth, abs(cosine)));
  toEye = normalize(toEye);
  return normalize(n + max(1e-3 - dot(n, toEye), 0.0) * toEye);
}
