// Draws umbrellas and nodes. Points, triangles and lines are shaded by the same code, so that the switch between them
// does not show.
//
// Variants: POINTS; LINES, of which several copies lie side by side; SHADE_FRAGMENTS shades each fragment, in place of
// each vertex; BEHIND draws behind triangles; BACKS_BEHIND draws what turns its back to the eye behind its place;
// RESOLUTION tints by the size of the detail; SECTION cuts at a plane; SHADOWS tells fragments their place.
layout(location = 0) in vec3 a_position;
layout(location = 1) in vec4 a_normal;
layout(location = 2) in vec4 a_color;
uniform mat4 u_clip_from_scene;
uniform vec4 u_eye;                    // homogeneous: parallel rays come from a point at infinity
uniform bool u_two_sided;              // normals are turned towards the viewer
uniform float u_samples;               // samples that a length of 1 covers at depth 1
uniform float u_point_samples;         // samples that a point spans at least
uniform float u_closing;               // diameter at which points leave no hole, width at which lines do, scene units
uniform float u_back;                  // what turns its back is drawn so far behind its place, scene units
uniform float u_pixels;                // pixels that a length of 1 spans at depth 1
uniform float u_detail;                // size of the detail that is shown, scene units
// Triangles smaller than a pixel would be shaded from beyond their corners at the pixel's middle.
centroid out vec3 v_color;
#ifdef SHADE_FRAGMENTS
centroid out vec3 v_normal;
centroid out vec3 v_to_eye;
#endif
#ifdef SHADOWS
out vec3 v_place;                      // from the eye; in parallel views from the scene's zero
#endif
#ifdef SECTION
uniform vec4 u_section;
out float v_beyond;                    // above 0: cut away
#endif

#if defined(BEHIND) || defined(BACKS_BEHIND)
// How much farther from the eye than it is a vertex is drawn. Points and lines fill holes between triangles, and do not
// cover the triangles around, even where these are seen at a grazing angle. The far side of a thin wall does not cover
// the near side, where errors let it come through.
float offsetBehind(bool is_back) {
#ifdef BEHIND
  float behind = 3.0 * u_closing;
#else
  float behind = 0.0;
#endif
#ifdef BACKS_BEHIND
  if (is_back) behind += u_back;
#endif
  return behind;
}

// The depth of a place that is by this length farther from the eye. A place at the far plane stays within the picture.
float depthBehind(float offset, vec3 to_eye, float squared_distance) {
  vec4 behind = u_clip_from_scene * vec4(a_position - offset * inversesqrt(squared_distance) * to_eye, 1.0);
  if (gl_Position.w <= 0.0 || behind.w <= 0.0) return gl_Position.z;
  return max(gl_Position.z, min(behind.z / behind.w, 0.999999) * gl_Position.w);
}
#endif

// Away from the picture's middle a length covers more samples, by 1 / cos² of the angle.
float closingSamples(float squared_distance) {
  float depth = gl_Position.w;
  return u_closing * u_samples * (u_eye.w > 0.0 ? sqrt(squared_distance) / (depth * depth) : 1.0);
}

#ifdef LINES
uniform int u_copies;                  // of each line to either side of its place: of flat ones, then of steep ones
uniform vec2 u_sample_size;            // in clip space
// A line covers one sample in each column, or in each row if it is steep. Copies beside it, at most a sample apart,
// make it as wide as is needed. Those of flat lines lie above each other, those of steep ones side by side; every line
// gets both, as it may turn from one to the other in perspective.
vec2 copyOffset(float squared_distance) {
  if (u_copies == 1) return vec2(0.0);
  float half_width = 0.5 * clamp(closingSamples(squared_distance) - 1.0, 0.0, float(u_copies - 1));
  bool is_flat = gl_InstanceID < u_copies;
  float place = float(is_flat ? gl_InstanceID : gl_InstanceID - u_copies) / float(u_copies - 1);
  float offset = (2.0 * place - 1.0) * half_width;
  return (is_flat ? vec2(0.0, offset) : vec2(offset, 0.0)) * u_sample_size;
}
#endif

void main() {
  vec3 to_eye = u_eye.xyz - u_eye.w * a_position;
  vec3 normal = a_normal.xyz;
  float squared = max(dot(to_eye, to_eye), 1e-30);
  gl_Position = u_clip_from_scene * vec4(a_position, 1.0);
#ifdef SHADE_FRAGMENTS
  v_color = a_color.rgb;
  v_normal = normal;
  v_to_eye = to_eye;
#ifdef SHADOWS
  v_place = a_position - u_eye.w * u_eye.xyz;
#endif
#else
  // A vertex at the silhouette may lean away a little. If its normal were flipped, it would be lit from the wrong side,
  // and silhouettes would get dark fringes.
  float lean = dot(normal, to_eye);
  if (!u_two_sided && lean < 0.0) normal -= (lean / squared - 1e-3 * inversesqrt(squared)) * to_eye;
  v_color = shadeSurface(a_color.rgb, normal, to_eye);
#ifdef RESOLUTION
  v_color = tinted(v_color, gl_Position.w > 0.0 ? u_detail * u_pixels / gl_Position.w : 1e9);
#endif
#endif
#ifdef POINTS
  gl_PointSize = max(u_point_samples, closingSamples(squared));
#endif
#if defined(BEHIND) || defined(BACKS_BEHIND)
  float offset = offsetBehind(dot(normal, to_eye) < 0.0);
  if (offset > 0.0) gl_Position.z = depthBehind(offset, to_eye, squared);
#endif
#ifdef SECTION
  v_beyond = dot(u_section.xyz, a_position) - u_section.w;
#endif
#ifdef LINES
  gl_Position.xy += copyOffset(squared) * gl_Position.w;
#endif
}
