// Adds a picture to a sum of bytes, or makes the sum a picture. Half floats hold whole numbers up to 2048, so sums of
// eight bytes are exact.
uniform sampler2D u_picture;
uniform float u_count;                 // pictures in the sum; 0: u_picture is added
out vec4 o_color;
// Less than an eighth of a byte's step: halves are rounded up, as a GL's own averages are.
const float kHalfUp = 1.0 / 4096.0;
void main() {
  vec4 texel = texelFetch(u_picture, ivec2(gl_FragCoord.xy), 0);
  o_color = u_count > 0.0 ? texel / (255.0 * u_count) + kHalfUp : floor(255.0 * texel + 0.5);
}
