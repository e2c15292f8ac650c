#pragma once
// How large points and lines are drawn that close holes and cracks (shaders/closing.glsl).
#include <algorithm>
#include <cmath>

namespace lod::draw {

/// A line covers the samples that are at most half a sample above or beside it, and so the less across it, down to
/// 1 / √2 of that, the nearer it is to a diagonal.
inline constexpr float kLineDiagonal = 1.4142F;

/// The width at which a line reaches as far as the error to both sides; of the same unit.
inline float closingLineWidth(float error) {
  return 2.0F * kLineDiagonal * error;
}

/// The copies of each line to either side that make it so wide, samples; it may be infinite. A crack of a node that is
/// shown while finer ones come may be wider.
inline int lineCopies(float width) {
  constexpr int kMaxCopies = 16;
  return width < static_cast<float>(kMaxCopies) ? std::max(1, static_cast<int>(std::ceil(width))) : kMaxCopies;
}

/// The instances of a line that is drawn so.
inline int lineInstances(int copies) {
  return copies == 1 ? 1 : 2 * copies;
}

}  // namespace lod::draw
