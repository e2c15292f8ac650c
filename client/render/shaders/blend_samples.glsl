// The Grid-Lumigraph (Okamoto 2011, section 3.2): a place of the proxy is blended in one pass from the sampling images
// that see it. The texts of lod/draw's shading and view modes and of view.glsl stand before it.
struct Sample {
  mat4 clip_from_scene;
  vec4 eye;      // xyz: centre of projection, w: fade in time
  vec4 place;    // array, layer, one depth texel's width and height in texture coordinates
  vec4 depth;    // A, B of depth −1..1 = B / w − A; width of a depth texel at distance 1; pixels per unit at distance 1
  vec4 floors;   // share of the weight that is kept at the left, right, bottom, top border of the core
  vec4 beyond;   // > 0: there a sample so many times half as fine goes on; < 0: one under this sample does
  vec4 core;     // the picture's width over its core's; its point's number; fade in time of the samples under it;
                 // its coding's squared error beyond the usual
};
layout(std140) uniform Samples { Sample u_samples[96]; };
// Software GL looks into all arrays for every sample, so where ONE_ARRAY is defined all samples are in the first.
uniform sampler2DArray u_color0;
uniform sampler2DArrayShadow u_depth0;
#ifndef ONE_ARRAY
uniform sampler2DArray u_color1;
uniform sampler2DArray u_color2;
uniform sampler2DArrayShadow u_depth1;
uniform sampler2DArrayShadow u_depth2;
#endif

uniform bool u_carve;
uniform float u_soft;                  // width of a carved edge, pixels; 0 where the target has one sample a pixel

// BlendTuning: lumigraph.h describes each.
// ANGLE_POWER, VOTE_POWER, and HALF_RESOLUTION_POWER, which squares are raised to, are defined before this text.
uniform float u_angle_floor, u_shift, u_border, u_side_low, u_side_high;
uniform float u_bias_texels, u_bias_error, u_carve_below, u_shade_blur, u_shade_weight;
uniform float u_image_noise, u_proxy_noise, u_near, u_outlier, u_lit_outlier, u_agreement, u_disagreement;
uniform float u_sharpen, u_footprint;

vec4 colorAt(int array, vec3 place, float level) {
#ifndef ONE_ARRAY
  if (array == 1) return textureLod(u_color1, place, level);
  if (array == 2) return textureLod(u_color2, place, level);
#endif
  return textureLod(u_color0, place, level);
}

float litAt(int array, vec4 place) {
#ifndef ONE_ARRAY
  if (array == 1) return texture(u_depth1, place);
  if (array == 2) return texture(u_depth2, place);
#endif
  return texture(u_depth0, place);
}

// Returns the share of a 3 × 3 neighbourhood of depth texels that lies no nearer than place.w, by four taps that are
// each filtered over 2 × 2 texels. One tap is as accurate on scans, but lets an edge's colour leak on what lies behind.
float litAround(int array, vec4 place, vec2 texel) {
  return 0.25 * (litAt(array, place + vec4(texel, 0.0, 0.0)) + litAt(array, place - vec4(texel, 0.0, 0.0)) +
                 litAt(array, place + vec4(texel.x, -texel.y, 0.0, 0.0)) +
                 litAt(array, place + vec4(-texel.x, texel.y, 0.0, 0.0)));
}

// A thing before a place hides it from an image where viewer and image see the thing further apart than this, radians:
// about a pixel. A choice (docs/decisions/choice-by-rays.md).
const float kAside = 0.0015;

// Raises to a power, mostly a constant and a small whole number.
float raised(float x, float power) {
  if (power == 3.0) return x * x * x;
  if (power == 1.0) return x;
  return pow(x, power);
}

// Towards its border, and while it fades in, an image loses the priority that a small angle gives it; otherwise the
// fade would happen within the last thousandth of its width. Radians, about the angle between neighbouring images.
const float kBorderAngle = 0.3;

