#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <glm/gtc/quaternion.hpp>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "mesh/readers.h"

namespace mesh {
namespace {

using nlohmann::json;

constexpr std::uint32_t kMagic = 0x46546C67;      // "glTF"
constexpr std::uint32_t kJsonChunk = 0x4E4F534A;  // "JSON"
constexpr std::uint32_t kBinChunk = 0x004E4942;   // "BIN\0"

// Nodes may draw one mesh many times, and a small hostile file must not fill the disk: 2^27 vertices are 3 GB of
// doubles.
constexpr std::uint64_t kMaxInstancedVertices = std::uint64_t{1} << 27;

// ---- JSON that may hold anything ----

const json kNothing;

const json& member(const json& object, const char* key) {
  if (!object.is_object()) return kNothing;
  const auto found = object.find(key);
  return found == object.end() ? kNothing : *found;
}

const json& item(const json& array, std::uint64_t index) {
  return array.is_array() && index < array.size() ? array[index] : kNothing;
}

/// A non-negative integer, or `otherwise` when it is missing or something else.
std::uint64_t integer(const json& value, std::uint64_t otherwise) {
  if (value.is_number_unsigned()) return value.get<std::uint64_t>();
  return otherwise;
}
constexpr std::uint64_t kMissing = ~std::uint64_t{0};

/// An array with as many numbers as the vector or matrix has.
template <class Vector>
std::optional<Vector> numbers(const json& value) {
  std::array<double, sizeof(Vector) / sizeof(double)> read{};
  if (!value.is_array() || value.size() != read.size()) return std::nullopt;
  for (std::size_t i = 0; i < read.size(); ++i) {
    if (!value[i].is_number()) return std::nullopt;
    read[i] = value[i].get<double>();
  }
  return std::bit_cast<Vector>(read);
}

std::string text(const json& value) {
  return value.is_string() ? value.get<std::string>() : std::string{};
}

// ---- Accessors (section 3.6.2) ----

enum ComponentType : std::uint64_t {
  kByte = 5120,
  kUnsignedByte = 5121,
  kShort = 5122,
  kUnsignedShort = 5123,
  kUnsignedInt = 5125,
  kFloat = 5126
};

std::size_t componentBytes(std::uint64_t type) {
  if (type == kByte || type == kUnsignedByte) return 1;
  if (type == kShort || type == kUnsignedShort) return 2;
  return type == kUnsignedInt || type == kFloat ? 4 : 0;
}

std::size_t componentsOf(const std::string& type) {
  if (type == "SCALAR") return 1;
  if (type == "VEC2") return 2;
  if (type == "VEC3") return 3;
  return type == "VEC4" ? 4 : 0;
}

struct Accessor {
  const std::uint8_t* data = nullptr;
  std::uint64_t count = 0;
  std::size_t stride = 0;
  std::uint64_t component_type = 0;
  std::size_t components = 0;
  bool normalized = false;

  template <class T>
  T load(std::uint64_t i, std::size_t component) const {
    T value;
    std::memcpy(&value, data + i * stride + component * sizeof(T), sizeof(T));
    return value;
  }
  /// A component as a number; normalised integers become −1..1 or 0..1 (section 3.6.2.2).
  double value(std::uint64_t i, std::size_t c) const {
    if (component_type == kFloat) return static_cast<double>(load<float>(i, c));
    if (component_type == kByte) return scaled(load<std::int8_t>(i, c), 127.0);
    if (component_type == kUnsignedByte) return scaled(load<std::uint8_t>(i, c), 255.0);
    if (component_type == kShort) return scaled(load<std::int16_t>(i, c), 32767.0);
    if (component_type == kUnsignedShort) return scaled(load<std::uint16_t>(i, c), 65535.0);
    return static_cast<double>(load<std::uint32_t>(i, c));
  }
  glm::dvec3 vector(std::uint64_t i) const { return {value(i, 0), value(i, 1), value(i, 2)}; }
  std::uint32_t index(std::uint64_t i) const {
    if (component_type == kUnsignedByte) return load<std::uint8_t>(i, 0);
    if (component_type == kUnsignedShort) return load<std::uint16_t>(i, 0);
    return load<std::uint32_t>(i, 0);
  }

