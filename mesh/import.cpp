#include "mesh/import.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <limits>

#include "base/parallel.h"
#include "mesh/mesh_stream.h"
#include "mesh/repair.h"
#include "mesh/stream_mesh.h"

namespace mesh {
namespace {

// Squares of coordinates must stay finite in float32.
constexpr double kMaxCoordinate = 1e18;

// ---- One file ----

/// Runs body(first, last) over [0, count) in blocks on all cores.
template <class Body>
void forBlocks(std::size_t count, const Body& body) {
  constexpr std::size_t kBlock = 1 << 16;
  base::parallelFor((count + kBlock - 1) / kBlock, 0,
                    [&](std::size_t block) { body(block * kBlock, std::min(count, (block + 1) * kBlock)); });
}

base::Result<void> checkPositions(const std::vector<glm::dvec3>& positions) {
  const auto good = [](const glm::dvec3& p) {
    return std::abs(p.x) <= kMaxCoordinate && std::abs(p.y) <= kMaxCoordinate && std::abs(p.z) <= kMaxCoordinate;
  };
  std::atomic<std::size_t> first_bad{positions.size()};
  forBlocks(positions.size(), [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (good(positions[i])) continue;
      std::size_t lowest = first_bad.load();
      while (i < lowest && !first_bad.compare_exchange_weak(lowest, i)) {
      }
      return;
    }
  });
  const std::size_t i = first_bad.load();
  if (i == positions.size()) return {};
  const glm::dvec3& p = positions[i];
  const bool finite = std::isfinite(p.x) && std::isfinite(p.y) && std::isfinite(p.z);
  return invalidInput("vertex " + std::to_string(i) + ": a coordinate is " +
                      (finite ? "larger than 1e18" : "not finite (NaN or infinite)") + "; mend or remove the vertex");
}

// Everything of a file in memory.
class SoupSink : public MeshSink {
 public:
  base::Result<void> vertices(const VertexBlock& block) override {
    if (soup.positions.size() + block.positions.size() > kMaxVertices)
      return tooManyVertices(soup.positions.size() + block.positions.size());
    const std::size_t first = soup.positions.size();
    soup.positions.insert(soup.positions.end(), block.positions.begin(), block.positions.end());
    if (!block.normals.empty()) {
      soup.normals.resize(first, glm::vec3(0.0F));
      soup.normals.insert(soup.normals.end(), block.normals.begin(), block.normals.end());
    }
    if (!block.colors.empty()) {
      soup.colors.resize(first, glm::u8vec4(255));
      soup.colors.insert(soup.colors.end(), block.colors.begin(), block.colors.end());
    }
    return {};
  }
  base::Result<void> triangles(const TriangleBlock& block) override {
    for (const std::uint64_t corner : block.corners) soup.indices.push_back(static_cast<std::uint32_t>(corner));
    // Ours are normals of vertices: corners that share a vertex add up. Vertices that come later get none.
    for (std::size_t i = 0; i < block.normals.size(); ++i) {
      if (block.corners[i] >= soup.positions.size()) continue;
      soup.normals.resize(soup.positions.size(), glm::vec3(0.0F));
      soup.normals[static_cast<std::size_t>(block.corners[i])] += block.normals[i];
    }
    // Colours of corners are averaged.
    for (std::size_t i = 0; i < block.colors.size(); ++i) {
      if (block.colors[i].a == 0 || block.corners[i] >= soup.positions.size()) continue;
      color_sums_.resize(soup.positions.size(), glm::uvec4(0));
      color_sums_[static_cast<std::size_t>(block.corners[i])] += glm::uvec4(glm::uvec3(block.colors[i]), 1);
    }
    return {};
  }
  void finish() {
    if (!soup.normals.empty()) soup.normals.resize(soup.positions.size(), glm::vec3(0.0F));
    if (!soup.colors.empty() || !color_sums_.empty()) soup.colors.resize(soup.positions.size(), glm::u8vec4(255));
    for (std::size_t v = 0; v < color_sums_.size(); ++v)
      if (const glm::uvec4& sum = color_sums_[v]; sum.a > 0)
        soup.colors[v] = glm::u8vec4(glm::u8vec3((glm::uvec3(sum) + sum.a / 2) / sum.a), 255);
  }
  base::Result<void> restart() override {
    soup = Soup{};
    color_sums_.clear();
    return {};
  }
  Soup soup;

