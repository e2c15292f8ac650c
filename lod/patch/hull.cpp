#include "lod/patch/hull.h"

#include <algorithm>
#include <cstdlib>
#include <glm/gtc/constants.hpp>
#include <limits>

#include "base/geometry.h"

namespace lod::patch {
namespace {

// The share of all area that may be left out as strays at each end of a direction. Scans by photographs have floaters
// of a few triangles.
constexpr double kStrayArea = 0.002;
// The gap before strays over the diagonal of the surface's box. A choice: a model's own loose parts are nearer.
constexpr float kGap = 0.25F;
// Bins of half a gap. A surface without strays is at most four gaps long.
constexpr std::size_t kBins = 16;
// Points are added until their hull reaches so far of the way to the surface's end in each direction.
constexpr float kReached = 0.99F;
// Directions in which a surface ends nearer to its middle, over half its box, are those across a flat one.
constexpr float kFlat = 1e-5F;

/// The directions through a grid of (2 n + 1)² points on each side of a cube, unit length.
std::vector<glm::vec3> directionsOfCube(int n) {
  std::vector<glm::vec3> all;
  for (int x = -n; x <= n; ++x)
    for (int y = -n; y <= n; ++y)
      for (int z = -n; z <= n; ++z)
        if (std::max({std::abs(x), std::abs(y), std::abs(z)}) == n) all.push_back(glm::normalize(glm::vec3(x, y, z)));
  return all;
}

// ---- strays ----

/// A part's place along a direction.
struct Span {
  float low = 0.0F, high = 0.0F;
  float area = 0.0F;
};

struct Surface {
  std::span<const SurfacePart> parts;
  double area = 0.0;

