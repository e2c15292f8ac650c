// Draws casters into a layer of a shadow map: triangles and, as LINES, the edges where cracks may open. closing.glsl
// and depth_slope.glsl come before.
layout(location = 0) in vec3 a_position;
uniform mat4 u_clip_from_scene;
#ifdef LINES
layout(location = 1) in vec4 a_normal;
#endif
void main() {
  gl_Position = u_clip_from_scene * vec4(a_position, 1.0);
#ifdef LINES
  // A line is wider than the edge, so it lies as deep as the triangle's plane does anywhere in its width. Otherwise it
  // would throw a shadow on the surface beside it.
  vec3 normal = normalize(a_normal.xyz);
  vec3 along = normalize(cross(normal, abs(normal.x) < 0.6 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0)));
  vec2 slope = depthSlope(u_clip_from_scene, gl_Position, along, cross(normal, along));
  vec3 to_eye = u_eye.xyz - u_eye.w * a_position;
  vec2 offset = copyOffset(max(dot(to_eye, to_eye), 1e-30));
  gl_Position.xy += offset * gl_Position.w;
  gl_Position.z += dot(abs(slope), abs(offset) + u_sample_size) * gl_Position.w;
#endif
}
