#include "lod/build/read_obj.h"

#include <algorithm>
#include <array>

namespace lod::build {
namespace {

struct ObjReader {
  Soup soup;
  std::vector<glm::vec3> file_normals;  // as the vn lines give them
  std::vector<glm::vec3> colors;        // per vertex, as given
  std::vector<std::uint32_t> corners;   // of the face being read
  std::int64_t highest_index = -1;      // of all faces, checked once every vertex is known
  std::uint64_t highest_index_line = 0;
  std::uint64_t line_number = 0;
  bool has_colors = false;
  bool textured = false;

  std::string place() const { return "line " + std::to_string(line_number); }
  base::Result<void> readLine(std::string_view line);
  base::Result<void> readVertex(std::string_view line);
  base::Result<void> readNormal(std::string_view line);
  base::Result<void> readFace(std::string_view line);
  base::Result<std::uint32_t> readCorner(std::string_view word);
  base::Result<void> finish();
};

// "v x y z", "v x y z w", "v x y z r g b"; returns how many numbers, or an error.
base::Result<std::size_t> readNumbers(std::string_view line, std::array<double, 7>& numbers, const std::string& place) {
  std::size_t count = 0;
  for (std::string_view word = nextWord(line); !word.empty() && count < numbers.size(); word = nextWord(line)) {
    if (word.front() == '#') break;
    if (!parseNumber(word, numbers[count])) return invalidInput(place + ": " + quoted(word) + " is not a number");
    ++count;
  }
  if (count < 3) return invalidInput(place + ": three numbers are needed (a truncated file?)");
  return count;
}

base::Result<void> ObjReader::readVertex(std::string_view line) {
  std::array<double, 7> n{};
  auto count = readNumbers(line, n, place());
  if (!count) return count.error();
  if (soup.positions.size() >= kMaxVertices) return tooManyVertices(soup.positions.size() + 1);
  soup.positions.emplace_back(n[0], n[1], n[2]);

  // Colours follow the position (6 numbers), or the position and its weight (7).
  const std::size_t c = *count == 7 ? 4 : 3;
  if (*count >= 6) has_colors = true;
  if (has_colors) {
    colors.resize(soup.positions.size(), glm::vec3(1.0F));
    if (*count >= 6) colors.back() = glm::vec3(glm::dvec3(n[c], n[c + 1], n[c + 2]));
  }
  return {};
}

base::Result<void> ObjReader::readNormal(std::string_view line) {
  std::array<double, 7> n{};
  auto count = readNumbers(line, n, place());
  if (!count) return count.error();
  file_normals.emplace_back(glm::dvec3(n[0], n[1], n[2]));
  return {};
}

// Numbers count from 1; negative ones back from the last element read so far.
bool resolveIndex(std::int64_t number, std::size_t count, std::int64_t& index) {
  index = number > 0 ? number - 1 : static_cast<std::int64_t>(count) + number;
  return number != 0 && index >= 0;
}

// "7", "7/2", "7//3" or "7/2/3": vertex, texture, normal.
base::Result<std::uint32_t> ObjReader::readCorner(std::string_view word) {
  std::int64_t number = 0;
  std::int64_t index = 0;
  const std::size_t slash = word.find('/');
  if (!parseNumber(word.substr(0, slash), number))
    return invalidInput(place() + ": " + quoted(word) + " is not a vertex index");
  if (!resolveIndex(number, soup.positions.size(), index) || index > static_cast<std::int64_t>(kMaxVertices))
    return indexOutOfRange(place(), number, soup.positions.size());
  if (index > highest_index) highest_index = index, highest_index_line = line_number;

  const std::size_t last_slash = word.rfind('/');
  if (slash == std::string_view::npos || last_slash == slash) return static_cast<std::uint32_t>(index);
  std::int64_t normal = 0;
  if (!parseNumber(word.substr(last_slash + 1), number) || !resolveIndex(number, file_normals.size(), normal) ||
      normal >= static_cast<std::int64_t>(file_normals.size()))
    return invalidInput(place() + ": " + quoted(word) + " names a normal that is not there (" +
                        std::to_string(file_normals.size()) + " normals)");

  // Ours are normals of vertices: corners that share a vertex add up. Vertices that come later get none.
  if (index < static_cast<std::int64_t>(soup.positions.size())) {
    soup.normals.resize(soup.positions.size(), glm::vec3(0.0F));
    soup.normals[static_cast<std::size_t>(index)] += file_normals[static_cast<std::size_t>(normal)];
  }
  return static_cast<std::uint32_t>(index);
}

base::Result<void> ObjReader::readFace(std::string_view line) {
  corners.clear();
  for (std::string_view word = nextWord(line); !word.empty() && word.front() != '#'; word = nextWord(line)) {
    auto corner = readCorner(word);
    if (!corner) return corner.error();
    corners.push_back(*corner);
  }
  addPolygon(soup, corners.data(), corners.size());
  return {};
}

base::Result<void> ObjReader::readLine(std::string_view line) {
  const std::string_view keyword = nextWord(line);
  if (keyword == "v") return readVertex(line);
  if (keyword == "vn") return readNormal(line);
  if (keyword == "f") return readFace(line);
  textured = textured || keyword == "vt" || keyword == "mtllib";
  return {};
}

base::Result<void> ObjReader::finish() {
  const std::size_t count = soup.positions.size();
  if (highest_index >= static_cast<std::int64_t>(count))
    return indexOutOfRange("line " + std::to_string(highest_index_line), highest_index + 1, count);
  if (!soup.normals.empty()) soup.normals.resize(count, glm::vec3(0.0F));
  if (has_colors) {
    colors.resize(count, glm::vec3(1.0F));
    setColors(soup, colors);
  }
  if (textured)
    soup.warnings.push_back(
        "textures and materials are not used; vertex colours stay (bake the texture to vertex colours first)");
  return {};
}

}  // namespace

base::Result<Soup> readObj(base::ByteView bytes) {
  ObjReader reader;
  std::string_view text = textOf(bytes);
  std::string joined;
  while (!text.empty()) {
    ++reader.line_number;
    std::string_view line = nextLine(text);

    // A backslash at the end continues the line.
    if (!line.empty() && line.back() == '\\') {
      joined.assign(line.substr(0, line.size() - 1));
      for (bool more = true; more && !text.empty();) {
        ++reader.line_number;
        line = nextLine(text);
        more = !line.empty() && line.back() == '\\';
        joined.append(" ").append(more ? line.substr(0, line.size() - 1) : line);
      }
      line = joined;
    }
    LUMIGRID_TRY(reader.readLine(line));
  }
  LUMIGRID_TRY(reader.finish());
  if (reader.soup.indices.empty() && reader.soup.short_faces == 0)
    return invalidInput("the file has no faces (a point cloud?); mesh it first");
  return std::move(reader.soup);
}

}  // namespace lod::build
