#include "lod/patch/builder/overlay.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "tests/support/test_meshes.h"

namespace {

using namespace lod::patch::builder;
using support::Mesh;

struct Sheet {
  std::vector<glm::vec3> positions;
  std::vector<std::uint32_t> indices;
  SurfaceView view() const { return {positions, indices}; }
};

// A flat sheet of 2 * n * n triangles from (0, 0) to (size, size), its inner vertices moved about by up to `shift`;
// keep(x, y) says which cells are there.
template <class Keep>
Sheet sheet(int n, int size, int shift, Keep&& keep) {
  Sheet out;
  const float cell = static_cast<float>(size) / static_cast<float>(n);
  for (int y = 0; y <= n; ++y)
    for (int x = 0; x <= n; ++x) {
      const bool is_inner = x > 0 && y > 0 && x < n && y < n;
      const int dx = is_inner ? (7 * x + 13 * y) % (2 * shift + 1) - shift : 0;
      const int dy = is_inner ? (11 * x + 5 * y) % (2 * shift + 1) - shift : 0;
      out.positions.push_back(glm::round(glm::vec3(static_cast<float>(x) * cell, static_cast<float>(y) * cell, 0)) +
                              glm::vec3(dx, dy, 0));
    }
  const auto at = [&](int x, int y) { return static_cast<std::uint32_t>(y * (n + 1) + x); };
  for (int y = 0; y < n; ++y)
    for (int x = 0; x < n; ++x)
      if (keep(x, y))
        out.indices.insert(out.indices.end(),
                           {at(x, y), at(x + 1, y), at(x + 1, y + 1), at(x, y), at(x + 1, y + 1), at(x, y + 1)});
  return out;
}
Sheet sheet(int n, int size, int shift) {
  return sheet(n, size, shift, [](int, int) { return true; });
}

// Lays one surface over another, with every vertex over the nearest facet.
struct Laid {
  FacetSurface above;
  FacetSurface below;
  std::vector<std::uint32_t> facet;
  std::vector<std::uint32_t> twin;
  std::vector<std::uint32_t> border;
  std::vector<Overlay::Gap> gap;
  Overlay overlay;

