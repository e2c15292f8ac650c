// PTX point clouds: scans as text, each a grid of points as seen from its scanner, behind ten lines that say how many
// there are and where the scanner stood.
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "mesh/greys.h"
#include "mesh/readers.h"

namespace mesh {
namespace {

constexpr std::size_t kShortestPoint = 8;  // bytes: "0 0 0 0" and the line's end

class PtxReader {
 public:
  PtxReader(std::string_view text, MeshStream& out) : text_(text), whole_(text), out_(out) {}
  base::Result<void> read();

 private:
  std::string place() const { return "line " + std::to_string(line_number_); }
  bool nextFullLine(std::string_view& line);
  base::Result<std::uint64_t> readCount(const char* of);
  template <std::size_t kCount>
  base::Result<std::array<double, kCount>> readNumbers();
  base::Result<void> readScan();
  base::Result<void> readPoint(std::string_view line, const glm::dmat4& world_from_scan);
  void lookAtSample();

  std::string_view text_;  // what is still to be read
  std::string_view whole_;
  MeshStream& out_;
  std::uint64_t line_number_ = 0;
  bool is_first_ = true;  // of the scans
  GreyRange greys_;
  bool has_colors_ = false;   // of their own, some of the points
  std::uint64_t unseen_ = 0;  // directions in which nothing returned
};

// Blank lines do not count.
bool PtxReader::nextFullLine(std::string_view& line) {
  while (!text_.empty()) {
    ++line_number_;
    line = nextLine(text_);
    std::string_view probe = line;
    if (skipSpaces(probe)) return true;
  }
  return false;
}

base::Result<std::uint64_t> PtxReader::readCount(const char* of) {
  std::string_view line;
  if (!nextFullLine(line)) return truncatedIn("a scan's header");
  std::uint64_t count = 0;
  const std::string_view word = nextWord(line);
  if (!parseNumber(word, count) || !nextWord(line).empty() || count > std::uint64_t{1} << 31)
    return invalidInput(place() + ": " + inQuotes(word) + " is not the number of " + of + " of a scan");
  return count;
}

template <std::size_t kCount>
base::Result<std::array<double, kCount>> PtxReader::readNumbers() {
  std::string_view line;
  if (!nextFullLine(line)) return truncatedIn("a scan's header");
  std::array<double, kCount> numbers{};
  for (double& number : numbers)
    if (!parseNumber(nextWord(line), number) || !std::isfinite(number))
      return invalidInput(place() + ": " + std::to_string(kCount) + " numbers are needed in a scan's header");
  return numbers;
}

// Intensities of 64 runs of lines, evenly over all behind the first header, or of a megabyte. Lines of other headers
// are too few to matter.
void PtxReader::lookAtSample() {
  const bool is_small = text_.size() < std::size_t{1} << 20;
  const std::size_t runs = is_small ? 1 : 64, lines = is_small ? text_.size() : 256;
  std::vector<double> intensities;
  for (std::size_t r = 0; r < runs; ++r) {
    std::string_view text = text_.substr(text_.size() / runs * r);
    if (r > 0) nextLine(text);
    for (std::size_t i = 0; i < lines && !text.empty(); ++i) {
      std::string_view line = nextLine(text);
      std::array<double, 4> n{};
      bool is_point = true;
      for (double& number : n) is_point = is_point && parseNumber(nextWord(line), number) && std::isfinite(number);
      if (is_point && (n[0] != 0.0 || n[1] != 0.0 || n[2] != 0.0)) intensities.push_back(n[3]);
    }
  }
  greys_ = GreyRange::of(intensities);
}

base::Result<void> PtxReader::read() {
  std::string_view rest;
  do {
    LUMIGRID_TRY(readScan());
    rest = text_;
  } while (skipSpaces(rest));
  if (out_.vertexCount() == 0) return invalidInput("the file has no points");
  if (!has_colors_ && !greys_.isEmpty())
    out_.summary.warnings.push_back("it has no colours; intensities are shown from black to white");
  if (unseen_ > 0)
    out_.summary.warnings.push_back(std::to_string(unseen_) + " of its points are left out: nothing returned there");
  return out_.flush(whole_.data() + whole_.size());
}

base::Result<void> PtxReader::readScan() {
  LUMIGRID_ASSIGN_OR_RETURN(const std::uint64_t columns, readCount("columns"));
  LUMIGRID_ASSIGN_OR_RETURN(const std::uint64_t rows, readCount("rows"));
  if (!out_.accepts_points) return unsupported(kOnlyPoints);
  for (int i = 0; i < 4; ++i)  // the scanner's place and axes, which the matrix repeats
    if (const auto numbers = readNumbers<3>(); !numbers) return numbers.error();
  // Points are rows that the matrix is to the right of, so that its last row is where the scanner stood.
  glm::dmat4 world_from_scan(1.0);
  for (int i = 0; i < 4; ++i) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto row, readNumbers<4>());
    world_from_scan[i] = {row[0], row[1], row[2], row[3]};
  }
  if (is_first_) lookAtSample();
  is_first_ = false;
  const std::uint64_t points = columns * rows;
  std::string_view line;
  for (std::uint64_t i = 0; i < points; ++i) {
    if ((points - i - 1) > text_.size() / kShortestPoint + 1 || !nextFullLine(line))
      return truncatedIn("point " + std::to_string(i) + " of " + std::to_string(points) + " of a scan");
    LUMIGRID_TRY(readPoint(line, world_from_scan));
    LUMIGRID_TRY(out_.flushFullBlocks(text_.data()));
  }
  return {};
}

base::Result<void> PtxReader::readPoint(std::string_view line, const glm::dmat4& world_from_scan) {
  std::array<double, 7> n{};
  std::size_t count = 0;
  for (std::string_view word = nextWord(line); !word.empty() && count < n.size(); word = nextWord(line), ++count)
    if (!parseNumber(word, n[count])) return invalidInput(place() + ": " + inQuotes(word) + " is not a number");
  if (count != 4 && count != 7)
    return invalidInput(place() + ": a point is x y z intensity, or these and r g b, and there are " +
                        std::to_string(count) + " numbers");
  const glm::dvec4 place_in_scan(n[0], n[1], n[2], 1.0);
  const bool is_seen =
      std::isfinite(n[0]) && std::isfinite(n[1]) && std::isfinite(n[2]) && (n[0] != 0.0 || n[1] != 0.0 || n[2] != 0.0);
  if (!is_seen) {
    ++unseen_;
    return {};
  }
  out_.positions.emplace_back(world_from_scan * place_in_scan);
  if (count == 7) {
    has_colors_ = true;
    glm::u8vec4 color(255);
    for (int k = 0; k < 3; ++k) color[k] = byteFromUnit(n[static_cast<std::size_t>(4 + k)] / 255.0);
    out_.colors.resize(out_.positions.size() - 1, glm::u8vec4(255));
    out_.colors.push_back(color);
  } else if (!greys_.isEmpty()) {
    out_.colors.resize(out_.positions.size() - 1, glm::u8vec4(255));
    out_.colors.push_back(greys_.grey(n[3]));
  } else if (has_colors_) {
    out_.colors.resize(out_.positions.size(), glm::u8vec4(255));
  }
  return {};
}

}  // namespace

base::Result<void> readPtx(base::ByteView bytes, MeshStream& out) {
  return PtxReader(textOf(bytes), out).read();
}

}  // namespace mesh
