// A share of a picture.
uniform sampler2D u_picture;
uniform float u_share;
out vec4 o_color;
void main() {
  o_color = u_share * texelFetch(u_picture, ivec2(gl_FragCoord.xy), 0);
}
