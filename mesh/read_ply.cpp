#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <optional>

#include "mesh/readers.h"

namespace mesh {
namespace {

// In the order of their names in scalarFromName().
enum class Scalar { kInt8, kUint8, kInt16, kUint16, kInt32, kUint32, kFloat32, kFloat64 };
enum class Encoding { kAscii, kLittle, kBig };

struct Property {
  std::string name;
  Scalar type = Scalar::kInt8;
  bool is_list = false;
  Scalar count_type = Scalar::kUint8;
};

struct Element {
  std::string name;
  std::uint64_t count = 0;
  std::vector<Property> properties;
};

struct Header {
  Encoding encoding = Encoding::kAscii;
  std::vector<Element> elements;
  std::size_t length = 0;             // bytes, end_header line included
  std::vector<std::string> textures;  // the files named, by number
};

// Choices, far above what files of scanners have: they bound what a hostile header costs.
constexpr std::size_t kMaxHeaderBytes = 1 << 20;
constexpr std::size_t kMaxProperties = 4096;

std::size_t sizeOf(Scalar type) {
  constexpr std::array<std::size_t, 8> kSizes{1, 1, 2, 2, 4, 4, 4, 8};
  return kSizes[static_cast<std::size_t>(type)];
}

base::Result<Scalar> scalarFromName(std::string_view name) {
  // Each type has two names.
  constexpr std::array<std::string_view, 16> kNames{"char",   "int8",    "uchar",  "uint8",  "short", "int16",
                                                    "ushort", "uint16",  "int",    "int32",  "uint",  "uint32",
                                                    "float",  "float32", "double", "float64"};
  const auto found = std::find(kNames.begin(), kNames.end(), name);
  if (found == kNames.end()) return invalidInput("header: unknown type " + inQuotes(name));
  return static_cast<Scalar>((found - kNames.begin()) / 2);
}

// ---- Header ----

base::Result<void> parseFormat(std::string_view line, Header& header) {
  const std::string_view name = nextWord(line);
  constexpr std::array<std::string_view, 3> kNames{"ascii", "binary_little_endian", "binary_big_endian"};
  const auto found = std::find(kNames.begin(), kNames.end(), name);
  if (found == kNames.end()) return invalidInput("header: unknown format " + inQuotes(name));
  header.encoding = static_cast<Encoding>(found - kNames.begin());
  return {};
}

base::Result<void> parseElement(std::string_view line, Header& header) {
  Element element;
  element.name = std::string(nextWord(line));
  const std::string_view count = nextWord(line);
  if (element.name.empty() || !parseNumber(count, element.count))
    return invalidInput("header: element " + inQuotes(element.name) + " has the count " + inQuotes(count));
  header.elements.push_back(std::move(element));
  return {};
}

base::Result<void> parseProperty(std::string_view line, Header& header) {
  if (header.elements.empty()) return invalidInput("header: a property stands before the first element");
  Element& element = header.elements.back();
  if (element.properties.size() >= kMaxProperties)
    return invalidInput("header: element " + inQuotes(element.name) + " has too many properties");

  // The line is "property float x" or "property list uchar int vertex_indices".
  Property property;
  std::string_view word = nextWord(line);
  if (word == "list") {
    property.is_list = true;
    word = nextWord(line);
    LUMIGRID_ASSIGN_OR_RETURN(property.count_type, scalarFromName(word));
    word = nextWord(line);
  }
  LUMIGRID_ASSIGN_OR_RETURN(property.type, scalarFromName(word));
  property.name = std::string(nextWord(line));
  element.properties.push_back(std::move(property));
  return {};
}

base::Result<Header> parseHeader(base::ByteView bytes) {
  Header header;
  const std::string_view head = textOf(bytes.first(std::min(bytes.size(), kMaxHeaderBytes)));
  std::string_view text = head;
  if (nextWord(text) != "ply") return invalidInput("not a PLY file: it does not begin with \"ply\"");
  bool has_format = false;
  while (!text.empty()) {
    const bool whole_line = text.find('\n') != std::string_view::npos;
    std::string_view line = nextLine(text);
    const std::string_view full_line = line;
    const std::string_view keyword = nextWord(line);
    if (keyword == "format") {
      LUMIGRID_TRY(parseFormat(line, header));
      has_format = true;
    } else if (keyword == "element" || keyword == "property") {
      LUMIGRID_TRY(keyword == "element" ? parseElement(line, header) : parseProperty(line, header));
    } else if (keyword == "comment") {
      if (nextWord(line) == "TextureFile") {
        skipSpaces(line);
        while (!line.empty() && isSpace(line.back())) line.remove_suffix(1);
        header.textures.emplace_back(line);
      }
    } else if (keyword == "end_header" && whole_line) {
      if (!has_format) return invalidInput("header: the format line is missing");
      header.length = head.size() - text.size();
      return header;
    } else if (!keyword.empty() && keyword != "obj_info") {
      return invalidInput("header: unknown line " + inQuotes(full_line));
    }
  }
  return invalidInput("truncated: the header has no end_header line; get the whole file again");
}

// ---- Sources of scalars: binary and text ----

template <class T>
T loadScalar(const std::uint8_t* data, bool swap) {
  std::array<std::uint8_t, sizeof(T)> raw;
  std::copy_n(data, sizeof(T), raw.begin());
  if (swap) std::reverse(raw.begin(), raw.end());
  return std::bit_cast<T>(raw);
}

// Every PLY scalar fits a double exactly.
double loadAsDouble(const std::uint8_t* data, Scalar type, bool swap) {
  switch (type) {
    case Scalar::kInt8:
      return static_cast<double>(loadScalar<std::int8_t>(data, false));
    case Scalar::kUint8:
      return static_cast<double>(*data);
    case Scalar::kInt16:
      return static_cast<double>(loadScalar<std::int16_t>(data, swap));
    case Scalar::kUint16:
      return static_cast<double>(loadScalar<std::uint16_t>(data, swap));
    case Scalar::kInt32:
      return static_cast<double>(loadScalar<std::int32_t>(data, swap));
    case Scalar::kUint32:
      return static_cast<double>(loadScalar<std::uint32_t>(data, swap));
    case Scalar::kFloat32:
      return static_cast<double>(loadScalar<float>(data, swap));
    case Scalar::kFloat64:
      return loadScalar<double>(data, swap);
  }
  return 0.0;
}

class BinarySource {
 public:
  BinarySource(base::ByteView body, bool swap) : body_(body), swap_(swap) {}

