// Makes the picture of what blend_pixels_fragment.glsl made, one sample a pixel.
uniform highp usampler2D u_layer_depth;
uniform mat4 u_clip_from_scene;
uniform sampler2D u_surface_color;     // shaded
uniform sampler2D u_surface_normals;
uniform sampler2D u_layer_color;       // of the images, and their share
uniform sampler2D u_layer_coverage;
out vec4 o_color;
void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  highp uint bits = texelFetch(u_layer_depth, pixel, 0).r;
  if (bits == 0u || texelFetch(u_layer_coverage, pixel, 0).r <= 0.5) discard;
  vec4 blended = texelFetch(u_layer_color, pixel, 0);
  vec3 place = placeAt(pixel, uintBitsToFloat(bits));
  vec3 color = mix(texelFetch(u_surface_color, pixel, 0).rgb, blended.rgb, blended.a);
  vec3 normal = fromOctahedral(texelFetch(u_surface_normals, pixel, 0).xy);
  o_color = vec4(litByViewer(color, normal), 1.0);
  vec4 clip = u_clip_from_scene * vec4(place, 1.0);
  gl_FragDepth = 0.5 * clip.z / clip.w + 0.5;
}