// Squared: no image is doubted for less than 0.014, about what its coding does beside an edge. A choice.
const float kLeastError2 = 2e-4;
// The square of an image's blur, in texels: the variance of its texel's box is 1 / 12, and looking it up between texels
// adds that of a tent, 1 / 6.
const float kLookUp = 3.0;
// This share of the squared error of scanned colours, detail that the proxy lacks, is lost in images at any blur; but
// no more than so many times their own noise, since a coarse proxy lacks more than an image ever loses.
const float kLostDetail = 0.05;
const float kMostLost = 1.5;
// Images that agree are believed as far as so many of them share the weight; or however few do, where no more than
// kFewListed may see the place, and less and less up to twice as many. Choices.
const float kSharing = 4.0;
const float kFewListed = 6.0;

// A surface at a steeper slant than this counts as one of this slant.
const float kLeastCosine = 0.05;
// Taps are no more than so many texels apart, as long as there are no more than so many of them. Choices:
// docs/decisions/image-footprints.md has others.
const float kTexelsATap = 1.35;
const float kMostTaps = 4.0;

// Returns the index of the k-th of the samples that may see the place.
int listed(int k);

// The parallelogram that a view pixel covers on the surface, scene units. Its first edge leads away from the eye.
struct Footprint {
  vec3 along;
  vec3 across;
};

// `size`: width of a view pixel at the place, scene units.
Footprint footprintOf(vec3 normal, vec3 view_ray, float size) {
  float cosine = dot(normal, view_ray);
  vec3 along = view_ray - cosine * normal;
  if (dot(along, along) < 1e-6) along = cross(normal, abs(normal.x) < 0.5 ? vec3(1.0, 0.0, 0.0) : vec3(0.0, 1.0, 0.0));
  along = normalize(along);
  return Footprint(size / clamp(cosine, kLeastCosine, 1.0) * along, size * cross(normal, along));
}

// A footprint in an image: an ellipse, whose axes are the singular values of how the image maps the surface.
struct Ellipse {
  float longest;                       // texels
  float shortest;
  vec3 axis;                           // the longest axis, whole, on the surface
};

// `density`: texels per scene unit of what faces the image at the place.
Ellipse ellipseOf(Footprint footprint, vec3 sample_ray, float density) {
  float along = dot(footprint.along, sample_ray);
  float across = dot(footprint.across, sample_ray);
  float xx = dot(footprint.along, footprint.along) - along * along;
  float yy = dot(footprint.across, footprint.across) - across * across;
  float xy = -along * across;
  float mean = 0.5 * (xx + yy);
  float apart = length(vec2(0.5 * (xx - yy), xy));
  vec2 axis = xx > yy ? vec2(mean + apart - yy, xy) : vec2(xy, mean + apart - xx);
  axis *= inversesqrt(max(dot(axis, axis), 1e-30));
  return Ellipse(density * sqrt(mean + apart), density * sqrt(max(mean - apart, 0.0)),
                 axis.x * footprint.along + axis.y * footprint.across);
}

// Looks the colour up over a footprint (Heckbert 1989, section 3.3): by as many taps along its longest axis as its
// length wants (McCormack et al. 1999, section 3), each of a mip level by its shortest. A wall at a slant would sparkle
// otherwise. `step`: the longest axis in texture coordinates.
vec4 filteredAt(int array, vec3 place, Ellipse ellipse, vec2 step) {
  float extent = u_footprint * ellipse.longest;
  float level = log2(max(max(ellipse.shortest, extent / (kMostTaps * kTexelsATap)), 1e-6));
  level = max(level - u_sharpen, 0.0);
  int taps = int(clamp(ceil(extent / (kTexelsATap * exp2(level))), 1.0, kMostTaps));
  vec4 sum = vec4(0.0);
  for (int tap = 0; tap < taps; ++tap) {
    float part = (float(tap) + 0.5) / float(taps) - 0.5;
    sum += colorAt(array, vec3(place.xy + u_footprint * part * step, place.z), level);
  }
  return sum / float(taps);
}

// Weighted sums over images of a place.
struct Sums {
  vec4 color;                          // premultiplied colours, and coverage
  float square;                        // of the colours
  float error2;                        // expected, squared
};

void add(inout Sums sums, float weight, vec4 color, float error2) {
  sums.color += weight * color;
  sums.square += weight * dot(color.rgb, color.rgb);
  sums.error2 += weight * color.a * error2;
}

vec3 colorOf(Sums sums) {
  return sums.color.rgb / max(sums.color.a, 1e-20);
}

