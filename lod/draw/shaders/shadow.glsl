// Shades a surface in the light whose shadow maps lie in LAYERS layers of a texture: one for a hard shadow, one for
// each sample of an area light.
//
// All layers are sheared copies of one view from the light's middle. Depth is the same in all of them, and x and y move
// in proportion to the distance in depth from a plane amid the receivers. This holds in parallel and in perspective
// views, for the reciprocal of the distance from the light is linear in depth.
//
// Casters lie deeper than they are by what their slope makes of a texel, so that no texel hides the surface beside it.
uniform sampler2DArrayShadow u_shadow_map;
uniform sampler2DArray u_shadow_depth; // the same texture, not compared
uniform mat4 u_map_from_place;         // of the light's middle; clip coordinates
uniform vec4 u_light;                  // homogeneous: parallel rays come from a point at infinity
uniform float u_depth_per_length;      // along the view from the light, at distance 1
uniform float u_reach;                 // how far the surface here and that of its casters may be apart, scene units
uniform bool u_one_of_several;         // the surface lies in several maps: what this one does not hold is not drawn
uniform vec4 u_slice[2];               // planes between which the places are that the map is for
uniform vec2 u_used_half;              // half the share of the texture that is used
uniform float u_middle;                // depth of the plane that does not move
uniform vec2 u_window;                 // size of what the light's middle sees in a layer, a share of the layer's
uniform vec4 u_layers[LAYERS];         // shear by depth in x and y; cosine and sine of a turn, another for each layer
uniform vec2 u_cell;                   // shear of the radius of a sample's share of the light

// Planes at a flatter angle to the light are biased less than they should be. They are hardly lit.
const float kFlattest = 0.02;
// The least cosine to the viewer of normals of what is seen. At silhouettes they lean away a little, and would be lit
// from the wrong side if they were turned.
const float kMostLean = -0.3;
// Triangles that face the light less than this have none, whatever their normals say. Below 0, or the triangles of a
// smooth surface would show where the light ends.
const float kTurnedAway = -0.1;
// Slivers that stand upright on the surface say nothing of its side.
const float kLeastAgreement = 0.3;
// Rounding of depths.
const float kDepthStep = 1e-6;

// The slope of depth along x and y, in normalized device coordinates, of the plane through the place at `clip` in two
// directions of the scene. 0 for a plane that is seen from its edge.
vec2 depthSlope(vec4 clip, vec3 along, vec3 across) {
  vec3 at = clip.xyz / clip.w;
  vec4 a = u_map_from_place * vec4(along, 0.0);
  vec4 b = u_map_from_place * vec4(across, 0.0);
  vec3 p = a.xyz - at * a.w;
  vec3 q = b.xyz - at * b.w;
  float area = p.x * q.y - p.y * q.x;
  return abs(area) > 1e-30 ? vec2(p.z * q.y - q.z * p.y, p.x * q.z - q.x * p.z) / area : vec2(0.0);
}

vec3 inTexture(vec2 at, float layer) {
  return vec3(u_used_half * (at + 1.0), layer);
}

float isLit(vec2 at, float layer, float depth) {
  vec3 place = inTexture(at, layer);
  return texture(u_shadow_map, vec4(place, 0.5 + 0.5 * depth));
}

#if LAYERS == 1
float litShare(vec3 at, vec2 slope, float bias) {
  return isLit(at.xy, 0.0, at.z - bias);
}
#else
// A share of the radius of a sample's share of the light. More shows as noise, less as steps; with 0.3 pictures are as
// near to the truth as with 0 (tests/lod/draw/shadow_map_test.cpp).
const float kSpread = 0.3;

// A number in 0 … 1 for each pixel, such that those of neighbours differ (Jimenez 2014, "Next generation post
// processing in Call of Duty: Advanced Warfare", interleaved gradient noise).
float noise(vec2 pixel) {
  return fract(52.9829189 * fract(dot(pixel, vec2(0.06711056, 0.00583715))));
}

