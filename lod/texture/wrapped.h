#pragma once
// Where places lie in a picture that repeats. Private to lod/texture.

namespace lod::texture {

/// The value less a multiple of the period, 0 to period - 1.
inline int wrapped(int value, int period) {
  const int rest = value % period;
  return rest < 0 ? rest + period : rest;
}

}  // namespace lod::texture
