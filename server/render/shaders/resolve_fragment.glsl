// Averages a pixel's samples: colour over the covered ones, alpha is their share.
// SUPERSAMPLING: samples of a pixel along each side.
uniform sampler2D u_samples;
layout(location = 0) out vec4 out_color;
void main() {
  ivec2 first = ivec2(gl_FragCoord.xy) * SUPERSAMPLING;
  vec3 color = vec3(0.0);
  float covered = 0.0;
  for (int y = 0; y < SUPERSAMPLING; ++y)
    for (int x = 0; x < SUPERSAMPLING; ++x) {
      vec4 texel = texelFetch(u_samples, first + ivec2(x, y), 0);
      color += texel.rgb * texel.a;
      covered += texel.a;
    }
  out_color = vec4(color / max(covered, 1e-3), covered / float(SUPERSAMPLING * SUPERSAMPLING));
}
