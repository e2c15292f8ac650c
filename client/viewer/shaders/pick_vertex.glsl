layout(location = 0) in vec3 a_position;
uniform mat4 u_clip_from_scene;
uniform vec4 u_depth_from_scene;       // gives the distance from the eye along the view axis
out highp float v_eye_depth;
out highp vec3 v_position;
void main() {
  gl_Position = u_clip_from_scene * vec4(a_position, 1.0);
  v_eye_depth = dot(u_depth_from_scene, vec4(a_position, 1.0));
  v_position = a_position;
}
