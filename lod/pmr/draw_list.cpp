#include "lod/pmr/draw_list.h"

#include <algorithm>
#include <array>
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

/// How many of the falling radii belong to umbrellas larger than the pixel.
std::uint32_t countUmbrellas(const std::vector<float>& radii, float pixel) {
  const auto end = std::partition_point(radii.begin(), radii.end(), [&](float r) { return !(2.0F * r < pixel); });
  return static_cast<std::uint32_t>(end - radii.begin());
}

}  // namespace

DrawnPart DrawList::pointsAt(float pixel) const {
  return {countUmbrellas(point_radii, pixel), static_cast<std::uint32_t>(point_radii.size())};
}

DrawnPart DrawList::trianglesAt(float pixel) const {
  return {0, countUmbrellas(reaches, pixel)};
}

float meanRadius(const DrawList& list) {
  double sum = 0.0;
  std::size_t umbrellas = 0;
  for (; umbrellas < list.point_radii.size() && list.point_radii[umbrellas] > 0.0F; ++umbrellas)
    sum += static_cast<double>(list.point_radii[umbrellas]);
  return umbrellas > 0 ? static_cast<float>(sum / static_cast<double>(umbrellas)) : 0.0F;
}

DrawList makeDrawList(std::span<const glm::vec3> positions, const std::vector<bool>& is_own,
                      std::span<const std::uint16_t> corners) {
  std::vector<float> radii(positions.size(), 0.0F);
  for (std::size_t i = 0; i + 2 < corners.size(); i += 3) {
    for (const auto& [a, b] : {std::pair(i, i + 1), std::pair(i + 1, i + 2), std::pair(i + 2, i)}) {
      const float length = glm::length(positions[corners[a]] - positions[corners[b]]);
      radii[corners[a]] = std::max(radii[corners[a]], length);
      radii[corners[b]] = std::max(radii[corners[b]], length);
    }
  }

  DrawList list;
  std::vector<std::uint16_t> own;
  std::vector<float> own_radii;
  for (std::size_t v = 0; v < positions.size(); ++v) {
    if (!is_own[v]) continue;
    own.push_back(static_cast<std::uint16_t>(v));
    own_radii.push_back(radii[v]);
  }
  for (const std::uint32_t i : orderByFalling(own_radii)) {
    list.points.push_back(own[i]);
    list.point_radii.push_back(own_radii[i]);
  }

  std::vector<float> reaches(corners.size() / 3, 0.0F);
  for (std::size_t i = 0; i < 3 * reaches.size(); ++i)
    if (is_own[corners[i]]) reaches[i / 3] = std::max(reaches[i / 3], radii[corners[i]]);
  for (const std::uint32_t t : orderByFalling(reaches)) {
    const auto first = corners.begin() + std::ptrdiff_t{3} * t;
    list.corners.insert(list.corners.end(), first, first + 3);
    list.reaches.push_back(reaches[t]);
  }
  return list;
}

}  // namespace lod::pmr
