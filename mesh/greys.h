#pragma once
// Greys of points by the intensity of what returned from them.
#include <algorithm>
#include <vector>

#include "mesh/mesh_stream.h"

namespace mesh {

/// The intensities that become black and white.
struct GreyRange {
  double black = 0.0;
  double white = 0.0;

  /// By a sample, which is sorted. One bright reflector would darken all else, so that one in a hundred at either end
  /// is cut off.
  static GreyRange of(std::vector<double>& intensities) {
    if (intensities.empty()) return {};
    std::sort(intensities.begin(), intensities.end());
    const std::size_t last = intensities.size() - 1;
    const GreyRange usual{intensities[last / 100], intensities[last - last / 100]};
    return usual.isEmpty() ? GreyRange{intensities.front(), intensities.back()} : usual;
  }
  /// Whether all are the same, so that they tell nothing.
  bool isEmpty() const { return black == white; }

  /// Intensities tell what power returned, and so are linear as light is.
  glm::u8vec4 grey(double intensity) const {
    const double light = std::clamp((intensity - black) / (white - black), 0.0, 1.0);
    return {glm::u8vec3(byteFromUnit(srgbFromLinear(light))), 255};
  }
};

}  // namespace mesh
