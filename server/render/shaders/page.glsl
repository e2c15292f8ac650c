// The colour of a surface that has a page of texture, between the colours of its vertices.
in vec2 v_place;                       // 0..1 across the page
uniform sampler2D u_page;
uniform vec2 u_page_size;              // texels of the level that look-ups begin with
uniform float u_last_level;            // the last level from there at which the page's charts are kept apart
vec3 pageColor(vec3 color) {
  // A pixel's footprint on the page is longer along one axis: up to four look-ups lie along it, and the level is that
  // of the shorter one. The anisotropic filter of software GL is three times slower, and blurs by 8 dB.
  vec2 across = dFdx(v_place), down = dFdy(v_place);
  vec2 dx = across * u_page_size, dy = down * u_page_size;
  float a = dot(dx, dx), b = dot(dy, dy);
  float longer = max(a, b), shorter = min(a, b);
  // Half of the binary logarithm, straight between powers of two, as a float's bits are, and so up to 0.05 low. The
  // nearest level is the exact one's all the same, since it changes at powers of two.
  float texels = max(max(shorter, longer / 16.0), 1e-12);
  float level = float(floatBitsToInt(texels)) * (0.5 / 8388608.0) - 63.5;
  // Texels that are larger than the footprint need one look-up, and square footprints too, those included that are up
  // to a tenth longer: two would blur them. Others need as many as the axis is longer, rounded up.
  float square = max(shorter, 1.0);
  float count = 1.0 + float(longer > 1.21 * square) + float(longer > 4.0 * square) + float(longer > 9.0 * square);
  float share = 1.0 / count;
  vec2 between = (a > b ? across : down) * share;
  vec2 at = v_place - 0.5 * (count - 1.0) * between;
  vec4 texel = vec4(0.0);
  // The end is asked for behind a look-up: software GL makes one more, unseen, where a loop begins with it.
  float left = count;
  do {
    texel += textureLod(u_page, at, level);
    at += between;
    left -= 1.0;
  } while (left > 0.0);
  texel *= share;
#ifdef ALPHA
  if (texel.a < 0.5) discard;
#endif
  // Beyond the last level texels would be too fine, and the vertices' colours, which are means over the surface around
  // them, are fine enough.
  return mix(texel.rgb, color, clamp(level - u_last_level, 0.0, 1.0));
}
