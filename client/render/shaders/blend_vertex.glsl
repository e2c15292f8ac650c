layout(location = 0) in vec3 a_position;
layout(location = 1) in vec4 a_normal;   // w: how finely the surface is sampled here (lod/draw/triangles.h)
layout(location = 2) in vec4 a_color;
uniform mat4 u_clip_from_scene;
uniform vec2 u_edge;                   // length of a lattice step; octaves per unit of a_normal.w
// A triangle smaller than a pixel mostly misses the pixel's middle. With several samples a pixel its values are taken
// where it covers the pixel, since extrapolated to the middle they would be far off. Its plane is not, and images are
// looked up at the middle, since the mean of many places would blur them.
centroid out float v_edge;
out vec3 v_position;
centroid out vec3 v_normal;
centroid out vec3 v_color;
centroid out vec3 v_place;
void main() {
  float squared = dot(a_normal.xyz, a_normal.xyz);
  v_edge = u_edge.x * exp2(u_edge.y * a_normal.w);
  v_position = a_position;
  v_place = a_position;
  v_normal = squared > 0.0 ? a_normal.xyz * inversesqrt(squared) : vec3(0.0);
  v_color = a_color.rgb;
  gl_Position = u_clip_from_scene * vec4(v_position, 1.0);
}
