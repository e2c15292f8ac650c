#include "lod/qsplat/builder/plane_fit.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace lod::qsplat::builder {
namespace {

// The eigenvector of the least eigenvalue of a symmetric matrix of trace 1, by Jacobi's rotations (Golub and Van Loan
// 2013, section 8.5); zero where the least eigenvalue is a double one.
glm::dvec3 leastEigenvector(glm::dmat3 a) {
  glm::dmat3 v(1.0);
  for (int sweep = 0; sweep < 12; ++sweep) {
    const double off = a[0][1] * a[0][1] + a[0][2] * a[0][2] + a[1][2] * a[1][2];
    if (off < 1e-24) break;
    for (int p = 0; p < 2; ++p)
      for (int q = p + 1; q < 3; ++q) {
        if (a[p][q] == 0.0) continue;
        const double theta = 0.5 * (a[q][q] - a[p][p]) / a[p][q];
        const double t = (theta < 0.0 ? -1.0 : 1.0) / (std::abs(theta) + std::sqrt(theta * theta + 1.0));
        const double c = 1.0 / std::sqrt(t * t + 1.0);
        const double s = t * c;
        glm::dmat3 turn(1.0);
        turn[p][p] = c, turn[q][q] = c, turn[p][q] = -s, turn[q][p] = s;
        a = glm::transpose(turn) * a * turn;
        v = v * turn;
      }
  }
  std::array<int, 3> order{0, 1, 2};
  std::sort(order.begin(), order.end(), [&](int x, int y) { return a[x][x] < a[y][y]; });
  constexpr double kMinGap = 1e-9;  // below, rounding decides the direction
  return a[order[1]][order[1]] - a[order[0]][order[0]] > kMinGap ? v[order[0]] : glm::dvec3(0.0);
}

}  // namespace

glm::dvec3 planeNormal(std::span<const glm::dvec3> points) {
  glm::dvec3 mean(0.0);
  for (const glm::dvec3& p : points) mean += p;
  mean /= static_cast<double>(points.size());
  glm::dmat3 spread(0.0);
  for (const glm::dvec3& p : points) spread += glm::outerProduct(p - mean, p - mean);
  const double trace = spread[0][0] + spread[1][1] + spread[2][2];
  const glm::dvec3 up(0.0, 0.0, 1.0);
  if (!(trace > 0.0)) return up;
  const glm::dvec3 n = leastEigenvector(spread / trace);
  return glm::length(n) > 0.5 ? glm::normalize(n) : up;
}

double cellReach(const glm::dvec3& center, const glm::dvec3& normal, std::span<const glm::dvec3> others,
                 double max_reach) {
  const glm::dvec3 side = std::abs(normal.x) < 0.8 ? glm::dvec3(1, 0, 0) : glm::dvec3(0, 1, 0);
  const glm::dvec3 u = glm::normalize(glm::cross(normal, side));
  const glm::dvec3 v = glm::cross(normal, u);
  // A square around the circle of radius `max_reach` is clipped by each neighbour's bisector.
  std::vector<glm::dvec2> cell{
      {-max_reach, -max_reach}, {max_reach, -max_reach}, {max_reach, max_reach}, {-max_reach, max_reach}};
  std::vector<glm::dvec2> cut;
  for (auto* corners : {&cell, &cut}) corners->reserve(others.size() + 4);
  for (const glm::dvec3& other : others) {
    const glm::dvec3 d = other - center;
    const glm::dvec2 p(glm::dot(d, u), glm::dot(d, v));
    const double half = 0.5 * glm::dot(p, p);
    if (!(half > 0.0)) continue;
    cut.clear();
    for (std::size_t i = 0; i < cell.size(); ++i) {
      const glm::dvec2 &a = cell[i], &b = cell[(i + 1) % cell.size()];
      const double x = glm::dot(a, p) - half, y = glm::dot(b, p) - half;
      if (x <= 0.0) cut.push_back(a);
      if ((x < 0.0 && y > 0.0) || (x > 0.0 && y < 0.0)) cut.push_back(a + (b - a) * (x / (x - y)));
    }
    std::swap(cell, cut);
  }
  double reach = 0.0;
  for (const glm::dvec2& corner : cell) reach = std::max(reach, glm::length(corner));
  return std::min(reach, max_reach);
}

}  // namespace lod::qsplat::builder
