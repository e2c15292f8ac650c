#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <limits>
#include <map>

#include "base/file.h"
#include "mesh/readers.h"

namespace mesh {
namespace {

// Faces name normals and texture coordinates by number, so all are kept in memory: 0.8 GB and 0.5 GB at most.
constexpr std::size_t kMaxNormals = std::size_t{1} << 26;
constexpr std::size_t kMaxUv = std::size_t{1} << 26;

// Numbers count from 1; negative ones count back from the last element read so far.
bool resolveIndex(std::int64_t number, std::uint64_t count, std::int64_t& index) {
  index = number > 0 ? number - 1 : static_cast<std::int64_t>(count) + number;
  return number != 0 && index >= 0;
}

struct ObjReader {
  explicit ObjReader(MeshStream& stream) : out(stream) {}

  MeshStream& out;
  std::vector<glm::vec3> file_normals;  // normals of the vn lines
  std::vector<std::uint64_t> corners;   // the face's vertices
  std::vector<glm::vec3> normals;       // the face's normals, up to the last corner that names one
  std::int64_t highest_index = -1;      // the highest of all faces; checked at the end, when every vertex is known
  std::uint64_t highest_index_line = 0;
  std::uint64_t line_number = 0;
  TextColors colors;
  bool has_colors = false;
  bool has_normals = false;
  bool too_many_normals = false;
  std::vector<glm::vec2> file_uv;  // texture coordinates of the vt lines
  std::vector<glm::dvec2> uv;      // the face's, where it has a texture; NaN where a corner names none
  struct Material {
    std::string picture;                  // its file; empty: none
    glm::u8vec4 color{255, 255, 255, 0};  // sRGB; a = 0 where it names none
  };
  std::map<std::string, Material> materials;
  bool has_paints = false;              // materials differ in colour, or are no greys
  const Material* asked = nullptr;      // the material in use, while its picture is not known
  std::uint32_t picture = kNoPicture;   // of the material in use
  glm::u8vec4 paint{255, 255, 255, 0};  // its colour, for faces without a picture where vertices have no colours
  std::vector<glm::u8vec4> painted_corners;
  bool too_many_uv = false;

  std::string place() const { return "line " + std::to_string(line_number); }

  base::Result<void> readFile(std::string_view text) {
    const std::string_view whole = text;
    std::string joined;
    while (!text.empty()) {
      ++line_number;
      std::string_view line = nextLine(text);

      // A backslash at the end continues the line.
      if (!line.empty() && line.back() == '\\') {
        joined.assign(line.substr(0, line.size() - 1));
        for (bool more = true; more && !text.empty();) {
          ++line_number;
          line = nextLine(text);
          more = !line.empty() && line.back() == '\\';
          joined.append(" ").append(more ? line.substr(0, line.size() - 1) : line);
        }
        line = joined;
      }
      LUMIGRID_TRY(readLine(line));
      if (colors.mustRestart()) {
        LUMIGRID_TRY(out.restart());
        text = whole;
        line_number = 0, highest_index = -1;
        file_normals.clear();
        file_uv.clear();
        has_normals = false;
        picture = kNoPicture, asked = nullptr;
        paint.a = 0;
        continue;
      }
      // Where colours begin in the middle of a block, the vertices before are white.
      if (has_colors) out.colors.resize(out.positions.size(), glm::u8vec4(255));
      LUMIGRID_TRY(out.flushFullBlocks(text.data()));
    }
    LUMIGRID_TRY(finish());
    return out.flush(whole.data() + whole.size());
  }

  base::Result<void> readLine(std::string_view line) {
    const std::string_view keyword = nextWord(line);
    if (keyword == "v") return readVertex(line);
    if (keyword == "vn") return readNormal(line);
    if (keyword == "f") return readFace(line);
    if (keyword == "vt") {
      glm::dvec2 p(0.0);
      for (int k = 0; k < 2; ++k)
        if (const std::string_view word = nextWord(line); !word.empty() && !parseNumber(word, p[k]))
          return invalidInput(place() + ": " + inQuotes(word) + " is not a number");
      // OBJ's v runs upwards, a picture's rows downwards.
      if (file_uv.size() < kMaxUv)
        file_uv.emplace_back(glm::vec2(p.x, 1.0 - p.y));
      else
        too_many_uv = true;
    } else if (keyword == "mtllib") {
      readLibraries(line);
    } else if (keyword == "usemtl") {
      useMaterial(restOfLine(line));
    }
    return {};
  }

  base::Result<void> readVertex(std::string_view line) {
    std::array<double, 7> n{};
    LUMIGRID_ASSIGN_OR_RETURN(auto count, readNumbers(line, n));
    out.positions.emplace_back(n[0], n[1], n[2]);

    // Colours follow the position (6 numbers), or the position and its weight (7).
    const std::size_t c = count == 7 ? 4 : 3;
    if (count >= 6) has_colors = true;
    if (has_colors) {
      out.colors.resize(out.positions.size(), glm::u8vec4(255));
      if (count >= 6) out.colors.back() = colors.color({n[c], n[c + 1], n[c + 2]});
    }
    return {};
  }

