#include "lod/patch/builder/error_histogram.h"

#include <algorithm>
#include <limits>

#include "lod/patch/builder/distance_bound.h"

namespace lod::patch::builder {

void ErrorHistogram::add(const ErrorHistogram& other) {
  areas_.resize(std::max(areas_.size(), other.areas_.size()), 0.0);
  for (std::size_t bin = 0; bin < other.areas_.size(); ++bin) areas_[bin] += other.areas_[bin];
}

float ErrorHistogram::quantile(double share) const {
  double all = 0.0;
  for (const double area : areas_) all += area;
  double sum = 0.0;
  for (std::uint32_t bin = 0; bin < areas_.size(); ++bin) {
    sum += areas_[bin];
    if (sum < share * all && bin + 1 < areas_.size()) continue;
    return errorOfCode(static_cast<std::uint16_t>(((bin + 1) << kBinBits) - 1));
  }
  return 0.0F;
}

void ErrorHistogram::write(base::ByteWriter& out) const {
  out.u16(static_cast<std::uint16_t>(areas_.size()));
  for (const double area : areas_) out.f64(area);
}

bool ErrorHistogram::read(base::ByteReader& in) {
  constexpr std::uint32_t kMaxBins = (std::numeric_limits<std::uint16_t>::max() >> kBinBits) + 1;
  areas_.assign(in.u16(), 0.0);
  if (areas_.size() > kMaxBins) return false;
  for (double& area : areas_) area = in.f64();
  return in.ok();
}

}  // namespace lod::patch::builder
