// Draws the proxy with what blend_pixels_fragment.glsl made of its pixels. A fragment takes what its own pixel's middle
// shows, or a pixel beside it, where that is the same place of the surface; else it has the proxy's own colour. So
// edges are as sharp as the picture's samples, and nothing is blended twice.
uniform highp usampler2D u_front_depth;
uniform sampler2D u_front_color;       // of the images, and their share
uniform sampler2D u_front_coverage;
uniform highp usampler2D u_back_depth;  // the same of what is seen where the front is carved, or beside its edge
uniform sampler2D u_back_color;
uniform sampler2D u_back_coverage;
out vec4 o_color;

// So many pixels apart, a fragment and its pixel's middle are one place, or a fragment and the middle of a pixel beside
// it. Measured best: docs/decisions/blend-once.md.
const float kSamePlace = 4.0;
const float kBeside = 1.0;
// So near, a fragment is carved as the pixel is. A choice.
const float kCarvedAlike = 16.0;

// Where the fragment covers its pixel: within half a pixel of its middle each way. llvmpipe (Mesa 22.3) takes it some
// pixels away at times, which left dashed lines without images along the edges of large triangles.
vec3 placeHere() {
  float reach = 0.51 * (length(dFdx(v_position)) + length(dFdy(v_position)));
  return distance(v_place, v_position) <= reach ? v_place : v_position;
}

// Returns by how many pixels the place lies off what the middle of a pixel shows, whose depth has these bits.
float offPixel(vec3 place, ivec2 pixel, highp uint bits) {
  float size = length(towardsEye(place)) / u_pixels_per_unit;
  return bits != 0u ? distance(placeAt(pixel, uintBitsToFloat(bits)), place) / size : 1e9;
}

// Returns the pixel to the right or left (axis 0), above or below (1), on whose side of the middle the place lies.
ivec2 pixelTowards(ivec2 pixel, vec3 place, int axis) {
  vec3 step = axis == 0 ? dFdx(v_position) : dFdy(v_position);
  return pixelBeside(pixel, 2 * axis + (dot(place - v_position, step) > 0.0 ? 0 : 1));
}

void main() {
  if (isCutAway(v_position)) discard;
  if (u_cut_open && !gl_FrontFacing) {
    o_color = vec4(u_section_color, 1.0);
    return;
  }
  vec4 blended = vec4(0.0);
  float covered = 1.0;
  vec3 place = placeHere();
  ivec2 here = ivec2(gl_FragCoord.xy);
  ivec2 front = here;
  float front_off = offPixel(place, here, texelFetch(u_front_depth, here, 0).r);
  float back_off = offPixel(place, here, texelFetch(u_back_depth, here, 0).r);
  float limit = kSamePlace;
  if (min(front_off, back_off) >= kSamePlace) {
    for (int axis = 0; axis < 2; ++axis) {
      ivec2 beside = pixelTowards(here, place, axis);
      float off = offPixel(place, beside, texelFetch(u_front_depth, beside, 0).r);
      if (off < front_off) front = beside;
      front_off = min(off, front_off);
    }
    limit = kBeside;
  }
  float off = min(front_off, back_off);
  if (off < kCarvedAlike) {
    bool is_front = front_off < kSamePlace || front_off <= back_off;
    covered = is_front ? texelFetch(u_front_coverage, front, 0).r : texelFetch(u_back_coverage, here, 0).r;
    if (off < limit)
      blended = is_front ? texelFetch(u_front_color, front, 0) : texelFetch(u_back_color, here, 0);
  }
  if (covered <= 0.0) discard;
  Surface surface = surfaceHere();
  o_color = vec4(litByViewer(mix(surface.shaded, blended.rgb, blended.a), surface.normal), covered);
}
