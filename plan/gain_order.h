#pragma once
// Orders what a view needs, groups of patches and images alike, by what each is expected to gain for its bytes: by how
// much it lessens the squared error of the picture. The functions are pure.
//
// The picture is looked at by rays. At a piece of surface the proxy's own shading has an expected error of
//
// clang-format off
//   P² = p² + a c² + o² · min(1, d²)
//   c    typical error of its colours
//   d    view pixels: typical error of its shape; at outlines, another colour lies beside its place
// clang-format on
//
// and an image
//
// clang-format off
//   e² = n² + a c² · (i + h s / (1 + s) + (s / f)²) + x C² · (t² − 1)^0.7
//   s    view pixels by which the proxy's typical error shifts the image: 3 · error · angle between the rays
//   t    view pixels that a texel covers, more where the image sees the surface at a slant; at least 1
//   C    c of the finest proxy above the leaves that is known here: what detail there is
// clang-format on
//
// with numbers that were fitted to pictures (docs/decisions/gain-per-byte.md). The shader weighs images by other ones:
// it compares them with each other at a pixel, this compares them with groups and over a picture.
//
// One image may fail at a place: something thin hides it, or its coverage is wrong. So a place's error is
// (1 − q) · e1² + q · e2², with e1 of the best image and e2 of the best one from another point, or of the proxy. A
// group makes c, d and with d also s smaller, so what images gain depends on the groups that came before them, and
// groups gain less where images show the detail already. One that the shape does not need leaves the c of e² as it was:
// images lie where they lay. The order is greedy: what gains most for its bytes next.
#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <vector>

#include "plan/point_choice.h"
#include "repository/sampling/key.h"

namespace plan {

/// How the proxy shows a piece of surface by itself.
struct ProxyShading {
  float color_error = 0.0F;  ///< typical, 0..1
  float shape_error = 0.0F;  ///< typical, scene units
};

/// How the proxy shows a piece of surface as it is, and once groups have come, each of which needs those before it.
struct ProxyPlace {
  ProxyShading now;
  struct Refined {
    std::size_t group = 0;  ///< index into the groups of the order
    ProxyShading shading;
  };
  std::vector<Refined> refined;
  /// Colour error of the finest proxy above the leaves that is known here: what detail there is.
  float detail = 0.0F;
};

struct OrderedGroup {
  std::uint64_t bytes = 1;
  /// The shape wants it, as those before it: it comes whatever it gains. Others only bring colours.
  bool is_needed = true;
  std::vector<std::size_t> parents;  ///< indices of groups that must come before it, all smaller than its own
  /// Later views gain as well: hidden sides turn up, and edges of the picture move in. These say how the proxy shows
  /// the group's place before and after it, the share of the picture that it would take if all were seen, and view
  /// pixels a unit there.
  ProxyShading before, after;
  float share = 0.0F;
  float density = 0.0F;
};

/// Bytes of a stored image: 0 where it is known not to be stored or to show nothing, nullopt where nothing is known.
/// The nearest ancestor of a tile that is not stored shows as much as it would. Null: nothing is known of any.
using StoredBytes = std::function<std::optional<std::uint64_t>(const repository::FaceKey&)>;

struct GainQuery {
  PointQuery points;
  std::size_t max_images = 64;  ///< with those that are here
  StoredBytes stored_bytes = nullptr;
  /// Whether the viewer has an image already, so that others gain only what they add to it.
  std::function<bool(const repository::FaceKey&)> is_here = [](const repository::FaceKey&) { return false; };
  /// The squared error, 0..1, of the proxy's colours where images show what no group brings: shadows. Coarse images
  /// lose their share of it, as of other detail.
  float lacking2 = 0.0F;
  std::uint64_t image_bytes = 10'000;  ///< of an image of which nothing else is known
  /// Groups gain for later views, too: so much of what each would gain there without images counts, 0..1. Of images
  /// nothing is said of later views.
  float later_share = 0.0F;
  /// An image may gain less for its bytes where the model does not fill the picture, by the model's share of it: who
  /// looks sees the model alone. Not for an eye that moves on.
  bool counts_foreground = true;
  /// Groups that are not needed and gain too little for their bytes stay behind, in place of coming after all else.
  bool leaves_groups = true;
};

/// An image or a group, and by how much it lessens the squared error of the picture's colours (0..1, mean over the
/// picture) after those before it.
struct OrderedItem {
  std::optional<repository::FaceKey> image;
  std::size_t group = 0;  ///< where it is no image
  float gain = 0.0F;
};

struct OrderByGain {
  /// All groups that are needed, parents first; among them the images that are not here, as long as they gain anything
  /// worth their bytes; and the other groups, all or likewise (GainQuery::leaves_groups).
  std::vector<OrderedItem> items;
  float error_before = 0.0F;  ///< expected squared error of the picture's colours, without the items
  float error_after = 0.0F;   ///< and with them
};

/// `points`: whose images there are. `places`: one a sample.
OrderByGain orderByGain(const GainQuery& query, std::span<const glm::uvec3> points,
                        std::span<const SurfaceSample> samples, std::span<const ProxyPlace> places,
                        std::span<const OrderedGroup> groups);

}  // namespace plan