  base::Result<void> readNormal(std::string_view line) {
    std::array<double, 7> n{};
    if (const auto count = readNumbers(line, n); !count) return count.error();
    if (file_normals.size() < kMaxNormals)
      file_normals.emplace_back(glm::dvec3(n[0], n[1], n[2]));
    else
      too_many_normals = true;
    return {};
  }

  // Reads the numbers of "v x y z", "v x y z w" or "v x y z r g b", and returns how many there are.
  base::Result<std::size_t> readNumbers(std::string_view line, std::array<double, 7>& numbers) const {
    std::size_t count = 0;
    for (; skipSpaces(line) && line.front() != '#' && count < numbers.size(); ++count) {
      if (const std::size_t plain = leadingDecimal(line, numbers[count]); plain > 0) {
        line.remove_prefix(plain);
        continue;
      }
      if (const std::string_view word = nextWord(line); !parseNumber(word, numbers[count]))
        return invalidInput(place() + ": " + inQuotes(word) + " is not a number");
    }
    if (count < 3) return invalidInput(place() + ": three numbers are needed (a truncated file?)");
    return count;
  }

  // Whether the material in use has a picture, as far as is known.
  bool isTextured() const { return asked != nullptr || picture != kNoPicture; }

  base::Result<void> readFace(std::string_view line) {
    corners.clear();
    normals.clear();
    uv.clear();
    while (skipSpaces(line) && line.front() != '#') {
      // Most corners are digits alone.
      std::int64_t number = 0;
      const std::size_t digits = leadingDigits(line, number);
      if (digits > 0 && (digits == line.size() || isSpace(line[digits]))) {
        line.remove_prefix(digits);
        LUMIGRID_TRY(addVertex(number));
      } else {
        LUMIGRID_TRY(readCorner(nextWord(line)));
      }
    }
    const auto known = [](const glm::dvec2& p) { return std::isfinite(p.x) && std::isfinite(p.y); };
    if (has_normals) normals.resize(corners.size(), glm::vec3(0.0F));
    const auto its_normals = has_normals ? std::span<const glm::vec3>(normals) : std::span<const glm::vec3>();
    const bool placed = isTextured() && std::all_of(uv.begin(), uv.end(), known);
    if (placed && asked != nullptr) {
      picture = out.textures.find({out.textures.pathOf(asked->picture), 0, 0}, uv, out.summary.warnings);
      asked = nullptr;
    }
    if (placed && picture != kNoPicture)
      out.addTextured(corners, its_normals, uv, picture);
    else if (paint.a != 0 && !has_colors) {
      painted_corners.assign(corners.size(), paint);
      out.addPolygon(corners, its_normals, painted_corners);
    } else {
      out.addPolygon(corners, its_normals);
    }
    return {};
  }

  // A corner is "7", "7/2", "7//3" or "7/2/3": vertex, texture coordinate, normal. Some writers leave out a number but
  // not its slash: "7//", "7/2/".
  base::Result<void> readCorner(std::string_view word) {
    std::int64_t number = 0;
    const std::size_t slash = word.find('/');
    if (!parseNumber(word.substr(0, slash), number))
      return invalidInput(place() + ": " + inQuotes(word) + " is not a vertex index");
    LUMIGRID_TRY(addVertex(number));
    if (slash == std::string_view::npos) return {};

    const std::size_t last_slash = word.rfind('/');
    if (isTextured()) {
      const std::size_t end = last_slash == slash ? word.size() : last_slash;
      std::int64_t at = 0;
      if (parseNumber(word.substr(slash + 1, end - slash - 1), number) && resolveIndex(number, file_uv.size(), at) &&
          at < static_cast<std::int64_t>(file_uv.size()))
        uv.back() = glm::dvec2(file_uv[static_cast<std::size_t>(at)]);
    }
    if (last_slash == slash || last_slash + 1 == word.size() || too_many_normals) return {};
    std::int64_t normal = 0;
    if (!parseNumber(word.substr(last_slash + 1), number) || !resolveIndex(number, file_normals.size(), normal) ||
        normal >= static_cast<std::int64_t>(file_normals.size()))
      return invalidInput(place() + ": " + inQuotes(word) + " names a normal that is not there (" +
                          std::to_string(file_normals.size()) + " normals)");
    normals.resize(corners.size(), glm::vec3(0.0F));
    normals.back() = file_normals[static_cast<std::size_t>(normal)];
    has_normals = true;
    return {};
  }

