// Unlit colours need neither normals nor the direction to the eye. Software GL pays for each value that is carried to
// the fragments: leaving them out saves a sixth of the time of a scan whose triangles are about as small as pixels.
uniform mat4 u_clip_from_scene;
layout(location = 0) in vec3 position;
layout(location = 2) in vec4 color;
#ifdef PAGES
uniform vec2 u_page_scale;             // from stored places to 0..1
layout(location = 3) in vec2 page_corner;
out vec2 v_place;
#endif
out vec3 v_color;
void main() {
  v_color = color.rgb;
#ifdef PAGES
  v_place = page_corner * u_page_scale;
#endif
  gl_Position = u_clip_from_scene * vec4(position, 1.0);
}