 private:
  double scaled(int raw, double largest) const {
    return normalized ? std::max(static_cast<double>(raw) / largest, -1.0) : static_cast<double>(raw);
  }
};

// ---- Colours ----

// The sRGB transfer function (IEC 61966-2-1): glTF's vertex colours and factors are linear, ours are sRGB.
double srgbFromLinear(double v) {
  return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1.0 / 2.4) - 0.055;
}

// ---- Scene graph (section 3.5) ----

glm::dmat4 nodeMatrix(const json& node) {
  if (const auto whole = numbers<glm::dmat4>(member(node, "matrix"))) return *whole;  // column-major, as glm's
  const auto translation = numbers<glm::dvec3>(member(node, "translation")).value_or(glm::dvec3(0.0));
  const auto scale = numbers<glm::dvec3>(member(node, "scale")).value_or(glm::dvec3(1.0));
  // The order in the file is x y z w.
  const auto rotation = numbers<glm::dvec4>(member(node, "rotation")).value_or(glm::dvec4(0.0, 0.0, 0.0, 1.0));
  glm::dmat4 matrix(glm::mat3_cast(glm::dquat(rotation.w, rotation.x, rotation.y, rotation.z)));
  for (int k = 0; k < 3; ++k) matrix[k] *= scale[k];
  matrix[3] = glm::dvec4(translation, 1.0);
  return matrix;
}

/// The roots of the default scene, or all nodes that are nobody's child.
std::vector<std::uint64_t> rootNodes(const json& document) {
  std::vector<std::uint64_t> roots;
  const json& listed = member(item(member(document, "scenes"), integer(member(document, "scene"), 0)), "nodes");
  if (listed.is_array()) {
    for (const json& node : listed) roots.push_back(integer(node, kMissing));
    return roots;
  }
  const json& nodes = member(document, "nodes");
  std::vector<bool> is_child(nodes.is_array() ? nodes.size() : 0, false);
  for (const json& node : nodes.is_array() ? nodes : json::array()) {
    const json& children = member(node, "children");
    for (std::size_t c = 0; children.is_array() && c < children.size(); ++c) {
      const std::uint64_t child = integer(children[c], kMissing);
      if (child < is_child.size()) is_child[child] = true;
    }
  }
  for (std::size_t n = 0; n < is_child.size(); ++n)
    if (!is_child[n]) roots.push_back(n);
  return roots;
}

// ---- The file (section 4.4), its primitives (section 3.7.2) ----

class GlbReader {
 public:
  explicit GlbReader(MeshStream& out) : out_(out) {}

  base::Result<void> read(base::ByteView bytes) {
    LUMIGRID_TRY(splitChunks(bytes));
    LUMIGRID_TRY(checkExtensions());
    LUMIGRID_TRY(readScene());
    if (out_.triangleCount() == 0) return invalidInput("the file has no triangles");
    if (skipped_primitives_ > 0)
      out_.summary.warnings.push_back(std::to_string(skipped_primitives_) +
                                      " primitives of points or lines are left out");
    return out_.flush(bytes.data() + bytes.size());
  }

 private:
  // A 12-byte header is followed by chunks, each of length, type and bytes (section 4.4).
  base::Result<void> splitChunks(base::ByteView bytes) {
    base::ByteReader reader(bytes);
    const std::uint32_t magic = reader.u32();
    const std::uint32_t version = reader.u32();
    const std::uint32_t length = reader.u32();
    if (!reader.ok() || magic != kMagic) return invalidInput("not a GLB file: it does not begin with \"glTF\"");
    if (version != 2) return unsupported("glTF version " + std::to_string(version) + " is not read (only 2 is)");
    if (length > bytes.size())
      return truncatedIn("byte " + std::to_string(bytes.size()) + " of " + std::to_string(length));
    file_bytes_ = bytes.size();
    file_ = bytes.data();

    bool has_json = false;
    while (reader.ok() && reader.offset() + 8 <= length) {
      const std::uint32_t chunk_length = reader.u32();
      const std::uint32_t type = reader.u32();
      const base::ByteView chunk = reader.bytes(chunk_length);
      if (!reader.ok()) return truncatedIn("a chunk of " + std::to_string(chunk_length) + " bytes");
      if (type == kJsonChunk && !has_json) {
        document_ = json::parse(chunk.begin(), chunk.end(), nullptr, false);
        has_json = true;
      } else if (type == kBinChunk && binary_.empty()) {
        binary_ = chunk;
      }
    }
    if (!has_json || !document_.is_object()) return invalidInput("the JSON chunk is missing or broken");
    return {};
  }

  base::Result<void> checkExtensions() const {
    const json& required = member(document_, "extensionsRequired");
    if (!required.is_array()) return {};
    for (const json& extension : required) {
      const std::string name = text(extension);
      if (name == "KHR_draco_mesh_compression" || name == "EXT_meshopt_compression")
        return unsupported("compressed by " + name + ", which is not read; write the file without mesh compression");
    }
    return {};
  }

