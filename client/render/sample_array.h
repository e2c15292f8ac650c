#pragma once
// Sampling images of one size on the GPU: an array of colour layers with mip levels, and one of depth layers beside it.
#include <cstdint>
#include <vector>

#include "base/gl/gl.h"
#include "base/image.h"

namespace client {

/// Layers of an array in one more step of its growth, or as many as it has where it may not grow.
struct LayerGrowth {
  int first = 4;       ///< layers of the first allocation
  int affordable = 0;  ///< layers that the budget holds; while they are copied, old and new ones count
  int at_once = 4;     ///< a budget for no more layers than this is allocated whole with the first image
  int most = 256;      ///< the GL's limit
  int after(int capacity) const;
};

/// Allocates and releases layers. Storage grows by doubling, with a copy on the GPU, and stays until the array is
/// destroyed.
class SampleArray {
 public:
  static constexpr int kFirstLayers = 4;  ///< layers of the first allocation, a choice; storage doubles from there

  /// Colour layers have width × height, depth layers depth_width × depth_height. A budget for no more than
  /// `whole_up_to_layers` layers is allocated at once with the first image.
  SampleArray(int width, int height, int depth_width, int depth_height, int whole_up_to_layers = kFirstLayers);

  int width() const { return width_; }
  int height() const { return height_; }
  int depthWidth() const { return depth_width_; }
  int depthHeight() const { return depth_height_; }
  /// Returns the bytes of a layer: colour with all mip levels, and depth.
  std::uint64_t bytesPerLayer() const;
  /// Returns the bytes of all allocated layers, used or not.
  std::uint64_t bytes() const { return bytesPerLayer() * static_cast<std::uint64_t>(capacity_); }
  int used() const { return capacity_ - static_cast<int>(free_.size()); }

  /// Uploads `rgba` (4 channels, of this array's size) and returns its layer; −1 if none is free and growing, with its
  /// temporary copy, would exceed `budget_bytes` for this array or the GL's limit of layers.
  int add(const base::Image& rgba, std::uint64_t budget_bytes);
  void release(int layer) { free_.push_back(layer); }

  GLuint color() const { return color_.name(); }
  GLuint depth() const { return depth_.name(); }
  /// Binds a framebuffer with this layer's depth map, sets the viewport and clears it.
  void beginDepth(int layer) const;

 private:
  bool grow(std::uint64_t budget_bytes);
  base::gl::Texture makeColor(int layers) const;
  base::gl::Texture makeDepth(int layers) const;
  void copyLayersTo(const base::gl::Texture& color, const base::gl::Texture& depth) const;

  int width_, height_, depth_width_, depth_height_, whole_up_to_layers_;
  int capacity_ = 0;
  std::vector<int> free_;
  base::gl::Texture color_;
  base::gl::Texture depth_;
  base::gl::Framebuffer framebuffer_;
};

}  // namespace client
