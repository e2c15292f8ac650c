// Makes the picture of what blend_pixels_fragment.glsl made: all of it, or only pixels whose samples show one surface,
// mostly by images, so that drawing the proxy need not shade these.
uniform bool u_insides;                // the second
uniform highp usampler2D u_layer_depth;
uniform mat4 u_clip_from_scene;
uniform sampler2D u_surface_color;     // shaded
uniform sampler2D u_surface_normals;
uniform sampler2D u_layer_color;       // of the images, and their share
uniform sampler2D u_layer_coverage;
out vec4 o_color;

// Where the proxy's own colour has more than the rest, its small triangles are averaged over the samples. A choice.
const float kMostlyImages = 0.5;
// So many pixels before the nearest that a pixel shows, so that no fragment of the same surface is before it. A choice.
const float kAhead = 0.5;

// Returns the least depth of the surface in a pixel, by those beside it.
float nearestAround(ivec2 pixel, float depth) {
  float nearest = depth;
  for (int i = 0; i < 4; ++i)
    nearest = min(nearest, 0.5 * (depth + uintBitsToFloat(texelFetch(u_layer_depth, pixelBeside(pixel, i), 0).r)));
  return nearest;
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  highp uint bits = texelFetch(u_layer_depth, pixel, 0).r;
  vec2 coverage = texelFetch(u_layer_coverage, pixel, 0).rg;
  if (bits == 0u || coverage.r <= 0.5) discard;
  vec4 blended = texelFetch(u_layer_color, pixel, 0);
  float depth = uintBitsToFloat(bits);
  if (u_insides) {
    if (coverage.r < 1.0 || coverage.g > 0.0 || blended.a < kMostlyImages) discard;
    float size = length(towardsEye(placeAt(pixel, depth))) / u_pixels_per_unit;
    depth = nearestAround(pixel, depth) - kAhead * size;
  }
  vec3 color = mix(texelFetch(u_surface_color, pixel, 0).rgb, blended.rgb, blended.a);
  vec3 normal = fromOctahedral(texelFetch(u_surface_normals, pixel, 0).xy);
  o_color = vec4(litByViewer(color, normal), 1.0);
  vec4 clip = u_clip_from_scene * vec4(placeAt(pixel, depth), 1.0);
  gl_FragDepth = 0.5 * clip.z / clip.w + 0.5;
}
