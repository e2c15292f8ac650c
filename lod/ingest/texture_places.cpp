#include "lod/ingest/texture_places.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "lod/ingest/morton.h"

namespace lod::ingest {

glm::vec2 TexturePlace::at(std::uint64_t code) const {
  for (std::size_t k = 0; k < 3; ++k)
    if (codes[k] == code) return uv[k];
  const glm::dvec3 a(mortonPoint(codes[0])), u = glm::dvec3(mortonPoint(codes[1])) - a,
                                             v = glm::dvec3(mortonPoint(codes[2])) - a;
  const glm::dvec3 p = glm::dvec3(mortonPoint(code)) - a;
  const double uu = glm::dot(u, u), uv_ = glm::dot(u, v), vv = glm::dot(v, v);
  const double pu = glm::dot(p, u), pv = glm::dot(p, v);
  const double area = uu * vv - uv_ * uv_;
  // A triangle without an area is a line, along which its longer edge runs.
  double s = 0.0, t = 0.0;
  if (area > 1e-9 * uu * vv)
    s = (vv * pu - uv_ * pv) / area, t = (uu * pv - uv_ * pu) / area;
  else if (uu >= vv && uu > 0.0)
    s = pu / uu;
  else if (vv > 0.0)
    t = pv / vv;
  return uv[0] + static_cast<float>(s) * (uv[1] - uv[0]) + static_cast<float>(t) * (uv[2] - uv[0]);
}

base::Result<TexturePlaces> TexturePlaces::create(const std::string& directory) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, SpoolFile::create(directory + "/" + kName));
  return TexturePlaces(std::move(file));
}

base::Result<TexturePlaces> TexturePlaces::open(const std::string& directory) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, SpoolFile::open(directory + "/" + kName));
  return TexturePlaces(std::move(file));
}

base::Result<void> TexturePlaces::append(std::span<const TexturePlace> places) {
  if (places.empty()) return {};
  return file_.append({reinterpret_cast<const std::uint8_t*>(places.data()), places.size_bytes()});
}

base::Result<TexturePlace> TexturePlaces::operator[](std::uint64_t source) const {
  TexturePlace place;
  std::uint8_t bytes[sizeof(TexturePlace)];
  LUMIGRID_TRY(file_.readAt(source * sizeof(TexturePlace), bytes));
  std::memcpy(&place, bytes, sizeof(place));
  return place;
}

base::Result<std::vector<TexturePlace>> TexturePlaces::read(std::span<const std::uint64_t> sources) const {
  // A choice: reading so many records between two that are wanted takes less time than another call, and a piece of so
  // many records stays in the cache.
  constexpr std::uint64_t kMaxGap = 32, kMaxPiece = 4096;
  std::vector<std::pair<std::uint64_t, std::size_t>> sorted;
  for (std::size_t i = 0; i < sources.size(); ++i)
    if (sources[i] != kNoSource) sorted.emplace_back(sources[i], i);
  std::sort(sorted.begin(), sorted.end());

  std::vector<TexturePlace> places(sources.size()), piece;
  for (std::size_t begin = 0, end = 0; begin < sorted.size(); begin = end) {
    const std::uint64_t first = sorted[begin].first;
    for (end = begin + 1; end < sorted.size() && sorted[end].first - sorted[end - 1].first <= kMaxGap &&
                          sorted[end].first - first < kMaxPiece;)
      ++end;
    piece.resize(static_cast<std::size_t>(sorted[end - 1].first - first) + 1);
    LUMIGRID_TRY(file_.readAt(first * sizeof(TexturePlace),
                              {reinterpret_cast<std::uint8_t*>(piece.data()), piece.size() * sizeof(TexturePlace)}));
    for (std::size_t i = begin; i < end; ++i) places[sorted[i].second] = piece[sorted[i].first - first];
  }
  return places;
}

}  // namespace lod::ingest