// Returns the squared distance of the colours from their mean.
float varianceOf(Sums sums) {
  vec3 color = colorOf(sums);
  return max(sums.square / max(sums.color.a, 1e-20) - dot(color, color), 0.0);
}

// Where images differ from each other by more than they are expected to err, they know less than they claim.
float disagreementOf(Sums sums) {
  return varianceOf(sums) / 3.0 / max(sums.error2 / max(sums.color.a, 1e-20), 1e-9);
}

// Returns the share of the picture's colour that images have beside the proxy's own, whose weight this is.
float shareOf(Sums sums, float weight) {
  weight *= raised(1.0 + u_disagreement * disagreementOf(sums), HALF_RESOLUTION_POWER);
  return sums.color.a / max(sums.color.a + weight, 1e-20);
}

// The images of a place, blended.
struct Blend {
  vec3 color;                          // mean of the images
  float share;                         // what it has of the picture's colour; the rest is the proxy's own
  float seen;                          // 0..1: whether images show the place at all
  float kept;                          // below 0 where it is carved
  float octaves;                       // log2 of the images' blur, pixels
  float disagreement;                  // the images' variance over their expected squared error
};

// Blends the first `count` samples listed. `view_ndc`: the pixel, −1..1. `proxy_error`: typical errors of the place's
// patch: of shape, scene units, below 0 where a texture is all that it lacks; of colour, 0..1; and of its own colour at
// this place, no more than that. `listed_of_patch`: samples that may see the place's patch.
Blend blendAt(Surface surface, vec2 view_ndc, vec3 proxy_error, int count, float listed_of_patch) {
  float view_distance = length(surface.to_eye);
  vec3 view_ray = surface.to_eye / view_distance;
  float error = max(proxy_error.x, 0.0);
  float color_error = proxy_error.y;
  float view_density = u_pixels_per_unit / view_distance;
  float error_px = error * view_density;

  // The colours' error grows with the blur: the proxy's own colours are blurred over its triangles, and that error is
  // known. `slope` is the error for each view pixel of blur.
  float shade_blur =
      max(u_shade_blur * surface.edge * view_density, 1.0) / clamp(dot(surface.normal, view_ray), kLeastCosine, 1.0);
  float slope = color_error / shade_blur;
  float image_noise2 = u_image_noise * u_image_noise;
  float lost2 = u_unlit ? kLostDetail * color_error * color_error : 0.0;
  float least_error2 = image_noise2 + min(lost2, kMostLost * image_noise2);
  // Images that are further from the proxy's colour than it errs most often show something else: what lies beside the
  // edge of a hidden place. Where light makes the colours, or a texture that the patch lacks, their error is less sure.
  float believable = u_unlit && proxy_error.x >= 0.0 ? u_outlier : u_lit_outlier;
  float believable2 = 3.0 * believable * believable * (color_error * color_error + kLeastError2);

  float finest = exp2(u_sharpen);
  Footprint footprint = footprintOf(surface.normal, view_ray, 1.0 / view_density);

  Sums all = Sums(vec4(0.0), 0.0, 0.0);
  Sums wary = all;                 // of images whose weight is less where they are doubted
  vec2 weights = vec2(0.0);        // of all, and their squares
  float votes = 0.0;               // on coverage, whatever way the surface faces
  float votes_for_model = 0.0;
  float voters = 0.0;              // the surest of them, 0..1
  float unseen = 1.0;              // 1 while no image shows the model here
  float octaves = 0.0;             // log2 of the blur, weighted like all

  // Samples of one point that lie within each other stand side by side, the finest first, and share one weight: a
  // coarser one shows what those before it have left.
  float point = -1.0;
  float left = 1.0;

  for (int k = 0; k < count; ++k) {
    int i = listed(k);
    vec4 core = u_samples[i].core;
    if (core.y != point) {
      point = core.y;
      left = 1.0;
    }
    if (left <= 0.0) continue;
    vec4 clip = u_samples[i].clip_from_scene * vec4(surface.position, 1.0);
    if (clip.w <= 0.0) continue;
    vec2 picture = clip.xy / clip.w;
    vec2 ndc = core.x * picture;
    vec4 inside = vec4(1.0 + ndc.x, 1.0 - ndc.x, 1.0 + ndc.y, 1.0 - ndc.y);
    if (min(min(inside.x, inside.y), min(inside.z, inside.w)) <= 0.0) continue;

    // Weights fade towards borders. Where the sample looks as the view does, its border is the screen's border and
    // nothing needs to fade.
    vec2 apart = abs(ndc - view_ndc);
    float width = clamp(8.0 * max(apart.x, apart.y), 1e-4, 2.0 * u_border);
    vec4 away = smoothstep(0.0, width, inside);
    vec4 rise = mix(u_samples[i].floors, vec4(1.0), away);
    float fade = u_samples[i].eye.w;
    float seen = left * fade * rise.x * rise.y * rise.z * rise.w;
    left -= seen;

    // Over a coarser sample of the point that goes on, it keeps its priority; beside one, it ends as coarse as that.
    vec4 beyond = u_samples[i].beyond;
    vec4 firm = mix(max(u_samples[i].floors, -beyond), vec4(1.0), away);
    float middle = max(fade, core.z) * firm.x * firm.y * firm.z * firm.w;
    float fineness = exp2(-dot(max(beyond, 0.0), 1.0 - away));

    // Visibility: the fragment is compared with the sample's depth map, with a bias that grows with the slope.
    vec3 to_sample = u_samples[i].eye.xyz - surface.position;
    float sample_distance = length(to_sample);
    vec3 sample_ray = to_sample / sample_distance;
    float cosine = dot(surface.normal, sample_ray);
    // From so near that the model may lie behind the image's eye, the image shows something else.
    seen *= smoothstep(u_near, 2.0 * u_near, sample_distance * abs(cosine) / max(error, 1e-20));
    float slant = min(abs(cosine), abs(dot(surface.facet, sample_ray)));
    if (proxy_error.x <= 0.0) seen *= smoothstep(0.02, 0.1, slant);
    float steep = clamp(slant, 0.1, 1.0);
    vec4 depth = u_samples[i].depth;
    float texel = depth.z * clip.w;
    float bias = u_bias_texels * texel * (1.0 + sqrt(1.0 - steep * steep) / steep) +
                 u_bias_error * error / max(steep, 0.4);
    float reference = 0.5 * (depth.y / max(clip.w - bias, 1e-6 * clip.w) - depth.x) + 0.5;
    vec4 place = u_samples[i].place;
    int array = int(place.x);
    vec2 uv = 0.5 * picture + 0.5;
    float lit = litAround(array, vec4(uv, place.y, clamp(reference, 0.0, 1.0)), place.zw);
    float voter = seen;
    // Close to an edge of the depth map the image may show what lies in front, but not where both rays coincide.
    float angle = length(view_ray - sample_ray);
    // That holds as far as the viewer sees: something may hide the place from an image that looks from behind the
    // viewer, such as a room's wall. Through a section plane the viewer sees further than any image along the same ray.
    float behind = smoothstep(1.0, 1.1, sample_distance / view_distance);
    float apart_rays = u_cut_open ? 1.0 : max(behind, smoothstep(0.002, 0.02, angle));
    // Rays that coincide at the place need not do so at what lies before it: it is seen aside by angle · (clip.w / its
    // own depth − 1), which is kAside at the depth `nearer`.
    if (apart_rays < 1.0 && lit < 1.0) {
      float nearer = clip.w / (1.0 + kAside / max(angle, 1e-7));
      float before = 0.5 * (depth.y / nearer - depth.x) + 0.5;
      float clear = litAround(array, vec4(uv, place.y, clamp(before, 0.0, 1.0)), place.zw);
      apart_rays = max(apart_rays, 1.0 - smoothstep(0.75, 1.0, clear));
    }
    seen *= mix(1.0, smoothstep(0.75, 1.0, lit) * smoothstep(u_side_low, u_side_high, cosine), apart_rays);

    // Coverage votes. Background in an image means that nothing lies along its whole ray, whether the proxy hides it
    // or not; model counts only where the image sees this place. Votes weigh by angle alone: the closer the ray, the
    // better the image knows the silhouette.
    float density = depth.w / clip.w;
    float ratio = density / view_density;
    Ellipse ellipse = ellipseOf(footprint, sample_ray, density);
    vec4 axis = u_samples[i].clip_from_scene * vec4(ellipse.axis, 0.0);
    vec2 axis_uv = 0.5 * (axis.xy - picture * axis.w) / clip.w;
    vec4 color = filteredAt(array, vec3(uv, place.y), ellipse, axis_uv);
    float for_model = color.a * min(1.0, 2.0 * lit);
    float vote = voter / raised(angle + u_angle_floor, VOTE_POWER);
    votes += vote * (1.0 - color.a + for_model);
    votes_for_model += vote * for_model;
    voters = max(voters, voter * (1.0 - color.a + for_model));

    // Weight. A texel covers 1 / ratio view pixels, more where the sample sees the surface at a slant, and no less than
    // that of the mip level that is looked up. An error of the proxy shifts the image by error × angle. Both count as
    // blur in view pixels; the sharpest images weigh most.
    float blur = 1.0 / clamp(ratio * fineness * cosine, 0.01, finest);
    float shift = u_shift * error_px * angle;
    // Noise of pixels that are smaller than the view's averages out.
    float noise2 = core.w / max(ratio * ratio / (finest * finest), 1.0);
    float error2 = least_error2 + noise2 + slope * slope * (max(kLookUp * blur * blur - 1.0, 0.0) + shift * shift);
    float weight = seen / (raised(error2 / image_noise2, HALF_RESOLUTION_POWER) *
                           raised(angle + u_angle_floor + kBorderAngle * (1.0 - middle), ANGLE_POWER));
    vec3 off = color.rgb - color.a * surface.shaded;
    float doubt = dot(off, off) / believable2;
    add(all, weight, color, error2);
    weights += vec2(weight, weight * weight);
    add(wary, weight / (1.0 + doubt * doubt), color, error2);
    if (u_show_resolution) {
      float texel_px = 1.0 / max(ellipse.shortest, 1e-4);
      octaves += weight * color.a * 0.5 * log2(texel_px * texel_px + shift * shift);
    }
    unseen *= 1.0 - seen * color.a;
  }

  Blend result;
  result.kept = max(votes_for_model / max(votes, 1e-20) - u_carve_below, 0.5 - voters);
  // Fragments that no image sees are shaded; in between both are blended, so that nothing pops.
  result.seen = smoothstep(0.0, 0.25, 1.0 - unseen);
  result.octaves = octaves / max(all.color.a, 1e-20);
  // The proxy's own shading is one more sample, whose texels are the proxy's triangles: it weighs more where the
  // images are coarser. Its blur contains the slant, as theirs does.
  float error2 = u_proxy_noise * u_proxy_noise + proxy_error.z * proxy_error.z;
  float weight = u_shade_weight / raised(error2 / image_noise2, HALF_RESOLUTION_POWER);
  // Several images that agree are right, though the proxy's colours are far from theirs: they show a letter on a wall
  // whose triangles are larger. Past the edge of a hidden place each image shows something else, or one alone is sharp.
  // While few images are here, as when a scene arrives, the proxy is coarse.
  vec3 off = colorOf(all) - surface.shaded;
  float spread = varianceOf(all) / max(dot(off, off), 1e-9);
  float sharing = weights.x * weights.x / max(weights.y, 1e-30);
  float many = smoothstep(kFewListed, 2.0 * kFewListed, listed_of_patch);
  float enough = max(smoothstep(1.0, kSharing, sharing), 1.0 - many);
  float believed = u_agreement > 0.0 ? enough * (1.0 - smoothstep(0.5, 1.0, spread / u_agreement)) : 0.0;
  float wary_share = shareOf(wary, weight);
  float full_share = shareOf(all, weight);
  float share = mix(wary_share, full_share, believed);
  result.color = mix(wary_share * colorOf(wary), full_share * colorOf(all), believed) / max(share, 1e-20);
  result.disagreement = mix(disagreementOf(wary), disagreementOf(all), believed);
  result.share = result.seen * share;
  return result;
}

// Returns how much of its pixel a place covers. It goes where the images that see it agree on background; beside that
// edge it covers a part of its pixel's samples (alpha to coverage), by its distance from the edge in pixels.
// `slope`: change of `kept` from pixel to pixel.
float coverageOf(float kept, vec2 slope) {
  float edge = clamp(u_soft * length(slope), 1e-6, 2.0 * u_carve_below);
  return u_carve ? clamp(kept / edge + 0.5, 0.0, 1.0) : 1.0;
}
