// Blends each pixel of the proxy's foremost surface once, as surface_fragment.glsl left it. Triangles may be smaller
// than pixels, and each would be blended for as many pixels as the GL shades at a time.
uniform highp sampler2D u_surface_depth;
uniform sampler2D u_surface_color;
uniform sampler2D u_surface_normals;
uniform sampler2D u_surface_patch;
uniform highp sampler2D u_patches;     // 256 a row: typical errors of shape and colour, row of its list, entries in use
uniform highp usampler2D u_lists;      // 8 a row, of 24 texels each: indices of samples
uniform mat4 u_scene_from_clip;
layout(location = 0) out vec4 o_color;     // of the images, and their share
layout(location = 1) out float o_coverage;

ivec2 g_list;
int listed(int k) {
  return int(texelFetch(u_lists, g_list + ivec2(k >> 2, 0), 0)[k & 3]);
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float depth = texelFetch(u_surface_depth, pixel, 0).r;
  vec2 ndc = gl_FragCoord.xy / u_viewport * 2.0 - 1.0;
  vec4 place = u_scene_from_clip * vec4(ndc, 2.0 * depth - 1.0, 1.0);
  vec4 color = texelFetch(u_surface_color, pixel, 0);
  vec4 normals = texelFetch(u_surface_normals, pixel, 0);
  vec2 code = texelFetch(u_surface_patch, pixel, 0).rg;
  ivec2 number = ivec2(255.0 * code + 0.5);
  vec4 patch_here = texelFetch(u_patches, number, 0);
  int row = int(patch_here.z);
  g_list = ivec2((row & 7) * 24, row >> 3);

  Surface here;
  here.position = place.xyz / place.w;
  here.to_eye = towardsEye(here.position);
  here.normal = fromOctahedral(normals.xy);
  here.facet = fromOctahedral(normals.zw);
  here.shaded = color.rgb;
  here.edge = fromEdgeCode(color.a);
  Blend blend = blendAt(here, ndc, patch_here.xy, depth < 1.0 ? int(patch_here.w) : 0);
  // Beside a pixel without a surface nothing is known of the slope.
  float is_surface = depth < 1.0 ? 1.0 : 0.0;
  vec2 known = vec2(dFdx(is_surface) == 0.0, dFdy(is_surface) == 0.0);
  o_coverage = coverageOf(blend.kept, known * vec2(dFdx(blend.kept), dFdy(blend.kept)));
  o_color = vec4(blend.color, blend.share);
}
