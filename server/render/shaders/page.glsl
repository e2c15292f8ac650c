// The colour of a surface that has a page of texture, between the colours of its vertices.
in vec2 v_place;                       // 0..1 across the page
uniform sampler2D u_page;
uniform float u_last_level;            // the last mip level at which the page's charts are kept apart
vec3 pageColor(vec3 color) {
  // The level that a look-up of four samples along the longer axis takes. Beyond the last level texels would be too
  // fine, and the vertices' colours, which are means over the surface around them, are fine enough.
  vec2 size = vec2(textureSize(u_page, 0));
  vec2 dx = dFdx(v_place) * size, dy = dFdy(v_place) * size;
  float a = dot(dx, dx), b = dot(dy, dy);
  float level = 0.5 * log2(max(max(min(a, b), max(a, b) / 16.0), 1e-12));
  vec4 texel = texture(u_page, v_place);
#ifdef ALPHA
  if (texel.a < 0.5) discard;
#endif
  return mix(texel.rgb, color, clamp(level - u_last_level, 0.0, 1.0));
}
