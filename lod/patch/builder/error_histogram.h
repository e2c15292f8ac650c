#pragma once
// How much of a surface has which stated error. It tells outlying places from a level that is coarse as a whole.
#include <cstdint>
#include <vector>

#include "base/bytes.h"

namespace lod::patch::builder {

class ErrorHistogram {
 public:
  /// Adds an area ≥ 0, in any unit, whose bound is the error of `code` (errorCode()).
  void add(std::uint16_t code, float area) {
    const std::size_t bin = code >> kBinBits;
    if (bin >= areas_.size()) areas_.resize(bin + 1, 0.0);
    areas_[bin] += static_cast<double>(area);
  }
  void add(const ErrorHistogram& other);
  /// The least error that `share` (0 … 1) of the area does not exceed, rounded up by at most 7 %; 0 without any area.
  float quantile(double share) const;

  void write(base::ByteWriter& out) const;
  /// False if write() has not made these bytes.
  bool read(base::ByteReader& in);

 private:
  static constexpr std::uint32_t kBinBits = 7;  // dropped from a code, which leaves sixteen bins to an octave of errors
  std::vector<double> areas_;                   // by bin, up to the last one with any area
};

}  // namespace lod::patch::builder
