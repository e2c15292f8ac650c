#include "mesh/generate/lettering.h"

#include <algorithm>

#include "mesh/generate/font.h"
#include "mesh/generate/surface.h"

namespace mesh::generate {
namespace {

constexpr double kMargin = 2.0;  // cells of a board around its text
const glm::dvec3 kGround(236.0, 229.0, 211.0);
const glm::dvec3 kInk(38.0, 33.0, 35.0);

}  // namespace

void Lettering::add(const std::string& text, const glm::dvec3& corner, double height, const glm::dvec2& right) {
  const double cell = height / kGlyphRows;
  const glm::dvec2 up(-right.y, right.x);
  signs_.push_back({text, corner, {right, 0.0}, {up, 0.0}, height});
  boards_.push_back({glm::dvec2(corner) - kMargin * cell * (right + up), right,
                     cell * glm::dvec2(textWidth(text) + 2.0 * kMargin, kGlyphRows + 2.0 * kMargin), corner.z,
                     static_cast<int>(signs_.size()) - 1, cell});
}

void Lettering::addBoard(const glm::dvec2& low, const glm::dvec2& high, double level) {
  boards_.push_back({low, {1.0, 0.0}, high - low, level, -1, 1.0});
}

void Lettering::finish(const glm::dvec2& size) {
  cell_size_ = size / static_cast<double>(kCells);
  boards_of_cell_.assign(std::size_t{kCells} * kCells, {});
  for (std::size_t i = 0; i < boards_.size(); ++i) enter(static_cast<std::uint16_t>(i));
}

void Lettering::enter(std::uint16_t board) {
  const Board& b = boards_[board];
  glm::dvec2 low = b.corner, high = b.corner;
  for (const glm::dvec2& end : {b.size.x * b.right, b.size.y * b.up(), b.size.x * b.right + b.size.y * b.up()}) {
    low = glm::min(low, b.corner + end);
    high = glm::max(high, b.corner + end);
  }
  // A cell more on each side leaves room for the widest texels.
  const auto cellOf = [](double x) { return static_cast<int>(std::clamp<double>(x, 0.0, kCells - 1.0)); };
  for (int y = cellOf(low.y / cell_size_.y - 1.0); y <= cellOf(high.y / cell_size_.y + 1.0); ++y)
    for (int x = cellOf(low.x / cell_size_.x - 1.0); x <= cellOf(high.x / cell_size_.x + 1.0); ++x)
      boards_of_cell_[static_cast<std::size_t>(y * kCells + x)].push_back(board);
}

glm::dvec3 Lettering::paint(const glm::dvec3& color, const glm::dvec2& p, double texel) const {
  const auto cellOf = [](double x) { return static_cast<int>(std::clamp<double>(x, 0.0, kCells - 1.0)); };
  const auto& near =
      boards_of_cell_[static_cast<std::size_t>(cellOf(p.y / cell_size_.y) * kCells + cellOf(p.x / cell_size_.x))];
  if (near.empty()) return color;
  double ground = 0.0, ink = 0.0;
  for (const std::uint16_t i : near) {
    const Board& b = boards_[i];
    const glm::dvec2 q = b.local(p);
    const double share = coverage(q, glm::dvec2(0.0), b.size, texel);
    if (share <= 0.0) continue;
    ground = std::max(ground, share);
    if (b.sign < 0) continue;
    const glm::dvec2 at = q / b.cell - kMargin;
    const glm::dvec2 half(0.5 * texel / b.cell);
    ink = std::max(ink, inkIn(signs_[static_cast<std::size_t>(b.sign)].text, at - half, at + half));
  }
  return blend(blend(color, kGround, ground), kInk, ink);
}

Lettering::Nearness Lettering::nearness(const glm::dvec2& p, double reach) const {
  Nearness nearest;
  for (const Board& b : boards_) {
    const glm::dvec2 q = b.local(p);
    const glm::dvec2 outside = glm::max(glm::max(-q, q - b.size), glm::dvec2(0.0));
    const double square = glm::dot(outside, outside);
    if (square >= reach * reach) continue;
    const double share = smooth(reach, 0.0, glm::length(outside));
    if (share > nearest.share) nearest = {share, b.level};
  }
  return nearest;
}

std::string randomText(std::uint32_t seed, std::size_t length) {
  constexpr std::string_view kCharacters = "ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789";
  std::string text;
  for (std::size_t i = 0; i < length; ++i)
    text += kCharacters[latticeHash(static_cast<std::int64_t>(i), 0, 0, seed) % kCharacters.size()];
  return text;
}

}  // namespace mesh::generate
