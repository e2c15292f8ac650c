#include "lod/patch/builder/coarse_positions.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "lod/ingest/code_map.h"
#include "lod/ingest/morton.h"
#include "lod/patch/builder/places_by_key.h"
#include "lod/patch/codec/header.h"

namespace lod::patch::builder {

namespace {

// Steps are at most this many times the typical error of what is merged, which is about half of the group's own. With
// twice as much, typical errors grow by a tenth to a half (docs/decisions/lattice-positions.md).
constexpr double kStepOverError = 3.0;
constexpr int kMostSpareBits = codec::kMostLowBits;
// A triangle keeps its direction if this share of its area at least is left along its normal.
constexpr float kKeptArea = 0.25F;

}  // namespace

int spareBits(double typical_error_below) {
  const double step = std::clamp(kStepOverError * typical_error_below, 1.0, std::exp2(kMostSpareBits));
  return static_cast<int>(std::floor(std::log2(step)));
}

void coarsenPositions(SimplifiedGroup& group, const std::vector<std::uint8_t>& locked, const glm::ivec3& corner,
                      int bits) {
  if (bits == 0) return;
  const std::vector<std::uint32_t>& indices = group.history.indices;
  std::vector<glm::vec3>& positions = group.vertices.positions;
  PlacesByKey corners;  // by vertex
  listPlaces(indices, positions.size(), corners);
  const auto corners_of = [&](std::size_t v) {
    return std::span(corners.member).subspan(corners.first[v], corners.first[v + 1] - corners.first[v]);
  };
  const auto code = [&](const glm::vec3& p) { return ingest::mortonCode(corner + glm::ivec3(p)); };
  // Places that were left count as taken, too: that costs few moves, and the map has no removal.
  ingest::CodeMap taken(positions.size() / 2);
  for (std::size_t v = 0; v < positions.size(); ++v)
    if (!corners_of(v).empty()) taken.insert(code(positions[v]));

  const auto coarse = [&](const glm::vec3& p) {
    const glm::ivec3 q = corner + glm::ivec3(p) + (1 << (bits - 1));
    return glm::vec3(((q >> bits) << bits) - corner);
  };
  const auto normalOf = [&](std::size_t t) {
    const glm::vec3& a = positions[indices[3 * t]];
    return glm::cross(positions[indices[3 * t + 1]] - a, positions[indices[3 * t + 2]] - a);
  };
  // Triangles are compared with what they were before any move, since several small turns add up.
  std::vector<glm::vec3> before(indices.size() / 3);
  for (std::size_t t = 0; t < before.size(); ++t) before[t] = normalOf(t);
  for (std::size_t v = 0; v < positions.size(); ++v) {
    const auto fan = corners_of(v);
    if (locked[v] != 0 || fan.empty()) continue;
    const glm::vec3 at = positions[v];
    const glm::vec3 to = coarse(at);
    if (to == at || glm::any(glm::lessThan(corner + glm::ivec3(to), glm::ivec3(0)))) continue;
    if (taken.at(code(to)) != ingest::CodeMap::kNone) continue;

    positions[v] = to;
    const bool keeps = std::all_of(fan.begin(), fan.end(), [&](std::uint32_t corner_place) {
      const glm::vec3& normal = before[corner_place / 3];
      return glm::dot(normalOf(corner_place / 3), normal) >= kKeptArea * glm::dot(normal, normal);
    });
    if (keeps)
      taken.insert(code(to));
    else
      positions[v] = at;
  }
}

}  // namespace lod::patch::builder
