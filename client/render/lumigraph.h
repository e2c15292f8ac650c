#pragma once
// The Grid-Lumigraph renderer (Okamoto 2011, section 3): every pixel of the proxy is blended in one pass from the
// sampling images that see it, by shadow-masked projective texturing.
//
// Every sampling image is a sample: a camera (off-axis where need be), pixels, coverage, and a depth map of the proxy.
// Faces of the repository, their tiles and exact frames are the same thing here.
#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/gl/gl.h"
#include "base/image.h"
#include "base/view_defaults.h"
#include "lod/draw/triangles.h"
#include "lod/draw/view_modes.h"
#include "lod/patch/hierarchy.h"

namespace client {

struct VisibleSurface;
using SampleId = std::uint64_t;

/// Samples that one frame blends at most: the length of u_samples in shaders/blend_samples.glsl.
inline constexpr int kMaxBlended = 96;

/// How samples are weighted. The defaults measured best: docs/decisions/blending-weights.md, docs/lumigraph-tuning.md.
struct BlendTuning {
  /// Weights are ∝ (expected error of the colour)^−resolution_power. An image's grows with its blur in view pixels,
  /// which comes from its texel and the proxy's error.
  float resolution_power = 6.0F;
  float shift = 3.0F;        ///< times the proxy's projected error and the angle between the rays: counts as blur
  float angle_power = 1.0F;  ///< weights are ∝ (angle between the rays to viewer and sample + angle_floor)^−angle_power
  float angle_floor = 0.001F;  ///< radians; small, so that at a sampling point its own image is the picture
  float vote_power = 3.0F;     ///< votes on coverage ∝ (angle + angle_floor)^−vote_power
  float carve_below = 0.2F;    ///< mean coverage by votes under which a fragment is discarded
  float border = 0.06F;        ///< share of a sample's width over which it fades towards a border with no neighbour
  float side_low = -0.3F;      ///< cosine between normal and ray to the sample where its weight begins,
  float side_high = 0.0F;      ///< and where it is full
  float bias_texels = 2.0F;    ///< shadow bias in depth map texels, scaled by the slope
  float bias_error = 2.0F;     ///< shadow bias in units of the proxy's error
  float shade_blur = 0.7F;     ///< blur of the proxy's own shading, in edge lengths of its triangles
  float shade_weight = 5.0F;   ///< its weight, as an image would have it at 1 / shade_weight radians; 0: images alone
  float image_noise = 0.01F;   ///< error of an image's colours by its coding, 0..1
  /// Share of the square of a coarsely coded image's own error that counts in place of that, where it is more: its
  /// error lies at edges, where others err, too.
  float coding_share = 0.5F;
  float outlier = 1.2F;      ///< an image further from the proxy's colour than so many typical errors is doubted;
  float lit_outlier = 6.8F;  ///< the same where light makes the colours
  /// Doubted images are believed where their variance is below this share of the square by which their mean differs
  /// from the proxy's colour; 0: never.
  float agreement = 0.2F;
  float disagreement = 0.1F;  ///< share of the images' variance, over their expected error, that counts as error
  /// Where the proxy's colours are even they err less than all of their patch do, down to this share of it, 0..1; 1:
  /// everywhere as much. Only where each pixel is blended once, and light does not make the colours.
  float even_error = 0.5F;
  float sharpen = 0.75F;       ///< images are looked up so many mip levels finer than one texel a view pixel,
  float footprint = 0.8F;      ///< and over this share, 0..1, of the longest extent that a view pixel has in them
  float near_errors = 3.0F;    ///< an image that is nearer to the proxy than so many of its errors is not used
  float proxy_noise = 0.004F;  ///< error of the proxy's colours beyond its stated one, 0..1

  friend bool operator==(const BlendTuning&, const BlendTuning&) = default;
};

struct LumigraphOptions {
  int max_samples = base::ViewDefaults::kImages;  ///< images blended per frame, 1..kMaxBlended
  /// Images beyond those, of points that have many of them (chooseSamples), 0..kMaxBlended − max_samples.
  int more_samples = 0;
  /// Sampling points from which a patch is blended at most, the best for it, 1..kMaxBlended. Fewer cost less and are
  /// less accurate: docs/decisions/moving-effort.md.
  int max_points_a_patch = kMaxBlended;
  float fade_seconds = 0.25F;  ///< images come in and go over this; 0 for pictures that must be final at once
  /// While pictures may still settle, a frame draws depth maps until they have so many times the proxy's triangles. A
  /// map that shows the whole proxy costs about as much as drawing it without images.
  int depth_maps_per_frame = 3;
  /// Blend each pixel of the foremost surface once, and fragments of other places by themselves, in place of each
  /// fragment; where the picture has nothing that needs more of them. docs/decisions/blend-once.md.
  bool blend_once = true;
  bool carve = true;          ///< discard fragments that the images' votes call background
  glm::vec2 shift{0.0F};      ///< of the picture on its pixels, in pixels: one of several whose mean is shown
  bool multisampled = false;  ///< the target has several samples a pixel, of which a carved edge covers a part
  bool unseen = false;        ///< depth maps, fades and figures go on as in any frame, but nothing is drawn
  bool fill_holes = true;  ///< shade what no image sees by vertex colour, normal and light; otherwise leave background
  /// Tint every fragment by how many times their expected error the images there differ from each other, in the steps
  /// and colours of lod::draw::kResolutionLegend: where the proxy is far from the surface, and beside hidden edges.
  bool show_disagreement = false;
  bool use_images = true;  ///< false: draw the proxy shaded by its vertex colours
  float background[4] = {0.0F, 0.0F, 0.0F, 0.0F};
  lod::draw::ViewModes modes;
  BlendTuning tuning;
  const VisibleSurface* surface = nullptr;  ///< for the choice of images; null: all of the cut's boxes

