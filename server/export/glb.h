#pragma once
// Writes glTF 2.0 in its binary form, GLB (Khronos, "glTF 2.0 Specification", section 4.4).
#include <cstdint>
#include <glm/glm.hpp>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"

namespace server::exports {

/// A primitive with 16-bit indices has at most so many vertices: glTF keeps the largest index for itself.
inline constexpr std::size_t kMaxShortVertices = 65535;

/// The longest file that the format can state, bytes, and the error for a longer one.
inline constexpr std::uint64_t kMaxGlbBytes = 0xFFFFFFFF;
base::Error tooLarge(const std::string& path);

/// Triangles with one material. Attributes are empty, or as many as positions.
struct GlbPrimitive {
  std::vector<glm::vec3> positions;
  std::vector<glm::vec3> normals;      ///< unit
  std::vector<glm::u16vec3> colors;    ///< linear, 65535 = 1
  std::vector<glm::vec2> places;       ///< on the picture, 0 … 1 from its upper left corner, x to the right
  std::vector<std::uint32_t> indices;  ///< 3 per triangle, counter-clockwise from outside

  base::Bytes picture;  ///< a JPEG or PNG; empty: none
  bool picture_is_png = false;
  bool masked = false;  ///< texels whose alpha is below a half are not drawn
};

/// How all primitives of a file look.
struct GlbStyle {
  bool unlit = false;       ///< shows the colours as they are (KHR_materials_unlit)
  std::string copyright{};  ///< whom viewers name; empty: nobody
};

/// The linear value, 65535 = 1, of an sRGB byte (IEC 61966-2-1). No two bytes share one.
std::uint16_t linearFromSrgb(std::uint8_t srgb);

/// Collects primitives, all in one mesh and one node, and writes the file. Needs memory for the whole file.
class GlbWriter {
 public:
  explicit GlbWriter(GlbStyle style) : style_(std::move(style)) {}

  /// Adds a primitive of at least one triangle.
  void add(const GlbPrimitive& primitive);
  /// The file's length is a little more than this.
  std::uint64_t binaryBytes() const { return binary_.size(); }
  /// Writes the file, which appears whole or not at all, and returns its length. `gltf_from_mesh` has a last row of
  /// 0 0 0 1. Errors: kUnsupported for a file over 4 GiB, which the format cannot state; kNoSpace, kIo.
  base::Result<std::uint64_t> write(const std::string& path, const glm::dmat4& gltf_from_mesh) const;

 private:
  template <class T>
  std::size_t addAccessor(const std::vector<T>& values, const char* type, int component, int target, bool normalized);
  std::size_t addView(base::ByteView bytes);
  std::size_t materialOf(const GlbPrimitive& primitive);
  nlohmann::json document(const glm::dmat4& gltf_from_mesh) const;

  GlbStyle style_;
  base::Bytes binary_;
  nlohmann::json views_ = nlohmann::json::array(), accessors_ = nlohmann::json::array();
  nlohmann::json primitives_ = nlohmann::json::array();
  nlohmann::json materials_ = nlohmann::json::array(), images_ = nlohmann::json::array();
  std::size_t plain_material_ = 0;  // number + 1 of the material without a picture; 0: not made yet
};

}  // namespace server::exports
