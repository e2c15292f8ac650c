// Unlit colours need neither normals nor the direction to the eye. Software GL pays for each value that is carried to
// the fragments: leaving them out saves a sixth of the time of a scan whose triangles are about as small as pixels.
uniform mat4 u_clip_from_scene;
layout(location = 0) in vec3 position;
layout(location = 2) in vec4 color;
out vec3 v_color;
void main() {
  v_color = color.rgb;
  gl_Position = u_clip_from_scene * vec4(position, 1.0);
}
