#include "mesh/gltf/reader.h"

#include <array>
#include <cmath>
#include <optional>

#include "mesh/gltf/draco_mesh.h"
#include "mesh/gltf/gpu_instances.h"
#include "mesh/gltf/instances.h"
#include "mesh/gltf/material.h"

namespace mesh::gltf {
namespace {

// ---- Scene graph (section 3.5) ----

glm::dmat4 nodeMatrix(const json& node) {
  if (const auto whole = numbers<glm::dmat4>(member(node, "matrix"))) return *whole;  // column-major, as glm's
  const auto translation = numbers<glm::dvec3>(member(node, "translation")).value_or(glm::dvec3(0.0));
  const auto scale = numbers<glm::dvec3>(member(node, "scale")).value_or(glm::dvec3(1.0));
  const auto rotation = numbers<glm::dvec4>(member(node, "rotation")).value_or(glm::dvec4(0.0, 0.0, 0.0, 1.0));
  return matrixOf(translation, rotation, scale);
}

// ---- Extensions ----

constexpr const char* kKnownExtensions[] = {
    "KHR_mesh_quantization",   "KHR_texture_transform",   "KHR_draco_mesh_compression", "EXT_meshopt_compression",
    "KHR_meshopt_compression", "EXT_mesh_gpu_instancing", "EXT_texture_webp",           "CESIUM_RTC"};

bool isKnown(const std::string& extension) {
  // Materials differ by how they shine, which is not shown.
  if (extension.rfind("KHR_materials_", 0) == 0) return true;
  return std::find(std::begin(kKnownExtensions), std::end(kKnownExtensions), extension) != std::end(kKnownExtensions);
}

base::Result<void> checkExtensions(const json& document, Omissions& omissions) {
  const json& required = member(document, "extensionsRequired");
  for (std::size_t i = 0; i < itemsOf(required); ++i) {
    const std::string name = text(required[i]);
    if (name == "KHR_texture_basisu")
      return unsupported(
          "its textures are KTX2 (KHR_texture_basisu), which is not read; write them as JPEG, PNG or WebP");
    if (!isKnown(name)) omissions.unknown_extensions.insert(name);
  }
  return {};
}

// ---- Primitives (section 3.7.2) ----

/// A primitive's numbers, wherever they come from.
struct Primitive {
  std::uint64_t mode = 4;
  Accessor position;
  std::optional<Accessor> normal, color, uv, indices;
  BaseColor base;
};

/// The places where a primitive's attributes may come from.
struct AttributeSource {
  const json& primitive;
  const json& compression;  // of the primitive; may be null
  const DracoMesh* draco;   // null where there is none
  const std::string& place;
};

class SceneReader {
 public:
  SceneReader(Document& document, const ShareOfSource& share, Omissions& omissions, MeshStream& out)
      : document_(document), share_(share), omissions_(omissions), out_(out), materials_(document, omissions, out) {}

  base::Result<void> read(const glm::dmat4& out_from_document) {
    LUMIGRID_TRY(checkExtensions(document_.root(), omissions_));
    LUMIGRID_ASSIGN_OR_RETURN(const auto shown, shownNodes(document_));
    // The claims alone tell of most files that show too much, before minutes have been spent on them.
    LUMIGRID_TRY(checkTimesShown(claimedBy(shown), amounts_.distinct));
    LUMIGRID_TRY(readNodes(shown, out_from_document));
    omissions_.triangles += out_.triangleCount() - first_triangle_;
    omissions_.triangles_in_meshes += static_cast<std::uint64_t>(held().triangles);
    return {};
  }

 private:
  std::uint64_t meshOf(const ShownNode& node) const {
    return integer(member(document_.list("nodes")[node.index], "mesh"), kMissing);
  }

  Amount claimedBy(const std::vector<ShownNode>& shown) const {
    Amount claimed;
    for (const ShownNode& node : shown) {
      const std::uint64_t mesh = meshOf(node);
      if (mesh >= amounts_.meshes.size()) continue;
      const double instances = GpuInstances::claimedBy(document_, document_.list("nodes")[node.index]);
      claimed.triangles += instances * amounts_.meshes[mesh].triangles;
      claimed.vertices += instances * amounts_.meshes[mesh].vertices;
    }
    return claimed;
  }

  /// The geometry that the document can hold: a triangle or vertex takes a byte at least, but in codecs' best cases.
  Amount held() const {
    const auto bytes = static_cast<double>(document_.bytes());
    return {std::min(amounts_.distinct.triangles, bytes), std::min(amounts_.distinct.vertices, bytes)};
  }