  base::Result<Accessor> accessor(std::uint64_t index, const std::string& place) const {
    const std::string here = place + ": accessor " + std::to_string(index);
    const json& source = item(member(document_, "accessors"), index);
    if (!source.is_object()) return invalidInput(here + " is not there");
    if (source.contains("sparse")) return unsupported(here + " is sparse, which is not read; write dense accessors");

    Accessor result;
    result.count = integer(member(source, "count"), 0);
    result.component_type = integer(member(source, "componentType"), 0);
    result.components = componentsOf(text(member(source, "type")));
    result.normalized = member(source, "normalized") == json(true);
    const std::size_t element = componentBytes(result.component_type) * result.components;
    if (element == 0) return invalidInput(here + " has an unknown type");
    if (result.count == 0) return invalidInput(here + " has no elements");

    // An accessor points into a buffer view, and that into the BIN chunk.
    const json& view = item(member(document_, "bufferViews"), integer(member(source, "bufferView"), kMissing));
    if (!view.is_object()) return invalidInput(here + " has no buffer view");
    const std::uint64_t buffer = integer(member(view, "buffer"), kMissing);
    if (buffer != 0 || item(member(document_, "buffers"), 0).contains("uri"))
      return unsupported(here + " lies outside the file; write one GLB with everything inside");
    const std::uint64_t view_offset = integer(member(view, "byteOffset"), 0);
    const std::uint64_t view_length = integer(member(view, "byteLength"), 0);
    const std::uint64_t offset = integer(member(source, "byteOffset"), 0);
    result.stride = integer(member(view, "byteStride"), element);
    const bool view_fits = view_offset <= binary_.size() && view_length <= binary_.size() - view_offset;
    if (!view_fits || result.stride < element || result.stride > 252 + element || offset > view_length ||
        view_length - offset < element || (view_length - offset - element) / result.stride < result.count - 1)
      return invalidInput(here + " reaches past its buffer (truncated?)");
    result.data = binary_.data() + view_offset + offset;
    return result;
  }

  // Nothing where the primitive has no such attribute.
  base::Result<std::optional<Accessor>> attribute(const json& primitive, const char* name, const std::string& place,
                                                  std::size_t min_components, std::size_t max_components,
                                                  std::uint64_t count) const {
    const json& index = member(member(primitive, "attributes"), name);
    if (index.is_null()) return std::optional<Accessor>();
    LUMIGRID_ASSIGN_OR_RETURN(const auto found, accessor(integer(index, kMissing), place + ": " + name));
    if (found.components < min_components || found.components > max_components || found.count != count)
      return invalidInput(place + ": " + name + " does not go with POSITION");
    return std::optional(found);
  }

  base::Result<void> readScene() {
    const json& nodes = member(document_, "nodes");
    const std::size_t node_count = nodes.is_array() ? nodes.size() : 0;

    // Where there are no nodes the meshes stand as they are.
    if (node_count == 0) {
      const json& meshes = member(document_, "meshes");
      for (std::size_t m = 0; meshes.is_array() && m < meshes.size(); ++m) LUMIGRID_TRY(readMesh(m, glm::dmat4(1.0)));
      return {};
    }

    // The walk is depth first. A node has one parent (section 3.5.2), so a file in which it is met twice is broken.
    std::vector<std::pair<std::uint64_t, glm::dmat4>> stack;
    std::vector<bool> seen(node_count, false);
    for (const std::uint64_t root : rootNodes(document_)) stack.emplace_back(root, glm::dmat4(1.0));
    std::reverse(stack.begin(), stack.end());
    while (!stack.empty()) {
      const auto [index, scene_from_parent] = stack.back();
      stack.pop_back();
      if (index >= node_count) return invalidInput("a scene or node names a node that is not there");
      if (seen[index]) return invalidInput("node " + std::to_string(index) + " has two parents or is its own child");
      seen[index] = true;
      const json& node = nodes[index];
      const glm::dmat4 scene_from_node = scene_from_parent * nodeMatrix(node);
      if (!member(node, "mesh").is_null())
        LUMIGRID_TRY(readMesh(integer(member(node, "mesh"), kMissing), scene_from_node));
      const json& children = member(node, "children");
      for (std::size_t c = children.is_array() ? children.size() : 0; c-- > 0;)
        stack.emplace_back(integer(children[c], kMissing), scene_from_node);
    }
    return {};
  }

