// Keeps the proxy's foremost surface for blend_pixels_fragment.glsl, or the one behind it where that is carved.
uniform vec2 u_patch;                  // low and high byte of the patch's place in the draw order, over 255
uniform vec2 u_inside;                 // the same of insides that a section exposes, which no image sees
uniform bool u_behind;
uniform highp sampler2D u_front_depth;
uniform sampler2D u_front_coverage;
layout(location = 0) out vec4 o_color;     // shaded; code of the edge
layout(location = 1) out vec4 o_normals;   // codes of the normal and the facet's
layout(location = 2) out vec2 o_patch;

// Depths of one fragment differ by no more: a few steps of 24 bits.
const float kSameDepth = 4e-7;

// Whether the front is carved in this pixel, or in one of those that tell the slope of its carving from pixel to pixel.
bool isFrontCarved(ivec2 pixel) {
  ivec2 beside = min(pixel ^ 1, textureSize(u_front_coverage, 0) - 1);
  float least = min(texelFetch(u_front_coverage, ivec2(beside.x, pixel.y), 0).r,
                    texelFetch(u_front_coverage, ivec2(pixel.x, beside.y), 0).r);
  return min(least, texelFetch(u_front_coverage, pixel, 0).r) < 1.0;
}

void main() {
  if (isCutAway(v_position)) discard;
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  if (u_behind && (gl_FragCoord.z <= texelFetch(u_front_depth, pixel, 0).r + kSameDepth || !isFrontCarved(pixel)))
    discard;
  Surface here = surfaceHere();
  bool inside = u_cut_open && !gl_FrontFacing;
  o_color = vec4(inside ? u_section_color : here.shaded, edgeCode(here.edge));
  o_normals = vec4(octahedral(here.normal), octahedral(here.facet));
  o_patch = inside ? u_inside : u_patch;
}