  base::Result<void> readNodes(const std::vector<ShownNode>& shown, const glm::dmat4& out_from_document) {
    const json& nodes = document_.list("nodes");
    // Where there are no nodes the meshes stand as they are.
    if (itemsOf(nodes) == 0) {
      for (std::size_t m = 0; m < itemsOf(document_.list("meshes")); ++m)
        LUMIGRID_TRY(readMesh(m, {}, out_from_document));
      return {};
    }
    std::vector<glm::dmat4> out_from_nodes;
    out_from_nodes.reserve(shown.size());
    for (const ShownNode& one : shown) {
      const json& node = nodes[one.index];
      const glm::dmat4& out_from_parent = one.parent == kMissing ? out_from_document : out_from_nodes[one.parent];
      out_from_nodes.push_back(out_from_parent * nodeMatrix(node));
      if (member(node, "mesh").is_null()) continue;
      const std::string place = "node " + std::to_string(one.index);
      LUMIGRID_ASSIGN_OR_RETURN(const auto instances, GpuInstances::of(document_, node, place));
      LUMIGRID_TRY(readMesh(meshOf(one), instances, out_from_nodes.back()));
    }
    return {};
  }

  base::Result<void> readMesh(std::uint64_t index, const GpuInstances& instances, const glm::dmat4& out_from_node) {
    const std::string place = "mesh " + std::to_string(index);
    const json& primitives = member(item(document_.list("meshes"), index), "primitives");
    if (!primitives.is_array()) return invalidInput(place + " is not there or has no primitives");
    for (std::size_t p = 0; p < primitives.size(); ++p)
      LUMIGRID_TRY(readPrimitive(primitives[p], place + " primitive " + std::to_string(p), instances, out_from_node));
    return {};
  }

  base::Result<void> readPrimitive(const json& source, const std::string& place, const GpuInstances& instances,
                                   const glm::dmat4& out_from_node) {
    const std::uint64_t mode = integer(member(source, "mode"), 4);
    if (mode < 4 || mode > 6) {
      const bool is_points = mode == kPoints;
      if (!is_points || !out_.reads_points) {
        ++(is_points ? omissions_.point_primitives : omissions_.line_primitives);
        return {};
      }
    } else if (out_.reads_points) {
      return {};
    }
    LUMIGRID_ASSIGN_OR_RETURN(const auto primitive, findNumbers(source, place));
    // Without vertices there is nothing to show, however often.
    for (std::uint64_t i = 0; i < instances.count() && primitive.position.count > 0; ++i) {
      const glm::dmat4 out_from_mesh = out_from_node * instances.nodeFromMesh(i);
      const std::uint64_t first = out_.vertexCount();
      LUMIGRID_TRY(readVertices(primitive, place, out_from_mesh));
      if (mode != kPoints)
        LUMIGRID_TRY(readTriangles(primitive, place, first, glm::determinant(glm::dmat3(out_from_mesh)) < 0.0));
    }
    corners_read_ += static_cast<double>(primitive.indices ? primitive.indices->count : primitive.position.count);
    return report();
  }

  base::Result<Primitive> findNumbers(const json& source, const std::string& place) {
    Primitive p;
    p.mode = integer(member(source, "mode"), 4);
    const json& compression = extension(source, "KHR_draco_mesh_compression");
    std::optional<DracoMesh> draco;
    if (compression.is_object()) {
      LUMIGRID_ASSIGN_OR_RETURN(const auto view,
                                document_.view(integer(member(compression, "bufferView"), kMissing), place));
      LUMIGRID_ASSIGN_OR_RETURN(draco, DracoMesh::decode(view.bytes, place));
    }
    const AttributeSource attributes{source, compression, draco ? &*draco : nullptr, place};
    LUMIGRID_ASSIGN_OR_RETURN(const auto position, attribute(attributes, "POSITION", 3, 3));
    if (!position) return invalidInput(place + ": POSITION is missing");
    p.position = *position;
    LUMIGRID_ASSIGN_OR_RETURN(p.normal, attribute(attributes, "NORMAL", 3, 3));
    LUMIGRID_ASSIGN_OR_RETURN(p.color, attribute(attributes, "COLOR_0", 3, 4));
    p.base = materials_.of(source);
    if (p.base.texture) {
      LUMIGRID_ASSIGN_OR_RETURN(p.uv, attribute(attributes, p.base.coordinates, 2, 2));
    }
    for (const auto* other : {&p.normal, &p.color, &p.uv})
      if (*other && (*other)->count != p.position.count)
        return invalidInput(place + ": its attributes have different numbers of elements");
    if (draco) {
      // Strips, too, are decoded to a list of triangles.
      p.mode = 4;
      p.indices = draco->indices();
      return p;
    }
    if (!member(source, "indices").is_null()) {
      LUMIGRID_ASSIGN_OR_RETURN(p.indices,
                                document_.accessor(integer(member(source, "indices"), kMissing), place + ": indices"));
      if (!p.indices->isIndex()) return invalidInput(place + ": indices are not unsigned integers");
    }
    return p;
  }

