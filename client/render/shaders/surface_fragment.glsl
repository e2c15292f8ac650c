// Keeps the proxy's foremost surface for blend_pixels_fragment.glsl, or the one behind it where that is seen, too:
// where the foremost is carved or has its edge.
uniform vec2 u_patch;                  // low and high byte of the patch's place in the draw order, over 255
uniform vec2 u_inside;                 // the same of insides that a section exposes, which no image sees
uniform bool u_behind;
uniform highp usampler2D u_front_depth;
uniform sampler2D u_front_coverage;
layout(location = 0) out vec4 o_color;     // shaded; code of the edge
layout(location = 1) out vec4 o_normals;   // codes of the normal and the facet's
layout(location = 2) out vec2 o_patch;
layout(location = 3) out highp uint o_depth;     // bits of a float, since 24 bits of the depth buffer are too coarse

void main() {
  if (isCutAway(v_position)) discard;
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float depth = depthOf(v_position);
  if (u_behind) {
    if (depth <= uintBitsToFloat(texelFetch(u_front_depth, pixel, 0).r)) discard;
    // Behind an edge, the far side of what has the edge is seen nowhere.
    if (texelFetch(u_front_coverage, pixel, 0).r >= 1.0 && !gl_FrontFacing) discard;
  }
  Surface here = surfaceHere();
  bool inside = u_cut_open && !gl_FrontFacing;
  o_color = vec4(inside ? u_section_color : here.shaded, edgeCode(here.edge));
  o_normals = vec4(octahedral(here.normal), octahedral(here.facet));
  o_patch = inside ? u_inside : u_patch;
  o_depth = floatBitsToUint(depth);
}
