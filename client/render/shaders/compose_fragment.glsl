// Makes the picture of what blend_pixels_fragment.glsl made, one sample a pixel.
uniform highp sampler2D u_front_depth;
uniform sampler2D u_surface_color;     // shaded
uniform sampler2D u_front_color;       // of the images, and their share
uniform sampler2D u_front_coverage;
out vec4 o_color;
void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  float depth = texelFetch(u_front_depth, pixel, 0).r;
  if (depth >= 1.0 || texelFetch(u_front_coverage, pixel, 0).r <= 0.5) discard;
  vec4 blended = texelFetch(u_front_color, pixel, 0);
  o_color = vec4(mix(texelFetch(u_surface_color, pixel, 0).rgb, blended.rgb, blended.a), 1.0);
  gl_FragDepth = depth;
}
