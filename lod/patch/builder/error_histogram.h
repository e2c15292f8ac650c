#pragma once
// How much of a surface has which stated error: what tells places that stand out from a level that is coarse.
#include <cstdint>
#include <vector>

#include "base/bytes.h"

namespace lod::patch::builder {

class ErrorHistogram {
 public:
  /// `area` ≥ 0, in whatever unit, whose bound is the error that `code` (errorCode()) stands for.
  void add(std::uint16_t code, float area) {
    const std::size_t bin = code >> kBinBits;
    if (bin >= areas_.size()) areas_.resize(bin + 1, 0.0);
    areas_[bin] += static_cast<double>(area);
  }
  void add(const ErrorHistogram& other);
  /// The least error that `share` (0 … 1) of the area keeps within, rounded up by at most 7 %; 0 of nothing.
  float quantile(double share) const;

  void write(base::ByteWriter& out) const;
  /// False where the bytes are none of write's.
  bool read(base::ByteReader& in);

 private:
  static constexpr std::uint32_t kBinBits = 7;  // of a code: sixteen bins an octave of errors
  std::vector<double> areas_;                   // by bin, up to the last that has any
};

}  // namespace lod::patch::builder
