#include "mesh/stream_mesh.h"

#include <algorithm>

#include "base/file.h"
#include "base/format_text.h"
#include "mesh/export_place.h"
#include "mesh/readers.h"

namespace mesh {
namespace {

std::string extensionOf(const std::string& path) {
  const std::size_t dot = path.rfind('.');
  if (dot == std::string::npos || path.find('/', dot) != std::string::npos) return {};
  std::string extension = path.substr(dot + 1);
  for (char& c : extension) c = c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  return extension;
}

// Whether the first line that is no comment begins with one of OBJ's keywords.
bool looksLikeObj(std::string_view text) {
  text = text.substr(0, 1 << 16);
  while (!text.empty()) {
    std::string_view line = nextLine(text);
    const std::string_view word = nextWord(line);
    if (word.empty() || word.front() == '#') continue;
    constexpr std::string_view kKeywords[] = {"v", "vn", "vt", "vp", "f", "o", "g", "s", "mtllib", "usemtl"};
    return std::find(std::begin(kKeywords), std::end(kKeywords), word) != std::end(kKeywords);
  }
  return false;
}

// Formats that another program converts, as their content (empty: it does not) and their names tell.
struct ConvertedFormat {
  std::string_view start;
  std::string_view extension;
  const char* advice;
};
constexpr const char* kConvertE57 =
    "E57 is not read; convert it: pdal translate in.e57 out.las (PDAL with its E57 plugin, from pdal.io; Debian 12 has "
    "no package of it)";
constexpr const char* kConvertFbx =
    "FBX is not read; convert it: assimp export in.fbx out.glb (Debian package assimp-utils)";
constexpr const char* kConvertTile =
    "tiles of instances and of several formats (i3dm, cmpt) are not read; write the tileset with b3dm or GLB";
constexpr ConvertedFormat kConverted[] = {
    {"ASTM-E57", "e57", kConvertE57},
    {"Kaydara FBX Binary", "fbx", kConvertFbx},
    {"i3dm", "i3dm", kConvertTile},
    {"cmpt", "cmpt", kConvertTile},
};

// Points as text have many names, and no content that tells them from other text.
constexpr std::string_view kXyzNames[] = {"xyz", "txt", "pts", "asc", "csv", "xyzrgb", "xyzn"};

// Programs that export OBJ tell beside it where its origin lies.
base::Result<void> readPlacedObj(const std::string& path, base::ByteView bytes, MeshStream& out) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto place, findExportPlace(path));
  if (!place) return readObj(bytes, out);
  out.origin = place->origin;
  LUMIGRID_TRY(readObj(bytes, out));
  // A reader that starts again drops what was said before.
  Georeference& georeference = out.summary.georeference;
  georeference.crs = place->crs.code, georeference.units = place->crs.unit;
  if (out.origin != glm::dvec3(0.0))
    georeference.moved = "moved by (" +
                         base::formatText("%.12g, %.12g, %.12g", out.origin.x, out.origin.y, out.origin.z) +
                         "), as " + place->file + " says";
  return {};
}

// Reads the file in the format that its content or else its name tells.
base::Result<void> readFile(const std::string& path, base::ByteView bytes, MeshStream& out) {
  if (bytes.empty()) return invalidInput("the file is empty");
  const std::string_view text = textOf(bytes);
  constexpr std::string_view kPointer = "version https://git-lfs";
  if (text.substr(0, kPointer.size()) == kPointer)
    return unsupported("it only says where Git LFS keeps the file; fetch that: git lfs pull");
  if (text.substr(0, 4) == "glTF") return readGlb(bytes, out);
  if (text.substr(0, 4) == "b3dm" || text.substr(0, 4) == "pnts") return readTile(bytes, out);
  if (looksLikeJson(text)) return readJson(bytes, out);
  if (text.substr(0, 4) == "LASF") return readLas(bytes, out);
  for (const ConvertedFormat& format : kConverted)
    if (!format.start.empty() && text.substr(0, format.start.size()) == format.start) return unsupported(format.advice);
  if (isBinaryStlBySize(bytes)) return readStl(bytes, out);
  std::string_view rest = text.substr(0, 1 << 16);
  const std::string_view word = nextWord(rest);
  if (word == "ply") return readPly(bytes, out);
  if (word == "solid") return readStl(bytes, out);
  if (word.size() >= 3 && word.size() <= 8 && word.substr(word.size() - 3) == "OFF") return readOff(bytes, out);
  if (looksLikeObj(text)) return readPlacedObj(path, bytes, out);

  // The content does not tell, so the name has to.
  const std::string extension = extensionOf(path);
  for (const ConvertedFormat& format : kConverted)
    if (extension == format.extension) return unsupported(format.advice);
  if (extension == "ply") return readPly(bytes, out);
  if (extension == "obj") return readPlacedObj(path, bytes, out);
  if (extension == "stl") return readStl(bytes, out);
  if (extension == "off") return readOff(bytes, out);
  if (extension == "glb") return readGlb(bytes, out);
  if (extension == "las" || extension == "laz") return readLas(bytes, out);
  if (extension == "ptx") return readPtx(bytes, out);
  if (std::find(std::begin(kXyzNames), std::end(kXyzNames), extension) != std::end(kXyzNames))
    return readXyz(bytes, out);
  return unsupported(
      "neither the content nor the name is that of a mesh (PLY, OBJ, STL, OFF, glTF, 3D Tiles, LAS, PTX and XYZ are "
      "read)");
}

}  // namespace

base::Result<StreamedFile> streamMesh(const std::string& path, MeshSink& sink, const StreamOptions& options) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, base::MappedFile::open(path));
  MeshStream stream(sink, file.bytes(), path, options.progress);
  stream.accepts_points = options.accepts_points;
  stream.textures.keepUnits(options.keep_units);
  if (auto read = readFile(path, file.bytes(), stream); !read) {
    // The sink's errors name their file already.
    const bool named = read.error().message.rfind(path + ":", 0) == 0 ||
                       read.error().code == base::ErrorCode::kNoSpace || read.error().code == base::ErrorCode::kIo ||
                       read.error().code == base::ErrorCode::kCancelled;
    return named ? read.error() : base::within(path, read.error());
  }
  StreamedFile& summary = stream.summary;
  summary.bytes = file.bytes().size();
  if (const std::size_t more = stream.textures.unnamed(); more > 0)
    summary.warnings.push_back(std::to_string(more) + " more textures cannot be read");
  summary.pictures = stream.textures.pictures();
  summary.texels = stream.baker.texels();
  return std::move(summary);
}

}  // namespace mesh
