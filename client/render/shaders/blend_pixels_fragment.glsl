// Blends each pixel of the proxy's foremost surface once, as surface_fragment.glsl left it. Triangles may be smaller
// than pixels, and each would be blended for as many pixels as the GL shades at a time.
uniform highp usampler2D u_surface_depth;  // bits of floats; 0 where there is no surface
uniform sampler2D u_surface_color;
uniform sampler2D u_surface_normals;
uniform sampler2D u_surface_patch;
// 256 a row, of three texels each: typical errors of shape and colour, its first cell, how many samples may see it; the
// box's lower corner, cells along x + 8 × those along y; cells per scene unit, those along z.
uniform highp sampler2D u_patches;
uniform highp usampler2D u_cells;      // 256 a row: where its list begins, from the lowest byte, and the list's length
uniform highp usampler2D u_lists;      // 256 a row: indices of four samples
layout(location = 0) out vec4 o_color;     // of the images, and their share
layout(location = 1) out vec2 o_coverage;  // and 1 where what lies behind is wanted as well

int g_list;                            // where the place's list begins
int listed(int k) {
  int texel = g_list + (k >> 2);
  return int(texelFetch(u_lists, ivec2(texel & 255, texel >> 8), 0)[k & 3]);
}

// Finds the list of a place of a patch, and returns its length.
int findList(vec3 position, ivec2 number, int first) {
  vec4 begin = texelFetch(u_patches, ivec2(3 * number.x + 1, number.y), 0);
  vec4 per_unit = texelFetch(u_patches, ivec2(3 * number.x + 2, number.y), 0);
  ivec3 counts = ivec3(int(begin.w) & 7, int(begin.w) >> 3, int(per_unit.w));
  ivec3 at = clamp(ivec3(floor((position - begin.xyz) * per_unit.xyz)), ivec3(0), counts - 1);
  int cell = first + at.x + counts.x * (at.y + counts.y * at.z);
  uvec4 list = texelFetch(u_cells, ivec2(cell & 255, cell >> 8), 0);
  g_list = int(list.r | list.g << 8 | list.b << 16);
  return int(list.a);
}

// So many pixels behind or before the next one, a pixel shows the edge of something. A choice.
const float kEdgeDepth = 4.0;

// Whether samples of the pixel may show another surface than its middle does.
bool isEdge(ivec2 pixel, vec3 position, float size) {
  bool found = false;
  for (int i = 0; i < 4; ++i) {
    ivec2 beside = pixelBeside(pixel, i);
    float depth = uintBitsToFloat(texelFetch(u_surface_depth, beside, 0).r);
    found = found || distance(placeAt(beside, depth), position) > kEdgeDepth * size;
  }
  return found;
}

uniform float u_even_error;            // of BlendTuning

// Colours have eight bits here, whose steps would count for too much over triangles of more pixels.
const float kWidest = 8.0;

// Where the proxy's colours are even, as on a painted wall, they err less than those of their whole patch: by no more
// than this, twice what they differ over a triangle. That is the difference from the pixels beside this one, times as
// many pixels as a triangle spans.
float contrastAt(ivec2 pixel, Surface here, float size) {
  float squared = 0.0;
  for (int i = 0; i < 4; ++i) {
    ivec2 beside = pixelBeside(pixel, i);
    float depth = uintBitsToFloat(texelFetch(u_surface_depth, beside, 0).r);
    vec3 off = texelFetch(u_surface_color, beside, 0).rgb - here.shaded;
    if (distance(placeAt(beside, depth), here.position) <= kEdgeDepth * size) squared += dot(off, off) / 12.0;
  }
  return 2.0 * sqrt(squared) * clamp(here.edge / size, 1.0, kWidest);
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  highp uint bits = texelFetch(u_surface_depth, pixel, 0).r;
  vec2 ndc = gl_FragCoord.xy / u_viewport * 2.0 - 1.0;
  vec4 color = texelFetch(u_surface_color, pixel, 0);
  vec4 normals = texelFetch(u_surface_normals, pixel, 0);
  vec2 code = texelFetch(u_surface_patch, pixel, 0).rg;
  ivec2 number = ivec2(255.0 * code + 0.5);
  vec4 patch_here = texelFetch(u_patches, ivec2(3 * number.x, number.y), 0);

  Surface here;
  here.position = placeAt(pixel, uintBitsToFloat(bits));
  here.to_eye = towardsEye(here.position);
  here.normal = fromOctahedral(normals.xy);
  here.facet = fromOctahedral(normals.zw);
  here.shaded = color.rgb;
  here.edge = fromEdgeCode(color.a);
  float size = length(here.to_eye) / u_pixels_per_unit;
  float local = patch_here.y;
  // A share of the patch's error is always left, since detail that all triangles lack shows in none; all of it while
  // the proxy's shape is off by pixels, as when a scene arrives, and where it lacks a texture.
  float least = mix(u_even_error, 1.0, smoothstep(0.25, 1.0, patch_here.x / size)) * local;
  if (u_unlit && patch_here.x >= 0.0) local = clamp(contrastAt(pixel, here, size), least, local);
  int count = findList(here.position, number, int(patch_here.z));
  Blend blend = blendAt(here, ndc, vec3(patch_here.xy, local), bits != 0u ? count : 0, patch_here.w);
  // Beside a pixel without a surface nothing is known of the slope.
  float is_surface = bits != 0u ? 1.0 : 0.0;
  vec2 known = vec2(dFdx(is_surface) == 0.0, dFdy(is_surface) == 0.0);
  float covered = coverageOf(blend.kept, known * vec2(dFdx(blend.kept), dFdy(blend.kept)));
  // A carved pixel's neighbours tell the slope of the carving behind it.
  bool carved = covered < 1.0 || dFdx(covered) != 0.0 || dFdy(covered) != 0.0;
  bool edge = u_soft > 0.0 && isEdge(pixel, here.position, size);
  o_coverage = vec2(covered, carved || edge ? 1.0 : 0.0);
  o_color = vec4(blend.color, blend.share);
}