  base::Result<void> readMesh(std::uint64_t index, const glm::dmat4& scene_from_mesh) {
    const std::string place = "mesh " + std::to_string(index);
    const json& primitives = member(item(member(document_, "meshes"), index), "primitives");
    if (!primitives.is_array()) return invalidInput(place + " is not there or has no primitives");
    for (std::size_t p = 0; p < primitives.size(); ++p)
      LUMIGRID_TRY(readPrimitive(primitives[p], place + " primitive " + std::to_string(p), scene_from_mesh));
    return {};
  }

  base::Result<void> readPrimitive(const json& primitive, const std::string& place, const glm::dmat4& scene_from_mesh) {
    const std::uint64_t mode = integer(member(primitive, "mode"), 4);
    if (mode < 4 || mode > 6) {
      ++skipped_primitives_;
      return {};
    }
    if (member(primitive, "extensions").contains("KHR_draco_mesh_compression") &&
        !item(member(document_, "accessors"), integer(member(member(primitive, "attributes"), "POSITION"), kMissing))
             .contains("bufferView"))
      return unsupported(place +
                         ": compressed by KHR_draco_mesh_compression, which is not read; write the file without");
    const std::uint64_t first = out_.vertexCount();
    LUMIGRID_TRY(readVertices(primitive, place, scene_from_mesh));
    return readTriangles(primitive, place, first, glm::determinant(glm::dmat3(scene_from_mesh)) < 0.0);
  }

  base::Result<void> readVertices(const json& primitive, const std::string& place, const glm::dmat4& scene_from_mesh) {
    const json& points = member(member(primitive, "attributes"), "POSITION");
    LUMIGRID_ASSIGN_OR_RETURN(const auto position, accessor(integer(points, kMissing), place + ": POSITION"));
    if (position.components != 3) return invalidInput(place + ": POSITION is not VEC3");
    const std::uint64_t total = out_.vertexCount() + position.count;
    if (total > std::max(file_bytes_, kMaxInstancedVertices))
      return unsupported(place + ": instances make " + std::to_string(total) + " vertices; write them as one mesh");

    LUMIGRID_ASSIGN_OR_RETURN(const auto normal, attribute(primitive, "NORMAL", place, 3, 3, position.count));
    const auto factor =
        numbers<glm::dvec4>(member(baseMaterial(primitive), "baseColorFactor")).value_or(glm::dvec4(1.0));
    LUMIGRID_ASSIGN_OR_RETURN(const auto color, attribute(primitive, "COLOR_0", place, 3, 4, position.count));
    const bool colored = color || glm::dvec3(factor) != glm::dvec3(1.0);

    // Normals are transformed by the inverse transpose. The cofactor matrix equals it up to scale, and exists for
    // singular matrices too.
    const glm::dmat3 m(scene_from_mesh);
    const glm::dmat3 cofactor(glm::cross(m[1], m[2]), glm::cross(m[2], m[0]), glm::cross(m[0], m[1]));
    const double side = glm::determinant(m) < 0.0 ? -1.0 : 1.0;
    const auto encode = [](double linear) { return byteFromUnit(srgbFromLinear(std::min(linear, 1.0))); };
    for (std::uint64_t i = 0; i < position.count; ++i) {
      // Primitives have different attributes, so each begins a block of its own.
      out_.positions.emplace_back(glm::dvec3(scene_from_mesh * glm::dvec4(position.vector(i), 1.0)));
      if (normal) out_.normals.emplace_back(side * (cofactor * normal->vector(i)));
      if (colored) {
        const glm::dvec3 c = color ? color->vector(i) : glm::dvec3(1.0);
        out_.colors.push_back({encode(factor.r * c.r), encode(factor.g * c.g), encode(factor.b * c.b), 255});
      }
      LUMIGRID_TRY(out_.flushFullBlocks(file_));
    }
    return out_.flush(file_);
  }

