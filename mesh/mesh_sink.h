#pragma once
// The interface between mesh readers and those who use what they read. Readers pass on blocks in the file's order, so
// that a file larger than memory goes through a bounded buffer.
#include <cstdint>
#include <glm/glm.hpp>
#include <span>

#include "base/error.h"

namespace mesh {

/// The next vertices of a file; they are numbered from 0 in the order in which they come.
struct VertexBlock {
  std::span<const glm::dvec3> positions;  ///< world, the file's own coordinates; may be NaN or infinite
  std::span<const glm::vec3> normals;     ///< empty, or as many as positions; any length, zero or NaN where unknown
  std::span<const glm::u8vec4> colors;    ///< empty, or as many as positions; sRGB, a = 255
};

/// The next triangles. Corners are vertex numbers within the file. The reader checks, here or before it returns, that
/// each is below the file's number of vertices, but a vertex may come after its triangle.
struct TriangleBlock {
  std::span<const std::uint64_t> corners;  ///< 3 per triangle
  std::span<const glm::u8vec4> colors;     ///< empty, or one per corner: sRGB from a texture; a = 0 where unknown
  std::span<const glm::vec3> normals;      ///< empty, or one per corner, instead of its vertex's; zero where unknown
};

class MeshSink {
 public:
  virtual ~MeshSink() = default;
  /// An error stops the reading, and the reader returns it as it is.
  virtual base::Result<void> vertices(const VertexBlock& block) = 0;
  virtual base::Result<void> triangles(const TriangleBlock& block) = 0;
  /// Drops all blocks of this file: the reader starts it again, since only on the way it learned how to read it.
  virtual base::Result<void> restart() = 0;
};

}  // namespace mesh