  // Nothing where the primitive has no such attribute.
  base::Result<std::optional<Accessor>> attribute(const AttributeSource& from, const std::string& name,
                                                  std::size_t min_components, std::size_t max_components) {
    const std::string here = from.place + ": " + name;
    const json& index = member(member(from.primitive, "attributes"), name.c_str());
    if (index.is_null()) return std::optional<Accessor>();
    const json& compressed = member(member(from.compression, "attributes"), name.c_str());
    Accessor found;
    if (from.draco != nullptr && !compressed.is_null()) {
      LUMIGRID_ASSIGN_OR_RETURN(found, from.draco->attribute(integer(compressed, kMissing), here));
      const json& accessor = item(document_.list("accessors"), integer(index, kMissing));
      found.normalized = member(accessor, "normalized") == json(true);
    } else {
      LUMIGRID_ASSIGN_OR_RETURN(found, document_.accessor(integer(index, kMissing), here));
    }
    if (found.components < min_components || found.components > max_components)
      return invalidInput(here + " has " + std::to_string(found.components) + " components");
    return std::optional(found);
  }

  base::Result<void> readVertices(const Primitive& p, const std::string& place, const glm::dmat4& out_from_mesh) {
    LUMIGRID_TRY(checkSoFar(p, place));
    const bool colored = p.color || glm::dvec3(p.base.factor) != glm::dvec3(1.0);

    // A block's vertices have the same attributes.
    const bool differs = out_.normals.empty() == p.normal.has_value() || out_.colors.empty() == colored;
    if (differs && !out_.positions.empty()) LUMIGRID_TRY(out_.handOver());

    // Normals are transformed by the inverse transpose. The cofactor matrix equals it up to scale, and exists for
    // singular matrices too.
    const glm::dmat3 m(out_from_mesh);
    const glm::dmat3 cofactor(glm::cross(m[1], m[2]), glm::cross(m[2], m[0]), glm::cross(m[0], m[1]));
    const double side = glm::determinant(m) < 0.0 ? -1.0 : 1.0;
    const glm::dvec4& factor = p.base.factor;
    const auto encode = [](double linear) { return byteFromUnit(srgbFromLinear(std::min(linear, 1.0))); };
    // Indices choose points, as they choose corners; a vertex of triangles stays where it is.
    const bool chosen = p.mode == kPoints && p.indices;
    for (std::uint64_t n = 0; n < (chosen ? p.indices->count : p.position.count); ++n) {
      const std::uint64_t i = chosen ? p.indices->index(n) : n;
      if (i >= p.position.count) return indexOutOfRange(place, static_cast<std::int64_t>(i), p.position.count);
      out_.positions.emplace_back(glm::dvec3(out_from_mesh * glm::dvec4(p.position.vector(i), 1.0)));
      if (p.normal) out_.normals.emplace_back(side * (cofactor * p.normal->vector(i)));
      if (colored) {
        const glm::dvec3 c = p.color ? p.color->vector(i) : glm::dvec3(1.0);
        out_.colors.push_back({encode(factor.r * c.r), encode(factor.g * c.g), encode(factor.b * c.b), 255});
      }
      LUMIGRID_TRY(flushFullBlocks());
    }
    return {};
  }

  base::Result<void> readTriangles(const Primitive& p, const std::string& place, std::uint64_t first, bool flip) {
    const std::uint64_t vertex_count = p.position.count;
    picture_.reset();
    // A texture that cannot be read is told, also where no triangle has a place in it.
    if (p.base.texture && !p.uv) picture_ = materials_.pictureOf(p.base, {});
    if (p.indices)
      for (std::uint64_t i = 0; i < p.indices->count; ++i)
        if (p.indices->index(i) >= vertex_count) return indexOutOfRange(place, p.indices->index(i), vertex_count);
    const std::uint64_t count = p.indices ? p.indices->count : vertex_count;
    const auto corner = [&](std::uint64_t i) { return p.indices ? std::uint64_t{p.indices->index(i)} : i; };

    // Mode 4 is a list of triangles, 5 a strip, in which every other triangle is turned, and 6 a fan (section 3.7.2.1).
    const std::size_t step = p.mode == 4 ? 3 : 1;
    for (std::uint64_t i = 0; i + 3 <= count; i += step) {
      std::array<std::uint64_t, 3> t{corner(p.mode == 6 ? 0 : i), corner(i + 1), corner(i + 2)};
      if ((p.mode == 5 && (i & 1U) != 0) != flip) std::swap(t[1], t[2]);
      const bool stitch = p.mode == 5 && (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]);
      if (!stitch) addTriangle(p, first, t);
      LUMIGRID_TRY(flushFullBlocks());
    }
    return {};
  }

