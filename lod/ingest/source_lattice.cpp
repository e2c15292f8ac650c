#include "lod/ingest/source_lattice.h"

#include <algorithm>
#include <cmath>

#include "lod/ingest/morton.h"

namespace lod::ingest {
namespace {

// Fewer bits hardly shorten the file of a small mesh, and cost accuracy at fine levels.
constexpr std::uint32_t kMinChosenBits = 14;
constexpr double kStepsPerMeanEdge = 16.0;
// The ends of an edge of √3 steps or more never meet at a lattice point.
constexpr double kStepsPerShortEdge = 2.0;
// Once bits are added, so few lost triangles are aimed at. The shares are of a sample of 8192 triangles at least, whose
// standard deviation is a thousandth, so that the told share is not met after all.
constexpr double kAimedShare = 0.5 * kToldShare;

// How many bits there must be for so short a step.
std::uint32_t bitsFor(double longest, const SourceInfo& info) {
  const double steps =
      std::max(kStepsPerMeanEdge * longest / info.mean_edge, kStepsPerShortEdge * longest / info.short_edge);
  auto bits = static_cast<std::uint32_t>(
      std::clamp(std::ceil(std::log2(steps + 1.0)), double{kMinChosenBits}, static_cast<double>(kMaxLatticeBits)));
  // A fine part may have less than a tenth of the edges. Slivers, which clipping leaves, have no such bits.
  if (info.lost[bits] > kToldShare && finerKeepsMost(info, bits))
    while (bits < kMaxLatticeBits && info.lost[bits] > kAimedShare) ++bits;
  return bits;
}

}  // namespace

glm::ivec3 SourceLattice::point(const glm::dvec3& world) const {
  const double last = static_cast<double>((1U << bits) - 1);
  // Halves are rounded up. For numbers that are not negative a comparison does it, faster than the library's round.
  const glm::dvec3 q = glm::clamp((world - corner) / lattice.step, 0.0, last);
  const glm::ivec3 whole(q);
  return whole + glm::ivec3(glm::greaterThanEqual(q - glm::dvec3(whole), glm::dvec3(0.5)));
}

bool finerKeepsMost(const SourceInfo& info, std::uint32_t bits) {
  return info.lost[kMaxLatticeBits] < 0.5 * info.lost[bits];
}

base::Result<void> checkPositionBits(std::uint32_t bits) {
  if (bits == 0 || (bits >= kMinLatticeBits && bits <= kMaxLatticeBits)) return {};
  return base::Error{base::ErrorCode::kInvalidInput, "position bits must be 10 to 21, or 0 to choose"};
}

SourceLattice makeLattice(const SourceInfo& info, const glm::dvec3& origin, std::uint32_t bits) {
  const glm::dvec3 size = info.box_max - info.box_min;
  const double longest = std::max({size.x, size.y, size.z});
  SourceLattice out;
  out.bits = bits;
  if (bits == 0) {
    out.bits = kMinChosenBits;
    if (info.mean_edge > 0.0 && longest > 0.0) out.bits = bitsFor(longest, info);
  }
  out.corner = info.box_min;
  out.lattice.origin = info.box_min - origin;
  // The longest side has an even number of steps, so that a symmetric mesh has lattice points on its middle plane.
  out.lattice.step = longest > 0.0 ? longest / static_cast<double>((1U << out.bits) - 2) : 1.0;
  return out;
}

}  // namespace lod::ingest