  friend bool operator==(const LumigraphOptions&, const LumigraphOptions&) = default;
};

/// Tells how a sampling image counts beside others.
struct SampleTraits {
  float fade_share = 1.0F;  ///< of LumigraphOptions::fade_seconds, over which it fades in
  /// Share of its width and height, around the middle, that is its own; the border around it only serves filters. More
  /// than 0, at most 1.
  float core = 1.0F;
  float coding_error = 0.0F;  ///< of its colours, 0..1; 0: not known (BlendTuning::coding_share)
};

/// How far a patch of the proxy typically is from the model, as root mean squares.
struct ProxyError {
  float shape = 0.0F;  ///< scene units
  float color = 0.0F;  ///< 0..1
  /// The shape is exact, and the colours lack a texture's detail: any colour may be right.
  bool texture = false;
  /// The shape's error as shaders get it: below 0 for a texture.
  float shapeForShader() const { return texture ? -1.0F : shape; }
};

struct LumigraphStats {
  std::uint32_t samples_used = 0;
  std::uint32_t samples_resident = 0;
  std::uint32_t patches = 0;
  std::uint64_t triangles = 0;
  std::uint32_t depth_maps_drawn = 0;  ///< this frame
  bool blended_once = false;           ///< LumigraphOptions::blend_once was followed
  std::uint64_t gpu_bytes = 0;         ///< textures and buffers of this renderer
};

class LumigraphRenderer {
 public:
  /// `gpu_budget_bytes` bounds textures; addSample refuses layers beyond it. Images of face_size × face_size leave
  /// `for_other_sizes` of it to images of other sizes, of which there are two: each leaves the other half of that.
  static base::Result<std::unique_ptr<LumigraphRenderer>> create(const lod::Lattice& lattice, int face_size,
                                                                 std::uint64_t gpu_budget_bytes,
                                                                 std::uint64_t for_other_sizes = 0);
  ~LumigraphRenderer();

  lod::draw::PatchMeshes& patches();

  /// Adds a sampling image with its perspective camera; false if there is no room. `rgba` may be of any size and is not
  /// resampled: each size has an array of layers, at most three sizes at a time, and an empty array gives way to
  /// another size. Alpha is coverage: 0 background, 255 model. The sample fades in from `now` on, in seconds.
  bool addSample(SampleId id, const base::Camera& camera, const base::Image& rgba, double now,
                 const SampleTraits& traits = {});
  void removeSample(SampleId id);
  /// Returns the bytes that LumigraphOptions::blend_once takes for pictures of this size, beside gpu_budget_bytes.
  static std::uint64_t bytesToBlendOnce(int width, int height);
  /// Returns what this renderer has allocated on the GPU, by kind.
  base::gl::HeldBytes heldBytes() const;

  /// Draws into the framebuffer bound now, viewport 0,0 … camera.width × height. Colours are blended as sRGB values.
  /// - `cut`: uploaded patches. `cut_error_px`: the largest projected bound among them; `proxy_errors` are
  /// guessed from it where they are missing.
  /// - `candidates`: resident samples to choose from, empty for all; those that add most are taken, of equals the
  /// first.
  /// - `occluders`: uploaded patches for the depth maps, empty for the cut. Best a cut without culling, since patches
  ///   outside the view hide things from samples, too.
  /// - `proxy_errors`: for each patch of `cut`, for shadow bias and weights.
  /// - `patch_error_px`: for each patch of `cut`, for colours by resolution; empty: cut_error_px for all.
  /// The camera's section cuts the picture; what it exposes is shaded where no sample sees it. A depth map is cut by
  /// the section of its sample's own camera: stored images show the whole model, frames what the view had left.
  void draw(const base::Camera& camera, std::span<const std::uint32_t> cut, std::span<const SampleId> candidates,
            float cut_error_px, const lod::draw::Shading& shading, const LumigraphOptions& options, double now,
            std::span<const std::uint32_t> occluders = {}, std::span<const float> patch_error_px = {},
            std::span<const ProxyError> proxy_errors = {});

  /// Whether drawWhole() can show this sample as the camera's picture: it is here, and of the camera's size.
  bool canDrawWhole(SampleId id, const base::Camera& camera) const;
  /// Draws the sample's own pixels over `background` (RGBA, 0 … 1) into the framebuffer bound now, whatever the proxy
  /// is; below 1, `opacity` mixes them with what was drawn there. canDrawWhole() must hold.
  void drawWhole(SampleId id, const base::Camera& camera, const std::array<float, 4>& background, float opacity);

  /// Whether another frame of the same view would differ: fades are running, or depth maps are not all drawn yet.
  bool settling() const;
  /// The camera of the last draw() that was seen, its near plane moved out to the cut: the depths in the target are
  /// its.
  const base::Camera& drawnCamera() const;
  const LumigraphStats& stats() const;

 private:
  LumigraphRenderer() = default;
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace client
