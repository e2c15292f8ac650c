#pragma once
// Where the source's triangles lie in its pictures: a work file with a record for each triangle in the source's order.
#include <array>
#include <cstdint>
#include <glm/glm.hpp>
#include <limits>
#include <span>
#include <string>
#include <vector>

#include "base/file.h"
#include "lod/ingest/spool.h"
#include "mesh/stream_mesh.h"

namespace lod::ingest {

/// In place of a source triangle's number, for triangles that no file has.
inline constexpr std::uint64_t kNoSource = std::numeric_limits<std::uint64_t>::max();

/// A triangle of the source on the lattice, and in its picture.
struct TexturePlace {
  std::array<std::uint64_t, 3> codes{};  ///< Morton codes of its corners, stitched
  std::array<glm::vec2, 3> uv{};         ///< of the same corners, as mesh::TriangleBlock has them
  std::uint32_t picture = mesh::kNoPicture;
  std::uint32_t unused = 0;

  /// The place in the picture of a point on the triangle (or beside it, as triangles have it that were cut or whose
  /// corners were moved): the corner's own where the code is one's, else by barycentric coordinates.
  glm::vec2 at(std::uint64_t code) const;
};

class TexturePlaces {
 public:
  static constexpr const char* kName = "textures";  ///< of the file in the work directory

  /// Creates the file in `directory`. Errors: kNoSpace, kIo.
  static base::Result<TexturePlaces> create(const std::string& directory);
  /// Opens the file that an earlier run, or an earlier stage, has flushed. Errors: kNotFound, kIo.
  static base::Result<TexturePlaces> open(const std::string& directory);
  TexturePlaces() = default;

  base::Result<void> append(std::span<const TexturePlace> places);
  base::Result<void> flush() { return file_.flush(); }
  std::uint64_t size() const { return file_.size() / sizeof(TexturePlace); }
  /// The place of a triangle of the source. Safe from several threads. Errors: kIo.
  base::Result<TexturePlace> operator[](std::uint64_t source) const;
  /// The places of many triangles, in their order; those of kNoSource show no picture. Neighbours in the source are
  /// read together. Safe from several threads. Errors: kIo.
  base::Result<std::vector<TexturePlace>> read(std::span<const std::uint64_t> sources) const;

 private:
  explicit TexturePlaces(SpoolFile file) : file_(std::move(file)) {}
  SpoolFile file_;
};

}  // namespace lod::ingest
