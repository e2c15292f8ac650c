#include "lod/texture/packing.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <numeric>
#include <tuple>

namespace lod::texture {
namespace {

int roundedUp(int value, int multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

// The upper outline of what is packed so far (the skyline of Jylänki 2010, "A thousand ways to pack the bin", section
// 2.6): segments from left to right. A rectangle goes where its lower side comes lowest.
class Skyline {
 public:
  Skyline(int width, int height) : height_(height), segments_{{0, 0, width}} {}

  // Returns whether the rectangle fits; if so, `place` is where it went.
  bool add(const glm::ivec2& size, glm::ivec2& place) {
    std::size_t best = segments_.size();
    int best_y = std::numeric_limits<int>::max();
    for (std::size_t i = 0; i < segments_.size(); ++i) {
      const int y = floorAt(i, size.x);
      if (y < 0 || y + size.y > height_ || y >= best_y) continue;
      best = i;
      best_y = y;
    }
    if (best == segments_.size()) return false;
    place = {segments_[best].x, best_y};
    raise(best, size.x, best_y + size.y);
    used_height_ = std::max(used_height_, best_y + size.y);
    return true;
  }
  int usedHeight() const { return used_height_; }

 private:
  struct Segment {
    int x, y, width;
  };

  // Returns how low a rectangle of this width can lie that begins with segment i; −1 where the page ends before.
  int floorAt(std::size_t i, int width) const {
    int y = 0;
    for (; width > 0; ++i) {
      if (i == segments_.size()) return -1;
      y = std::max(y, segments_[i].y);
      width -= segments_[i].width;
    }
    return y;
  }

  void raise(std::size_t i, int width, int y) {
    const int x = segments_[i].x;
    const int end = x + width;
    std::size_t last = i;  // behind the segments that lie wholly under the new one
    while (last < segments_.size() && segments_[last].x + segments_[last].width <= end) ++last;
    if (last < segments_.size() && segments_[last].x < end) {
      segments_[last].width -= end - segments_[last].x;
      segments_[last].x = end;
    }
    const auto from = segments_.begin() + static_cast<std::ptrdiff_t>(i);
    segments_.insert(segments_.erase(from, segments_.begin() + static_cast<std::ptrdiff_t>(last)), {x, y, width});
    join(i);
    if (i > 0) join(i - 1);
  }

  // Makes one segment of i and the next where they are equally high.
  void join(std::size_t i) {
    if (i + 1 >= segments_.size() || segments_[i].y != segments_[i + 1].y) return;
    segments_[i].width += segments_[i + 1].width;
    segments_.erase(segments_.begin() + static_cast<std::ptrdiff_t>(i) + 1);
  }

  int height_;
  int used_height_ = 0;
  std::vector<Segment> segments_;
};

struct Attempt {
  PackedPage page;
  std::vector<std::uint32_t> left_over;
};

Attempt tryWidth(std::span<const glm::ivec2> sizes, std::span<const std::uint32_t> order, int width, int max_side,
                 int multiple) {
  Attempt attempt;
  Skyline skyline(width, max_side);
  for (const std::uint32_t index : order) {
    glm::ivec2 place(0);
    if (skyline.add(sizes[index], place))
      attempt.page.rectangles.push_back({index, place});
    else
      attempt.left_over.push_back(index);
  }
  attempt.page.size = {width, roundedUp(skyline.usedHeight(), multiple)};
  return attempt;
}

std::int64_t areaOf(const glm::ivec2& size) {
  return std::int64_t{size.x} * size.y;
}

// Tries pages of several widths for all that is left, or fills a page of full size where it is too much for one.
Attempt packPage(std::span<const glm::ivec2> sizes, std::span<const std::uint32_t> order, int max_side, int multiple) {
  std::int64_t area = 0;
  int widest = 0;
  for (const std::uint32_t index : order) {
    area += areaOf(sizes[index]);
    widest = std::max(widest, sizes[index].x);
  }

  // A choice: wider and narrower pages than square ones, as shelves come out fuller at one or the other.
  constexpr std::array kWidths{0.7, 0.8, 0.9, 1.0, 1.05, 1.15, 1.3, 1.5};
  Attempt best;
  int last_width = 0;
  for (const double share : kWidths) {
    if (area > areaOf(glm::ivec2(max_side))) break;
    const double wanted = std::max<double>(widest, std::sqrt(static_cast<double>(area)) * share);
    const int width = std::min(max_side, roundedUp(static_cast<int>(std::ceil(wanted)), multiple));
    if (width == last_width) continue;
    last_width = width;
    Attempt attempt = tryWidth(sizes, order, width, max_side, multiple);
    if (!attempt.left_over.empty()) continue;
    if (best.page.rectangles.empty() || areaOf(attempt.page.size) < areaOf(best.page.size)) best = std::move(attempt);
  }
  return best.page.rectangles.empty() ? tryWidth(sizes, order, max_side, max_side, multiple) : best;
}

}  // namespace

std::vector<PackedPage> packRectangles(std::span<const glm::ivec2> sizes, int max_side, int multiple) {
  std::vector<std::uint32_t> order(sizes.size());
  std::iota(order.begin(), order.end(), 0U);
  std::stable_sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::tie(sizes[a].y, sizes[a].x) > std::tie(sizes[b].y, sizes[b].x);
  });

  std::vector<PackedPage> pages;
  while (!order.empty()) {
    Attempt attempt = packPage(sizes, order, max_side, multiple);
    pages.push_back(std::move(attempt.page));
    order = std::move(attempt.left_over);
  }
  return pages;
}

}  // namespace lod::texture
