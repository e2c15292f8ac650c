#pragma once
// Sampling images of one size on the GPU: a colour array with mip levels and, layer beside layer, a depth array.
#include <cstdint>
#include <vector>

#include "base/gl/gl.h"
#include "base/image.h"

namespace client {

/// Layers are handed out and taken back; storage grows by doubling (copied on the GPU) and stays until the array is
/// destroyed.
class SampleArray {
 public:
  static constexpr int kFirstLayers = 4;  ///< a first allocation; doubled from there

  /// Colour layers of width × height, depth layers of depth_width × depth_height. A budget of no more than
  /// `most_at_once` layers is allocated whole with the first image.
  SampleArray(int width, int height, int depth_width, int depth_height, int most_at_once = kFirstLayers);

  int width() const { return width_; }
  int height() const { return height_; }
  int depthWidth() const { return depth_width_; }
  int depthHeight() const { return depth_height_; }
  /// Of one layer: colour with all mip levels, and depth.
  std::uint64_t bytesPerLayer() const;
  /// Of all layers that are allocated, used or not.
  std::uint64_t bytes() const { return bytesPerLayer() * static_cast<std::uint64_t>(capacity_); }
  int used() const { return capacity_ - static_cast<int>(free_.size()); }

  /// A layer for `rgba` (4 channels, of this array's size), −1 when none is free and growing would exceed
  /// `budget_bytes` for this array, the copy that growing makes included, or the GL's limit of layers.
  int add(const base::Image& rgba, std::uint64_t budget_bytes);
  void release(int layer) { free_.push_back(layer); }

  GLuint color() const { return color_.name(); }
  GLuint depth() const { return depth_.name(); }
  /// Binds a framebuffer whose depth is this layer's map, sets the viewport and clears it.
  void beginDepth(int layer) const;

 private:
  bool grow(std::uint64_t budget_bytes);
  base::gl::Texture makeColor(int layers) const;
  base::gl::Texture makeDepth(int layers) const;
  void copyLayersTo(const base::gl::Texture& color, const base::gl::Texture& depth) const;

  int width_, height_, depth_width_, depth_height_, most_at_once_;
  int capacity_ = 0;
  std::vector<int> free_;
  base::gl::Texture color_;
  base::gl::Texture depth_;
  base::gl::Framebuffer framebuffer_;
};

}  // namespace client
