// Lets pixels pass where what lies behind the foremost surface is wanted as well.
uniform sampler2D u_front_coverage;
void main() {
  if (texelFetch(u_front_coverage, ivec2(gl_FragCoord.xy), 0).g <= 0.0) discard;
}
