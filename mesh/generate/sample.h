#pragma once
// Generated scan-like meshes, for any machine (`lumigrid sample`). Deterministic by seed; streamed, so that memory does
// not grow with the triangle count.
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
  std::uint64_t triangles = 1'000'000;  ///< 10^4 … 10^9; the result has within 2 % of it
  std::uint64_t seed = 1;
  bool colors = true;
  bool faces = true;       ///< false: a point cloud of its vertices, half as many as triangles
  glm::dvec3 origin{0.0};  ///< added to every position (survey coordinates); written as double then
};

/// Binary little-endian PLY at `path`; appears whole or not at all.
base::Result<void> writeSamplePly(const SampleOptions& options, const std::string& path,
                                  const std::function<bool(double done)>& progress = nullptr);

}  // namespace mesh::generate