  bool scalar(Scalar type, double& value) {
    const std::size_t size = sizeOf(type);
    if (size > remaining()) return false;
    value = loadAsDouble(at(), type, swap_);
    offset_ += size;
    return true;
  }
  bool skip(Scalar type, std::uint64_t count) {
    if (count > remaining() / sizeOf(type)) return false;
    offset_ += count * sizeOf(type);
    return true;
  }
  /// The least bytes that a scalar takes.
  static std::size_t leastBytes(Scalar type) { return sizeOf(type); }
  std::string badWord() const { return {}; }

  bool swap() const { return swap_; }
  const std::uint8_t* at() const { return body_.data() + offset_; }
  std::size_t remaining() const { return body_.size() - offset_; }
  void advance(std::size_t bytes) { offset_ += bytes; }
  const void* place() const { return at(); }

 private:
  base::ByteView body_;
  std::size_t offset_ = 0;
  bool swap_;
};

class TextSource {
 public:
  explicit TextSource(std::string_view body) : body_(body) {}

  bool scalar(Scalar, double& value) {
    const std::string_view word = nextWord(body_);
    if (parseNumber(word, value)) return true;
    bad_word_ = word;
    return false;
  }
  bool skip(Scalar, std::uint64_t count) {
    for (std::uint64_t i = 0; i < count; ++i)
      if (nextWord(body_).empty()) return false;
    return true;
  }
  static std::size_t leastBytes(Scalar) { return 1; }
  std::size_t remaining() const { return body_.size(); }
  const void* place() const { return body_.data(); }
  /// The word that is not a number; empty where the text ended.
  std::string badWord() const { return bad_word_.empty() ? std::string{} : inQuotes(bad_word_); }

