#pragma once
// Pages are the small atlases that a leaf patch is textured by. They are cut out of the pictures that a scan came with
// at the pictures' own texels, so that nothing is lost but what JPEG loses (docs/formats/texture.md).
#include <glm/glm.hpp>

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace lod::texture {

/// The longest side of a page, in texels.
inline constexpr int kMaxPageSide = 8192;
/// Page coordinates are whole steps, so many to a texel.
inline constexpr int kCornerSteps = 8;

/// A triangle in the source picture.
struct PictureTriangle {
  std::uint16_t triangle = 0;  ///< number in the patch as decoded; each at most once in a call
  /// In texels of the picture, x to the right, y downwards; texel (0, 0) covers 0 … 1. They may lie outside the
  /// picture, which repeats. makePages() rounds them to 1 / kCornerSteps.
  std::array<glm::vec2, 3> corners{};
};

/// A triangle on a page.
struct PageTriangle {
  std::uint16_t triangle = 0;             ///< number in the patch as decoded
  std::array<glm::u16vec2, 3> corners{};  ///< texels of the page × kCornerSteps
  bool operator==(const PageTriangle&) const = default;
};

/// A page is sampled with clamped, never with repeated coordinates: charts at its edges have no more gutter there than
/// they need.
struct Page {
  std::vector<PageTriangle> triangles;  ///< by number, each once; at least 1
  base::Image image;                    ///< 3 channels, or 4; sides are multiples of 4, 4 … kMaxPageSide
  /// Mip levels, counting the full one, down to which a trilinear look-up inside a chart sees no other chart, if each
  /// level is the mean of 2 × 2 texels of the one before: the largest level to use is levels − 1. 1 … 14
  std::uint32_t levels = 1;
  float scale = 1.0F;  ///< texels of the page for one of the picture: 1, or 1/2, 1/3 … where a chart was too large
};

/// Cuts the triangles' texels out of `picture` (3 or 4 channels, not empty) and packs them into pages of at most
/// `max_side` texels (64 … kMaxPageSide). Triangles that share an edge in the picture form a chart, which is moved by
/// whole texels and never turned or resampled, unless it is longer than `max_side` texels and so reduced by a whole
/// factor. Texels that no triangle needs have the colours of the nearest that one does, so that no line shows in mip
/// levels and JPEG has little to do. A page has 4 channels where the picture has an alpha below 255 in its charts.
///
/// Triangles with a corner that is not finite or farther than 10^6 texels from the origin are on no page. Returns no
/// page when none is left. The result depends on the input alone; may be called from several threads.
std::vector<Page> makePages(const base::Image& picture, std::span<const PictureTriangle> triangles,
                            int max_side = 4096);

/// Returns the page as bytes: corners and alpha without loss, colours as a JPEG of this quality, 1 … 100. Errors:
/// kInvalidInput for a page that decodePage() would refuse.
base::Result<base::Bytes> encodePage(const Page& page, int quality = 95);
/// Reads what encodePage() wrote. Errors: kInvalidInput. Hostile bytes of length n take at most some 2000 n bytes of
/// memory, besides 4 MB.
base::Result<Page> decodePage(base::ByteView bytes);

}  // namespace lod::texture
