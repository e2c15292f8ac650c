// With SHADOWS defined, for surfaces in a light that throws shadows.
uniform mat4 u_clip_from_scene;
uniform vec4 u_eye;                    // homogeneous: parallel rays come from a point at infinity
layout(location = 0) in vec3 position;
layout(location = 1) in vec3 normal;
layout(location = 2) in vec4 color;
#ifdef PAGES
uniform vec2 u_page_scale;             // from stored places to 0..1
layout(location = 3) in vec2 page_corner;
out vec2 v_place;
#endif
out vec3 v_position;
#ifdef SHADOWS
out vec3 v_from_eye;                   // the place, from the eye; in parallel views from the scene's zero
#endif
out vec3 v_normal;
out vec3 v_to_eye;
out vec3 v_color;
void main() {
  v_position = position;
#ifdef SHADOWS
  v_from_eye = position - u_eye.w * u_eye.xyz;
#endif
  v_normal = normal;
  v_to_eye = u_eye.xyz - u_eye.w * position;
  v_color = color.rgb;
#ifdef PAGES
  v_place = page_corner * u_page_scale;
#endif
  gl_Position = u_clip_from_scene * vec4(position, 1.0);
}
