// The slope of depth along x and y, in normalized device coordinates, of the plane through the place at `clip` in two
// directions of the scene. 0 for a plane that is seen from its edge.
vec2 depthSlope(mat4 clip_from_scene, vec4 clip, vec3 along, vec3 across) {
  vec3 at = clip.xyz / clip.w;
  vec4 a = clip_from_scene * vec4(along, 0.0);
  vec4 b = clip_from_scene * vec4(across, 0.0);
  vec3 p = a.xyz - at * a.w;
  vec3 q = b.xyz - at * b.w;
  float area = p.x * q.y - p.y * q.x;
  return abs(area) > 1e-30 ? vec2(p.z * q.y - q.z * p.y, p.x * q.z - q.x * p.z) / area : vec2(0.0);
}
