// The view that is drawn.
uniform vec4 u_eye;                    // homogeneous; parallel views: w is 0, xyz the rays' direction, distances are 1
uniform vec2 u_viewport;               // pixels
uniform float u_pixels_per_unit;       // the view's pixels per scene unit, at distance 1
uniform vec3 u_forward;                // unit, into the scene; depths are measured along it from the eye
uniform mat3 u_rays_from, u_rays_along;  // origins and steps of depth of rays, for (1, pixel −1..1)

// A place of the proxy's surface.
struct Surface {
  vec3 position;
  vec3 to_eye;                         // of any length
  vec3 normal;                         // unit, on the side that the viewer sees
  vec3 facet;                          // the triangle's own, likewise
  vec3 shaded;                         // colour without images
  float edge;                          // scene units between the proxy's vertices
};
float depthOf(vec3 position) {
  return dot(position - u_rays_from[0], u_forward);
}
vec3 placeAt(ivec2 pixel, float depth) {
  vec3 at = vec3(1.0, (vec2(pixel) + 0.5) / u_viewport * 2.0 - 1.0);
  return u_rays_from * at + depth * (u_rays_along * at);
}
// Returns the pixel right, left, above or below, by i = 0..3, or the pixel itself at the picture's border.
ivec2 pixelBeside(ivec2 pixel, int i) {
  ivec2 beside = pixel + ivec2(1 - (i >> 1), i >> 1) * (1 - 2 * (i & 1));
  return clamp(beside, ivec2(0), ivec2(u_viewport) - 1);
}
vec3 towardsEye(vec3 position) {
  return u_eye.xyz - u_eye.w * position;
}
