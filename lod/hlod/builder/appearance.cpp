#include "lod/hlod/builder/appearance.h"

#include <array>

namespace lod::hlod::builder {
namespace {

constexpr float kHalfTurn = 3.1415927F;

LUMIGRID_ALWAYS_INLINE Four least(const Four& a, const Four& b) {
  return a < b ? a : b;
}
LUMIGRID_ALWAYS_INLINE Four most(const Four& a, const Four& b) {
  return a > b ? a : b;
}
LUMIGRID_ALWAYS_INLINE Four share(const Four& part) {
  return least(most(part, Four{}), Four{} + 1.0F);
}
LUMIGRID_ALWAYS_INLINE Four rootOf(const Four& v) {
  return Four{std::sqrt(v[0]), std::sqrt(v[1]), std::sqrt(v[2]), std::sqrt(v[3])};
}
/// The lanes of a value that are chosen, and 0 in the others.
LUMIGRID_ALWAYS_INLINE Four where(const base::Int4& chosen, const Four& v) {
  return reinterpret_cast<Four>(chosen & reinterpret_cast<base::Int4>(v));
}
LUMIGRID_ALWAYS_INLINE FourPoints between(const FourPoints& from, const FourPoints& to) {
  return {to.x - from.x, to.y - from.y, to.z - from.z};
}
LUMIGRID_ALWAYS_INLINE Four reciprocal(const Four& v) {
  return where(v > 0.0F, 1.0F / v);
}

/// The angle between unit vectors whose ends are sqrt(chord2) apart: twice an arc sine, by the polynomial of Moshier's
/// Cephes library (asinf), which is good to 2e-7.
LUMIGRID_ALWAYS_INLINE Four turnOf(const Four& chord2) {
  const Four sine2 = least(0.25F * chord2, Four{} + 1.0F);
  const Four sine = rootOf(sine2);
  const base::Int4 is_large = sine > 0.5F;
  const Four z = is_large ? 0.5F * (1.0F - sine) : sine2;
  const Four root = is_large ? rootOf(z) : sine;
  Four sum = z * 4.2163199048e-2F + 2.4181311049e-2F;
  sum = sum * z + 4.5470025998e-2F;
  sum = sum * z + 7.4953002686e-2F;
  sum = sum * z + 1.6666752422e-1F;
  const Four arc = root + root * z * sum;
  return is_large ? kHalfTurn - 4.0F * arc : 2.0F * arc;
}

/// The distance along the triangle over which the attribute changes by `difference`.
LUMIGRID_ALWAYS_INLINE Four along(const Four& difference, const Four& scale) {
  return where(difference > 0.0F, difference * scale);
}

LUMIGRID_ALWAYS_INLINE FourPoints valueAt(const FourPoints& a, const FourPoints& ab, const FourPoints& ac,
                                          const FourTriangles::Closest& at) {
  return {a.x + at.b_weight * ab.x + at.c_weight * ac.x, a.y + at.b_weight * ab.y + at.c_weight * ac.y,
          a.z + at.b_weight * ab.z + at.c_weight * ac.z};
}

/// The squared lengths of a's, b's and c's edges.
struct EdgeLengths2 {
  Four ab, bc, ca;
};
LUMIGRID_ALWAYS_INLINE EdgeLengths2 lengths2(const FourPoints& ab, const FourPoints& ac) {
  const FourPoints bc = between(ab, ac);
  return {ab.dot(ab), bc.dot(bc), ac.dot(ac)};
}
/// The largest ratio of an edge.
LUMIGRID_ALWAYS_INLINE Four steepest2(const EdgeLengths2& changes2, const EdgeLengths2& edges2) {
  return most(most(changes2.ab * reciprocal(edges2.ab), changes2.bc * reciprocal(edges2.bc)),
              changes2.ca * reciprocal(edges2.ca));
}

}  // namespace

FourTriangles::FourTriangles(const FourPoints& a, const FourPoints& b, const FourPoints& c)
    : a_(a), ab_(between(a, b)), ac_(between(a, c)) {
  bb_ = ab_.dot(ab_), bc_ = ab_.dot(ac_), cc_ = ac_.dot(ac_);
  const FourPoints bc = between(ab_, ac_);
  ab_scale_ = reciprocal(bb_), ac_scale_ = reciprocal(cc_), bc_scale_ = reciprocal(bc.dot(bc));
}

// The regions are those of Ericson 2005, section 5.1.5, and his names.
FourTriangles::Closest FourTriangles::closest(const Four& p) const {
  const FourPoints ap{p[0] - a_.x, p[1] - a_.y, p[2] - a_.z};
  const Four d1 = ab_.dot(ap), d2 = ac_.dot(ap);
  const Four d3 = d1 - bb_, d4 = d2 - bc_, d5 = d1 - bc_, d6 = d2 - cc_;
  const Four vc = d1 * d4 - d3 * d2, vb = d5 * d2 - d1 * d6, va = d3 * d6 - d5 * d4;
  const base::Int4 is_inside = (va > 0.0F) & (vb > 0.0F) & (vc > 0.0F);
  const base::Int4 is_beside_bc = (va <= 0.0F) & (d4 >= d3) & (d5 >= d6);
  // The rest lies beside ab, ac or a corner, which are ends of edges. Those of a and b lie on ab, that of c on ac.
  const base::Int4 is_beside_ac =
      (((vb <= 0.0F) & (d2 >= 0.0F) & (d6 <= 0.0F)) | ((d6 >= 0.0F) & (d5 <= d6))) & ~is_inside & ~is_beside_bc;
  const base::Int4 is_beside_ab = ~(is_inside | is_beside_bc | is_beside_ac);
  const Four scale = 1.0F / (va + vb + vc);
  const Four on_bc = share((d4 - d3) * bc_scale_);
  Closest out;
  out.b_weight =
      where(is_inside, vb * scale) + where(is_beside_bc, 1.0F - on_bc) + where(is_beside_ab, share(d1 * ab_scale_));
  out.c_weight = where(is_inside, vc * scale) + where(is_beside_bc, on_bc) + where(is_beside_ac, share(d2 * ac_scale_));
  const FourPoints off{ap.x - out.b_weight * ab_.x - out.c_weight * ac_.x,
                       ap.y - out.b_weight * ab_.y - out.c_weight * ac_.y,
                       ap.z - out.b_weight * ab_.z - out.c_weight * ac_.z};
  out.distance2 = off.dot(off);
  return out;
}

FourAppearances::FourAppearances(const FourAttributes& a, const FourAttributes& b, const FourAttributes& c,
                                 const AppearanceOptions& options)
    : shape_(a.position, b.position, c.position) {
  if (options.isShapeAlone()) return;
  const EdgeLengths2 edges2 = lengths2(between(a.position, b.position), between(a.position, c.position));
  if (options.normals) {
    normal_.a = a.normal, normal_.ab = between(a.normal, b.normal), normal_.ac = between(a.normal, c.normal);
    const EdgeLengths2 chords2 = lengths2(normal_.ab, normal_.ac);
    const Four ab = turnOf(chords2.ab), bc = turnOf(chords2.bc), ca = turnOf(chords2.ca);
    normal_.scale = 1.0F / rootOf(steepest2({ab * ab, bc * bc, ca * ca}, edges2));
  }
  if (options.colors) {
    color_.a = a.color, color_.ab = between(a.color, b.color), color_.ac = between(a.color, c.color);
    color_.scale = 1.0F / rootOf(steepest2(lengths2(color_.ab, color_.ac), edges2));
  }
}

Four FourAppearances::error2(const Attributes& place, const AppearanceOptions& options) const {
  const FourTriangles::Closest at = shape_.closest(place.position);
  Four sum = at.distance2;
  if (options.normals) {
    const FourPoints normal = valueAt(normal_.a, normal_.ab, normal_.ac, at);
    const Four length2 = normal.dot(normal);
    const Four unit = 1.0F / rootOf(length2);
    const FourPoints off{normal.x * unit - place.normal[0], normal.y * unit - place.normal[1],
                         normal.z * unit - place.normal[2]};
    // Normals that cancel each other out are none.
    const Four turn = length2 > 0.0F ? turnOf(off.dot(off)) : Four{} + kHalfTurn;
    const Four reach = along(turn - options.negligible_turn, normal_.scale);
    sum += reach * reach;
  }
  if (options.colors) {
    const FourPoints color = valueAt(color_.a, color_.ab, color_.ac, at);
    const FourPoints off{color.x - place.color[0], color.y - place.color[1], color.z - place.color[2]};
    const Four reach = along(rootOf(off.dot(off)) - options.negligible_color, color_.scale);
    sum += reach * reach;
  }
  return sum;
}

}  // namespace lod::hlod::builder
