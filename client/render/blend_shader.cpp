#include "client/render/blend_shader.h"

#include "lod/draw/triangles.h"

namespace client {

// Outward by u_push × distance from the eye: a constant number of pixels on the screen, whatever patch a vertex belongs to, so
// that no border opens.
std::string blendVertexSource() {
  return R"(
layout(location = 0) in vec3 a_position;
layout(location = 1) in vec3 a_normal;
layout(location = 2) in vec4 a_color;
uniform mat4 u_clip_from_scene;
uniform vec3 u_eye;
uniform float u_push;
out vec3 v_position;
out vec3 v_normal;
out vec3 v_color;
void main() {
  float squared = dot(a_normal, a_normal);
  vec3 outward = squared > 0.0 ? a_normal * inversesqrt(squared) : vec3(0.0);
  v_position = a_position + outward * (u_push * distance(a_position, u_eye));
  v_normal = outward;
  v_color = a_color.rgb;
  gl_Position = u_clip_from_scene * vec4(v_position, 1.0);
}
)";
}

std::string depthVertexSource() {
  return R"(
layout(location = 0) in vec3 a_position;
uniform mat4 u_clip_from_scene;
void main() {
  gl_Position = u_clip_from_scene * vec4(a_position, 1.0);
}
)";
}

std::string depthFragmentSource() {
  return R"(
void main() {
}
)";
}