 private:
  std::string_view body_;
  std::string_view bad_word_;
};

// ---- Elements ----

// The vertex properties that are read.
enum Slot { kX, kY, kZ, kNx, kNy, kNz, kRed, kGreen, kBlue, kSlots };

std::optional<Slot> slotFromName(std::string_view name) {
  constexpr std::array<std::string_view, 15> kNames{
      "x", "y", "z", "nx", "ny", "nz", "red", "green", "blue", "diffuse_red", "diffuse_green", "diffuse_blue",
      "r", "g", "b"};
  const auto found = std::find(kNames.begin(), kNames.end(), name) - kNames.begin();
  // The other names of colours come in the same order.
  if (found < kSlots) return static_cast<Slot>(found);
  if (found < std::ssize(kNames)) return static_cast<Slot>(kRed + found % 3);
  return std::nullopt;
}

struct VertexLayout {
  std::array<int, kSlots> property_of;  // −1: absent
  std::array<double, kSlots> scale;     // brings colours to 0..1
  std::array<std::size_t, kSlots> offset;
  std::size_t stride = 0;  // bytes of a binary row; 0 when it has lists
  bool has_normals = false;
  bool has_colors = false;
};

double colorScale(Scalar type) {
  if (type == Scalar::kFloat32 || type == Scalar::kFloat64) return 1.0;
  return type == Scalar::kUint16 ? 1.0 / 65535.0 : 1.0 / 255.0;
}

base::Result<VertexLayout> layoutOf(const Element& element) {
  VertexLayout layout;
  layout.property_of.fill(-1);
  layout.scale.fill(1.0);
  layout.offset.fill(0);
  std::size_t offset = 0;
  bool has_lists = false;
  for (std::size_t p = 0; p < element.properties.size(); ++p) {
    const Property& property = element.properties[p];
    has_lists = has_lists || property.is_list;
    const auto slot = slotFromName(property.name);
    if (slot && !property.is_list && layout.property_of[*slot] < 0) {
      layout.property_of[*slot] = static_cast<int>(p);
      layout.offset[*slot] = offset;
      if (*slot >= kRed) layout.scale[*slot] = colorScale(property.type);
    }
    offset += sizeOf(property.type);
  }
  layout.stride = has_lists ? 0 : offset;
  const auto has = [&](Slot s) { return layout.property_of[s] >= 0; };
  if (!has(kX) || !has(kY) || !has(kZ)) return invalidInput("header: the vertex element has no x, y and z");
  layout.has_normals = has(kNx) && has(kNy) && has(kNz);
  layout.has_colors = has(kRed) && has(kGreen) && has(kBlue);
  return layout;
}

void addVertex(MeshStream& out, const VertexLayout& layout, const std::array<double, kSlots>& v) {
  out.positions.emplace_back(v[kX], v[kY], v[kZ]);
  if (layout.has_normals)
    out.normals.emplace_back(static_cast<float>(v[kNx]), static_cast<float>(v[kNy]), static_cast<float>(v[kNz]));
  if (layout.has_colors)
    out.colors.emplace_back(byteFromUnit(v[kRed] * layout.scale[kRed]), byteFromUnit(v[kGreen] * layout.scale[kGreen]),
                            byteFromUnit(v[kBlue] * layout.scale[kBlue]), 255);
}

std::string placeOf(const Element& element, std::uint64_t row) {
  return element.name + " " + std::to_string(row) + " of " + std::to_string(element.count);
}

template <class Source>
base::Error badRow(const Source& source, const Element& element, std::uint64_t row) {
  const std::string word = source.badWord();
  if (word.empty()) return truncatedIn(placeOf(element, row));
  return invalidInput(element.name + " " + std::to_string(row) + ": " + word + " is not a number");
}

// Refuses counts of rows that the file is too short for, so that a hostile count allocates nothing.
template <class Source>
base::Result<void> checkFits(const Source& source, const Element& element) {
  std::uint64_t row = 0;
  for (const Property& p : element.properties) row += Source::leastBytes(p.is_list ? p.count_type : p.type);
  if (row == 0 || element.count <= source.remaining() / row) return {};
  return truncatedIn(placeOf(element, source.remaining() / row));
}

// Binary rows of equal length are read in place.
base::Result<void> readFixedVertices(BinarySource& source, const Element& element, const VertexLayout& layout,
                                     MeshStream& out) {
  const bool plain = !source.swap() && [&] {
    // The usual row has float x, y and z side by side, and byte colours side by side.
    const auto is = [&](Slot s, Slot first, Scalar type) {
      return element.properties[static_cast<std::size_t>(layout.property_of[s])].type == type &&
             layout.offset[s] == layout.offset[first] + static_cast<std::size_t>(s - first) * sizeOf(type);
    };
    for (const Slot s : {kX, kY, kZ})
      if (!is(s, kX, Scalar::kFloat32)) return false;
    for (const Slot s : {kNx, kNy, kNz})
      if (layout.has_normals && !is(s, kNx, Scalar::kFloat32)) return false;
    for (const Slot s : {kRed, kGreen, kBlue})
      if (layout.has_colors && !is(s, kRed, Scalar::kUint8)) return false;
    return true;
  }();
  for (std::uint64_t i = 0; i < element.count; ++i) {
    const std::uint8_t* row = source.at();
    if (plain) {
      glm::vec3 p;
      std::memcpy(&p, row + layout.offset[kX], sizeof(p));
      out.positions.emplace_back(p);
      if (layout.has_normals) {
        std::memcpy(&p, row + layout.offset[kNx], sizeof(p));
        out.normals.push_back(p);
      }
      if (layout.has_colors) {
        const std::uint8_t* c = row + layout.offset[kRed];
        out.colors.emplace_back(c[0], c[1], c[2], 255);
      }
    } else {
      std::array<double, kSlots> values{};
      for (std::size_t s = 0; s < kSlots; ++s) {
        if (layout.property_of[s] < 0) continue;
        const Property& property = element.properties[static_cast<std::size_t>(layout.property_of[s])];
        values[s] = loadAsDouble(row + layout.offset[s], property.type, source.swap());
      }
      addVertex(out, layout, values);
    }
    source.advance(layout.stride);
    LUMIGRID_TRY(out.flushFullBlocks(source.place()));
  }
  return {};
}

template <class Source>
base::Result<void> skipProperty(Source& source, const Element& element, const Property& property, std::uint64_t row) {
  double count = 1.0;
  if ((property.is_list && (!source.scalar(property.count_type, count) || !(count >= 0.0))) ||
      !source.skip(property.type, static_cast<std::uint64_t>(std::min(count, 1e18))))
    return badRow(source, element, row);
  return {};
}

template <class Source>
base::Result<void> readVertices(Source& source, const Element& element, MeshStream& out) {
  LUMIGRID_ASSIGN_OR_RETURN(auto layout, layoutOf(element));
  if constexpr (std::is_same_v<Source, BinarySource>) {
    if (layout.stride > 0) return readFixedVertices(source, element, layout, out);
  }

  // Text, and rows that hold lists, are read value by value.
  std::vector<int> slot_of(element.properties.size(), -1);
  for (std::size_t s = 0; s < kSlots; ++s)
    if (layout.property_of[s] >= 0) slot_of[static_cast<std::size_t>(layout.property_of[s])] = static_cast<int>(s);
  for (std::uint64_t i = 0; i < element.count; ++i) {
    std::array<double, kSlots> values{};
    for (std::size_t p = 0; p < element.properties.size(); ++p) {
      const Property& property = element.properties[p];
      double value = 0.0;
      if (property.is_list) {
        LUMIGRID_TRY(skipProperty(source, element, property, i));
      } else if (!source.scalar(property.type, value)) {
        return badRow(source, element, i);
      }
      if (slot_of[p] >= 0) values[static_cast<std::size_t>(slot_of[p])] = value;
    }
    addVertex(out, layout, values);
    LUMIGRID_TRY(out.flushFullBlocks(source.place()));
  }
  return {};
}

template <class Source>
base::Result<void> skipElement(Source& source, const Element& element) {
  if (element.properties.empty()) return {};
  for (std::uint64_t i = 0; i < element.count; ++i)
    for (const Property& property : element.properties) LUMIGRID_TRY(skipProperty(source, element, property, i));
  return {};
}

// Stands for −1 in a strip's list of indices, which begins a new strip.
constexpr std::uint64_t kRestart = std::numeric_limits<std::uint64_t>::max();

// Reads how many values a row's list has; they are there, as far as the file's length tells.
template <class Source>
base::Result<std::size_t> readListLength(Source& source, const Element& element, const Property& property,
                                         std::uint64_t row) {
  double count = 0.0;
  if (!source.scalar(property.count_type, count) || !(count >= 0.0)) return badRow(source, element, row);
  if (count > static_cast<double>(source.remaining())) return truncatedIn(placeOf(element, row));
  return static_cast<std::size_t>(count);
}

template <class Source>
base::Result<void> readCorners(Source& source, const Element& element, const Property& property, std::uint64_t row,
                               std::uint64_t vertex_count, bool strips, std::vector<std::uint64_t>& corners) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto count, readListLength(source, element, property, row));
  corners.resize(count);
  for (std::uint64_t& corner : corners) {
    double index = 0.0;
    if (!source.scalar(property.type, index)) return badRow(source, element, row);
    if (strips && index == -1.0) {
      corner = kRestart;
      continue;
    }
    if (!(index >= 0.0) || index >= static_cast<double>(vertex_count) || index != std::floor(index))
      return indexOutOfRange(element.name + " " + std::to_string(row),
                             std::abs(index) < 1e18 ? static_cast<std::int64_t>(index) : -1, vertex_count);
    corner = static_cast<std::uint64_t>(index);
  }
  return {};
}

