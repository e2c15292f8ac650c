in vec3 v_position;
in vec3 v_normal;
in vec3 v_to_eye;
vec3 seenNormalHere() {
  vec3 facet = cross(dFdx(v_position), dFdy(v_position));
  if (dot(facet, v_to_eye) < 0.0) facet = -facet;
  return seenNormal(v_normal, facet * inversesqrt(max(dot(facet, facet), 1e-30)), v_to_eye);
}
