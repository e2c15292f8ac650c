// Draws casters into a layer of a shadow map.
layout(location = 0) in vec3 a_position;
uniform mat4 u_clip_from_scene;
void main() {
  gl_Position = u_clip_from_scene * vec4(a_position, 1.0);
}