// Adds the triangles of a strip, of which every other one is wound the other way.
void addStrip(MeshStream& out, const std::vector<std::uint64_t>& corners) {
  std::size_t start = 0;
  for (std::size_t i = 0; i < corners.size(); ++i) {
    if (corners[i] == kRestart) {
      start = i + 1;
      continue;
    }
    if (i < start + 2) continue;
    const bool odd = ((i - start) & 1U) != 0;
    const std::array<std::uint64_t, 3> triangle{corners[i - 2], corners[odd ? i : i - 1], corners[odd ? i - 1 : i]};
    // Strips are joined by triangles with a repeated corner, which are no faces.
    if (triangle[0] != triangle[1] && triangle[1] != triangle[2] && triangle[2] != triangle[0])
      out.corners.insert(out.corners.end(), triangle.begin(), triangle.end());
  }
}

// Reads rows as long as they are of the usual kind, "uchar 3, three 32-bit indices", and returns how many.
std::uint64_t readPlainTriangles(BinarySource& source, const Element& element, std::uint64_t first_row,
                                 std::uint64_t vertex_count, MeshStream& out) {
  std::uint64_t row = first_row;
  const std::uint64_t end = std::min<std::uint64_t>(element.count, first_row + MeshStream::kBlock);
  for (; row < end && source.remaining() >= 13 && *source.at() == 3; ++row) {
    std::array<std::uint32_t, 3> corner;
    for (std::size_t k = 0; k < 3; ++k) corner[k] = loadScalar<std::uint32_t>(source.at() + 1 + 4 * k, source.swap());
    if (corner[0] >= vertex_count || corner[1] >= vertex_count || corner[2] >= vertex_count) break;
    out.corners.insert(out.corners.end(), corner.begin(), corner.end());
    source.advance(13);
  }
  return row - first_row;
}

