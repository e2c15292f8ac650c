#pragma once
// The mean of pictures of one view, each shifted by a part of a pixel: as many samples a pixel as there are pictures,
// which a GL need not have at a time. docs/decisions/antialiasing.md.
#include <cstdint>
#include <glm/glm.hpp>

#include "base/error.h"
#include "base/gl/gl.h"

namespace client {

class PictureMean {
 public:
  static constexpr int kMostPictures = 8;  ///< whose sum half floats hold without rounding

  static base::Result<PictureMean> create();

  /// Makes targets of this size. Error where the GL has none of half floats, or no room: kNoSpace.
  base::Result<void> prepare(int width, int height);
  /// Gives them back.
  void release();
  static std::uint64_t bytesOf(int width, int height);
  std::uint64_t bytes() const { return color_.bytes() + depth_.bytes() + sum_.bytes() + kept_.bytes(); }

  /// Returns by how many pixels picture number i of `count` is shifted, less than half a pixel either way: no two
  /// pictures of 4 or 8 share a row or a column (the patterns of Direct3D 11's multisampling).
  static glm::vec2 shiftOf(int i, int count);

  /// The next picture is the first of another mean.
  void restart() { count_ = 0; }
  /// The same, and the mean so far is kept, in place of the one that was kept before.
  void keep();
  void dropKept() { kept_count_ = 0; }
  /// Pictures in the mean that is kept; 0 where there is none.
  int kept() const { return kept_count_; }
  /// Pictures that were added since then.
  int pictures() const { return count_; }
  /// Makes the picture that is drawn next the target: RGBA8 and 24 bits of depth.
  void beginPicture() const;
  /// Adds it, at most kMostPictures in all. Leaves it bound.
  void addPicture();
  /// Writes the mean that is kept, else that of the pictures, into the framebuffer and leaves that one bound, all of it
  /// the viewport. Pixels that are covered in part get a colour premultiplied by their alpha, if the background is
  /// transparent black.
  void resolveTo(GLuint framebuffer) const;

 private:
  PictureMean() = default;
  void cover(const base::gl::Texture& picture, int count) const;
  base::gl::Program program_;
  base::gl::WholeTarget whole_;
  base::gl::Texture color_, sum_, kept_;
  base::gl::Texture depth_;
  base::gl::Framebuffer picture_target_, sum_target_, kept_target_;
  int width_ = 0, height_ = 0, count_ = 0, kept_count_ = 0;
};

}  // namespace client
