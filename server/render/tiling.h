#pragma once
// Pictures larger than a render target are drawn in tiles: equal parts of the picture, each with its own off-axis
// camera.
#include <cstdint>
#include <vector>

#include "base/camera.h"
#include "base/error.h"
#include "base/geometry.h"

namespace server {

/// Checks that a picture is within limits: sides of 1 … 32768 pixels, 1 … 8 squared samples a pixel. kInvalidInput.
base::Result<void> checkPicture(const base::Camera& camera, int supersampling);

/// A part of a picture in pixels; y counts rows from the top.
struct Tile {
  int x = 0;
  int y = 0;
  int width = 0;  ///< pixels inside the picture
  int height = 0;
};

struct TilePlan {
  int tile_width = 0;  ///< pixels of every tile's target, which may extend beyond the picture's right and lower edge
  int tile_height = 0;
  int border = 0;           ///< pixels more that the target has on each of its four sides; 0 with a single tile
  std::vector<Tile> tiles;  ///< row by row from the top left
};

/// Divides a picture into as few tiles as keep each side at most `max_side` samples and each tile at most
/// `max_samples`, with `supersampling`² samples a pixel, borders included. A tile has at least one pixel.
TilePlan planTiles(int width, int height, int supersampling, int max_side, std::uint64_t max_samples, int border = 0);

/// Returns the camera of the tile_width × tile_height pixels of `camera`'s picture whose top left pixel is (x, y).
base::Camera tileCamera(const base::Camera& camera, int x, int y, int tile_width, int tile_height);

/// Bounds the pixels that boxes can touch in a camera's picture.
class PixelBounds {
 public:
  explicit PixelBounds(const base::Camera& camera);
  /// Adds a box; all of the picture if a part of it is beside or behind the eye.
  void add(const base::Aabb& box);
  /// Returns the bounds, a pixel wider on every side, within the picture's `width` × `height` top left pixels; 0 × 0 if
  /// no pixel can be touched.
  Tile within(int width, int height) const;

 private:
  glm::dmat4 clip_from_scene_;
  glm::dvec2 size_;
  glm::dvec2 min_;
  glm::dvec2 max_;
};

}  // namespace server
