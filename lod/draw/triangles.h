#pragma once
// Uploads patches and draws cuts of them, for the server's renderer and the client.
#include <cstdint>
#include <glm/glm.hpp>
#include <span>
#include <string>
#include <unordered_map>

#include "base/gl/gl.h"
#include "lod/patch/hierarchy.h"

namespace lod::draw {

/// Vertex attribute locations that every program drawing patches uses.
enum AttributeLocation : GLuint { kPosition = 0, kNormal = 1, kColor = 2 };

/// Describes these attributes of the vertices in the bound GL_ARRAY_BUFFER: a float32 position, a normal of four signed
/// bytes and a colour of four unsigned ones.
void describeSurfaceVertices();
inline constexpr std::size_t kSurfaceVertexBytes = 20;

/// An offset into a bound buffer, as OpenGL takes it.
inline const void* bufferOffset(std::size_t bytes) {
  return reinterpret_cast<const void*>(bytes);
}

/// The normal's fourth component encodes how finely the surface is sampled at the vertex: 127 × a_normal.w is
/// kEdgeCodesPerOctave × log2 of the root mean square length of the vertex's edges, in lattice steps.
inline constexpr float kEdgeCodesPerOctave = 4.0F;

/// Uploaded patches by number. Positions are float32 scene-local (Lattice::position), normals signed bytes, colours
/// unsigned bytes (white where the scene has none): 20 bytes a vertex, 6 a triangle. Each patch has its own buffers and
/// vertex array: a draw call costs about 8 µs and a triangle 60 to 80 ns (llvmpipe), so one large shared buffer would
/// save some 5 % at 2000 triangles a patch.
class PatchMeshes {
 public:
  explicit PatchMeshes(const Lattice& lattice) : lattice_(lattice) {}
  const Lattice& lattice() const { return lattice_; }
  bool contains(std::uint32_t patch) const { return meshes_.count(patch) != 0; }
  void upload(std::uint32_t patch, const patch::PatchGeometry& geometry);
  void remove(std::uint32_t patch);
  /// Draws these patches with the program in use. All must be uploaded.
  void draw(std::span<const std::uint32_t> patches) const;
  std::uint64_t gpuBytes() const { return bytes_; }
  /// Return the box and the triangle count of an uploaded patch.
  const base::Aabb& box(std::uint32_t patch) const { return mesh(patch).box; }
  /// Returns the edge of a patch's mean triangle, scene units: √(2 · area / triangles), as the hierarchy's errors of
  /// colour have it.
  float meanEdge(std::uint32_t patch) const { return mesh(patch).mean_edge; }
  std::uint64_t triangles(std::uint32_t patch) const { return static_cast<std::uint64_t>(mesh(patch).index_count) / 3; }
  /// Returns the GPU bytes of an uploaded patch of this size.
  static std::uint64_t bytesFor(std::uint64_t vertices, std::uint64_t triangles);
  std::size_t size() const { return meshes_.size(); }

 private:
  struct Mesh {
    base::gl::VertexArray array;
    base::gl::Buffer vertices;
    base::gl::Buffer indices;
    GLsizei index_count = 0;
    std::uint64_t bytes = 0;
    base::Aabb box;
    float mean_edge = 0.0F;
  };
  const Mesh& mesh(std::uint32_t patch) const;
  Lattice lattice_;
  std::unordered_map<std::uint32_t, Mesh> meshes_;
  std::uint64_t bytes_ = 0;
};

/// Shading of surfaces where no image is used. Has the fields of base::Light without depending on its file.
struct Shading {
  bool unlit = false;
  glm::vec3 light_direction{0.35F, 0.45F, 0.82F};  ///< unit, towards the light

  friend bool operator==(const Shading&, const Shading&) = default;
};

/// Returns GLSL that defines `vec3 shadeSurface(vec3 color, vec3 normal, vec3 toEye)` and its uniforms `bool u_unlit`
/// and `vec3 u_light_direction` (unit, scene axes, towards the light). `color` is 0..1, `normal` need not be unit,
/// `toEye` is eye minus surface point, of any length. A normal that points away from the eye is flipped. Lit surfaces
/// are shaded by half-Lambert, so that nothing is black; unlit ones keep `color`.
std::string shadingSource();
/// Returns GLSL that defines `vec3 seenNormal(vec3 normal, vec3 facet, vec3 toEye)`: the unit normal of an interpolated
/// one on the seen side of a triangle, whose own unit normal on that side is `facet`. `normal` is interpolated between
/// unit normals, or 0, and left as it is: its length tells a hard edge. shadeSurface() does not flip the result.
std::string seenNormalSource();
/// Sets the uniforms of shadingSource(); leaves `program` in use.
void setShading(const base::gl::Program& program, const Shading& shading);

}  // namespace lod::draw
