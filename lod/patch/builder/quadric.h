#pragma once
// Quadric error metrics (Garland and Heckbert 1997, "Surface Simplification Using Quadric Error Metrics"), one at a
// time and two or four at once. Every lane does the operations of IEEE 754 in the same order, so all machines agree.
#include <algorithm>
#include <cstddef>
#include <cstring>
#include <glm/glm.hpp>

#include "base/simd.h"

// Vectors of four doubles are passed only to functions that become part of their caller: no ABI says how.
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wpsabi"

namespace lod::patch::builder {

/// Squared distances to planes, weighted by area: x^T A x + 2 b x + c (section 3.3 of the paper).
struct Quadric {
  double a00 = 0, a01 = 0, a02 = 0, a11 = 0, a12 = 0, a22 = 0;
  double b0 = 0, b1 = 0, b2 = 0, c = 0;
  double weight = 0;

  /// The plane dot(n, x) + d = 0, n of length 1.
  void addPlane(const glm::dvec3& n, double d, double w) {
    a00 += w * n.x * n.x, a01 += w * n.x * n.y, a02 += w * n.x * n.z;
    a11 += w * n.y * n.y, a12 += w * n.y * n.z, a22 += w * n.z * n.z;
    b0 += w * n.x * d, b1 += w * n.y * d, b2 += w * n.z * d, c += w * d * d;
  }
  void addPoint(const glm::dvec3& p, double w) {
    a00 += w, a11 += w, a22 += w;
    b0 -= w * p.x, b1 -= w * p.y, b2 -= w * p.z, c += w * glm::dot(p, p);
  }
  /// The error at p.
  double at(const glm::dvec3& p) const {
    const double x = a00 * p.x + a01 * p.y + a02 * p.z + 2.0 * b0;
    const double y = a01 * p.x + a11 * p.y + a12 * p.z + 2.0 * b1;
    const double z = a02 * p.x + a12 * p.y + a22 * p.z + 2.0 * b2;
    return std::max(0.0, p.x * x + p.y * y + p.z * z + c);
  }
  void add(const Quadric& q) {
    a00 += q.a00, a01 += q.a01, a02 += q.a02, a11 += q.a11, a12 += q.a12, a22 += q.a22;
    b0 += q.b0, b1 += q.b1, b2 += q.b2, c += q.c, weight += q.weight;
  }
};

/// How many lanes a vector of doubles has, and the type of its comparisons.
template <class Lanes>
constexpr std::size_t kLaneCount = sizeof(Lanes) / sizeof(double);
template <class Lanes>
using MaskOf = decltype(Lanes{} < Lanes{});

template <class Lanes>
struct PointLanes {
  Lanes x, y, z;
  LUMIGRID_ALWAYS_INLINE PointLanes operator-(const PointLanes& p) const { return {x - p.x, y - p.y, z - p.z}; }
};
template <class Lanes>
LUMIGRID_ALWAYS_INLINE Lanes dot(const PointLanes<Lanes>& p, const PointLanes<Lanes>& q) {
  return p.x * q.x + p.y * q.y + p.z * q.z;
}
/// p where the mask is set, else q.
template <class Lanes>
LUMIGRID_ALWAYS_INLINE PointLanes<Lanes> either(const MaskOf<Lanes>& mask, const PointLanes<Lanes>& p,
                                                const PointLanes<Lanes>& q) {
  return {mask ? p.x : q.x, mask ? p.y : q.y, mask ? p.z : q.z};
}
/// value(0), value(1), … in the lanes.
template <class Lanes, class Value>
LUMIGRID_ALWAYS_INLINE Lanes lanesOf(Value&& value) {
  if constexpr (kLaneCount<Lanes> == 2)
    return Lanes{static_cast<double>(value(0)), static_cast<double>(value(1))};
  else
    return Lanes{static_cast<double>(value(0)), static_cast<double>(value(1)), static_cast<double>(value(2)),
                 static_cast<double>(value(3))};
}
template <class Lanes>
LUMIGRID_ALWAYS_INLINE PointLanes<Lanes> cross(const PointLanes<Lanes>& p, const PointLanes<Lanes>& q) {
  return {p.y * q.z - q.y * p.z, p.z * q.x - q.z * p.x, p.x * q.y - q.x * p.y};
}
using PairPoint = PointLanes<base::Double2>;
LUMIGRID_ALWAYS_INLINE PairPoint pairOf(const glm::vec3& p, const glm::vec3& q) {
  return {base::Double2{p.x, q.x}, base::Double2{p.y, q.y}, base::Double2{p.z, q.z}};
}

/// Numbers 2 k and 2 k + 1 of a quadric, in the order of its members.
LUMIGRID_ALWAYS_INLINE base::Double2 pairOfQuadric(const Quadric& q, std::size_t k) {
  base::Double2 two;
  std::memcpy(&two, reinterpret_cast<const char*>(&q) + k * sizeof two, sizeof two);
  return two;
}

template <class Lanes>
struct QuadricLanes {
  Lanes a00, a01, a02, a11, a12, a22, b0, b1, b2, c;

