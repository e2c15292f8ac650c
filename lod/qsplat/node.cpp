#include "lod/qsplat/node.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace lod::qsplat {

// Cells span equal angles seen from the cube's middle.
double cellBorder(double cell) {
  return std::tan(0.25 * 3.14159265358979323846 * (2.0 * cell / kNormalSide - 1.0));
}

namespace {

struct CellBorders {
  std::array<float, kNormalSide + 1> at;
  CellBorders() {
    for (std::uint32_t i = 0; i <= kNormalSide; ++i) at[i] = static_cast<float>(cellBorder(i));
    // The outermost cells extend to infinity.
    at.front() = -std::numeric_limits<float>::infinity();
    at.back() = std::numeric_limits<float>::infinity();
  }
};

std::uint32_t cellOf(const CellBorders& borders, float t) {
  // A polynomial for the arctangent (Rajan et al. 2006; at most 0.0038 rad off, an eighth of a cell) gives a first
  // guess, which the exact borders then correct.
  const float turns = t * (1.0F + 0.3476F * (1.0F - std::abs(t)));
  const float guess = 0.5F * static_cast<float>(kNormalSide) * (turns + 1.0F);
  const auto cell = static_cast<std::uint32_t>(std::clamp(guess, 0.0F, static_cast<float>(kNormalSide - 1)));
  return cell + (t >= borders.at[cell + 1] ? 1U : 0U) - (t < borders.at[cell] ? 1U : 0U);
}

}  // namespace

SphereCodes::SphereCodes() {
  codes_.fill(static_cast<std::uint16_t>(kSphereCodes));
  std::uint16_t code = 0;
  for (int s = 1; s <= kSphereSteps; ++s)
    for (int x = 0; x <= kSphereSteps - s; ++x)
      for (int y = 0; y <= kSphereSteps - s; ++y)
        for (int z = 0; z <= kSphereSteps - s; ++z) {
          if (!isChildSphere(s, x, y, z)) continue;
          spheres_[code] = {s, {x, y, z}};
          codes_[index(spheres_[code])] = code;
          ++code;
        }
}

const SphereCodes& sphereCodes() {
  static const SphereCodes codes;
  return codes;
}

const SphereTable& sphereTable() {
  static const SphereTable table = [] {
    const auto thirteenths = [](int v) { return static_cast<float>(static_cast<double>(v) / kSphereSteps); };
    SphereTable steps;
    for (std::uint32_t code = 0; code < kSphereCodes; ++code) {
      const auto& [s, cell] = sphereCodes().sphere(code);
      steps[code] = {{thirteenths(s + 2 * cell[0] - kSphereSteps), thirteenths(s + 2 * cell[1] - kSphereSteps),
                      thirteenths(s + 2 * cell[2] - kSphereSteps)},
                     thirteenths(s)};
    }
    return steps;
  }();
  return table;
}

bool encloses(const base::Sphere& outer, const base::Sphere& inner) {
  const glm::dvec3 between = glm::dvec3(outer.center) - glm::dvec3(inner.center);
  const double room = static_cast<double>(outer.radius) * (1.0 + 1e-12) - static_cast<double>(inner.radius);
  return room >= 0.0 && glm::dot(between, between) <= room * room;
}

std::uint32_t encodeSphere(const base::Sphere& parent, const base::Sphere& child) {
  const SphereCodes& codes = sphereCodes();
  const SphereTable& table = sphereTable();
  if (!(parent.radius > 0.0F) || !encloses(parent, child)) return kWholeParent;
  const double scale = kSphereSteps / static_cast<double>(parent.radius);
  // Units are thirteenths, counted from the corner of the parent's bounding cube and twice as wide: a sphere of code
  // (s, x, y, z) has its centre at s/2 + (x, y, z).
  const glm::dvec3 at = 0.5 * ((glm::dvec3(child.center) - glm::dvec3(parent.center)) * scale + double{kSphereSteps});
  const double radius = static_cast<double>(child.radius) * scale;
  int s =
      radius < double{kSphereSteps} ? std::max(1, static_cast<int>(std::ceil(radius * (1.0 - 1e-6)))) : kSphereSteps;
  for (; s < kSphereSteps; ++s) {
    // The nearest cell: halves are rounded up, values below 0 become 0.
    const glm::ivec3 cell = glm::min(glm::ivec3(glm::max(at - 0.5 * s + 0.5, 0.0)), kSphereSteps - s);
    const std::uint32_t code = codes.code({s, {cell.x, cell.y, cell.z}});
    if (code < kSphereCodes && encloses(decodeSphere(parent, table[code]), child)) return code;
  }
  return kWholeParent;
}

