#pragma once
// Textures of a mesh file baked to colours at triangle corners: all that a hierarchy of coloured vertices can keep.
#include <glm/glm.hpp>
#include <map>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/image.h"

namespace mesh {

/// A JPEG or PNG as a pyramid of images, each half as wide and high as the one before.
class Texture {
 public:
  /// Errors: kInvalidInput (broken, or neither JPEG nor PNG), kUnsupported (a side over 16384).
  static base::Result<Texture> decode(base::ByteView bytes);
  int width() const { return levels_[0].width; }
  int height() const { return levels_[0].height; }
  /// The mean over about `texels` x `texels` texels around (u, v), the picture repeated; u to the right and v
  /// downwards, 0..1 across the whole. NaN gives some colour.
  glm::u8vec4 mean(const glm::dvec2& uv, double texels) const;

 private:
  std::vector<base::Image> levels_;  // 3 channels
};

/// What a mesh file's textures come to, and what is lost.
class TextureBaker {
 public:
  /// One colour per corner of a polygon: the texture's mean around the corner, over half the way to its neighbours and
  /// a little to the inside, so that seams in the picture stay out. Counts the texels that the polygon covers.
  void bake(const Texture& texture, std::span<const glm::dvec2> uv, std::span<glm::u8vec4> colors);
  /// A warning when there are clearly more texels than vertices; empty else.
  std::string warning(std::uint64_t vertices) const;

 private:
  double texels_ = 0.0;
};

/// The textures that an OBJ's material libraries or a PLY's comments name, each read once, from files beside the mesh.
class TextureFiles {
 public:
  explicit TextureFiles(std::string directory) : directory_(std::move(directory)) {}
  /// Null when it cannot be read; `warnings` gets a line the first time.
  const Texture* find(const std::string& name, std::vector<std::string>& warnings);
  /// The bytes of a small file beside the mesh.
  base::Result<base::Bytes> read(const std::string& name) const;

 private:
  std::string directory_;  // empty: the working directory
  std::map<std::string, std::unique_ptr<Texture>> textures_;
};

}  // namespace mesh
