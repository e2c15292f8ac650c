#pragma once
// Lists of the places at which each key stands, side by side in one array.
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace lod::patch::builder {

/// The places of key k are member[first[k]] … member[first[k + 1] − 1], in rising order.
struct PlacesByKey {
  std::vector<std::uint32_t> first;
  std::vector<std::uint32_t> member;
};

/// Sets `out` to the places of the keys 0 to `count` − 1 in `keys`; its memory is kept.
inline void listPlaces(std::span<const std::uint32_t> keys, std::size_t count, PlacesByKey& out) {
  out.first.assign(count + 1, 0);
  for (const std::uint32_t key : keys) ++out.first[key + 1];
  for (std::size_t k = 1; k <= count; ++k) out.first[k] += out.first[k - 1];
  out.member.resize(keys.size());
  std::vector<std::uint32_t> next(out.first.begin(), out.first.end() - 1);
  for (std::uint32_t i = 0; i < keys.size(); ++i) out.member[next[keys[i]]++] = i;
}

}  // namespace lod::patch::builder