// The share of the light that is seen. In each pixel each sample lies somewhere else in its share of the light, so that
// no steps between the samples' shadows show. The shadow of what lies nearer to the light by a depth moves with its
// sample in proportion to that depth. So the mean depth of what hides samples is found first.
float litShare(vec3 at, vec2 slope, float bias) {
  float hidden = 0.0, above = 0.0;
  for (int i = 0; i < LAYERS; ++i) {
    vec2 place = u_window * (at.xy + u_layers[i].xy * (at.z - u_middle));
    float depth = 2.0 * texture(u_shadow_depth, inTexture(place, float(i))).r - 1.0;
    if (at.z - bias > depth && depth < 1.0) hidden += 1.0, above += at.z - depth;
  }
  if (hidden == 0.0) return 1.0;
  if (hidden == float(LAYERS)) return 0.0;
  float turn = 6.2831853 * noise(gl_FragCoord.xy);
  float radius = sqrt(noise(gl_FragCoord.yx + 17.0));
  vec2 jitter = kSpread * radius * vec2(cos(turn), sin(turn)) * (above / hidden);
  float lit = 0.0;
  for (int i = 0; i < LAYERS; ++i) {
    vec4 layer = u_layers[i];
    // The sample may lie behind the plane of a surface.
    float facing = 1.0 + dot(layer.xy, slope);
    if (facing <= 0.0) continue;
    vec2 tilt = slope / (facing * u_window);
    vec2 moved = u_window * u_cell * (mat2(layer.z, layer.w, -layer.w, layer.z) * jitter);
    vec2 place = u_window * (at.xy + layer.xy * (at.z - u_middle)) + moved;
    lit += isLit(place, float(i), at.z + dot(tilt, moved) - bias);
  }
  return lit / float(LAYERS);
}
#endif

// `place`: from where u_map_from_place and u_light count. Surfaces are lit on the side that is seen. A third of the
// light comes from everywhere.
vec3 shadeInLight(vec3 color, vec3 normal, vec3 to_eye, vec3 place) {
  float squared = dot(normal, normal);
  vec3 n = squared > 1e-12 ? normal * inversesqrt(squared) : normalize(to_eye);
  vec3 to_viewer = normalize(to_eye);
#if defined(POINTS) || defined(LINES)
  if (dot(n, to_viewer) < kMostLean) n = -n;
  vec3 plane = n;
  vec3 along = normalize(cross(n, abs(n.x) < 0.6 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0)));
  vec3 across = cross(n, along);
#else
  if (!gl_FrontFacing) n = -n;
  vec3 along = dFdx(place);
  vec3 across = dFdy(place);
  vec3 plane = cross(along, across);
  plane = dot(plane, plane) > 0.0 ? normalize(plane) : n;
  if (dot(plane, to_viewer) < 0.0) plane = -plane;
  // If the normal of a triangle leans far away from the side that is seen, the source's normals point inwards. Those at
  // the edge of a box lean away, too, and stay on the triangle's side.
  if (dot(n, to_viewer) < kMostLean && dot(n, plane) < 0.0) n = -n;
#endif
  vec4 clip = u_map_from_place * vec4(place, 1.0);
  bool is_held = max(abs(clip.x), abs(clip.y)) <= clip.w && dot(u_slice[0], vec4(place, 1.0)) >= 0.0 &&
      dot(u_slice[1], vec4(place, 1.0)) >= 0.0;
  if (u_one_of_several && !is_held) discard;
  vec3 to_light = normalize(u_light.xyz - u_light.w * place);
  float facing = dot(n, to_light);
  float plane_facing = dot(plane, to_light) * sign(dot(plane, n));
  bool is_turned_away = plane_facing < kTurnedAway && abs(dot(plane, n)) > kLeastAgreement;
  if (facing <= 0.0 || is_turned_away) return 0.35 * color;
  float flatness = max(abs(plane_facing), 1e-6);
  vec2 slope = depthSlope(clip, along, across) * min(flatness / kFlattest, 1.0);
  float bias = u_reach / max(flatness, kFlattest) * u_depth_per_length / (clip.w * clip.w) + kDepthStep;
  return color * (0.35 + 0.65 * facing * litShare(clip.xyz / clip.w, slope, bias));
}
