// A round splat is a square across the ray through the sphere's centre. In this plane the cone of rays that touch the
// sphere cuts out a circle of radius R = r / sqrt(1 − r²/d²). The square around that circle covers the sphere's
// projection, and the circle is the projection, in any perspective. In a parallel view R = r.
//
// Variants: ROUND, FUZZY or ELLIPSE shape the splat; POINTS draws it as a GL point; RESOLUTION tints it by its size;
// SECTION cuts it at a plane. REACH is half the square's side in units of R. From sine_squared = WIDEST on, the splat
// is drawn as the whole picture.
layout(location = 0) in vec4 sphere;   // centre, radius
layout(location = 1) in uvec2 codes;   // normal code and flags, colour
uniform mat4 u_clip_from_scene;
uniform vec4 u_eye;                    // homogeneous: parallel rays come from a point at infinity
uniform vec3 u_up;                     // the picture's upward direction in the scene
uniform vec3 u_ray;                    // through the picture's middle
uniform vec3 u_ray_right;              // from there to the picture's right rim
uniform vec3 u_ray_up;                 // and to its upper rim
uniform float u_margin;                // added to a quad at depth 1, for what rasterisers may round off its corners
uniform float u_cells[52];             // tangents at the middles of the cells of a normal's face
uniform float u_pixels;                // pixels that a length of 1 spans at depth 1
uniform bool u_two_sided;
uniform float u_push;                  // depth is taken at a point this many radii behind the centre
uniform float u_rim;                   // and the rim's depth this many radii behind that
uniform float u_samples;               // samples that a length of 1 covers at depth 1
flat out vec3 v_color;
#ifdef RESOLUTION
flat out float v_hatched;              // 1 where finer splats are still to come, else 0
#endif
#ifndef POINTS
out vec3 v_place;                      // position on the splat, homogeneous; its outline is at distance 1
#endif
#ifdef ROUND
flat out vec2 v_depth;                 // window depth of the centre, and by how much the rim lies behind it
#endif
#ifdef SECTION
uniform vec4 u_section;
out float v_beyond;                    // above 0: cut away
#endif

const float kLast = 0.999999;          // just before the far plane's depth, with room for kStep
const float kPointMargin = 0.125;      // samples: u_margin at depth 1, plus the granularity of point sizes
const float kStep = 4e-7;              // more than two computations of the same depth may differ by

vec3 decodeNormal(uint code) {
  uint face = code / 2704u;
  float row = u_cells[(code / 52u) % 52u];
  float column = u_cells[code % 52u];
  float side = (face & 1u) == 0u ? 1.0 : -1.0;
  uint axis = face / 2u;
  vec3 n = axis == 0u ? vec3(side, row, column) : axis == 1u ? vec3(row, side, column) : vec3(row, column, side);
  return normalize(n);
}

vec3 surfaceColor() {
  return vec3(uvec3(codes.y >> 11, codes.y >> 5 & 63u, codes.y & 31u)) / vec3(31.0, 63.0, 31.0);
}

// Returns the depth of a point of the scene, clamped so that the point is never clipped.
float depthAt(vec3 point) {
  vec4 clip = u_clip_from_scene * vec4(point, 1.0);
  return clip.w > 0.0 ? clamp(clip.z / clip.w, -kLast, kLast) : -kLast;
}

