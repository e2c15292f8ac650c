#pragma once
// The stream that mesh readers write to, and the small tools that they share.
#include <charconv>
#include <cmath>
#include <cstdint>
#include <functional>
#include <glm/glm.hpp>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "mesh/stream_mesh.h"
#include "mesh/texture.h"

namespace mesh {

inline base::Error invalidInput(std::string message) {
  return {base::ErrorCode::kInvalidInput, std::move(message)};
}
inline base::Error unsupported(std::string message) {
  return {base::ErrorCode::kUnsupported, std::move(message)};
}
inline base::Error indexOutOfRange(const std::string& place, std::int64_t index, std::uint64_t vertex_count) {
  return invalidInput(place + ": index " + std::to_string(index) + " is out of range (" + std::to_string(vertex_count) +
                      " vertices)");
}
inline base::Error truncatedIn(const std::string& place) {
  return invalidInput("truncated: the file ends in " + place + "; get the whole file again");
}
/// For a file without faces where MeshStream::accepts_points does not hold. Without vertices either it is no cloud.
inline base::Error lacksFaces(std::uint64_t vertices) {
  if (vertices == 0) return invalidInput("the file has neither faces nor points");
  return unsupported(kOnlyPoints);
}

/// Readers append to its vectors. It hands full blocks to the sink and releases the pages of the mapped file that have
/// been read, so that memory stays bounded whatever the file's length.
class MeshStream {
 public:
  /// `file` is the whole mapped file and `path` its name, beside which textures lie. `progress` gets the share read,
  /// and cancels by false; it may be empty.
  MeshStream(MeshSink& sink, base::ByteView file, const std::string& path, std::function<bool(double)> progress)
      : textures(path), sink_(sink), file_(file), progress_(std::move(progress)) {
    positions.reserve(kBlock);
    corners.reserve(3 * kBlock);
  }

  std::vector<glm::dvec3> positions;  ///< positions of the block being filled
  std::vector<glm::vec3> normals;     ///< empty, or as many
  std::vector<glm::u8vec4> colors;    ///< empty, or as many
  std::vector<std::uint64_t> corners;
  std::vector<glm::vec3> corner_normals;   ///< empty, or as many as corners
  std::vector<glm::u8vec4> corner_colors;  ///< empty, or as many as corners; a = 0 where unknown
  std::vector<glm::vec2> corner_uv;        ///< empty, or as many as corners
  std::vector<std::uint32_t> pictures;     ///< empty, or one per triangle
  StreamedFile summary;                    ///< of the blocks handed to the sink; short faces and warnings so far
  bool accepts_points = false;             ///< a file of vertices without faces is no error
  /// Points whose place is not finite are left out and counted in `unplaced`: cameras of depth write a row of them for
  /// what they did not see. Not for meshes, whose triangles name vertices by number.
  bool leaves_out_unplaced = false;
  std::uint64_t unplaced = 0;
  glm::dvec3 origin{0.0};     ///< is added to all positions
  bool reads_points = false;  ///< readers of glTF and 3D Tiles read points, and no triangles
  Textures textures;
  TextureBaker baker;

  std::uint64_t vertexCount() const { return summary.vertices + positions.size(); }
  std::uint64_t triangleCount() const { return summary.triangles + corners.size() / 3; }

  /// Adds the polygon as a fan around its first corner. Its corners have been checked. `its_normals` and `its_colors`
  /// are empty, or hold one per corner.
  void addPolygon(std::span<const std::uint64_t> polygon, std::span<const glm::vec3> its_normals = {},
                  std::span<const glm::u8vec4> its_colors = {}) {
    if (polygon.size() < 3) {
      ++summary.short_faces;
      return;
    }
    // Where attributes begin in the middle of a block, those of the corners before are unknown.
    if (!its_normals.empty() || !corner_normals.empty()) corner_normals.resize(corners.size(), glm::vec3(0.0F));
    if (!its_colors.empty() || !corner_colors.empty()) corner_colors.resize(corners.size(), glm::u8vec4(0));
    for (std::size_t i = 2; i < polygon.size(); ++i) {
      corners.insert(corners.end(), {polygon[0], polygon[i - 1], polygon[i]});
      if (!its_normals.empty())
        corner_normals.insert(corner_normals.end(), {its_normals[0], its_normals[i - 1], its_normals[i]});
      if (!its_colors.empty())
        corner_colors.insert(corner_colors.end(), {its_colors[0], its_colors[i - 1], its_colors[i]});
    }
  }
  /// Adds a polygon with a texture: each corner has its place `uv` in the picture, as TriangleBlock has it. The
  /// corners' colours are the picture's.
  void addTextured(std::span<const std::uint64_t> polygon, std::span<const glm::vec3> its_normals,
                   std::span<const glm::dvec2> uv, std::uint32_t picture);
  /// Hands full blocks to the sink. Readers call it after each element, with the place in the file that they reached.
  base::Result<void> flushFullBlocks(const void* at) { return isFull() ? flush(at) : base::Result<void>(); }
  base::Result<void> flush(const void* at);
  bool isFull() const { return positions.size() >= kBlock || corners.size() >= 3 * kBlock; }
  /// Hands what there is to the sink. Readers that do not go through the file from front to back call it in place of
  /// flush(), and report(): no page is released.
  base::Result<void> handOver();
  /// Reports which share of the source has been read, 0..1; an error where that cancels.
  base::Result<void> report(double share);
  /// Drops all that was read of the file so far, since it was read the wrong way.
  base::Result<void> restart();

  static constexpr std::size_t kBlock = std::size_t{1} << 16;

