// Points and triangles are shaded here, by the same code, so that the switch between them does not show.
//
// Variants: POINTS; RESOLUTION tints by the size of umbrellas; SECTION cuts at a plane.
layout(location = 0) in vec3 a_position;
layout(location = 1) in vec4 a_normal;
layout(location = 2) in vec4 a_color;
uniform mat4 u_clip_from_scene;
uniform vec4 u_eye;                    // homogeneous: parallel rays come from a point at infinity
uniform bool u_two_sided;              // normals are turned towards the viewer
uniform float u_samples;               // samples that a length of 1 covers at depth 1
uniform float u_point_samples;         // samples that a point spans at least
uniform float u_closing;               // diameter at which points leave no hole between them, scene units
uniform float u_pixels;                // pixels that a length of 1 spans at depth 1
uniform float u_diameter;              // of a mean umbrella, scene units
out vec3 v_color;
#ifdef SECTION
uniform vec4 u_section;
out float v_beyond;                    // above 0: cut away
#endif

void main() {
  vec3 to_eye = u_eye.xyz - u_eye.w * a_position;
  vec3 normal = a_normal.xyz;
  // A vertex at the silhouette may lean away a little. If its normal were flipped, it would be lit from the wrong side,
  // and silhouettes would get dark fringes.
  float squared = max(dot(to_eye, to_eye), 1e-30);
  float lean = dot(normal, to_eye);
  if (!u_two_sided && lean < 0.0) normal -= (lean / squared - 1e-3 * inversesqrt(squared)) * to_eye;
  v_color = shadeSurface(a_color.rgb, normal, to_eye);
  gl_Position = u_clip_from_scene * vec4(a_position, 1.0);
#ifdef RESOLUTION
  v_color = tinted(v_color, gl_Position.w > 0.0 ? u_diameter * u_pixels / gl_Position.w : 1e9);
#endif
#ifdef POINTS
  // Away from the picture's middle a length covers more samples, by 1 / cos² of the angle.
  float depth = gl_Position.w;
  float stretch = u_eye.w > 0.0 ? sqrt(squared) / (depth * depth) : 1.0;
  gl_PointSize = max(u_point_samples, u_closing * u_samples * stretch);
#endif
#ifdef SECTION
  v_beyond = dot(u_section.xyz, a_position) - u_section.w;
#endif
}
