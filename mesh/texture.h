#pragma once
// Bakes the textures of a mesh file to colours at triangle corners, since hierarchies keep colours at vertices only.
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
  /// The mean over about `texels` x `texels` texels around (u, v), where the picture is repeated. u runs to the right
  /// and v downwards, 0..1 across the picture. NaN gives grey.
  glm::u8vec4 mean(const glm::dvec2& uv, double texels) const;

 private:
  std::vector<base::Image> levels_;  // 3 channels
};

/// Bakes polygons, and measures how much finer the textures are than the mesh.
class TextureBaker {
 public:
  /// Gives each corner of a polygon the texture's mean over half the way to its neighbours. The mean is taken a little
  /// inside the polygon, so that what lies beyond a seam in the picture does not count.
  void bake(const Texture& texture, std::span<const glm::dvec2> uv, std::span<glm::u8vec4> colors);
  /// A warning where the polygons baked cover clearly more texels than there are vertices; else empty.
  std::string warning(std::uint64_t vertices) const;

 private:
  double texels_ = 0.0;  // covered by all polygons so far
};

/// The textures that an OBJ's material libraries or a PLY's comments name, each read once, from files beside the mesh.
class TextureFiles {
 public:
  explicit TextureFiles(std::string directory) : directory_(std::move(directory)) {}
  /// Null where it cannot be read; the first time `warnings` gets a line.
  const Texture* find(const std::string& name, std::vector<std::string>& warnings);
  /// The bytes of a file beside the mesh.
  base::Result<base::Bytes> read(const std::string& name) const;

 private:
  std::string directory_;  // empty: the working directory
  std::map<std::string, std::unique_ptr<Texture>> textures_;
};

}  // namespace mesh
