// Averages a pixel's samples: colour over the covered ones, alpha is their share.
uniform sampler2D u_samples;
uniform int u_supersampling;
layout(location = 0) out vec4 out_color;
void main() {
  ivec2 first = ivec2(gl_FragCoord.xy) * u_supersampling;
  vec3 color = vec3(0.0);
  float covered = 0.0;
  for (int y = 0; y < u_supersampling; ++y)
    for (int x = 0; x < u_supersampling; ++x) {
      vec4 texel = texelFetch(u_samples, first + ivec2(x, y), 0);
      color += texel.rgb * texel.a;
      covered += texel.a;
    }
  out_color = vec4(color / max(covered, 1e-3), covered / float(u_supersampling * u_supersampling));
}
