#include "mesh/tiles/points.h"

#include <cmath>
#include <cstring>
#include <glm/gtc/matrix_transform.hpp>
#include <optional>

#include "mesh/tiles/feature_table.h"

namespace mesh::tiles {
namespace {

using gltf::json;
using gltf::member;

template <class T>
T elementOf(base::ByteView bytes, std::uint64_t index) {
  T element;
  std::memcpy(&element, bytes.data() + index * sizeof(T), sizeof(T));
  return element;
}

// A normal from octahedral coordinates in two bytes (section "Oct-encoded normals"; Cigolle et al. 2014, "A Survey of
// Efficient Representations for Independent Unit Vectors").
glm::vec3 normalFromOctahedron(const glm::u8vec2& packed) {
  const glm::vec2 e = glm::vec2(packed) / 127.5F - 1.0F;
  glm::vec3 n(e, 1.0F - std::abs(e.x) - std::abs(e.y));
  if (n.z < 0.0F) {
    const glm::vec2 folded = 1.0F - glm::abs(glm::vec2(n.y, n.x));
    n.x = n.x < 0.0F ? -folded.x : folded.x;
    n.y = n.y < 0.0F ? -folded.y : folded.y;
  }
  return n;
}

glm::u8vec4 colorFrom565(std::uint16_t packed) {
  const auto widen = [](int value, int largest) {
    return static_cast<std::uint8_t>((255 * value + largest / 2) / largest);
  };
  return {widen(packed >> 11, 31), widen(packed >> 5 & 63, 63), widen(packed & 31, 31), 255};
}

/// The attributes of a tile's points, of which each is as long as their number says.
class Points {
 public:
  static base::Result<Points> of(const FeatureTable& table) {
    Points points;
    const json& length = member(table.root, "POINTS_LENGTH");
    points.count_ = gltf::integer(length, gltf::integer(gltf::item(length, 0), gltf::kMissing));
    // More could not lie in the file, and the products below stay within 64 bits.
    if (points.count_ > table.binary.size())
      return invalidInput("POINTS_LENGTH is missing, or more than the tile holds");
    LUMIGRID_TRY(points.findPositions(table));
    const auto find = [&](const char* name, std::uint64_t bytes, base::ByteView& found) -> base::Result<void> {
      if (member(table.root, name).is_null()) return {};
      LUMIGRID_ASSIGN_OR_RETURN(found, table.bytesOf(name, points.count_ * bytes));
      return {};
    };
    LUMIGRID_TRY(find("NORMAL", sizeof(glm::vec3), points.normals_));
    if (points.normals_.empty()) LUMIGRID_TRY(find("NORMAL_OCT16P", 2, points.packed_normals_));
    // The order in which they go before one another is the specification's.
    LUMIGRID_TRY(find("RGBA", 4, points.rgba_));
    if (points.rgba_.empty()) LUMIGRID_TRY(find("RGB", 3, points.rgb_));
    if (points.rgba_.empty() && points.rgb_.empty()) LUMIGRID_TRY(find("RGB565", 2, points.rgb565_));
    const json& constant = member(table.root, "CONSTANT_RGBA");
    if (gltf::itemsOf(constant) == 4) {
      glm::u8vec4 color(255);
      for (int k = 0; k < 3; ++k)
        color[k] = static_cast<std::uint8_t>(
            std::min<std::uint64_t>(255, gltf::integer(constant[static_cast<std::size_t>(k)], 255)));
      points.constant_ = color;
    }
    return points;
  }

  std::uint64_t count() const { return count_; }
  bool hasNormals() const { return !normals_.empty() || !packed_normals_.empty(); }
  bool hasColors() const { return !rgba_.empty() || !rgb_.empty() || !rgb565_.empty() || constant_; }

  glm::dvec3 position(std::uint64_t i) const {
    if (!positions_.empty()) return glm::dvec3(elementOf<glm::vec3>(positions_, i));
    return offset_ + scale_ * (glm::dvec3(elementOf<glm::u16vec3>(quantized_, i)) / 65535.0);
  }
  glm::vec3 normal(std::uint64_t i) const {
    if (!normals_.empty()) return elementOf<glm::vec3>(normals_, i);
    return normalFromOctahedron(elementOf<glm::u8vec2>(packed_normals_, i));
  }
  glm::u8vec4 color(std::uint64_t i) const {
    if (!rgba_.empty()) return glm::u8vec4(glm::u8vec3(elementOf<glm::u8vec4>(rgba_, i)), 255);
    if (!rgb_.empty()) return glm::u8vec4(elementOf<glm::u8vec3>(rgb_, i), 255);
    return rgb565_.empty() ? *constant_ : colorFrom565(elementOf<std::uint16_t>(rgb565_, i));
  }

 private:
  base::Result<void> findPositions(const FeatureTable& table) {
    if (!member(table.root, "POSITION").is_null()) {
      LUMIGRID_ASSIGN_OR_RETURN(positions_, table.bytesOf("POSITION", count_ * sizeof(glm::vec3)));
      return {};
    }
    const auto offset = gltf::numbers<glm::dvec3>(member(table.root, "QUANTIZED_VOLUME_OFFSET"));
    const auto scale = gltf::numbers<glm::dvec3>(member(table.root, "QUANTIZED_VOLUME_SCALE"));
    if (member(table.root, "POSITION_QUANTIZED").is_null() || !offset || !scale)
      return invalidInput("its points have neither POSITION nor POSITION_QUANTIZED with its volume");
    offset_ = *offset, scale_ = *scale;
    LUMIGRID_ASSIGN_OR_RETURN(quantized_, table.bytesOf("POSITION_QUANTIZED", count_ * sizeof(glm::u16vec3)));
    return {};
  }

  std::uint64_t count_ = 0;
  base::ByteView positions_, quantized_, normals_, packed_normals_, rgba_, rgb_, rgb565_;
  glm::dvec3 offset_{0.0}, scale_{1.0};
  std::optional<glm::u8vec4> constant_;
};

}  // namespace

base::Result<void> readPoints(base::ByteView bytes, const glm::dmat4& world_from_tile, const gltf::ShareOfSource& share,
                              MeshStream& out) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto table, FeatureTable::parse(bytes, "pnts"));
  if (gltf::extension(table.root, "3DTILES_draco_point_compression").is_object())
    return unsupported("its points are compressed by Draco (3DTILES_draco_point_compression), which is not read");
  LUMIGRID_ASSIGN_OR_RETURN(const auto center, table.center());
  LUMIGRID_ASSIGN_OR_RETURN(const auto points, Points::of(table));
  // A block's points have the same attributes.
  const bool differs = out.normals.empty() == points.hasNormals() || out.colors.empty() == points.hasColors();
  if (differs && !out.positions.empty()) LUMIGRID_TRY(out.handOver());
  const glm::dmat4 world_from_points = glm::translate(world_from_tile, center);
  const glm::mat3 world_from_normal(glm::transpose(glm::inverse(glm::dmat3(world_from_points))));
  for (std::uint64_t i = 0; i < points.count(); ++i) {
    out.positions.emplace_back(world_from_points * glm::dvec4(points.position(i), 1.0));
    if (points.hasNormals()) out.normals.push_back(world_from_normal * points.normal(i));
    if (points.hasColors()) out.colors.push_back(points.color(i));
    if (!out.isFull()) continue;
    LUMIGRID_TRY(out.handOver());
    const double done = static_cast<double>(i + 1) / static_cast<double>(points.count());
    LUMIGRID_TRY(out.report(share.begin + done * (share.end - share.begin)));
  }
  return {};
}

}  // namespace mesh::tiles
