uniform sampler2DArray u_color;
uniform int u_layer;
uniform vec4 u_background;
out vec4 o_color;
void main() {
  vec4 texel = texelFetch(u_color, ivec3(gl_FragCoord.xy, u_layer), 0);
  o_color = texel + (1.0 - texel.a) * u_background;
}
