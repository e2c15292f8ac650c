#include "lod/draw/triangles.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

#include "lod/draw/shaders.h"

namespace lod::draw {
namespace {

/// A vertex as the GPU reads it: 20 bytes.
struct Vertex {
  glm::vec3 position;
  std::array<std::int8_t, 4> normal;
  glm::u8vec4 color;
};
static_assert(sizeof(Vertex) == kSurfaceVertexBytes && offsetof(Vertex, normal) == 12 && offsetof(Vertex, color) == 16);

std::int8_t snorm8(float v) {
  return static_cast<std::int8_t>(std::lround(std::clamp(v, -1.0F, 1.0F) * 127.0F));
}

/// Returns the root mean square length of each vertex's edges, in lattice steps.
std::vector<float> edgeLengths(const patch::PatchGeometry& geometry) {
  std::vector<float> squares(geometry.positions.size(), 0.0F);
  std::vector<float> counts(geometry.positions.size(), 0.0F);
  for (std::size_t i = 0; i < geometry.indices.size(); ++i) {
    const std::size_t a = geometry.indices[i];
    const std::size_t b = geometry.indices[i % 3 == 2 ? i - 2 : i + 1];
    const glm::vec3 edge(geometry.positions[b] - geometry.positions[a]);
    for (const std::size_t v : {a, b}) squares[v] += glm::dot(edge, edge), counts[v] += 1.0F;
  }
  for (std::size_t v = 0; v < squares.size(); ++v) squares[v] = std::sqrt(squares[v] / std::max(counts[v], 1.0F));
  return squares;
}

std::int8_t edgeCode(float steps) {
  const float code = kEdgeCodesPerOctave * std::log2(std::max(steps, 1.0F));
  return static_cast<std::int8_t>(std::lround(std::clamp(code, 0.0F, 127.0F)));
}

std::vector<Vertex> verticesOf(const patch::PatchGeometry& geometry, const Lattice& lattice) {
  std::vector<Vertex> vertices(geometry.positions.size());
  const std::vector<float> edges = edgeLengths(geometry);
  for (std::size_t i = 0; i < vertices.size(); ++i) {
    const glm::vec3 n = i < geometry.normals.size() ? geometry.normals[i] : glm::vec3(0.0F);
    vertices[i].position = lattice.position(geometry.positions[i]);
    vertices[i].normal = {snorm8(n.x), snorm8(n.y), snorm8(n.z), edgeCode(edges[i])};
    vertices[i].color = i < geometry.colors.size() ? geometry.colors[i] : glm::u8vec4(255);
  }
  return vertices;
}

/// Returns √(2 · area / triangles), scene units.
float meanEdgeOf(const std::vector<Vertex>& vertices, const std::vector<std::uint16_t>& indices) {
  double doubled_area = 0.0;
  for (std::size_t i = 0; i + 2 < indices.size(); i += 3) {
    const glm::vec3& a = vertices[indices[i]].position;
    const glm::vec3 normal = glm::cross(vertices[indices[i + 1]].position - a, vertices[indices[i + 2]].position - a);
    doubled_area += static_cast<double>(glm::length(normal));
  }
  return static_cast<float>(std::sqrt(3.0 * doubled_area / std::max<double>(3.0, static_cast<double>(indices.size()))));
}

}  // namespace

void describeSurfaceVertices() {
  glEnableVertexAttribArray(kPosition);
  glVertexAttribPointer(kPosition, 3, GL_FLOAT, GL_FALSE, sizeof(Vertex), bufferOffset(offsetof(Vertex, position)));
  glEnableVertexAttribArray(kNormal);
  glVertexAttribPointer(kNormal, 4, GL_BYTE, GL_TRUE, sizeof(Vertex), bufferOffset(offsetof(Vertex, normal)));
  glEnableVertexAttribArray(kColor);
  glVertexAttribPointer(kColor, 4, GL_UNSIGNED_BYTE, GL_TRUE, sizeof(Vertex), bufferOffset(offsetof(Vertex, color)));
}

std::uint64_t PatchMeshes::bytesFor(std::uint64_t vertices, std::uint64_t triangles) {
  return vertices * sizeof(Vertex) + triangles * 3 * sizeof(std::uint16_t);
}

void PatchMeshes::upload(std::uint32_t patch, const patch::PatchGeometry& geometry) {
  remove(patch);
  const std::vector<Vertex> vertices = verticesOf(geometry, lattice_);
  Mesh mesh;
  mesh.array = base::gl::VertexArray::create();
  mesh.vertices = base::gl::Buffer::create();
  mesh.indices = base::gl::Buffer::create();
  mesh.index_count = static_cast<GLsizei>(geometry.indices.size());
  mesh.bytes = bytesFor(vertices.size(), geometry.indices.size() / 3);
  for (const Vertex& vertex : vertices) mesh.box.add(vertex.position);
  mesh.mean_edge = meanEdgeOf(vertices, geometry.indices);

  glBindVertexArray(mesh.array.name());
  base::gl::allocate(mesh.vertices, GL_ARRAY_BUFFER, vertices.data(), vertices.size() * sizeof(Vertex), GL_STATIC_DRAW);
  base::gl::allocate(mesh.indices, GL_ELEMENT_ARRAY_BUFFER, geometry.indices.data(),
                     geometry.indices.size() * sizeof(std::uint16_t), GL_STATIC_DRAW);
  describeSurfaceVertices();
  glBindVertexArray(0);

  bytes_ += mesh.bytes;
  meshes_.emplace(patch, std::move(mesh));
}

void PatchMeshes::remove(std::uint32_t patch) {
  const auto found = meshes_.find(patch);
  if (found == meshes_.end()) return;
  bytes_ -= found->second.bytes;
  meshes_.erase(found);
}

void PatchMeshes::draw(std::span<const std::uint32_t> patches) const {
  for (const std::uint32_t patch : patches) {
    const Mesh& drawn = mesh(patch);
    glBindVertexArray(drawn.array.name());
    glDrawElements(GL_TRIANGLES, drawn.index_count, GL_UNSIGNED_SHORT, nullptr);
  }
  glBindVertexArray(0);
}

const PatchMeshes::Mesh& PatchMeshes::mesh(std::uint32_t patch) const {
  const auto found = meshes_.find(patch);
  LUMIGRID_CHECK(found != meshes_.end());
  return found->second;
}

std::string seenNormalSource() {
  return glsl::kSeenNormal;
}

std::string shadingSource() {
  return glsl::kShading;
}

void setShading(const base::gl::Program& program, const Shading& shading) {
  program.use();
  const float length = glm::length(shading.light_direction);
  const glm::vec3 direction = length > 0.0F ? shading.light_direction / length : glm::vec3(0.0F, 0.0F, 1.0F);
  glUniform1i(program.uniform("u_unlit"), shading.unlit ? 1 : 0);
  glUniform3f(program.uniform("u_light_direction"), direction.x, direction.y, direction.z);
}

}  // namespace lod::draw
