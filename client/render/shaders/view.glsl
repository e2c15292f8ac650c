// The view that is drawn.
uniform vec4 u_eye;                    // homogeneous; parallel views: w is 0, xyz the rays' direction, distances are 1
uniform vec2 u_viewport;               // pixels
uniform float u_pixels_per_unit;       // the view's pixels per scene unit, at distance 1

// A place of the proxy's surface.
struct Surface {
  vec3 position;
  vec3 to_eye;                         // of any length
  vec3 normal;                         // unit, on the side that the viewer sees
  vec3 facet;                          // the triangle's own, likewise
  vec3 shaded;                         // colour without images
  float edge;                          // scene units between the proxy's vertices
};
vec3 towardsEye(vec3 position) {
  return u_eye.xyz - u_eye.w * position;
}