std::string blendFragmentSource() {
  return lod::draw::shadingSource() + R"(
struct Sample {
  mat4 clip_from_scene;
  vec4 eye;      // xyz centre of projection, w fade in time
  vec4 place;    // array, layer, width, height in pixels
  vec4 depth;    // A, B of w = B / (depth + A); width of a depth texel at distance 1; pixels per unit length at distance 1
  vec4 floors;   // what the weight keeps at the left, right, bottom, top border
};
layout(std140) uniform Samples { Sample u_samples[32]; };
uniform ivec4 u_list[8];               // the samples that may see the patches being drawn
uniform int u_count;
uniform sampler2DArray u_color0;
uniform sampler2DArray u_color1;
uniform sampler2DArray u_color2;
uniform sampler2DArrayShadow u_depth0;
uniform sampler2DArrayShadow u_depth1;
uniform sampler2DArrayShadow u_depth2;

uniform vec3 u_eye;
uniform vec2 u_viewport;               // pixels
uniform float u_pixels_per_unit;       // of the view, at distance 1
uniform float u_push;                  // outward shift per distance from the eye
uniform float u_error;                 // the proxy's error per distance from the eye
uniform bool u_carve;
uniform bool u_fill;
uniform vec4 u_background;

uniform float u_angle_power, u_angle_floor, u_resolution_power, u_border, u_side_low, u_side_high;
uniform float u_bias_texels, u_bias_error, u_mip_bias, u_parallax, u_carve_below;
uniform float u_x0, u_x1, u_x2, u_x3;

in vec3 v_position;
in vec3 v_normal;
in vec3 v_color;
out vec4 o_color;

vec4 colorAt(int array, vec3 place, float level) {
  if (array == 0) return textureLod(u_color0, place, level);
  if (array == 1) return textureLod(u_color1, place, level);
  return textureLod(u_color2, place, level);
}

float litAt(int array, vec4 place) {
  if (array == 0) return texture(u_depth0, place);
  if (array == 1) return texture(u_depth1, place);
  return texture(u_depth2, place);
}

void main() {
  // The surface here: seen side, normal, the proxy's error.
  vec3 dx = dFdx(v_position);
  vec3 dy = dFdy(v_position);
  vec3 to_eye = u_eye - v_position;
  float view_distance = length(to_eye);
  vec3 view_ray = to_eye / view_distance;
  vec3 facet = cross(dx, dy);
  float area = length(facet);
  facet = area > 0.0 ? facet / area : view_ray;
  if (dot(facet, view_ray) < 0.0) facet = -facet;
  vec3 normal = dot(v_normal, facet) < 0.0 ? -v_normal : v_normal;
  float error = u_error * view_distance;

  // A pushed fragment lies in front of the surface that its view ray meets: look further along the ray.
  float push = u_push * view_distance;
  vec3 p = v_position - view_ray * min(push / max(dot(normal, view_ray), 0.01), u_parallax * push);

  vec2 view_ndc = gl_FragCoord.xy / u_viewport * 2.0 - 1.0;
  float view_density = u_pixels_per_unit / view_distance;

  vec3 color_sum = vec3(0.0);          // premultiplied
  float coverage_sum = 0.0;
  float weight_sum = 0.0;
  float unseen = 1.0;                  // how far nothing sees this
  float seen_model = 0.0;
  float seen_any = 0.0;

  for (int k = 0; k < u_count; ++k) {
    int i = u_list[k >> 2][k & 3];
    vec4 clip = u_samples[i].clip_from_scene * vec4(p, 1.0);
    if (clip.w <= 0.0) continue;
    vec2 ndc = clip.xy / clip.w;
    vec4 inside = vec4(1.0 + ndc.x, 1.0 - ndc.x, 1.0 + ndc.y, 1.0 - ndc.y);
    if (min(min(inside.x, inside.y), min(inside.z, inside.w)) <= 0.0) continue;

    // Fading towards borders. A sample whose border is the screen's border as well has nothing to fade to.
    vec2 apart = abs(ndc - view_ndc);
    float width = clamp(max(apart.x, apart.y), 1e-4, 1.0) ;
    width = min(2.0 * u_border, width);
    vec4 rise = mix(u_samples[i].floors, vec4(1.0), smoothstep(0.0, width, inside));
    float seen = u_samples[i].eye.w * rise.x * rise.y * rise.z * rise.w;

    // The side of the surface that the viewer sees.
    vec3 to_sample = u_samples[i].eye.xyz - p;
    vec3 sample_ray = to_sample / length(to_sample);
    float cosine = dot(normal, sample_ray);
    seen *= smoothstep(u_side_low, u_side_high, cosine);

    // Visibility: shadow mask.
    vec4 depth = u_samples[i].depth;
    float cosine_safe = clamp(abs(cosine), 0.2, 1.0);
    float slope = sqrt(1.0 - cosine_safe * cosine_safe) / cosine_safe;
    float bias = u_bias_texels * depth.z * clip.w * (1.0 + slope) + u_bias_error * (error + push) / cosine_safe;
    float biased = max(clip.w - bias, 1e-6 * clip.w);
    float reference = 0.5 * (depth.y / biased - depth.x) + 0.5;
    vec4 place = u_samples[i].place;
    int array = int(place.x);
    vec2 uv = ndc * 0.5 + 0.5;
    float lit = litAt(array, vec4(uv, place.y, clamp(reference, 0.0, 1.0)));
    seen *= lit;
    if (seen <= 0.0) continue;

    // Weight: by angle and by resolution.
    float angle = length(view_ray - sample_ray);
    float density = depth.w / clip.w;
    float ratio = min(1.0, density / view_density);
    float weight = seen * pow(ratio, u_resolution_power) * pow(angle + u_angle_floor, -u_angle_power);

    float level = log2(max(density / view_density, 1.0)) + u_mip_bias;
    vec4 color = colorAt(array, vec3(uv, place.y), level);
    color_sum += weight * color.rgb;
    coverage_sum += weight * color.a;
    weight_sum += weight;
    unseen *= 1.0 - seen * color.a;
    seen_any = max(seen_any, seen);
  }

  // Carving: what the images that see this place call background is not there.
  if (u_carve && seen_any > 0.5 && coverage_sum < u_carve_below * weight_sum) discard;

  // What no image sees is shaded; in between, blended.
  float images = smoothstep(0.0, 0.25, 1.0 - unseen);
  vec3 color = color_sum / max(coverage_sum, 1e-20);
  if (images < 1.0) {
    if (!u_fill && images <= 0.0) discard;
    vec3 shaded = u_fill ? shadeSurface(v_color, normal, to_eye) : u_background.rgb;
    color = mix(shaded, color, images);
  }
  o_color = vec4(color, 1.0);
}
)";
}

}  // namespace client