  base::Result<void> addVertex(std::int64_t number) {
    std::int64_t index = 0;
    if (!resolveIndex(number, out.vertexCount(), index) || index >= std::int64_t{1} << 48)
      return indexOutOfRange(place(), number, out.vertexCount());
    if (index > highest_index) highest_index = index, highest_index_line = line_number;
    corners.push_back(static_cast<std::uint64_t>(index));
    if (isTextured()) uv.emplace_back(std::numeric_limits<double>::quiet_NaN());
    return {};
  }

  // The diffuse colour of a material, which viewers take for sRGB. As a file of spectra or in XYZ it is not read.
  static glm::u8vec4 readColor(std::string_view line) {
    glm::u8vec4 color(255);
    double value = 0.0;
    for (int k = 0; k < 3; ++k) {
      const std::string_view word = nextWord(line);
      if (!word.empty() && !parseNumber(word, value)) return {255, 255, 255, 0};
      if (word.empty() && k == 0) return {255, 255, 255, 0};
      color[k] = byteFromUnit(value);
    }
    return color;  // a number alone is a grey
  }

  // A line names one library, whose name may have spaces, or several.
  void readLibraries(std::string_view line) {
    std::string_view names = line;
    const std::string whole(restOfLine(names));
    if (whole.empty()) return;
    if (std::error_code ignored; std::filesystem::exists(out.textures.pathOf(whole), ignored)) {
      readMaterials(whole);
      return;
    }
    for (std::string_view word = nextWord(line); !word.empty(); word = nextWord(line)) readMaterials(word);
  }

  // Removes the options of a line that names a picture, "-s 1 1 1 -bm 0.5", so that the name is left.
  static void skipPictureOptions(std::string_view& line) {
    while (skipSpaces(line) && line.front() == '-') {
      std::string_view rest = line;
      const std::string_view option = nextWord(rest);
      const bool is_place = option == "-s" || option == "-o" || option == "-t";  // one to three numbers
      const int most = is_place ? 3 : option == "-mm" ? 2 : 1;
      for (int k = 0; k < most; ++k) {
        std::string_view after = rest;
        double ignored = 0.0;
        const bool is_number = parseNumber(nextWord(after), ignored);
        if (k > 0 && !is_number) break;
        rest = after;
      }
      line = rest;
    }
  }

  // Notes the picture and the colour of each material in a material library.
  void readMaterials(std::string_view name) {
    const auto bytes = base::readFile(out.textures.pathOf(std::string(name)));
    if (!bytes) {
      out.summary.warnings.push_back("its materials cannot be read, vertex colours stay: " + bytes.error().message);
      return;
    }
    std::string material;
    std::vector<SourcePicture> pictures;
    for (std::string_view text = textOf(*bytes); !text.empty();) {
      std::string_view line = nextLine(text);
      const std::string_view keyword = nextWord(line);
      if (keyword == "newmtl") material = std::string(restOfLine(line));
      if (keyword == "Kd") materials[material].color = readColor(line);
      if (keyword != "map_Kd") continue;
      skipPictureOptions(line);
      const std::string_view picture = restOfLine(line);
      if (picture.empty()) continue;
      materials[material].picture = std::string(picture);
      pictures.push_back({out.textures.pathOf(std::string(picture)), 0, 0});
    }
    out.textures.expect(std::move(pictures));
    findPaints();
  }

  // Exporters give a scan without colours a grey material, which says nothing.
  void findPaints() {
    const glm::u8vec4* first = nullptr;
    for (const auto& [name, material] : materials) {
      const glm::u8vec4& c = material.color;
      if (c.a == 0) continue;
      if (first == nullptr) first = &c;
      has_paints = has_paints || c != *first || c.r != c.g || c.g != c.b;
    }
  }

  void useMaterial(std::string_view name) {
    const auto found = materials.find(std::string(name));
    picture = kNoPicture;
    asked = found == materials.end() || found->second.picture.empty() ? nullptr : &found->second;
    paint = found != materials.end() && has_paints ? found->second.color : glm::u8vec4(255, 255, 255, 0);
  }

  base::Result<void> finish() {
    const std::uint64_t count = out.vertexCount();
    if (highest_index >= static_cast<std::int64_t>(count))
      return indexOutOfRange("line " + std::to_string(highest_index_line), highest_index + 1, count);
    if (too_many_uv)
      out.summary.warnings.push_back("has more than " + std::to_string(kMaxUv) +
                                     " texture coordinates; those beyond are not used");
    if (too_many_normals)
      out.summary.warnings.push_back("has more than " + std::to_string(kMaxNormals) +
                                     " normals; those beyond are computed from the triangles");
    if (out.triangleCount() == 0 && out.summary.short_faces == 0 && (count == 0 || !out.accepts_points))
      return lacksFaces(count);
    return {};
  }
};

}  // namespace

base::Result<void> readObj(base::ByteView bytes, MeshStream& out) {
  return ObjReader(out).readFile(textOf(bytes));
}

}  // namespace mesh
