#include "lod/pmr/draw_list.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>
#include <utility>

#include "base/bytes.h"

namespace lod::pmr {
namespace {

/// The numbers 0 … values.size() − 1 by falling values, which are not negative. A stable radix sort: bits of such
/// floats are in the order of their values.
std::vector<std::uint32_t> orderByFalling(const std::vector<float>& values) {
  constexpr unsigned kDigitBits = 11, kKeyBits = 32;
  constexpr std::uint32_t kDigits = 1U << kDigitBits;
  struct Keyed {
    std::uint32_t key = 0, number = 0;
  };
  std::vector<Keyed> items(values.size()), sorted(values.size());
  for (std::uint32_t i = 0; i < items.size(); ++i) items[i] = {~base::bitCast<std::uint32_t>(values[i]), i};
  for (unsigned shift = 0; shift < kKeyBits; shift += kDigitBits) {
    std::array<std::uint32_t, kDigits + 1> begins{};
    for (const Keyed& item : items) ++begins[(item.key >> shift & (kDigits - 1)) + 1];
    std::partial_sum(begins.begin(), begins.end(), begins.begin());
    for (const Keyed& item : items) sorted[begins[item.key >> shift & (kDigits - 1)]++] = item;
    std::swap(items, sorted);
  }
  std::vector<std::uint32_t> order(values.size());
  std::transform(items.begin(), items.end(), order.begin(), [](const Keyed& item) { return item.number; });
  return order;
}

/// `radii`: of umbrellas, 0 of points that are not the leaf's own.
float reachOf(const std::vector<float>& radii, const std::uint16_t* corners) {
  return std::max({radii[corners[0]], radii[corners[1]], radii[corners[2]]});
}

}  // namespace

DrawnPart DrawList::pointsAt(float pixel) const {
  return {countUmbrellas(point_radii, pixel), static_cast<std::uint32_t>(point_radii.size())};
}

std::uint32_t countUmbrellas(std::span<const float> falling, float pixel) {
  const auto end = std::partition_point(falling.begin(), falling.end(), [&](float r) { return !(2.0F * r < pixel); });
  return static_cast<std::uint32_t>(end - falling.begin());
}

float meanRadius(const DrawList& list) {
  double sum = 0.0;
  std::size_t umbrellas = 0;
  for (; umbrellas < list.point_radii.size() && list.point_radii[umbrellas] > 0.0F; ++umbrellas)
    sum += static_cast<double>(list.point_radii[umbrellas]);
  return umbrellas > 0 ? static_cast<float>(sum / static_cast<double>(umbrellas)) : 0.0F;
}

DrawList makeDrawList(std::span<const glm::vec3> positions, const std::vector<bool>& is_own,
                      std::vector<std::uint16_t> corners) {
  // Squares have their maxima where lengths have them.
  std::vector<float> radii(positions.size(), 0.0F);
  const auto squaredLength = [&](std::uint16_t from, std::uint16_t to) {
    const glm::vec3 edge = positions[from] - positions[to];
    return glm::dot(edge, edge);
  };
  for (std::size_t i = 0; i + 2 < corners.size(); i += 3) {
    const std::uint16_t a = corners[i], b = corners[i + 1], c = corners[i + 2];
    const float ab = squaredLength(a, b), bc = squaredLength(b, c), ca = squaredLength(c, a);
    radii[a] = std::max({radii[a], ab, ca});
    radii[b] = std::max({radii[b], ab, bc});
    radii[c] = std::max({radii[c], bc, ca});
  }
  for (float& radius : radii) radius = std::sqrt(radius);

  DrawList list;
  std::vector<std::uint16_t> own;
  std::vector<float> own_radii;
  own.reserve(positions.size());
  own_radii.reserve(positions.size());
  for (std::size_t v = 0; v < positions.size(); ++v) {
    if (!is_own[v]) {
      radii[v] = 0.0F;
      continue;
    }
    own.push_back(static_cast<std::uint16_t>(v));
    own_radii.push_back(radii[v]);
  }
  list.points.reserve(own.size());
  list.point_radii.reserve(own.size());
  for (const std::uint32_t i : orderByFalling(own_radii)) {
    list.points.push_back(own[i]);
    list.point_radii.push_back(own_radii[i]);
  }

  for (std::size_t i = 0; i + 2 < corners.size(); i += 3)
    list.least_reach = std::min(list.least_reach, reachOf(radii, &corners[i]));
  list.corners = std::move(corners);
  return list;
}

SortedTriangles sortedTriangles(const DrawList& list, std::size_t vertices) {
  std::vector<float> radii(vertices, 0.0F);  // of own points
  for (std::size_t i = 0; i < list.points.size(); ++i) radii[list.points[i]] = list.point_radii[i];
  std::vector<float> reaches;
  for (std::size_t i = 0; i + 2 < list.corners.size(); i += 3) reaches.push_back(reachOf(radii, &list.corners[i]));

  SortedTriangles sorted;
  for (const std::uint32_t t : orderByFalling(reaches)) {
    const auto first = list.corners.begin() + std::ptrdiff_t{3} * t;
    sorted.corners.insert(sorted.corners.end(), first, first + 3);
    sorted.reaches.push_back(reaches[t]);
  }
  return sorted;
}

}  // namespace lod::pmr
