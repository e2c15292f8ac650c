in vec3 v_position;
in vec3 v_normal;
in vec3 v_to_eye;
vec3 seenNormalHere() {
  return seenNormal(v_normal, cross(dFdx(v_position), dFdy(v_position)), v_to_eye);
}