  Laid(const Sheet& upper, const Sheet& lower) {
    above.reset(upper.view());
    below.reset(lower.view());
    for (const glm::vec3& p : upper.positions) {
      float best = std::numeric_limits<float>::max();
      std::uint32_t nearest = 0;
      for (std::uint32_t t = 0; t < below.triangleCount(); ++t)
        if (const float d2 = below.facet(t).distance2(p); d2 < best) best = d2, nearest = t;
      std::uint32_t same = FacetSurface::kNone;
      for (std::uint32_t v = 0; v < lower.positions.size(); ++v)
        if (lower.positions[v] == p && !below.around(v).empty()) same = v;
      std::uint32_t leaving = FacetSurface::kNone;
      if (same != FacetSurface::kNone) {
        leaving = below.leavingBorder(same);
        nearest = leaving != FacetSurface::kNone ? below.edges()[leaving].triangle[0] : below.around(same)[0];
        best = 0.0F;
      } else if (above.leavingBorder(static_cast<std::uint32_t>(facet.size())) != FacetSurface::kNone) {
        leaving = nearestBorder(p, best);
        if (leaving != FacetSurface::kNone) nearest = below.edges()[leaving].triangle[0];
      }
      border.push_back(leaving);
      facet.push_back(nearest), twin.push_back(same), gap.push_back({std::sqrt(best), 0.0F});
    }
    overlay.compute(above, below, facet, gap, twin, border);
  }
  // The border edge below that p lies on, up to a small distance, and that distance.
  std::uint32_t nearestBorder(const glm::vec3& p, float& distance2) const {
    for (std::uint32_t e = 0; e < below.edges().size(); ++e) {
      if (below.edges()[e].triangles != 1) continue;
      const auto [a, b] = below.edges()[e].vertex;
      const glm::vec3 from = below.view().positions[a];
      const glm::vec3 ab = below.view().positions[b] - from;
      const glm::vec3 d = p - from - closestShare(p - from, ab) * ab;
      const float d2 = glm::dot(d, d);
      if (d2 < 4.0F) return distance2 = d2, e;
    }
    return FacetSurface::kNone;
  }
  std::size_t coveredAbove() {
    std::size_t count = 0;
    for (std::uint32_t s = 0; s < above.triangleCount(); ++s) count += overlay.coversAbove(s) ? 1 : 0;
    return count;
  }
  std::size_t coveredBelow() {
    std::size_t count = 0;
    for (std::uint32_t t = 0; t < below.triangleCount(); ++t) count += overlay.coversBelow(t) ? 1 : 0;
    return count;
  }
};

TEST(Overlay, coversASurfaceByItselfAtDistanceZero) {
  for (const Mesh& mesh : {support::bumpySphere(12, 16), support::torus(14, 10), support::openGrid(12)}) {
    Sheet one;
    for (const glm::vec3& p : mesh.positions) one.positions.push_back(glm::round((p + 2.0F) * 500.0F));
    one.indices = mesh.indices;
    Laid laid(one, one);
    EXPECT_EQ(laid.coveredAbove(), one.indices.size() / 3);
    EXPECT_EQ(laid.coveredBelow(), one.indices.size() / 3);
    for (std::uint32_t s = 0; s < laid.above.triangleCount(); ++s) EXPECT_LT(laid.overlay.distance(s), 1e-2F);
  }
}

// The same square is cut into other triangles: every facet is covered, at distance 0 in a plane.
TEST(Overlay, coversBothOfTwoMeshesOfOneSheet) {
  for (const auto& [fine, coarse] : {std::pair{12, 12}, {24, 12}, {36, 6}, {12, 1}}) {
    const Sheet upper = sheet(fine, 3600, fine == coarse ? 0 : 40);
    Sheet lower = sheet(coarse, 3600, coarse > 1 ? 60 : 0);
    // With one cell along each side both borders are the same.
    Laid laid(upper, lower);
    EXPECT_EQ(laid.coveredAbove(), upper.indices.size() / 3) << fine << " over " << coarse;
    for (std::uint32_t s = 0; s < laid.above.triangleCount(); ++s)
      if (laid.overlay.coversAbove(s)) {
        EXPECT_LT(laid.overlay.distance(s), 0.1F);
      }
    // Borders may have other vertices, too.
    EXPECT_EQ(laid.coveredBelow(), lower.indices.size() / 3) << fine << " over " << coarse;
  }
}

// Facets below a hole and beyond a border must not count as covered.
TEST(Overlay, findsWhatIsNotCovered) {
  const Sheet whole = sheet(20, 4000, 50);
  for (const int size : {1, 3, 8}) {
    const auto is_hole = [&](int x, int y) { return x >= 6 && x < 6 + size && y >= 7 && y < 7 + size; };
    const Sheet pierced = sheet(20, 4000, 30, [&](int x, int y) { return !is_hole(x, y); });
    Laid laid(pierced, whole);
    EXPECT_EQ(laid.coveredAbove(), pierced.indices.size() / 3);
    for (int y = 0; y < 20; ++y)
      for (int x = 0; x < 20; ++x) {
        if (!is_hole(x, y)) continue;
        for (int k = 0; k < 2; ++k)
          EXPECT_FALSE(laid.overlay.coversBelow(static_cast<std::uint32_t>(2 * (20 * y + x) + k))) << x << ' ' << y;
      }
    EXPECT_GT(laid.coveredBelow(), 300U);
  }
  const Sheet half = sheet(20, 4000, 30, [](int x, int) { return x < 11; });
  Laid laid(half, whole);
  for (int y = 0; y < 20; ++y)
    for (int x = 11; x < 20; ++x)
      for (int k = 0; k < 2; ++k)
        EXPECT_FALSE(laid.overlay.coversBelow(static_cast<std::uint32_t>(2 * (20 * y + x) + k))) << x << ' ' << y;
}

// The border above has a notch: the border below the notch is uncovered, and that beside it is covered.
TEST(Overlay, coversABorderOnlyAsFarAsThereIsABorderAbove) {
  const Sheet whole = sheet(20, 4000, 50);
  for (const int size : {1, 3, 8}) {
    const auto is_notch = [&](int x, int y) { return x >= 6 && x < 6 + size && y < size; };
    const Sheet notched = sheet(20, 4000, 30, [&](int x, int y) { return !is_notch(x, y); });
    Laid laid(notched, whole);
    for (int y = 0; y < 20; ++y)
      for (int x = 0; x < 20; ++x)
        for (int k = 0; k < 2; ++k) {
          const bool is_covered = laid.overlay.coversBelow(static_cast<std::uint32_t>(2 * (20 * y + x) + k));
          if (is_notch(x, y)) {
            EXPECT_FALSE(is_covered) << x << ' ' << y;
          }
          if (x < 4 || x > 7 + size) {
            EXPECT_TRUE(is_covered) << x << ' ' << y;
          }
        }
  }
}

// Cells like the black fields of a chessboard meet at corners only, so every vertex has two fans and two borders. Laid
// over itself the sheet is covered. If one cell is missing above, that one is uncovered, and those that it touches are
// covered.
TEST(Overlay, tellsTheFansThatMeetAtAVertexApart) {
  const auto is_black = [](int x, int y) { return (x + y) % 2 == 0; };
  const Sheet board = sheet(9, 3600, 30, is_black);
  Laid same(board, board);
  EXPECT_EQ(same.coveredAbove(), board.indices.size() / 3);
  EXPECT_EQ(same.coveredBelow(), board.indices.size() / 3);
  const Sheet missing = sheet(9, 3600, 30, [&](int x, int y) { return is_black(x, y) && (x != 4 || y != 4); });
  Laid laid(missing, board);
  EXPECT_EQ(laid.coveredAbove(), missing.indices.size() / 3);
  std::uint32_t t = 0;
  for (int y = 0; y < 9; ++y)
    for (int x = 0; x < 9; ++x) {
      if (!is_black(x, y)) continue;
      for (int k = 0; k < 2; ++k, ++t) EXPECT_EQ(laid.overlay.coversBelow(t), x != 4 || y != 4) << x << ' ' << y;
    }
}

// A vertex of six facets stays while the others move: the corners at it turn once around over its edges.
TEST(Overlay, coversTheFacetsAroundAVertexThatStays) {
  const Sheet lower{
      {{0, 0, 0}, {900, 0, 0}, {450, 780, 0}, {-450, 780, 0}, {-900, 0, 0}, {-450, -780, 0}, {450, -780, 0}},
      {0, 1, 2, 0, 2, 3, 0, 3, 4, 0, 4, 5, 0, 5, 6, 0, 6, 1}};
  // Three triangles lie over six, so each corner at the middle turns by two facets. The border keeps every other
  // vertex.
  const Sheet upper{{{0, 0, 0}, {900, 0, 0}, {-450, 780, 0}, {-450, -780, 0}}, {0, 1, 2, 0, 2, 3, 0, 3, 1}};
  Laid laid(upper, lower);
  EXPECT_EQ(laid.coveredAbove(), 3U);
  EXPECT_EQ(laid.coveredBelow(), 6U);
  // The removed corners of the hexagon are among the pairs.
  std::vector<float> largest(6, 0.0F);
  for (std::uint32_t e = 0; e < laid.above.edges().size(); ++e)
    laid.overlay.forEachPairOfEdge(
        e, [&](std::uint32_t t, const Overlay::Gap& gap) { largest[t] = std::max(largest[t], gap.distance); });
  for (const float distance : largest) EXPECT_GE(distance, 389.0F);
}

// The surface above is a square without one corner. The distance of that corner must be among the pairs of its facet,
// or the facet must be uncovered.
TEST(Overlay, forgetsNoCornerThatTheBorderTurnsAround) {
  const Sheet square = sheet(1, 3600, 0);
  const Sheet chamfered{{{0, 0, 0}, {3300, 0, 0}, {3600, 300, 0}, {3600, 3600, 0}, {0, 3600, 0}},
                        {0, 1, 2, 0, 2, 3, 0, 3, 4}};
  Laid laid(chamfered, square);
  float largest[2] = {0.0F, 0.0F};
  for (std::uint32_t e = 0; e < laid.above.edges().size(); ++e)
    laid.overlay.forEachPairOfEdge(
        e, [&](std::uint32_t t, const Overlay::Gap& gap) { largest[t] = std::max(largest[t], gap.distance); });
  EXPECT_TRUE(!laid.overlay.coversBelow(0) || largest[0] >= 212.0F);
}

// Where a second sheet lies over a part, cells count twice: modulo 2 that proves nothing, so the part is uncovered.
TEST(Overlay, doesNotCountACoverTwice) {
  const Sheet whole = sheet(10, 4000, 40);
  Sheet twice = whole;
  for (const std::uint32_t v : whole.indices)
    twice.indices.push_back(v + static_cast<std::uint32_t>(whole.positions.size()));
  for (const glm::vec3& p : whole.positions) twice.positions.push_back(p + glm::vec3(0, 0, 5));
  Laid laid(twice, whole);
  EXPECT_EQ(laid.coveredBelow(), 0U);
}

}  // namespace
