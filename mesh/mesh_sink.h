#pragma once
// How mesh readers hand on what they read: piece by piece, in the file's order, so that a file larger than memory
// passes through a bounded buffer. Private to lod/build.
#include <cstdint>
#include <glm/glm.hpp>
#include <span>

#include "base/error.h"

namespace mesh {

/// The next vertices of a file; they are numbered from 0 in the order in which they come.
struct VertexBlock {
  std::span<const glm::dvec3> positions;  ///< world, the file's own coordinates; may hold what is not finite
  std::span<const glm::vec3> normals;     ///< empty, or as many as positions; any length, zero or NaN where unknown
  std::span<const glm::u8vec4> colors;    ///< empty, or as many as positions; sRGB, a = 255
};

/// The next triangles. Corners are vertex numbers within the file; a reader has checked (or checks before it returns)
/// that each is below the number of vertices that the file turns out to have, but a vertex may come after its triangle.
struct TriangleBlock {
  std::span<const std::uint64_t> corners;  ///< 3 per triangle
  std::span<const glm::u8vec4> colors;     ///< empty, or one per corner: sRGB from a texture; a = 0 where unknown
  std::span<const glm::vec3> normals;      ///< empty, or one per corner, instead of its vertex's; zero where unknown
};

class MeshSink {
 public:
  virtual ~MeshSink() = default;
  /// Errors stop the reading; the reader returns them as they are.
  virtual base::Result<void> vertices(const VertexBlock& block) = 0;
  virtual base::Result<void> triangles(const TriangleBlock& block) = 0;
  /// Forget everything of this file: the reader begins again (it learned how to read only on the way).
  virtual base::Result<void> restart() = 0;
};

}  // namespace mesh
