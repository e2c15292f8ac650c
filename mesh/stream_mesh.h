#pragma once
// Reads a mesh file of any format from front to back into a sink: PLY (ASCII and both binary orders), OBJ, STL (ASCII
// and binary), OFF, glTF (GLB, and JSON with files beside it), 3D Tiles in local files, and points from LAS and from
// text (XYZ). Memory does not grow with the file, apart from OBJ's normals and texture coordinates, the JSON of glTF
// and of tilesets, and primitives of glTF that are compressed.
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <span>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"

namespace mesh {

/// The next vertices of a file; they are numbered from 0 in the order in which they come.
struct VertexBlock {
  std::span<const glm::dvec3> positions;  ///< world, the file's own coordinates; may be NaN or infinite
  std::span<const glm::vec3> normals;     ///< empty, or as many as positions; any length, zero or NaN where unknown
  std::span<const glm::u8vec4> colors;    ///< empty, or as many as positions; sRGB, a = 255
};

/// A picture that triangles take their colours from: a file, or a part of another file.
struct SourcePicture {
  std::string path;
  std::uint64_t offset = 0;
  std::uint64_t bytes = 0;  ///< 0: all of the file
  bool base64 = false;      ///< the bytes are base64 text
  bool opaque = false;      ///< its alpha, if it has one, says nothing
  friend bool operator==(const SourcePicture&, const SourcePicture&) = default;
};
/// In place of a picture's number where a triangle has none.
inline constexpr std::uint32_t kNoPicture = 0xFFFFFFFFU;

/// The next triangles. Corners are vertex numbers within the file. The reader checks, here or before it returns, that
/// each is below the file's number of vertices, but a vertex may come after its triangle.
struct TriangleBlock {
  std::span<const std::uint64_t> corners;  ///< 3 per triangle
  std::span<const glm::u8vec4> colors;     ///< empty, or one per corner: sRGB from a texture; a = 0 where unknown
  std::span<const glm::vec3> normals;      ///< empty, or one per corner, instead of its vertex's; zero where unknown
  /// Empty, or one per corner: its place in its triangle's picture, which is repeated; 0..1 across it, x to the right,
  /// y downwards. Without meaning where the triangle has no picture.
  std::span<const glm::vec2> uv;
  std::span<const std::uint32_t> pictures;  ///< empty, or one per triangle: into StreamedFile::pictures, or kNoPicture
};

class MeshSink {
 public:
  virtual ~MeshSink() = default;
  /// An error stops the reading, and the reader returns it as it is.
  virtual base::Result<void> vertices(const VertexBlock& block) = 0;
  virtual base::Result<void> triangles(const TriangleBlock& block) = 0;
  /// Drops all blocks of this file: the reader starts it again, since only on the way it learned how to read it.
  virtual base::Result<void> restart() = 0;
};

/// The message, without the file's name, of the error kUnsupported that a file of points without faces gives where
/// StreamOptions::accepts_points does not hold.
inline constexpr const char* kOnlyPoints =
    "the file has no faces (a point cloud?); mesh it first, or build it with --methods qsplat or pmr";

/// Gets the units of a picture that is a JPEG, as base::JpegBlocks::readQuarter tells them, so that whoever cuts it up
/// need not look for them again. Called from several threads.
using KeepUnits = std::function<void(const SourcePicture& picture, base::ByteView units)>;

struct StreamOptions {
  bool accepts_points = false;           ///< a file of points without faces is no error
  std::function<bool(double)> progress;  ///< share of the file read; false cancels
  KeepUnits keep_units;                  ///< may be empty; not every JPEG's units are told
};

/// Tells how a file's coordinates lie in the world, as far as the file says.
struct Georeference {
  std::string crs;    ///< the coordinate reference system by authority and code, "EPSG:26912"; empty: not known
  std::string units;  ///< of length: "m", "ft", "us-ft" or another name; empty: not known
  enum class Up : std::uint8_t { kUnknown, kZ, kY } up = Up::kUnknown;  ///< by the format's definition
  std::string moved = {};  ///< how the file's coordinates were moved to these, for people; empty: they were not
};

struct StreamedFile {
  std::uint64_t bytes = 0;
  std::uint64_t vertices = 0;
  std::uint64_t triangles = 0;
  std::uint64_t short_faces = 0;  ///< faces with fewer than three corners: left out
  bool has_normals = false;
  bool has_colors = false;
  Georeference georeference;
  std::vector<std::string> warnings;    ///< one line each, without the file's name
  std::vector<SourcePicture> pictures;  ///< all could be read
  double texels = 0.0;                  ///< of these, as many as triangles cover
};

/// The format is told by the content, and by the file's name only where the content does not tell. Errors name the file
/// and the place in it ("scan.ply: face 17: index 99 is out of range (5 vertices)"), or are the sink's.
base::Result<StreamedFile> streamMesh(const std::string& path, MeshSink& sink, const StreamOptions& options);

}  // namespace mesh
