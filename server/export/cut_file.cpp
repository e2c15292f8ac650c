#include "server/export/cut_file.h"

#include <algorithm>
#include <unordered_map>

#include "base/file.h"

namespace server::exports {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;
using lod::patch::Cut;
using lod::patch::PatchGeometry;

// Bytes are handed to the file in pieces of about this many.
constexpr std::size_t kPieceBytes = 1 << 20;
// Programs read the indices of PLY's faces as signed integers, too.
constexpr std::uint64_t kMaxPlyVertices = std::uint64_t{1} << 31;

struct PlaceHash {
  std::size_t operator()(const glm::ivec3& q) const {
    // Large factors spread neighbours (Teschner et al. 2003, "Optimized Spatial Hashing", section 4).
    const glm::uvec3 u(q);
    return (std::size_t{u.x} * 73856093U) ^ (std::size_t{u.y} * 19349663U) ^ (std::size_t{u.z} * 83492791U);
  }
};

/// Numbers the vertices of a cut: those along the borders of patches by their place, all others in turn.
class VertexNumbers {
 public:
  /// The number of each vertex. `next` is the first one not given yet, and grows with each new vertex. The second time
  /// the patches are gone through, `next` begins at 0 again, and all is the same.
  std::vector<std::uint32_t> numbersOf(const PatchGeometry& geometry, std::uint32_t& next) {
    const std::vector<bool> border = borderOf(geometry);
    std::vector<std::uint32_t> numbers(geometry.positions.size());
    for (std::size_t v = 0; v < numbers.size(); ++v) {
      numbers[v] = border[v] ? shared_.try_emplace(geometry.positions[v], next).first->second : next;
      if (numbers[v] == next) ++next;
    }
    return numbers;
  }

 private:
  // Vertices of edges that one triangle of the patch has alone.
  static std::vector<bool> borderOf(const PatchGeometry& geometry) {
    std::vector<std::uint32_t> edges;
    edges.reserve(geometry.indices.size());
    for (std::size_t i = 0; i < geometry.indices.size(); ++i) {
      const std::uint32_t a = geometry.indices[i], b = geometry.indices[i % 3 == 2 ? i - 2 : i + 1];
      edges.push_back(std::min(a, b) << 16U | std::max(a, b));
    }
    std::sort(edges.begin(), edges.end());
    std::vector<bool> border(geometry.positions.size(), false);
    for (std::size_t i = 0; i < edges.size();) {
      std::size_t end = i + 1;
      while (end < edges.size() && edges[end] == edges[i]) ++end;
      if (end == i + 1) border[edges[i] >> 16U] = border[edges[i] & 0xFFFFU] = true;
      i = end;
    }
    return border;
  }

  std::unordered_map<glm::ivec3, std::uint32_t, PlaceHash> shared_;
};

class PlyWriter {
 public:
  PlyWriter(const ExportScene& scene, const Cut& cut, const CutProgress& progress)
      : scene_(scene), cut_(cut), progress_(progress) {}

  Result<CutFileReport> write(const std::string& path) {
    LUMIGRID_ASSIGN_OR_RETURN(auto file, base::AtomicFile::create(path));
    // The number of vertices is known when they are written; the header's length does not depend on it.
    LUMIGRID_TRY(file.write(base::viewOfText(header(0))));
    LUMIGRID_TRY(forEachPatch(file, path, 0.0, [&](const PatchGeometry& geometry) { addVertices(geometry); }));
    const std::uint32_t vertices = next_;
    next_ = 0;
    LUMIGRID_TRY(forEachPatch(file, path, 0.5, [&](const PatchGeometry& geometry) { addFaces(geometry); }));
    LUMIGRID_TRY(file.writeAt(0, base::viewOfText(header(vertices))));
    const CutFileReport report{vertices, cut_.triangles, file.size()};
    LUMIGRID_TRY(file.commit());
    return report;
  }

 private:
  bool hasColors() const { return scene_.hierarchy().has_colors; }

  std::string header(std::uint64_t vertices) const {
    const std::string count = std::to_string(vertices);
    std::string text = "ply\nformat binary_little_endian 1.0\ncomment written by lumigrid " +
                       std::string(20 - count.size(), '.') + "\n";
    const base::Scene& scene = scene_.scene;
    if (!scene.crs.empty()) text += "comment crs " + scene.crs + "\n";
    if (!scene.attribution.empty()) text += "comment attribution " + scene.attribution + "\n";
    text += "element vertex " + count + "\nproperty double x\nproperty double y\nproperty double z\n";
    if (!scene_.unlit()) text += "property float nx\nproperty float ny\nproperty float nz\n";
    if (hasColors()) text += "property uchar red\nproperty uchar green\nproperty uchar blue\n";
    return text + "element face " + std::to_string(cut_.triangles) +
           "\nproperty list uchar uint vertex_indices\nend_header\n";
  }

  Result<void> forEachPatch(base::AtomicFile& file, const std::string& path, double done_before,
                            const std::function<void(const PatchGeometry&)>& add) {
    const auto count = static_cast<double>(cut_.patches.size());
    for (std::size_t i = 0; i < cut_.patches.size(); ++i) {
      if (progress_ && !progress_(done_before + 0.5 * static_cast<double>(i) / count))
        return Error{ErrorCode::kCancelled, path + ": stopped; nothing is written"};
      LUMIGRID_ASSIGN_OR_RETURN(const auto geometry, scene_.patches.geometry(cut_.patches[i]));
      if (next_ + geometry.positions.size() > kMaxPlyVertices)
        return Error{ErrorCode::kUnsupported, path +
                                                  ": has more vertices than readers of PLY can number; say "
                                                  "--triangles"};
      add(geometry);
      if (piece_.size() >= kPieceBytes) LUMIGRID_TRY(flush(file));
    }
    return flush(file);
  }