void main() {
  vec3 center = sphere.xyz;
  float radius = sphere.w;
  vec3 to_eye = u_eye.xyz - u_eye.w * center;
  float squared = dot(to_eye, to_eye);
  vec3 towards = to_eye * inversesqrt(squared);
  vec3 normal = decodeNormal(codes.x & 0x3FFFu);
  // A part of every node that is drawn faces the eye, so a node that leans away on average is seen at its horizon. If
  // its normal were flipped, it would be lit from the wrong side, and silhouettes would get dark fringes.
  float lean = dot(normal, towards);
  if (!u_two_sided && lean < 0.0) normal -= (lean - 1e-3) * towards;
  v_color = shadeSurface(surfaceColor(), normal, to_eye);
#ifndef POINTS
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
#endif
  float depth = dot(vec4(u_clip_from_scene[0].w, u_clip_from_scene[1].w, u_clip_from_scene[2].w,
                         u_clip_from_scene[3].w), vec4(center, 1.0));
#ifdef RESOLUTION
  v_color = tinted(v_color, depth > 0.0 ? 2.0 * radius * u_pixels / depth : 1e9);
  v_hatched = float(codes.x >> 15);
#endif
  float margin = u_margin * max(depth, 0.0);
  // The step makes a splat whose depth is clamped lie behind its own first pass, too.
  float behind = u_push > 0.0 ? kStep : 0.0;
  float z = depthAt(center - u_push * radius * towards) + behind;

#ifdef ELLIPSE
  if (dot(normal, towards) < 0.0) normal = -normal;
  float facing = dot(normal, towards);
  vec3 across = normal - facing * towards;     // the minor axis as the eye sees it
  if (dot(across, across) < 1e-6) across = u_up - dot(u_up, towards) * towards;
  across = normalize(across);
  float ratio = max(facing, 0.1);
  vec3 major = cross(towards, across);
  vec3 minor = sqrt(1.0 - ratio * ratio) * towards - ratio * across;
  v_place = vec3(corner, 1.0);
  vec3 point = center + corner.x * (radius + margin) * major + corner.y * (radius + margin / ratio) * minor;
  gl_Position = u_clip_from_scene * vec4(point, 1.0);
#elif defined(POINTS)
  // The sphere's projection is an ellipse: its longer half axis, and the distance of its middle from the centre's
  // image.
  float beyond = 1.0 / (depth * depth - u_eye.w * radius * radius);
  float distance = u_eye.w > 0.0 ? sqrt(squared) : 1.0;
  float longer = radius * distance * beyond;
  float off = u_eye.w * radius * radius * beyond * distance / depth;
  gl_Position = u_clip_from_scene * vec4(center, 1.0);
  gl_Position.z = z * gl_Position.w;
  gl_PointSize = 2.0 * REACH * (u_samples * (longer + off) + kPointMargin);
  vec3 point = center;
#else
  float sine_squared = u_eye.w * radius * radius / squared;
  float stretch = inversesqrt(max(1.0 - sine_squared, 1e-6));
  vec3 right = normalize(cross(u_up, towards) + 1e-6 * u_ray_right);  // defined for rays straight up, too
  vec3 upwards = cross(towards, right);
  float reach = radius * stretch + margin;
  vec3 point = center + REACH * reach * (corner.x * right + corner.y * upwards);
  v_place = vec3(REACH * corner, 1.0);
  gl_Position = u_clip_from_scene * vec4(point, 1.0);
  gl_Position.z = z * gl_Position.w;
  if (sine_squared > WIDEST) {
    // The eye is so near that the square continues behind it: draw the whole picture and intersect its rays with the
    // square.
    vec3 ray = u_ray + corner.x * u_ray_right + corner.y * u_ray_up;
    v_place = vec3(dot(ray, right), dot(ray, upwards), -dot(ray, towards) * radius * stretch * inversesqrt(squared));
    gl_Position = vec4(corner, z, 1.0);
    point = center;
  }
  if (sine_squared > 0.999) {
    // The eye is inside the sphere, whose surface may be seen anywhere: draw it behind everything else.
    v_place = vec3(0.0, 0.0, 1.0);
    z = kLast + behind;
    gl_Position = vec4(corner, z, 1.0);
  }
#endif
#ifdef ROUND
  float rim = depthAt(center - (u_push + u_rim) * radius * towards) + behind;
  v_depth = vec2(0.5 + 0.5 * z, max(0.5 * (rim - z), 0.0));
#endif
#ifdef SECTION
  v_beyond = dot(u_section.xyz, point) - u_section.w;
#endif
}
