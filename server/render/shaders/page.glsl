// The colour of a surface that has a page of texture, between the colours of its vertices.
in vec2 v_place;                       // 0..1 across the page
uniform sampler2D u_page;
uniform vec2 u_page_size;              // texels of the level that look-ups begin with
uniform float u_last_level;            // the last level from there at which the page's charts are kept apart
vec3 pageColor(vec3 color) {
  // A pixel's footprint on the page is longer along one axis: up to four trilinear look-ups lie along it, and the level
  // is that of the shorter one. The anisotropic filter of software GL is three times slower, and blurs by 8 dB.
  vec2 dx = dFdx(v_place) * u_page_size, dy = dFdy(v_place) * u_page_size;
  float a = dot(dx, dx), b = dot(dy, dy);
  vec2 axis = (a > b ? dx : dy) / u_page_size;
  float longer = max(a, b);
  float level = 0.5 * log2(max(max(min(a, b), longer / 16.0), 1e-12));
  // Texels that are larger than the footprint need one look-up, and square footprints too.
  int count = int(clamp(ceil(sqrt(longer / max(min(a, b), 1.0))), 1.0, 4.0));
  vec4 texel = vec4(0.0);
  for (int k = 0; k < count; ++k)
    texel += textureLod(u_page, v_place + ((float(k) + 0.5) / float(count) - 0.5) * axis, level);
  texel /= float(count);
#ifdef ALPHA
  if (texel.a < 0.5) discard;
#endif
  // Beyond the last level texels would be too fine, and the vertices' colours, which are means over the surface around
  // them, are fine enough.
  return mix(texel.rgb, color, clamp(level - u_last_level, 0.0, 1.0));
}
