#include "mesh/crs_text.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <optional>
#include <vector>

#include "mesh/mesh_stream.h"

namespace mesh {
namespace {

// Longer than any name of EPSG's register, and short enough for a line on a screen.
constexpr std::size_t kMaxName = 80;

/// KEYWORD[value, value, NODE[...], ...], a node of well-known text. All nodes lie in one list, parents first.
struct WktNode {
  std::string_view keyword;
  std::size_t parent = 0;
  std::vector<std::string_view> values;  // without their quotes
};

// A choice: systems have some dozens of nodes, and a hostile text gets no more memory than this.
constexpr std::size_t kMaxNodes = 4096;

std::vector<WktNode> parseNodes(std::string_view text) {
  std::vector<WktNode> nodes(1);  // the root, which holds the outermost nodes
  std::size_t inside = 0;
  std::string_view word;
  const auto endWord = [&] {
    if (!word.empty()) nodes[inside].values.push_back(word);
    word = {};
  };
  for (std::size_t at = 0; at < text.size() && nodes.size() < kMaxNodes; ++at) {
    const char c = text[at];
    if (c == '"') {
      const std::size_t end = std::min(text.find('"', at + 1), text.size());
      nodes[inside].values.push_back(text.substr(at + 1, end - at - 1));
      at = end;
    } else if (c == '[' || c == '(') {
      nodes.push_back({word, inside, {}});
      inside = nodes.size() - 1;
      word = {};
    } else if (c == ']' || c == ')') {
      endWord();
      inside = nodes[inside].parent;
    } else if (c == ',' || c == '\0' || isSpace(c)) {
      endWord();
    } else {
      word = text.substr(at - word.size(), word.size() + 1);
    }
  }
  return nodes;
}

bool isOneOf(std::string_view word, std::initializer_list<std::string_view> words) {
  return std::find(words.begin(), words.end(), word) != words.end();
}

// The place of the first node with such a keyword below `parent`, or anywhere without one; 0 where there is none.
std::size_t findNode(const std::vector<WktNode>& nodes, std::initializer_list<std::string_view> keywords,
                     std::optional<std::size_t> parent = std::nullopt) {
  for (std::size_t i = 1; i < nodes.size(); ++i)
    if ((!parent || nodes[i].parent == *parent) && isOneOf(nodes[i].keyword, keywords)) return i;
  return 0;
}

std::string nameFrom(std::string_view text) {
  std::string name;
  for (const char c : text.substr(0, kMaxName)) name += c >= ' ' && c <= '~' ? c : '?';
  return name;
}

// Authority and code as one word; empty where either is no plain word.
std::string codeFrom(std::string_view authority, std::string_view code) {
  constexpr std::size_t kMaxWord = 24;  // together they fit what scene.json keeps
  const auto isPlain = [](std::string_view word) {
    return !word.empty() && word.size() <= kMaxWord && std::all_of(word.begin(), word.end(), [](char c) {
      return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '.';
    });
  };
  const bool begins_with_letter = !authority.empty() && authority.front() > '9';
  if (!isPlain(authority) || !isPlain(code) || !begins_with_letter) return {};
  return std::string(authority) + ":" + std::string(code);
}

std::string unitFrom(std::string_view name, double metres) {
  const auto is = [metres](double length) { return std::abs(metres - length) < 1e-9; };
  if (is(1.0)) return "m";
  if (is(0.3048)) return "ft";
  if (is(1200.0 / 3937.0)) return "us-ft";  // PROJ's name
  constexpr std::size_t kMaxUnit = 32;      // as many bytes as viewers are told
  return nameFrom(name.substr(0, kMaxUnit));
}

}  // namespace

CrsDescription crsFromWellKnownText(std::string_view text) {
  const std::vector<WktNode> nodes = parseNodes(text);
  CrsDescription crs;
  std::size_t system = findNode(nodes, {"PROJCS", "PROJCRS", "PROJECTEDCRS"});
  if (system == 0) {
    system = findNode(nodes, {"GEOGCS", "GEOGCRS", "GEOGRAPHICCRS"});
    crs.has_degrees = system != 0;
  }
  if (system == 0) system = findNode(nodes, {"LOCAL_CS", "ENGCRS", "ENGINEERINGCRS", "GEOCCS", "GEODCRS"});
  if (system == 0) return crs;

  if (!nodes[system].values.empty()) crs.name = nameFrom(nodes[system].values[0]);
  const std::size_t id = findNode(nodes, {"AUTHORITY", "ID"}, system);
  if (id != 0 && nodes[id].values.size() >= 2) crs.code = codeFrom(nodes[id].values[0], nodes[id].values[1]);
  if (crs.has_degrees) return crs;

  // A unit stands in the system itself, or else in its first axis.
  std::size_t unit = findNode(nodes, {"UNIT", "LENGTHUNIT"}, system);
  if (const std::size_t axis = findNode(nodes, {"AXIS"}, system); unit == 0 && axis != 0)
    unit = findNode(nodes, {"UNIT", "LENGTHUNIT"}, axis);
  double metres = 0.0;
  if (unit != 0 && nodes[unit].values.size() >= 2 && parseNumber(nodes[unit].values[1], metres))
    crs.unit = unitFrom(nodes[unit].values[0], metres);
  return crs;
}

CrsDescription crsFromGeoKeys(base::ByteView directory, std::string_view names) {
  // Each key has four numbers: its name, the tag that holds its value (0: it is the last number), a count, an offset.
  base::ByteReader in(directory);
  in.bytes(6);  // versions
  std::uint16_t projected = 0, geographic = 0, unit = 0;
  CrsDescription crs;
  for (std::uint16_t left = in.u16(); left > 0; --left) {
    const std::uint16_t key = in.u16(), tag = in.u16(), count = in.u16(), value = in.u16();
    if (!in.ok()) break;
    if (tag == 0 && key == 2048) geographic = value;
    if (tag == 0 && key == 3072) projected = value;
    if (tag == 0 && key == 3076) unit = value;
    const bool is_name = key == 1026 || key == 3073;
    if (tag == 34737 && is_name && value < names.size()) {
      std::string_view name = names.substr(value, count);
      name = name.substr(0, name.find_first_of(std::string_view("|\0", 2)));
      if (crs.name.empty() || key == 3073) crs.name = nameFrom(name);
    }
  }

  // 0 is "undefined" and 32767 "as other keys say".
  const auto isCode = [](std::uint16_t value) { return value > 0 && value < 32767; };
  crs.has_degrees = projected == 0 && isCode(geographic);
  if (isCode(projected)) crs.code = "EPSG:" + std::to_string(projected);
  if (crs.has_degrees) crs.code = "EPSG:" + std::to_string(geographic);
  if (unit >= 9001 && unit <= 9003 && !crs.has_degrees) crs.unit = unit == 9001 ? "m" : unit == 9002 ? "ft" : "us-ft";
  return crs;
}

}  // namespace mesh