  /// In each lane the sum of the quadrics one(lane) and other(lane).
  template <class One, class Other>
  LUMIGRID_ALWAYS_INLINE QuadricLanes(One&& one, Other&& other) {
    sum(one, other, 0, a00, a01);
    sum(one, other, 1, a02, a11);
    sum(one, other, 2, a12, a22);
    sum(one, other, 3, b0, b1);
    sum(one, other, 4, b2, c);
  }
  LUMIGRID_ALWAYS_INLINE Lanes at(const PointLanes<Lanes>& p) const {
    const Lanes x = a00 * p.x + a01 * p.y + a02 * p.z + 2.0 * b0;
    const Lanes y = a01 * p.x + a11 * p.y + a12 * p.z + 2.0 * b1;
    const Lanes z = a02 * p.x + a12 * p.y + a22 * p.z + 2.0 * b2;
    const Lanes sum = p.x * x + p.y * y + p.z * z + c;
    return sum > 0.0 ? sum : Lanes{};
  }
  /// The point of least error; false where the planes are nearly parallel. The determinant is compared with the cube
  /// of the mean eigenvalue.
  LUMIGRID_ALWAYS_INLINE MaskOf<Lanes> minimum(PointLanes<Lanes>& p) const {
    const Lanes m00 = a11 * a22 - a12 * a12;
    const Lanes m01 = a02 * a12 - a01 * a22;
    const Lanes m02 = a01 * a12 - a02 * a11;
    const Lanes determinant = a00 * m00 + a01 * m01 + a02 * m02;
    const Lanes trace = a00 + a11 + a22;
    const Lanes m11 = a00 * a22 - a02 * a02;
    const Lanes m12 = a01 * a02 - a00 * a12;
    const Lanes m22 = a00 * a11 - a01 * a01;
    const Lanes scale = -1.0 / determinant;
    p = {(m00 * b0 + m01 * b1 + m02 * b2) * scale, (m01 * b0 + m11 * b1 + m12 * b2) * scale,
         (m02 * b0 + m12 * b1 + m22 * b2) * scale};
    return determinant > 1e-4 * trace * trace * trace / 27.0;
  }

 private:
  // Numbers 2 k and 2 k + 1 of all lanes.
  template <class One, class Other>
  LUMIGRID_ALWAYS_INLINE static void sum(const One& one, const Other& other, std::size_t k, Lanes& even, Lanes& odd) {
    const base::Double2 first = pairOfQuadric(one(0), k) + pairOfQuadric(other(0), k);
    const base::Double2 second = pairOfQuadric(one(1), k) + pairOfQuadric(other(1), k);
    const base::Double2 low_even = __builtin_shufflevector(first, second, 0, 2);
    const base::Double2 low_odd = __builtin_shufflevector(first, second, 1, 3);
    if constexpr (kLaneCount<Lanes> == 2) {
      even = low_even, odd = low_odd;
    } else {
      const base::Double2 third = pairOfQuadric(one(2), k) + pairOfQuadric(other(2), k);
      const base::Double2 fourth = pairOfQuadric(one(3), k) + pairOfQuadric(other(3), k);
      even = __builtin_shufflevector(low_even, __builtin_shufflevector(third, fourth, 0, 2), 0, 1, 2, 3);
      odd = __builtin_shufflevector(low_odd, __builtin_shufflevector(third, fourth, 1, 3), 0, 1, 2, 3);
    }
  }
};

/// The quadrics of two planes, as Quadric::addPlane() makes them, with their weights.
class PlanePair {
 public:
  LUMIGRID_ALWAYS_INLINE PlanePair(const PairPoint& n, const base::Double2& d, const base::Double2& weight) {
    const base::Double2 x = weight * n.x;
    const base::Double2 y = weight * n.y;
    const base::Double2 z = weight * n.z;
    const base::Double2 w = weight * d;
    put(0, x * n.x, x * n.y), put(1, x * n.z, y * n.y), put(2, y * n.z, z * n.z);
    put(3, x * d, y * d), put(4, z * d, w * d);
    weight_ = weight;
  }
  LUMIGRID_ALWAYS_INLINE void addTo(Quadric& q, std::size_t plane) const {
    for (std::size_t k = 0; k < 5; ++k) {
      const base::Double2 two = pairOfQuadric(q, k) + values_[plane][k];
      std::memcpy(reinterpret_cast<char*>(&q) + k * sizeof two, &two, sizeof two);
    }
    q.weight += weight_[plane];
  }

 private:
  // Numbers 2 k and 2 k + 1 of both quadrics.
  LUMIGRID_ALWAYS_INLINE void put(std::size_t k, const base::Double2& even, const base::Double2& odd) {
    values_[0][k] = __builtin_shufflevector(even, odd, 0, 2);
    values_[1][k] = __builtin_shufflevector(even, odd, 1, 3);
  }
  base::Double2 values_[2][5];
  base::Double2 weight_;
};

}  // namespace lod::patch::builder

#pragma GCC diagnostic pop
