#pragma once
// Indices of a mesh on the GPU, two bytes each where they fit.
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <span>
#include <vector>

#include "base/gl/gl.h"

namespace lod::draw {

struct IndexBuffer {
  base::gl::Buffer buffer;
  GLenum type = GL_UNSIGNED_SHORT;

  /// Bytes of `count` indices.
  std::size_t bytesOf(std::size_t count) const { return count * (type == GL_UNSIGNED_SHORT ? 2 : 4); }
};

namespace detail {

template <class Index>
base::gl::Buffer uploadIndices(std::initializer_list<std::span<const std::uint32_t>> lists) {
  std::vector<Index> indices;
  for (const auto& list : lists)
    for (const std::uint32_t index : list) indices.push_back(static_cast<Index>(index));
  base::gl::Buffer buffer = base::gl::Buffer::create();
  base::gl::allocate(buffer, GL_ELEMENT_ARRAY_BUFFER, indices.data(), indices.size() * sizeof(Index), GL_STATIC_DRAW);
  return buffer;
}

}  // namespace detail

/// Uploads the lists one behind the other; the buffer stays bound. `vertices`: how many the mesh has.
inline IndexBuffer uploadIndices(std::size_t vertices, std::initializer_list<std::span<const std::uint32_t>> lists) {
  if (vertices <= std::size_t{std::numeric_limits<std::uint16_t>::max()} + 1)
    return {detail::uploadIndices<std::uint16_t>(lists), GL_UNSIGNED_SHORT};
  return {detail::uploadIndices<std::uint32_t>(lists), GL_UNSIGNED_INT};
}

}  // namespace lod::draw