bool isPlainFace(const Element& element) {
  if (element.properties.size() != 1 || !element.properties[0].is_list) return false;
  const Property& p = element.properties[0];
  return sizeOf(p.count_type) == 1 && (p.type == Scalar::kInt32 || p.type == Scalar::kUint32);
}

bool isFinite(const glm::dvec2& p) {
  return std::isfinite(p.x) && std::isfinite(p.y);
}

// Reads the list of a face's texture coordinates, two for each corner.
template <class Source>
base::Result<void> readUv(Source& source, const Element& element, const Property& property, std::uint64_t row,
                          std::vector<glm::dvec2>& uv) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto count, readListLength(source, element, property, row));
  uv.clear();
  for (std::size_t i = 0; i < count; ++i) {
    double value = 0.0;
    if (!source.scalar(property.type, value)) return badRow(source, element, row);
    if (i % 2 == 0)
      uv.emplace_back(value, 0.0);
    else
      uv.back().y = 1.0 - value;  // PLY's v runs upwards, a picture's rows downwards
  }
  return {};
}

template <class Source>
base::Result<void> readFaces(Source& source, const Element& element, bool strips, std::uint64_t vertex_count,
                             const Header& header, MeshStream& out) {
  const auto is_corners = [](const Property& p) {
    return p.is_list && (p.name == "vertex_indices" || p.name == "vertex_index");
  };
  if (std::none_of(element.properties.begin(), element.properties.end(), is_corners))
    return invalidInput("header: the " + element.name + " element has no vertex_indices list");

  [[maybe_unused]] const bool plain = isPlainFace(element) && !strips;  // used by binary sources
  const auto is_uv = [](const Property& p) { return p.is_list && p.name == "texcoord"; };
  const bool has_uv = std::any_of(element.properties.begin(), element.properties.end(), is_uv);
  const bool textured = !header.textures.empty() && has_uv && !strips;
  // A file of several pictures numbers them by face; the texcoord list may come first.
  double number = 0.0;
  if (!header.textures.empty() && !has_uv)
    out.summary.warnings.push_back(
        "textures are not used, since its faces have no texcoord list; vertex colours stay (bake the texture to vertex "
        "colours first)");
  std::vector<glm::dvec2> uv;
  std::vector<std::uint64_t> corners;
  for (std::uint64_t row = 0; row < element.count; ++row) {
    if constexpr (std::is_same_v<Source, BinarySource>) {
      if (plain) {
        if (const std::uint64_t read = readPlainTriangles(source, element, row, vertex_count, out); read > 0) {
          row += read - 1;
          LUMIGRID_TRY(out.flushFullBlocks(source.place()));
          continue;
        }
      }
    }
    for (const Property& property : element.properties) {
      if (is_corners(property)) {
        LUMIGRID_TRY(readCorners(source, element, property, row, vertex_count, strips, corners));
      } else if (textured && is_uv(property)) {
        LUMIGRID_TRY(readUv(source, element, property, row, uv));
      } else if (textured && !property.is_list && property.name == "texnumber") {
        if (!source.scalar(property.type, number)) return badRow(source, element, row);
      } else {
        LUMIGRID_TRY(skipProperty(source, element, property, row));
      }
    }
    if (strips) {
      addStrip(out, corners);
    } else {
      std::uint32_t picture = kNoPicture;
      const bool complete = uv.size() == corners.size() && std::all_of(uv.begin(), uv.end(), isFinite);
      if (textured && complete && number >= 0.0 && number < static_cast<double>(header.textures.size())) {
        const std::string& name = header.textures[static_cast<std::size_t>(number)];
        picture = out.textures.find({out.textures.pathOf(name), 0, 0}, uv, out.summary.warnings);
      }
      if (picture != kNoPicture)
        out.addTextured(corners, {}, uv, picture);
      else
        out.addPolygon(corners);
    }
    LUMIGRID_TRY(out.flushFullBlocks(source.place()));
  }
  return {};
}