const NormalTable& normalTable() {
  static const NormalTable table = [] {
    NormalTable normals;
    normals.fill({0.0F, 0.0F, 1.0F});
    for (std::uint32_t face = 0; face < 6; ++face)
      for (std::uint32_t row = 0; row < kNormalSide; ++row)
        for (std::uint32_t column = 0; column < kNormalSide; ++column) {
          const std::uint32_t axis = face / 2;
          glm::dvec3 n(0.0);
          n[static_cast<int>(axis)] = face % 2 == 0 ? 1.0 : -1.0;
          n[axis == 0 ? 1 : 0] = cellBorder(row + 0.5);
          n[axis == 2 ? 1 : 2] = cellBorder(column + 0.5);
          normals[(face * kNormalSide + row) * kNormalSide + column] = glm::vec3(glm::normalize(n));
        }
    return normals;
  }();
  return table;
}

std::uint32_t encodeNormal(const glm::vec3& n) {
  const glm::vec3 size = glm::abs(n);
  // Which one it is cannot be foretold: no branches.
  const bool is_x = (size.x >= size.y) & (size.x >= size.z);
  const std::uint32_t axis = is_x ? 0U : 2U - static_cast<std::uint32_t>(size.y >= size.z);
  const float major = std::max(size.x, std::max(size.y, size.z));
  if (!(major > 0.0F) || !(size.x + size.y + size.z <= std::numeric_limits<float>::max()))
    return encodeNormal({0.0F, 0.0F, 1.0F});
  const std::uint32_t face = 2 * axis + (n[static_cast<int>(axis)] < 0.0F ? 1 : 0);
  static const CellBorders borders;
  const std::uint32_t row = cellOf(borders, n[axis == 0 ? 1 : 0] / major);
  const std::uint32_t column = cellOf(borders, n[axis == 2 ? 1 : 2] / major);
  return (face * kNormalSide + row) * kNormalSide + column;
}

namespace {

constexpr float kAnySine = std::numeric_limits<float>::infinity();

// Returns the code of a cone; the last of `codes` codes means any direction.
std::uint32_t encodeSine(double least_cosine, std::uint32_t codes) {
  // Products of two normals in float32 are off by at most this.
  constexpr double kRounding = 3e-7;
  const double cosine = least_cosine - kRounding;
  if (!(cosine > 0.0)) return codes - 1;
  const double sine = std::sqrt(std::max(0.0, 1.0 - cosine * cosine));
  return std::min(codes - 1, static_cast<std::uint32_t>(std::ceil(std::max(sine * codes, 1.0))) - 1);
}

}  // namespace

const ConeSines& coneSines(bool has_pointer) {
  static const std::array<ConeSines, 2> tables = [] {
    std::array<ConeSines, 2> made{};
    for (std::uint32_t field = 0; field < made[0].size(); ++field) {
      const auto sine = [](std::uint32_t code, std::uint32_t codes) {
        return code + 1 == codes ? kAnySine : static_cast<float>(code + 1) / static_cast<float>(codes);
      };
      made[0][field] = sine(field, kLeafConeCodes);
      made[1][field] = sine(field % kConeCodes, kConeCodes);
    }
    return made;
  }();
  return tables[has_pointer ? 1 : 0];
}

std::uint32_t encodeCone(double least_cosine) {
  return encodeSine(least_cosine, kConeCodes);
}

std::uint32_t encodeLeafCone(double least_cosine) {
  return encodeSine(least_cosine, kLeafConeCodes);
}

std::uint16_t encodeColor(const glm::u8vec3& color) {
  const auto nearest = [](std::uint32_t value, std::uint32_t most) { return (value * most * 2 + 255) / (2 * 255); };
  return static_cast<std::uint16_t>(nearest(color.r, 31) << 11 | nearest(color.g, 63) << 5 | nearest(color.b, 31));
}

}  // namespace lod::qsplat
