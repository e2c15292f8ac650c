// The proxy's surface at a fragment.
in vec3 v_position;
centroid in vec3 v_place;              // where the fragment covers its pixel
centroid in vec3 v_normal;
centroid in vec3 v_color;
centroid in float v_edge;              // scene units between the proxy's vertices
Surface surfaceHere() {
  Surface here;
  here.position = v_position;
  here.to_eye = towardsEye(v_position);
  vec3 facet = cross(dFdx(v_position), dFdy(v_position));
  if (dot(facet, here.to_eye) < 0.0) facet = -facet;
  here.facet = facet * inversesqrt(max(dot(facet, facet), 1e-30));
  here.normal = seenNormal(v_normal, here.facet, here.to_eye);
  here.shaded = shadeSurface(v_color, here.normal, here.to_eye);
  here.edge = v_edge;
  return here;
}