template <class Source>
base::Result<void> readBody(Source source, const Header& header, std::uint64_t vertex_count, MeshStream& out) {
  for (const Element& element : header.elements) {
    LUMIGRID_TRY(checkFits(source, element));
    if (element.name == "vertex") {
      LUMIGRID_TRY(readVertices(source, element, out));
    } else if (element.name == "face" || element.name == "tristrips") {
      LUMIGRID_TRY(readFaces(source, element, element.name == "tristrips", vertex_count, header, out));
    } else {
      LUMIGRID_TRY(skipElement(source, element));
    }
  }
  return out.flush(source.place());
}

}  // namespace

base::Result<void> readPly(base::ByteView bytes, MeshStream& out) {
  LUMIGRID_ASSIGN_OR_RETURN(auto header, parseHeader(bytes));

  // Faces may stand before the vertices, so the number of vertices is taken from the header.
  std::uint64_t vertex_count = 0;
  int vertex_elements = 0;
  bool has_faces = false;
  for (const Element& element : header.elements) {
    if (element.name == "vertex") vertex_count = element.count, ++vertex_elements;
    has_faces = has_faces || ((element.name == "face" || element.name == "tristrips") && element.count > 0);
  }
  if (vertex_elements != 1) return invalidInput("header: there is not exactly one vertex element");
  if (!has_faces && !out.accepts_points) return lacksFaces(vertex_count);

  out.leaves_out_unplaced = !has_faces;
  const base::ByteView body = bytes.subspan(header.length);
  if (header.encoding == Encoding::kAscii)
    LUMIGRID_TRY(readBody(TextSource(textOf(body)), header, vertex_count, out));
  else
    LUMIGRID_TRY(readBody(BinarySource(body, header.encoding == Encoding::kBig), header, vertex_count, out));
  if (out.unplaced == 0) return {};
  if (out.vertexCount() == 0) return invalidInput("none of its points has a finite place");
  out.summary.warnings.push_back(std::to_string(out.unplaced) +
                                 " of its points are left out, since their places are not finite (NaN or infinite)");
  return {};
}

}  // namespace mesh