  Result<void> flush(base::AtomicFile& file) {
    LUMIGRID_TRY(file.write(piece_.view()));
    piece_ = {};
    return {};
  }

  void addVertices(const PatchGeometry& geometry) {
    const lod::Lattice& lattice = scene_.hierarchy().lattice;
    const glm::dvec3 origin = scene_.scene.origin + lattice.origin;
    std::uint32_t expected = next_;
    const std::vector<std::uint32_t> numbers = numbers_.numbersOf(geometry, next_);
    for (std::size_t v = 0; v < numbers.size(); ++v) {
      if (numbers[v] != expected) continue;
      ++expected;
      piece_.write(origin + lattice.step * glm::dvec3(geometry.positions[v]));
      if (!scene_.unlit()) piece_.write(geometry.normals[v]);
      if (hasColors()) piece_.write(glm::u8vec3(geometry.colors[v]));
    }
  }

  void addFaces(const PatchGeometry& geometry) {
    const std::vector<std::uint32_t> numbers = numbers_.numbersOf(geometry, next_);
    for (std::size_t i = 0; i < geometry.indices.size(); ++i) {
      if (i % 3 == 0) piece_.u8(3);
      piece_.u32(numbers[geometry.indices[i]]);
    }
  }

  const ExportScene& scene_;
  const Cut& cut_;
  const CutProgress& progress_;
  VertexNumbers numbers_;
  std::uint32_t next_ = 0;
  base::ByteWriter piece_;
};

// The shortest turn that takes `up` to +y (Möller and Hughes 1999, "Efficiently Building a Matrix to Rotate One Vector
// to Another"). Exact where `up` is an axis.
glm::dmat3 turnToY(const glm::dvec3& up) {
  const glm::dvec3 from = glm::normalize(up), y(0.0, 1.0, 0.0);
  const double c = glm::dot(from, y);
  if (c < -1.0 + 1e-12) return {{1.0, 0.0, 0.0}, {0.0, -1.0, 0.0}, {0.0, 0.0, -1.0}};
  const glm::dvec3 v = glm::cross(from, y);
  const glm::dmat3 cross({0.0, v.z, -v.y}, {-v.z, 0.0, v.x}, {v.y, -v.x, 0.0});
  return glm::dmat3(1.0) + cross + cross * cross / (1.0 + c);
}

glm::dmat4 gltfFromMesh(const ExportScene& scene, const glm::ivec3& origin) {
  const lod::Lattice& lattice = scene.hierarchy().lattice;
  const glm::dmat3 turn = metresPerUnit(scene.scene) * turnToY(scene.scene.up);
  glm::dmat4 matrix(turn);
  matrix[3] = glm::dvec4(turn * (lattice.origin + lattice.step * glm::dvec3(origin)), 1.0);
  return matrix;
}

}  // namespace

Result<ExportCut> selectCutForExport(const lod::patch::Hierarchy& hierarchy, std::uint64_t max_triangles) {
  // In a parallel view of one pixel per unit, projected errors are the errors themselves.
  lod::patch::CutRequest request;
  request.camera.height = 2;
  request.tolerance_px = 0.0F;
  request.max_triangles = max_triangles;
  request.cull = false;
  ExportCut chosen{lod::patch::selectCut(hierarchy, request)};
  if (chosen.cut.triangles > max_triangles)
    return Error{ErrorCode::kInvalidInput, "--triangles: the coarsest form of the scene has " +
                                               std::to_string(chosen.cut.triangles) + "; say that or more"};
  chosen.error = chosen.cut.error_px;
  return chosen;
}

Result<CutFileReport> writeCutAsPly(const ExportScene& scene, const Cut& cut, const std::string& path,
                                    const CutProgress& progress) {
  return PlyWriter(scene, cut, progress).write(path);
}

Result<CutFileReport> writeCutAsGlb(const ExportScene& scene, const Cut& cut, const std::string& path,
                                    const CutProgress& progress) {
  base::Aabb box;
  for (const std::uint32_t p : cut.patches) box.add(scene.hierarchy().patches[p].box);
  const glm::ivec3 origin = floatOriginNear(scene.hierarchy(), box.center());
  GlbWriter glb({scene.unlit(), scene.scene.attribution});
  CutFileReport report{0, cut.triangles, 0};
  const auto add = [&](GlbPrimitive&& primitive) -> Result<void> {
    glb.add(primitive);
    report.vertices += primitive.positions.size();
    if (glb.binaryBytes() <= kMaxGlbBytes) return {};
    return tooLarge(path);
  };
  const auto count = static_cast<double>(cut.patches.size());
  const auto go_on = [&](std::size_t i) { return !progress || progress(static_cast<double>(i) / count); };
  if (const auto added = addSurface(scene, cut.patches, origin, add, go_on); !added)
    return added.error().code == ErrorCode::kCancelled
               ? Error{ErrorCode::kCancelled, path + ": stopped; nothing is written"}
               : added.error();
  LUMIGRID_ASSIGN_OR_RETURN(report.bytes, glb.write(path, gltfFromMesh(scene, origin)));
  return report;
}

}  // namespace server::exports