  std::vector<Span> along(const glm::vec3& direction) const {
    std::vector<Span> spans(parts.size());
    for (std::size_t i = 0; i < parts.size(); ++i) {
      const auto& [p, reach, part_area] = parts[i];
      const std::array<float, 3> at{glm::dot(p[0], direction), glm::dot(p[1], direction), glm::dot(p[2], direction)};
      spans[i] = {std::min({at[0], at[1], at[2]}) - reach, std::max({at[0], at[1], at[2]}) + reach, part_area};
    }
    return spans;
  }
};

Surface surfaceOf(std::span<const SurfacePart> parts) {
  Surface surface{parts};
  for (const SurfacePart& part : parts) surface.area += part.area;
  return surface;
}

/// How far the surface goes: to the end of all but the strays' area, and from there on as long as the next part begins
/// within the gap. Sorts the spans.
float endOf(std::vector<Span>& spans, double area, float gap) {
  std::sort(spans.begin(), spans.end(), [](const Span& a, const Span& b) { return a.low < b.low; });
  double seen = 0.0;
  float end = std::numeric_limits<float>::lowest();
  for (const Span& span : spans) {
    if (seen >= (1.0 - kStrayArea) * area && span.low > end + gap) break;
    seen += span.area;
    end = std::max(end, span.high);
  }
  return end;
}

/// Whether there may be a gap as long as this: tells without sorting that there is none.
bool mayHaveGap(const std::vector<Span>& spans, float gap) {
  Span all = spans.front();
  for (const Span& span : spans) all = {std::min(all.low, span.low), std::max(all.high, span.high)};
  // Between two parts with a gap of two bins lies an empty one.
  const float bin = 0.5F * gap;
  if (!(all.high - all.low < bin * static_cast<float>(kBins))) return true;
  const auto binOf = [&](float at) { return std::min(kBins - 1, static_cast<std::size_t>((at - all.low) / bin)); };
  std::array<bool, kBins> is_covered{};
  for (const Span& span : spans)
    for (std::size_t i = binOf(span.low); i <= binOf(span.high); ++i) is_covered[i] = true;
  return std::any_of(is_covered.begin(), is_covered.begin() + binOf(all.high), [](bool covered) { return !covered; });
}

/// The diagonal of the box around what touches along each axis.
float sizeOf(const Surface& surface) {
  glm::vec3 size(0.0F);
  for (int axis = 0; axis < 3; ++axis)
    for (const float sign : {1.0F, -1.0F}) {
      glm::vec3 direction(0.0F);
      direction[axis] = sign;
      std::vector<Span> spans = surface.along(direction);
      size[axis] += endOf(spans, surface.area, 0.0F);
    }
  return glm::length(size);
}

/// A place, and how far around it there is surface.
struct Ball {
  glm::vec3 center{0.0F};
  float radius = 0.0F;
};

/// A stray in one direction may be the outermost part in others, too, so that it is left out of all.
std::vector<Ball> cornersWithoutStrays(const Surface& surface) {
  const float gap = kGap * sizeOf(surface);
  std::vector<bool> is_stray(surface.parts.size(), false);
  for (const glm::vec3& direction : directionsOfCube(1)) {
    std::vector<Span> spans = surface.along(direction);
    if (!mayHaveGap(spans, gap)) continue;
    std::vector<Span> sorted = spans;
    const float end = endOf(sorted, surface.area, gap);
    for (std::size_t i = 0; i < spans.size(); ++i)
      if (spans[i].low > end) is_stray[i] = true;
  }
  std::vector<Ball> corners;
  for (std::size_t i = 0; i < is_stray.size(); ++i) {
    if (is_stray[i]) continue;
    const auto& [p, reach, area] = surface.parts[i];
    corners.push_back({p[0], reach});
    if (p[1] != p[0]) corners.push_back({p[1], reach});
    if (p[2] != p[0]) corners.push_back({p[2], reach});
  }
  return corners;
}

// ---- the hull ----

/// A direction, how far the surface goes in it, where, and how far the chosen points go.
struct Support {
  glm::vec3 direction{0.0F};
  glm::vec3 outermost{0.0F};
  float end = 0.0F;
  float reached = std::numeric_limits<float>::lowest();
  float share() const { return reached / end; }
};

/// Space in which a box has its middle at the origin and sides of 2.
struct BoxSpace {
  glm::vec3 middle{0.0F};
  glm::vec3 half{1.0F};
  glm::vec3 into(const glm::vec3& p) const { return (p - middle) / half; }
  glm::vec3 outOf(const glm::vec3& p) const { return middle + half * p; }
};

BoxSpace spaceAround(const std::vector<Ball>& balls) {
  base::Aabb box;
  for (const Ball& ball : balls) box.add(base::Aabb{ball.center - ball.radius, ball.center + ball.radius});
  BoxSpace space{box.center(), 0.5F * box.size()};
  for (int i = 0; i < 3; ++i)
    if (!(space.half[i] > 0.0F)) space.half[i] = 1.0F;
  return space;
}

/// The surface's ends in all directions of the box's space in which it is not flat. A ball is an ellipsoid there.
std::vector<Support> supportsOf(const std::vector<Ball>& balls, const BoxSpace& space) {
  std::vector<glm::vec3> centers;
  for (const Ball& ball : balls) centers.push_back(space.into(ball.center));
  std::vector<Support> all;
  for (const glm::vec3& direction : directionsOfCube(3)) {
    const glm::vec3 outside = direction / space.half;
    const float length = glm::length(outside);
    const glm::vec3 to_end = outside / (length * space.half);  // of a ball of radius 1
    Support support{direction};
    for (std::size_t i = 0; i < balls.size(); ++i) {
      const float along = glm::dot(centers[i], direction) + balls[i].radius * length;
      if (along > support.end) support.end = along, support.outermost = centers[i] + balls[i].radius * to_end;
    }
    if (support.end > kFlat) all.push_back(support);
  }
  return all;
}

}  // namespace

SurfacePart trianglePart(const std::array<glm::vec3, 3>& p, float reach) {
  return {p, reach, 0.5F * glm::length(glm::cross(p[1] - p[0], p[2] - p[0]))};
}

SurfacePart ballPart(const glm::vec3& center, float radius) {
  return {{center, center, center}, radius, glm::pi<float>() * radius * radius};
}

std::vector<glm::vec3> findHull(std::span<const SurfacePart> parts) {
  if (parts.empty()) return {};
  const std::vector<Ball> corners = cornersWithoutStrays(surfaceOf(parts));
  // In a box with equal sides directions are as dense to a flat surface as to a round one.
  const BoxSpace space = spaceAround(corners);

  // The point is added next in whose direction the hull falls short most.
  std::vector<Support> supports = supportsOf(corners, space);
  std::vector<glm::vec3> hull;
  float least = 1.0F;
  while (!supports.empty()) {
    const auto worst = std::min_element(supports.begin(), supports.end(),
                                        [](const Support& a, const Support& b) { return a.share() < b.share(); });
    least = worst->share();
    if (least >= kReached || hull.size() == kMaxHullPoints) break;
    hull.push_back(worst->outermost);
    for (Support& s : supports) s.reached = std::max(s.reached, glm::dot(hull.back(), s.direction));
  }
  if (hull.empty()) hull.emplace_back(0.0F);
  for (glm::vec3& p : hull) p = space.outOf(p / least);
  return hull;
}

}  // namespace lod::patch
