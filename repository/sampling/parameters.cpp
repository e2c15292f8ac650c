#include "repository/sampling/parameters.h"

#include <nlohmann/json.hpp>
#include <sstream>
#include <string_view>
#include <utility>

#include "base/json/parse.h"

namespace repository {
namespace {

using nlohmann::json;

constexpr const char* kTree = ",\n\"tree\": \"";
constexpr const char* kTiles = ",\n\"tiles\": \"";
constexpr const char* kEnd = "\n}\n";

/// Reads an array of three numbers; false when there is none.
template <class Vector>
bool readVector(const json& parent, const char* key, Vector& v) {
  const auto it = parent.find(key);
  if (it == parent.end() || !it->is_array() || it->size() != 3) return false;
  for (int axis = 0; axis < 3; ++axis) {
    const json& number = (*it)[static_cast<std::size_t>(axis)];
    if (std::is_integral_v<typename Vector::value_type> ? !number.is_number_unsigned() : !number.is_number())
      return false;
    v[axis] = number.get<typename Vector::value_type>();
  }
  return true;
}

std::string withLine(const std::string& text, const char* name, base::ByteView bytes) {
  return text.substr(0, text.rfind(kEnd)) + name + base::hexOf(bytes) + "\"" + kEnd;
}

std::string withoutLinesFrom(const std::string& text, const char* name) {
  const std::size_t at = text.find(name);
  return at == std::string::npos ? text : text.substr(0, at) + kEnd;
}

/// The bytes of a line that withLine() added: nothing where there is no such line, and none where it is damaged.
std::optional<base::Bytes> bytesOfLine(const std::string& text, const char* name) {
  std::size_t begin = text.find(name);
  if (begin == std::string::npos) return std::nullopt;
  begin += std::string_view(name).size();
  const std::size_t end = text.find('"', begin);
  const auto bytes = base::bytesOfHex(std::string_view(text).substr(begin, end == std::string::npos ? 0 : end - begin));
  return bytes ? *bytes : base::Bytes();
}

/// The part that a line holds, a SampleTree or WantedTiles; nothing where there is no such line.
template <class Part>
base::Result<std::optional<Part>> partFromLine(const std::string& text, const char* line, const Grid& grid,
                                               const std::string& name) {
  const auto bytes = bytesOfLine(text, line);
  if (!bytes) return std::optional<Part>();
  auto part = Part::decode(grid, *bytes);
  if (part) return std::optional(std::move(*part));
  base::Error error = base::within(name, part.error());
  error.message += "; build the images again with `lumigrid build --force`";
  return error;
}

}  // namespace

base::Result<Grid> gridFromMeta(const std::string& meta, const std::string& name) {
  const base::Error wrong{
      base::ErrorCode::kInvalidInput,
      name + ": the repository's parameters hold no valid grid; build the images again with `lumigrid build`"};
  const json root = base::parseJson(base::viewOfText(meta));
  if (!root.is_object() || !root.contains("grid") || !root["grid"].is_object()) return wrong;
  const json& object = root["grid"];
  Grid grid;
  if (!readVector(object, "first", grid.first) || !readVector(object, "count", grid.count)) return wrong;
  const auto spacing = object.find("spacing");
  const auto face_size = object.find("face_size");
  if (spacing == object.end() || !spacing->is_number() || face_size == object.end() || !face_size->is_number_unsigned())
    return wrong;
  grid.spacing = spacing->get<float>();
  grid.face_size = face_size->get<std::uint32_t>();
  if (const auto depth = object.find("tile_depth"); depth != object.end()) {
    if (!depth->is_number_unsigned()) return wrong;
    grid.tile_depth = depth->get<std::uint32_t>();
  }

  // Grid::decode holds the only checks of a grid's values, so the grid passes through it.
  base::ByteWriter out;
  grid.encode(out);
  base::ByteReader in(out.view());
  auto checked = Grid::decode(in);
  return checked ? std::move(checked) : base::within(name, checked.error());
}

std::string withTree(const std::string& parameters, const SampleTree& tree) {
  return withLine(parameters, kTree, tree.encode());
}

std::string withTiles(const std::string& text, const Grid& grid, const WantedTiles& tiles) {
  return withLine(text, kTiles, tiles.encode(grid));
}

std::string withoutSelection(const std::string& text) {
  return withoutLinesFrom(text, kTree);
}

std::string withoutTiles(const std::string& text) {
  return withoutLinesFrom(text, kTiles);
}

std::string publishedParameters(const std::string& meta) {
  const auto points = sampledPointsFromMeta(meta, "");
  if (!points || !points->tree) return withoutTiles(meta);
  return withLine(withoutSelection(meta), kTree, points->tree->encode(SampleTree::Form::kPublished));
}

base::Result<std::optional<SampleTree>> treeFromText(const std::string& text, const Grid& grid,
                                                     const std::string& name) {
  return partFromLine<SampleTree>(text, kTree, grid, name);
}

base::Result<std::optional<WantedTiles>> tilesFromText(const std::string& text, const Grid& grid,
                                                       const std::string& name) {
  return partFromLine<WantedTiles>(text, kTiles, grid, name);
}

std::string codecFromMeta(const std::string& meta) {
  const json root = base::parseJson(base::viewOfText(meta));
  const auto codec = root.is_object() ? root.find("codec") : root.end();
  return codec != root.end() && codec->is_string() ? codec->get<std::string>() : "jpeg";
}

base::Result<SampledPoints> sampledPointsFromMeta(const std::string& meta, const std::string& name) {
  LUMIGRID_ASSIGN_OR_RETURN(auto grid, gridFromMeta(meta, name));
  LUMIGRID_ASSIGN_OR_RETURN(auto tree, treeFromText(meta, grid, name));
  return SampledPoints{grid, std::move(tree)};
}

std::string firstDifference(const std::string& stored, const std::string& wanted) {
  std::istringstream a(withoutSelection(stored));
  std::istringstream b(withoutSelection(wanted));
  std::string line_a;
  std::string line_b;
  while (std::getline(a, line_a) && std::getline(b, line_b)) {
    for (std::string* line : {&line_a, &line_b}) {
      if (line->ends_with(',')) line->pop_back();
    }
    if (line_a == line_b) continue;
    if (line_a == "}") return "nothing said of " + line_b;
    return line_a + (line_b == "}" ? ", now nothing said of it" : ", now " + line_b);
  }
  return "other sampling points";
}

}  // namespace repository
