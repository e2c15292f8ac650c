// Divides sums of fuzzy splats by the sum of their opacities and enlarges pictures that were drawn with fewer samples.
uniform highp sampler2D u_sums;
uniform highp sampler2D u_depth;
uniform vec2 u_scale;  // from pixels of the target to texture coordinates of the canvas
uniform vec2 u_last;   // the middle of the last sample that was drawn on the canvas
layout(location = 0) out vec4 out_color;
void main() {
  vec2 at = min(gl_FragCoord.xy * u_scale, u_last);
  vec4 sum = texture(u_sums, at);
  if (sum.a < 1.0 / 512.0) discard;
  out_color = vec4(sum.rgb / sum.a, min(sum.a, 1.0));
  // At soft edges only the splats' colour is known, so the depth is taken as it is.
  gl_FragDepth = min(texture(u_depth, at).r, 0.9999998);
}