  // Numbers may turn out larger than the document claimed: Draco's are told by its bytes alone.
  base::Result<void> checkSoFar(const Primitive& next, const std::string& place) const {
    const std::uint64_t corners = next.indices ? next.indices->count : next.position.count;
    const Amount shown{static_cast<double>(out_.triangleCount() - first_triangle_) +
                           trianglesOf(next.mode, static_cast<double>(corners)),
                       static_cast<double>(out_.vertexCount() - first_vertex_) +
                           static_cast<double>(next.mode == kPoints ? corners : next.position.count)};
    const auto checked = checkTimesShown(shown, held());
    return checked ? checked : base::within(place, checked.error());
  }

  // Textured primitives take their texture's colours; the base colour factor is not applied to them.
  void addTriangle(const Primitive& p, std::uint64_t first, const std::array<std::uint64_t, 3>& t) {
    const std::array<std::uint64_t, 3> corners{first + t[0], first + t[1], first + t[2]};
    std::array<glm::dvec2, 3> uv{};
    bool complete = p.uv.has_value();
    for (std::size_t k = 0; k < 3 && complete; ++k) {
      uv[k] = p.base.picture_from_vertex * glm::dvec2(p.uv->value(t[k], 0), p.uv->value(t[k], 1)) + p.base.offset;
      complete = std::isfinite(uv[k].x) && std::isfinite(uv[k].y);
    }
    if (complete && !picture_) picture_ = materials_.pictureOf(p.base, uv);
    if (complete && *picture_ != kNoPicture)
      out_.addTextured(corners, {}, uv, *picture_);
    else
      out_.addPolygon(corners);
  }

  // Accessors point anywhere into several files, so no page is released.
  base::Result<void> flushFullBlocks() {
    if (!out_.isFull()) return {};
    LUMIGRID_TRY(out_.handOver());
    return report();
  }
  base::Result<void> report() {
    const double done = amounts_.corners > 0.0 ? std::min(1.0, corners_read_ / amounts_.corners) : 1.0;
    return out_.report(share_.begin + done * (share_.end - share_.begin));
  }

  Document& document_;
  const ShareOfSource share_;
  Omissions& omissions_;
  MeshStream& out_;
  Materials materials_;
  std::optional<std::uint32_t> picture_;  // of the primitive at hand, once a triangle has shown it
  const std::uint64_t first_vertex_ = out_.vertexCount();
  const std::uint64_t first_triangle_ = out_.triangleCount();
  const MeshAmounts amounts_ =
      measureMeshes(document_, out_.reads_points);  // progress and a warning of instances are measured by it
  double corners_read_ = 0.0;
};

}  // namespace

void Omissions::describe(std::vector<std::string>& warnings) const {
  if (const std::uint64_t left_out = point_primitives + line_primitives; left_out > 0)
    warnings.push_back(std::to_string(left_out) + " primitives of points or lines are left out");
  if (unread_textures == 1) warnings.push_back("a texture cannot be read, vertex colours stay: " + first_unread);
  if (unread_textures > 1)
    warnings.push_back(std::to_string(unread_textures) +
                       " textures cannot be read, vertex colours stay; of the first: " + first_unread);
  for (const std::string& name : unknown_extensions)
    warnings.push_back("it requires the extension " + inQuotes(name) +
                       ", which is not known, so that the model may look otherwise");
  // A choice: files that repeat one tree or chair a few times are as their authors expect them.
  constexpr std::uint64_t kManyTriangles = 1000000, kManyTimes = 4;
  if (triangles > kManyTriangles && triangles / kManyTimes > triangles_in_meshes)
    warnings.push_back("its nodes show meshes many times: " + std::to_string(triangles_in_meshes) +
                       " triangles in the file become " + std::to_string(triangles));
}

base::Result<void> readScene(Document& document, const glm::dmat4& out_from_document, const ShareOfSource& share,
                             Omissions& omissions, MeshStream& out) {
  return SceneReader(document, share, omissions, out).read(out_from_document);
}

}  // namespace mesh::gltf
