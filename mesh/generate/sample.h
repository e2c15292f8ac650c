#pragma once
// Generates meshes that look like scans (`lumigrid sample`). The seed determines every byte on any machine. Files are
// streamed, so memory does not grow with the number of triangles.
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <string>

#include "base/error.h"

namespace mesh::generate {

enum class SampleShape {
  kStatue,  ///< closed: a displaced sphere-like body with carved fine detail and colour
  kRelief,  ///< open: a carved relief panel (height field) with an open border
};

struct SampleOptions {
  SampleShape shape = SampleShape::kStatue;
  std::uint64_t triangles = 1'000'000;  ///< 10^4 … 10^9; the result differs by at most 2 %
  std::uint64_t seed = 1;
  bool colors = true;
  bool faces = true;       ///< false: a point cloud of its vertices, half as many as triangles
  glm::dvec3 origin{0.0};  ///< added to every position, as in survey coordinates; positions are doubles then
};

/// Writes a binary little-endian PLY, which appears at `path` whole or not at all.
base::Result<void> writeSamplePly(const SampleOptions& options, const std::string& path,
                                  const std::function<bool(double done)>& progress = nullptr);

}  // namespace mesh::generate
