// Blends a fragment of the proxy by itself.
uniform ivec4 u_list[24];              // indices of the samples that may see the patch
uniform int u_count;                   // entries of u_list in use
uniform float u_patch_error;           // error of the patch being drawn, pixels
uniform vec2 u_proxy_error;            // its typical errors: of shape, scene units; of colour, 0..1
uniform bool u_fill;
uniform vec4 u_background;
uniform bool u_show_disagreement;      // tints by how many times their expected error the images differ

out vec4 o_color;

int listed(int k) {
  return u_list[k >> 2][k & 3];
}

void main() {
  if (isCutAway(v_position)) discard;
  if (u_cut_open && !gl_FrontFacing) {
    o_color = vec4(u_section_color, 1.0);
    return;
  }

  Surface here = surfaceHere();
  vec2 view_ndc = gl_FragCoord.xy / u_viewport * 2.0 - 1.0;
  Blend blend = blendAt(here, view_ndc, u_proxy_error.xyy, u_count, float(u_count));
  float covered = coverageOf(blend.kept, vec2(dFdx(blend.kept), dFdy(blend.kept)));
  if (covered <= 0.0) discard;

  vec3 color = mix(here.shaded, blend.color, blend.share);
  if (!u_fill) {
    if (blend.seen <= 0.0) discard;
    color = mix(u_background.rgb, blend.color, blend.seen);
  }
  color = litByViewer(color, here.normal);
  if (u_show_resolution || u_show_disagreement) {
    float shown = mix(u_patch_error, exp2(blend.octaves), u_fill ? blend.share : blend.seen);
    if (u_show_disagreement) shown = blend.seen * sqrt(blend.disagreement);
    color = tinted(color, shown);
  }
  o_color = vec4(color, covered);
}
