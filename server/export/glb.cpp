#include "server/export/glb.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/check.h"
#include "base/file.h"

namespace server::exports {
namespace {

using nlohmann::json;

// Component types, targets, filters and wrapping are OpenGL's numbers (sections 3.6.2 and 5.26).
constexpr int kUnsignedShort = 5123, kUnsignedInt = 5125, kFloat = 5126;
constexpr int kArrayBuffer = 34962, kElementArrayBuffer = 34963;
constexpr int kLinear = 9729, kLinearMipmapLinear = 9987, kClampToEdge = 33071;

constexpr std::uint32_t kMagic = 0x46546C67;      // "glTF"
constexpr std::uint32_t kJsonChunk = 0x4E4F534A;  // "JSON"
constexpr std::uint32_t kBinChunk = 0x004E4942;   // "BIN\0"

constexpr const char* kUnlitExtension = "KHR_materials_unlit";

std::size_t paddedSize(std::size_t size) {
  return (size + 3) / 4 * 4;
}

}  // namespace

base::Error tooLarge(const std::string& path) {
  return {base::ErrorCode::kUnsupported,
          path + ": a GLB holds 4 GiB at most, and this one would be longer; say --triangles"};
}

std::uint16_t linearFromSrgb(std::uint8_t srgb) {
  static const std::array<std::uint16_t, 256> kTable = [] {
    std::array<std::uint16_t, 256> table{};
    for (std::size_t i = 0; i < table.size(); ++i) {
      const double v = static_cast<double>(i) / 255.0;
      const double linear = v <= 0.04045 ? v / 12.92 : std::pow((v + 0.055) / 1.055, 2.4);
      table[i] = static_cast<std::uint16_t>(std::lround(65535.0 * linear));
    }
    return table;
  }();
  return kTable[srgb];
}

// Views begin at multiples of 4, which suits every component type.
std::size_t GlbWriter::addView(base::ByteView bytes) {
  binary_.resize(paddedSize(binary_.size()));
  views_.push_back({{"buffer", 0}, {"byteOffset", binary_.size()}, {"byteLength", bytes.size()}});
  binary_.insert(binary_.end(), bytes.begin(), bytes.end());
  return views_.size() - 1;
}

template <class T>
std::size_t GlbWriter::addAccessor(const std::vector<T>& values, const char* type, int component, int target,
                                   bool normalized) {
  const std::size_t view = addView({reinterpret_cast<const std::uint8_t*>(values.data()), values.size() * sizeof(T)});
  views_[view]["target"] = target;
  json accessor{{"bufferView", view}, {"componentType", component}, {"count", values.size()}, {"type", type}};
  if (normalized) accessor["normalized"] = true;
  accessors_.push_back(std::move(accessor));
  return accessors_.size() - 1;
}

void GlbWriter::add(const GlbPrimitive& p) {
  LUMIGRID_CHECK(!p.indices.empty());
  json attributes;

  // The smallest box is required of positions.
  attributes["POSITION"] = addAccessor(p.positions, "VEC3", kFloat, kArrayBuffer, false);
  glm::vec3 low = p.positions[0], high = low;
  for (const glm::vec3& point : p.positions) low = glm::min(low, point), high = glm::max(high, point);
  accessors_.back()["min"] = {low.x, low.y, low.z};
  accessors_.back()["max"] = {high.x, high.y, high.z};

  if (!p.normals.empty()) attributes["NORMAL"] = addAccessor(p.normals, "VEC3", kFloat, kArrayBuffer, false);
  if (!p.places.empty()) attributes["TEXCOORD_0"] = addAccessor(p.places, "VEC2", kFloat, kArrayBuffer, false);
  if (!p.colors.empty()) {
    // Each vertex begins at a multiple of 4, so three shorts are followed by a fourth, here the alpha.
    std::vector<glm::u16vec4> colors;
    colors.reserve(p.colors.size());
    for (const glm::u16vec3& color : p.colors) colors.emplace_back(color, 65535);
    attributes["COLOR_0"] = addAccessor(colors, "VEC4", kUnsignedShort, kArrayBuffer, true);
  }

  json primitive{{"attributes", std::move(attributes)}};
  if (p.positions.size() <= kMaxShortVertices) {
    const std::vector<std::uint16_t> indices(p.indices.begin(), p.indices.end());
    primitive["indices"] = addAccessor(indices, "SCALAR", kUnsignedShort, kElementArrayBuffer, false);
  } else {
    primitive["indices"] = addAccessor(p.indices, "SCALAR", kUnsignedInt, kElementArrayBuffer, false);
  }
  primitive["material"] = materialOf(p);
  primitives_.push_back(std::move(primitive));
}

std::size_t GlbWriter::materialOf(const GlbPrimitive& p) {
  if (p.picture.empty() && plain_material_ != 0) return plain_material_ - 1;
  json surface;
  if (!p.picture.empty()) {
    images_.push_back(
        {{"bufferView", addView(p.picture)}, {"mimeType", p.picture_is_png ? "image/png" : "image/jpeg"}});
    surface["baseColorTexture"] = {{"index", images_.size() - 1}};
  }
  surface["metallicFactor"] = 0.0;
  surface["roughnessFactor"] = 1.0;
  // Open scans are seen from behind too.
  json material{{"pbrMetallicRoughness", std::move(surface)}, {"doubleSided", true}};
  if (p.masked) material["alphaMode"] = "MASK";
  if (style_.unlit) material["extensions"] = {{kUnlitExtension, json::object()}};
  materials_.push_back(std::move(material));
  if (p.picture.empty()) plain_material_ = materials_.size();
  return materials_.size() - 1;
}

json GlbWriter::document(const glm::dmat4& gltf_from_mesh) const {
  json asset{{"version", "2.0"}, {"generator", "lumigrid"}};
  if (!style_.copyright.empty()) asset["copyright"] = style_.copyright;
  json matrix = json::array();
  for (int column = 0; column < 4; ++column)
    for (int row = 0; row < 4; ++row) matrix.push_back(gltf_from_mesh[column][row] + 0.0);  // no −0
  json node{{"mesh", 0}};
  if (gltf_from_mesh != glm::dmat4(1.0)) node["matrix"] = std::move(matrix);

  json j{{"asset", std::move(asset)},
         {"scene", 0},
         {"scenes", {{{"nodes", {0}}}}},
         {"nodes", {std::move(node)}},
         {"meshes", {{{"primitives", primitives_}}}},
         {"materials", materials_},
         {"accessors", accessors_},
         {"bufferViews", views_},
         {"buffers", {{{"byteLength", binary_.size()}}}}};
  if (style_.unlit) j["extensionsUsed"] = {kUnlitExtension};
  if (!images_.empty()) {
    // Coordinates are clamped: charts at a page's edges have no more gutter than they need.
    j["samplers"] = {
        {{"magFilter", kLinear}, {"minFilter", kLinearMipmapLinear}, {"wrapS", kClampToEdge}, {"wrapT", kClampToEdge}}};
    j["images"] = images_;
    j["textures"] = json::array();
    for (std::size_t i = 0; i < images_.size(); ++i) j["textures"].push_back({{"sampler", 0}, {"source", i}});
  }
  return j;
}

base::Result<std::uint64_t> GlbWriter::write(const std::string& path, const glm::dmat4& gltf_from_mesh) const {
  LUMIGRID_CHECK(!primitives_.empty());
  std::string text = document(gltf_from_mesh).dump();
  text.resize(paddedSize(text.size()), ' ');
  const std::size_t binary_size = paddedSize(binary_.size());
  const std::uint64_t total = 12 + 8 + text.size() + 8 + binary_size;
  if (total > kMaxGlbBytes) return tooLarge(path);

  base::ByteWriter head;
  head.u32(kMagic);
  head.u32(2);
  head.u32(static_cast<std::uint32_t>(total));
  head.u32(static_cast<std::uint32_t>(text.size()));
  head.u32(kJsonChunk);
  head.bytes(base::viewOfText(text));
  head.u32(static_cast<std::uint32_t>(binary_size));
  head.u32(kBinChunk);
  LUMIGRID_ASSIGN_OR_RETURN(auto file, base::AtomicFile::create(path));
  LUMIGRID_TRY(file.write(head.view()));
  LUMIGRID_TRY(file.write(binary_));
  LUMIGRID_TRY(file.write(base::Bytes(binary_size - binary_.size(), 0)));
  LUMIGRID_TRY(file.commit());
  return total;
}

}  // namespace server::exports