  base::Result<void> readTriangles(const json& primitive, const std::string& place, std::uint64_t first, bool flip) {
    const std::uint64_t vertex_count = out_.vertexCount() - first;
    std::optional<Accessor> indices;
    if (!member(primitive, "indices").is_null()) {
      LUMIGRID_ASSIGN_OR_RETURN(auto found,
                                accessor(integer(member(primitive, "indices"), kMissing), place + ": indices"));
      const std::uint64_t type = found.component_type;
      if (found.components != 1 || (type != kUnsignedByte && type != kUnsignedShort && type != kUnsignedInt))
        return invalidInput(place + ": indices are not unsigned integers");
      indices = found;
      for (std::uint64_t i = 0; i < indices->count; ++i)
        if (indices->index(i) >= vertex_count) return indexOutOfRange(place, indices->index(i), vertex_count);
    }
    const std::uint64_t count = indices ? indices->count : vertex_count;
    const auto corner = [&](std::uint64_t i) { return indices ? std::uint64_t{indices->index(i)} : i; };

    // Textured primitives take their texture's colours; the base colour factor is not applied to them.
    std::uint32_t picture = basePicture(primitive);
    std::optional<Accessor> uv;
    if (picture != kNoPicture) {
      LUMIGRID_ASSIGN_OR_RETURN(uv, attribute(primitive, "TEXCOORD_0", place, 2, 2, vertex_count));
      if (!uv) picture = kNoPicture;
    }

    // Mode 4 is a list of triangles, 5 a strip, in which every other triangle is turned, and 6 a fan (section 3.7.2.1).
    const std::uint64_t mode = integer(member(primitive, "mode"), 4);
    const std::size_t step = mode == 4 ? 3 : 1;
    for (std::uint64_t i = 0; i + 3 <= count; i += step) {
      std::array<std::uint64_t, 3> t{corner(mode == 6 ? 0 : i), corner(i + 1), corner(i + 2)};
      if ((mode == 5 && (i & 1U) != 0) != flip) std::swap(t[1], t[2]);
      const bool stitch = mode == 5 && (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]);
      if (stitch) continue;
      const std::array<std::uint64_t, 3> corners{first + t[0], first + t[1], first + t[2]};
      std::array<glm::dvec2, 3> uv_of{};
      bool complete = picture != kNoPicture;
      for (std::size_t k = 0; k < 3 && complete; ++k) {
        uv_of[k] = {uv->value(t[k], 0), uv->value(t[k], 1)};
        complete = std::isfinite(uv_of[k].x) && std::isfinite(uv_of[k].y);
      }
      if (complete)
        out_.addTextured(corners, {}, uv_of, picture);
      else
        out_.addPolygon(corners);
      LUMIGRID_TRY(out_.flushFullBlocks(file_));
    }
    if (out_.triangleCount() > std::max(file_bytes_, 4 * kMaxInstancedVertices))
      return unsupported(place + ": instances make too many triangles; write them as one mesh");
    return {};
  }

  const json& baseMaterial(const json& primitive) const {
    const json& material = item(member(document_, "materials"), integer(member(primitive, "material"), kMissing));
    return member(material, "pbrMetallicRoughness");
  }

  // Returns the picture of a primitive's base colour; kNoPicture where there is none, or where it cannot be read.
  std::uint32_t basePicture(const json& primitive) {
    const json& reference = member(baseMaterial(primitive), "baseColorTexture");
    if (!reference.is_object()) return kNoPicture;
    const json& texture = item(member(document_, "textures"), integer(member(reference, "index"), kMissing));
    const json& image = item(member(document_, "images"), integer(member(texture, "source"), kMissing));
    if (const std::string uri = text(member(image, "uri")); !uri.empty() && uri.rfind("data:", 0) != 0)
      return out_.textures.find({out_.textures.pathOf(uri), 0, 0}, out_.summary.warnings);
    const json& view = item(member(document_, "bufferViews"), integer(member(image, "bufferView"), kMissing));
    const std::uint64_t offset = integer(member(view, "byteOffset"), 0);
    const std::uint64_t length = integer(member(view, "byteLength"), 0);
    if (length > 0 && offset <= binary_.size() && length <= binary_.size() - offset) {
      const auto begin = static_cast<std::uint64_t>(binary_.data() - file_) + offset;
      return out_.textures.find({out_.textures.path(), begin, length}, out_.summary.warnings);
    }
    if (!warned_of_picture_)
      out_.summary.warnings.push_back("a texture cannot be read, vertex colours stay: it is not in the file");
    warned_of_picture_ = true;
    return kNoPicture;
  }

  json document_;
  base::ByteView binary_;
  std::uint64_t file_bytes_ = 0;
  MeshStream& out_;
  const std::uint8_t* file_ = nullptr;  // accessors point anywhere into it, so no page is released
  std::uint64_t skipped_primitives_ = 0;
  bool warned_of_picture_ = false;
};

}  // namespace

base::Result<void> readGlb(base::ByteView bytes, MeshStream& out) {
  return GlbReader(out).read(bytes);
}

}  // namespace mesh