 private:
  std::vector<glm::uvec4> color_sums_;  // and how many
};

base::Result<Soup> readMesh(const std::string& path, std::uint64_t& bytes) {
  SoupSink sink;
  LUMIGRID_ASSIGN_OR_RETURN(auto file, streamMesh(path, sink, {}));
  bytes = file.bytes;
  Soup& soup = sink.soup;
  sink.finish();
  soup.short_faces = file.short_faces;
  soup.warnings = std::move(file.warnings);
  if (auto finite = checkPositions(soup.positions); !finite) return base::within(path, finite.error());
  return std::move(soup);
}

// ---- All files ----

struct DoubleBox {
  glm::dvec3 min{std::numeric_limits<double>::max()};
  glm::dvec3 max{std::numeric_limits<double>::lowest()};
};

/// Centre of the box, rounded to a power of two of about an eighth of its longest side, so that the number is short and
/// the subtraction exact; 0 for models that lie around 0 anyway, whose float32 coordinates then stay as they are bit
/// for bit.
glm::dvec3 originFor(const DoubleBox& box) {
  const glm::dvec3 size = box.max - box.min;
  const double longest = std::max({size.x, size.y, size.z});
  const glm::dvec3 reach = glm::max(glm::abs(box.min), glm::abs(box.max));
  if (std::max({reach.x, reach.y, reach.z}) <= longest) return glm::dvec3(0.0);
  const double step = longest > 0.0 ? std::exp2(std::floor(std::log2(longest)) - 2.0) : 1.0;
  const glm::dvec3 center = 0.5 * (box.min + box.max);
  return {std::round(center.x / step) * step + 0.0, std::round(center.y / step) * step + 0.0,
          std::round(center.z / step) * step + 0.0};
}

DoubleBox boxOf(const std::vector<Soup>& soups) {
  // Unreferenced vertices may lie anywhere, so only corners count.
  DoubleBox box;
  for (const Soup& soup : soups)
    for (const std::uint32_t index : soup.indices) {
      box.min = glm::min(box.min, soup.positions[index]);
      box.max = glm::max(box.max, soup.positions[index]);
    }
  return box;
}

/// Appends one file's vertices and triangles, and frees them.
void append(Mesh& mesh, Soup& soup, bool normals, bool colors) {
  const std::size_t first = mesh.positions.size();
  const std::size_t count = soup.positions.size();
  mesh.positions.resize(first + count);
  forBlocks(count, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i)
      mesh.positions[first + i] = glm::vec3(soup.positions[i] - mesh.origin) + 0.0F;  // −0 becomes +0
  });
  if (normals) {
    soup.normals.resize(count, glm::vec3(0.0F));
    mesh.normals.insert(mesh.normals.end(), soup.normals.begin(), soup.normals.end());
  }
  if (colors) {
    soup.colors.resize(count, glm::u8vec4(255));
    mesh.colors.insert(mesh.colors.end(), soup.colors.begin(), soup.colors.end());
  }
  if (first == 0) {
    mesh.indices = std::move(soup.indices);
  } else {
    mesh.indices.reserve(mesh.indices.size() + soup.indices.size());
    for (const std::uint32_t index : soup.indices) mesh.indices.push_back(static_cast<std::uint32_t>(first + index));
  }
  soup = Soup{};
}

base::Result<void> checkTotals(const std::vector<Soup>& soups, const std::vector<std::string>& paths) {
  std::uint64_t vertices = 0;
  std::uint64_t triangles = 0;
  for (std::size_t i = 0; i < soups.size(); ++i) {
    vertices += soups[i].positions.size();
    triangles += soups[i].indices.size() / 3;
    if (vertices > kMaxVertices) return base::within(paths[i], tooManyVertices(vertices));
    if (triangles > kMaxTriangles)
      return base::within(paths[i],
                          unsupported(std::to_string(triangles) + " triangles are more than " +
                                      std::to_string(kMaxTriangles) + "; split the mesh into several scenes"));
  }
  return {};
}

/// The soups of all files as one mesh around one origin. Missing attributes are filled in with a warning.
void merge(std::vector<Soup>& soups, const std::vector<std::string>& paths, Imported& out) {
  const auto has_normals = [](const Soup& s) { return !s.normals.empty(); };
  const auto has_colors = [](const Soup& s) { return !s.colors.empty(); };
  out.has_normals = std::any_of(soups.begin(), soups.end(), has_normals);
  const bool colors = std::any_of(soups.begin(), soups.end(), has_colors);
  for (std::size_t i = 0; i < soups.size(); ++i) {
    out.repairs.add("degenerate_triangles", soups[i].short_faces);
    for (const std::string& warning : soups[i].warnings) out.warnings.push_back(paths[i] + ": " + warning);
    if (colors && soups[i].colors.empty())
      out.warnings.push_back(paths[i] + ": has no colours while other files have; it becomes white");
  }
  out.mesh.origin = originFor(boxOf(soups));
  for (Soup& soup : soups) append(out.mesh, soup, out.has_normals, colors);
}

/// Normals where files gave none, or none of use.
void fillNormals(Imported& out) {
  std::vector<glm::vec3>& given = out.mesh.normals;
  const auto missing = [](const glm::vec3& n) { return n == glm::vec3(0.0F); };
  if (given.empty()) {
    given = computeVertexNormals(out.mesh);
  } else if (std::any_of(given.begin(), given.end(), missing)) {
    const std::vector<glm::vec3> computed = computeVertexNormals(out.mesh);
    for (std::size_t v = 0; v < given.size(); ++v)
      if (missing(given[v])) given[v] = computed[v];
  }
}

}  // namespace

base::Result<Imported> importMeshes(const std::vector<std::string>& paths, const ImportOptions& options) {
  if (paths.empty()) return invalidInput("no mesh file is named");
  if (!std::isfinite(options.weld_distance) || options.weld_distance < 0.0)
    return invalidInput("the weld distance must be 0 or more");

  Imported out;
  std::vector<Soup> soups;
  for (const std::string& path : paths) {
    SourceFile source{path, 0, 0};
    LUMIGRID_ASSIGN_OR_RETURN(auto soup, readMesh(path, source.bytes));
    source.triangles = soup.indices.size() / 3 + soup.short_faces;
    out.sources.push_back(std::move(source));
    soups.push_back(std::move(soup));
  }
  LUMIGRID_TRY(checkTotals(soups, paths));
  merge(soups, paths, out);
  repairMesh(out.mesh, options.weld ? options.weld_distance : -1.0, out.repairs);
  if (out.mesh.indices.empty())
    return invalidInput(paths.front() + ": no triangle is left after cleaning (all are degenerate)");
  fillNormals(out);
  return out;
}

}  // namespace mesh