 private:
  void clearBlocks();
  void leaveOutUnplaced();
  MeshSink& sink_;
  base::ByteView file_;
  std::function<bool(double)> progress_;
  std::size_t dropped_ = 0;
  double reported_ = 0.0;
  std::vector<glm::u8vec4> baked_;
};

/// A colour component in 0..1 as a byte; larger values are clamped, and NaN becomes 0.
inline std::uint8_t byteFromUnit(double value) {
  if (!(value > 0.0)) return 0;
  return value >= 1.0 ? std::uint8_t{255} : static_cast<std::uint8_t>(value * 255.0 + 0.5);
}

/// A share of light, 0..1, as sRGB codes it (IEC 61966-2-1); glTF's vertex colours and factors are such shares.
inline double srgbFromLinear(double v) {
  return v <= 0.0031308 ? 12.92 * v : 1.055 * std::pow(v, 1.0 / 2.4) - 0.055;
}

/// Text formats write colours as 0..1 or as 0..255 without saying which. One component above 1 anywhere means 0..255,
/// so a reader assumes 0..1 until it meets such a component, and then starts the file again.
class TextColors {
 public:
  glm::u8vec4 color(const glm::dvec3& given);
  /// True once, after colours have been read as 0..1 that were not: the file must be read again.
  bool mustRestart();

 private:
  bool bytes_ = false;
  bool seen_ = false;  // colours were read as 0..1
  bool wrong_ = false;
};

using base::textOf;

inline bool isSpace(char c) {
  return c == ' ' || (c >= '\t' && c <= '\r');
}

/// Removes spaces from the front of `text`; false when nothing is left.
inline bool skipSpaces(std::string_view& text) {
  std::size_t begin = 0;
  while (begin < text.size() && isSpace(text[begin])) ++begin;
  text.remove_prefix(begin);
  return !text.empty();
}

/// Removes UTF-8's byte order mark, with which programs on Windows begin files, from the front of `text`.
inline void skipMark(std::string_view& text) {
  constexpr std::string_view kMark = "\xEF\xBB\xBF";
  if (text.substr(0, kMark.size()) == kMark) text.remove_prefix(kMark.size());
}

/// Whether the text begins as a JSON object does.
inline bool looksLikeJson(std::string_view text) {
  skipMark(text);
  return skipSpaces(text) && text.front() == '{';
}

/// Removes the next word from the front of `text` and returns it; empty when none is left.
inline std::string_view nextWord(std::string_view& text) {
  skipSpaces(text);
  std::size_t end = 0;
  while (end < text.size() && !isSpace(text[end])) ++end;
  std::string_view word = text.substr(0, end);
  text.remove_prefix(end);
  return word;
}

/// Removes all of `text` and returns it without spaces around: a name that may have some within.
inline std::string_view restOfLine(std::string_view& text) {
  skipSpaces(text);
  std::string_view rest = text;
  text = {};
  while (!rest.empty() && isSpace(rest.back())) rest.remove_suffix(1);
  return rest;
}

/// Removes the next line from the front of `text` and returns it without its "\n" or "\r\n".
inline std::string_view nextLine(std::string_view& text) {
  const std::size_t end = text.find('\n');
  std::string_view line = text.substr(0, end);
  text.remove_prefix(end == std::string_view::npos ? text.size() : end + 1);
  if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
  return line;
}

/// Reads a decimal without an exponent from the front of `text` and returns how many characters it has. It must have so
/// few digits that its whole number and the power of ten below it are both exact doubles, so that the quotient is
/// rounded correctly (Clinger 1990, "How to read floating point numbers accurately"). Returns 0 where there is no such
/// decimal: std::from_chars reads all others.
inline std::size_t leadingDecimal(std::string_view text, double& value) {
  static constexpr double kTens[] = {1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,  1e7,  1e8, 1e9,
                                     1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18};
  constexpr std::size_t kMaxDigits = 18;
  const bool negative = !text.empty() && text.front() == '-';
  std::size_t at = negative ? 1 : 0;
  std::uint64_t whole = 0;
  std::size_t digits = 0;
  std::size_t point = 0;  // how many digits stand before it
  bool pointed = false;
  for (; at < text.size(); ++at) {
    const char c = text[at];
    if (c >= '0' && c <= '9') {
      if (++digits > kMaxDigits) return 0;
      whole = 10 * whole + static_cast<std::uint64_t>(c - '0');
    } else if (c == '.' && !pointed) {
      pointed = true;
      point = digits;
    } else {
      break;
    }
  }
  if (digits == 0 || whole > std::uint64_t{1} << 53) return 0;
  if (at < text.size() && !isSpace(text[at])) return 0;
  const double size = static_cast<double>(whole) / kTens[pointed ? digits - point : 0];
  value = negative ? -size : size;
  return at;
}

/// Reads the whole word as a number; false when it is none.
template <class T>
bool parseNumber(std::string_view word, T& value) {
  if constexpr (std::is_same_v<T, double>)
    if (leadingDecimal(word, value) == word.size() && !word.empty()) return true;
  if (!word.empty() && word.front() == '+') word.remove_prefix(1);
  const auto [end, error] = std::from_chars(word.data(), word.data() + word.size(), value);
  return error == std::errc{} && end == word.data() + word.size();
}

/// Counts the digits that the word begins with, up to 18, which never overflow `value`, and reads them.
inline std::size_t leadingDigits(std::string_view word, std::int64_t& value) {
  constexpr std::size_t kMax = 18;
  std::size_t count = 0;
  value = 0;
  for (; count < word.size() && count < kMax && word[count] >= '0' && word[count] <= '9'; ++count)
    value = 10 * value + (word[count] - '0');
  return count;
}

/// A word from a file in quotes, fit for an error line: cut to 40 characters, unprintable bytes replaced.
std::string inQuotes(std::string_view word);

}  // namespace mesh
