#include <array>
#include <limits>

#include "mesh/readers.h"

namespace mesh {
namespace {

struct Layout {
  bool texture = false;
  bool color = false;
  bool normal = false;
};

// The keyword is "[ST][C][N]OFF". Homogeneous (4) and n-dimensional (n) forms have no meaning for a scan.
base::Result<Layout> layoutFromKeyword(std::string_view keyword) {
  Layout layout;
  std::string_view rest = keyword;
  const auto skipPrefix = [&](std::string_view prefix) {
    if (rest.substr(0, prefix.size()) != prefix) return false;
    rest.remove_prefix(prefix.size());
    return true;
  };
  layout.texture = skipPrefix("ST");
  layout.color = skipPrefix("C");
  layout.normal = skipPrefix("N");
  if (rest == "4OFF" || rest == "nOFF" || rest == "4nOFF")
    return unsupported(inQuotes(keyword) + " is not read (only three coordinates are)");
  if (rest != "OFF") return invalidInput("not an OFF file: it begins with " + inQuotes(keyword));
  return layout;
}

class OffReader {
 public:
  OffReader(std::string_view text, MeshStream& out) : text_(text), out_(out) {}

  base::Result<void> read() {
    LUMIGRID_TRY(readCounts());
    if (face_count_ == 0 && (vertex_count_ == 0 || !out_.accepts_points)) return lacksFaces(vertex_count_);
    LUMIGRID_TRY(readVertices());
    LUMIGRID_TRY(readFaces());
    if (layout_.texture)
      out_.summary.warnings.push_back(
          "textures are not used; vertex colours stay (bake the texture to vertex colours first)");
    return out_.flush(text_.data());
  }

 private:
  /// Finds the next line that holds more than a comment; false at the end.
  bool nextFullLine(std::string_view& line) {
    while (!text_.empty()) {
      ++line_number_;
      line = nextLine(text_);
      line = line.substr(0, line.find('#'));
      std::string_view probe = line;
      if (!nextWord(probe).empty()) return true;
    }
    return false;
  }

  /// The next word, of a later line where this one has no more: a face may go over several lines. Empty at the end.
  std::string_view nextWordOnAnyLine(std::string_view& line) {
    std::string_view word = nextWord(line);
    while (word.empty() && nextFullLine(line)) word = nextWord(line);
    return word;
  }

  std::string place() const { return "line " + std::to_string(line_number_); }

  base::Result<void> readCounts() {
    std::string_view line;
    if (!nextFullLine(line)) return truncatedIn("the header");
    LUMIGRID_ASSIGN_OR_RETURN(layout_, layoutFromKeyword(nextWord(line)));

    // The counts may stand on the keyword's own line.
    std::string_view word = nextWord(line);
    if (word == "BINARY") return unsupported("binary OFF is not read; write it as text or as PLY");
    if (word.empty()) {
      if (!nextFullLine(line)) return truncatedIn("the header");
      word = nextWord(line);
    }
    const std::string_view faces = nextWord(line);
    if (!parseNumber(word, vertex_count_) || !parseNumber(faces, face_count_))
      return invalidInput(place() + ": the numbers of vertices and faces are missing");

    // The shortest vertex is "0 0 0", the shortest face "0".
    if (vertex_count_ > text_.size() / 5 + 1) return truncatedIn("vertex " + std::to_string(text_.size() / 5));
    if (face_count_ > text_.size()) return truncatedIn("face " + std::to_string(text_.size()));
    return {};
  }

  base::Result<void> readVertices() {
    const std::string_view begin = text_;
    const std::uint64_t begin_line = line_number_;
    TextColors colors;
    for (std::uint64_t i = 0; i < vertex_count_; ++i) {
      std::string_view line;
      if (!nextFullLine(line))
        return truncatedIn("vertex " + std::to_string(i) + " of " + std::to_string(vertex_count_));
      std::array<double, 12> n{};
      std::size_t count = 0;
      for (std::string_view word = nextWord(line); !word.empty() && count < n.size(); word = nextWord(line), ++count)
        if (!parseNumber(word, n[count])) return invalidInput(place() + ": " + inQuotes(word) + " is not a number");

      // A line holds the position, then the normal, then the colour, whose alpha may be missing.
      const std::size_t color_at = layout_.normal ? 6 : 3;
      const std::size_t needed = layout_.color ? color_at + 3 : color_at;
      if (count < needed) return truncatedIn("vertex " + std::to_string(i) + " of " + std::to_string(vertex_count_));
      out_.positions.emplace_back(n[0], n[1], n[2]);
      if (layout_.normal) out_.normals.emplace_back(glm::dvec3(n[3], n[4], n[5]));
      if (layout_.color) out_.colors.push_back(colors.color({n[color_at], n[color_at + 1], n[color_at + 2]}));
      if (colors.mustRestart()) {
        LUMIGRID_TRY(out_.restart());
        text_ = begin, line_number_ = begin_line;
        i = std::numeric_limits<std::uint64_t>::max();  // the loop goes on with 0
      } else {
        LUMIGRID_TRY(out_.flushFullBlocks(text_.data()));
      }
    }
    return {};
  }

  base::Result<void> readFaces() {
    std::vector<std::uint64_t> corners;
    for (std::uint64_t i = 0; i < face_count_; ++i) {
      const std::string face = "face " + std::to_string(i);
      std::string_view line;
      if (!nextFullLine(line)) return truncatedIn(face + " of " + std::to_string(face_count_));
      std::uint64_t count = 0;
      const std::string_view word = nextWord(line);
      if (!parseNumber(word, count))
        return invalidInput(place() + ": " + inQuotes(word) + " is not a number of corners");
      if (count > line.size() + text_.size()) return truncatedIn(face + " of " + std::to_string(face_count_));
      corners.clear();
      for (std::uint64_t k = 0; k < count; ++k) {
        const std::string_view index_word = nextWordOnAnyLine(line);
        if (index_word.empty()) return truncatedIn(face + " of " + std::to_string(face_count_));
        std::int64_t index = 0;
        if (!parseNumber(index_word, index))
          return invalidInput(face + ": " + inQuotes(index_word) + " is not an index");
        if (index < 0 || static_cast<std::uint64_t>(index) >= vertex_count_)
          return indexOutOfRange(face, index, vertex_count_);
        corners.push_back(static_cast<std::uint64_t>(index));
      }
      out_.addPolygon(corners);
      LUMIGRID_TRY(out_.flushFullBlocks(text_.data()));
    }
    return {};
  }

  std::string_view text_;
  std::uint64_t line_number_ = 0;
  Layout layout_;
  std::uint64_t vertex_count_ = 0;
  std::uint64_t face_count_ = 0;
  MeshStream& out_;
};

}  // namespace

base::Result<void> readOff(base::ByteView bytes, MeshStream& out) {
  return OffReader(textOf(bytes), out).read();
}

}  // namespace mesh
