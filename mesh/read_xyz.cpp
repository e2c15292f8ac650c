// XYZ point clouds: text with a point on each line. Nothing in a file says what its columns are, unless a line names
// them; their number and their first values tell.
#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

#include "mesh/readers.h"

namespace mesh {
namespace {

constexpr std::size_t kSampleLines = 1000;
constexpr std::size_t kMaxColumns = 64;  // a choice, far above what scanners write

enum Slot : std::uint8_t { kX, kY, kZ, kRed, kGreen, kBlue, kNx, kNy, kNz, kUnused, kSlots };

// The forms of lines whose columns have no names. The number of columns chooses; of the two with six, the values do.
constexpr std::string_view kForms[] = {"x y z",          "x y z intensity",       "x y z r g b",
                                       "x y z nx ny nz", "x y z intensity r g b", "x y z r g b nx ny nz"};
constexpr std::string_view kNormalForm = kForms[3];

// ---- Lines and columns ----

bool isSeparator(char c) {
  return isSpace(c) || c == ',' || c == ';';
}

/// Removes separators from the front of `line` and returns whether commas or semicolons were among them: ',', ';', or
/// else ' '. Both give ';'.
char skipSeparators(std::string_view& line) {
  char mark = ' ';
  std::size_t begin = 0;
  for (; begin < line.size() && isSeparator(line[begin]); ++begin)
    if (!isSpace(line[begin])) mark = std::max(mark, line[begin]);
  line.remove_prefix(begin);
  return mark;
}

/// Removes the next column from the front of `line` and returns it; empty when none is left.
std::string_view nextColumn(std::string_view& line) {
  skipSeparators(line);
  std::size_t end = 0;
  while (end < line.size() && !isSeparator(line[end])) ++end;
  const std::string_view column = line.substr(0, end);
  line.remove_prefix(end);
  return column;
}

/// The columns of a line, of which it has more than kMaxColumns where so many are returned and one more.
std::vector<std::string_view> columnsOf(std::string_view line) {
  std::vector<std::string_view> columns;
  for (std::string_view c = nextColumn(line); !c.empty() && columns.size() <= kMaxColumns; c = nextColumn(line))
    columns.push_back(c);
  return columns;
}

Slot slotFromName(std::string_view name) {
  std::string lower;
  for (const char c : name)
    if (c != '"' && c != '\'') lower += c >= 'A' && c <= 'Z' ? static_cast<char>(c - 'A' + 'a') : c;
  constexpr std::array<std::string_view, 12> kNames{"x",  "y",  "z",  "r",   "g",     "b",
                                                    "nx", "ny", "nz", "red", "green", "blue"};
  const auto found = std::find(kNames.begin(), kNames.end(), lower) - kNames.begin();
  if (found < kUnused) return static_cast<Slot>(found);
  return found < std::ssize(kNames) ? static_cast<Slot>(kRed + found % 3) : kUnused;
}

/// Tells which column holds what.
struct Layout {
  std::vector<Slot> slots;  ///< what each column holds
  std::vector<std::string> unused;
  bool has_colors = false;
  bool has_normals = false;

  bool has(Slot slot) const { return std::find(slots.begin(), slots.end(), slot) != slots.end(); }
  bool hasThree(Slot first) const {
    return has(first) && has(static_cast<Slot>(first + 1)) && has(static_cast<Slot>(first + 2));
  }
};

Layout layoutFromNames(const std::vector<std::string_view>& names) {
  Layout layout;
  for (const std::string_view name : names) {
    const Slot slot = slotFromName(name);
    layout.slots.push_back(layout.has(slot) ? kUnused : slot);
  }
  layout.has_colors = layout.hasThree(kRed);
  layout.has_normals = layout.hasThree(kNx);
  for (std::size_t c = 0; c < names.size(); ++c) {
    Slot& slot = layout.slots[c];
    if ((slot >= kRed && slot <= kBlue && !layout.has_colors) || (slot >= kNx && slot <= kNz && !layout.has_normals))
      slot = kUnused;
    if (slot == kUnused) layout.unused.push_back(inQuotes(names[c]));
  }
  return layout;
}

/// Goes through the lines that hold a point. Blank lines, comments, and counts of points are passed over.
class PointLines {
 public:
  explicit PointLines(std::string_view text) : text_(text) { skipMark(text_); }

  /// Finds the next one, which begins with its first column; false at the end.
  bool next(std::string_view& line) {
    while (!text_.empty()) {
      ++number_;
      line = nextLine(text_);
      skipSeparators(line);
      if (line.empty()) continue;
      const bool comment = line.front() == '#' || line.substr(0, 2) == "//";
      if (points_ == 0 && isHeader(line, comment)) continue;
      if (comment || (points_ == counted_ && isCount(line))) continue;
      ++points_;
      return true;
    }
    return false;
  }

  std::uint64_t number() const { return number_; }  ///< the line's, counted from 1
  std::string place() const { return "line " + std::to_string(number_); }
  const char* end() const { return text_.data(); }  ///< where the line ends
  /// Whether the file ends in the line, without a line break.
  bool isCut() const { return text_.empty() && text_.data()[-1] != '\n'; }
  std::uint64_t points() const { return points_; }
  /// How many points the counts promise; 0 where there are none.
  std::uint64_t counted() const { return counted_; }

  /// The names of the columns, from the last line of names before the first point; empty where there is none.
  const std::vector<std::string_view>& names() const { return names_; }
  std::uint64_t namesLine() const { return names_line_; }
  /// A comment may be no line of names, even if it looks like one.
  bool areNamesComment() const { return are_names_comment_; }

 private:
  // Keeps names of columns, x, y and z among them.
  bool isHeader(std::string_view line, bool comment) {
    if (comment) line.remove_prefix(line.front() == '#' ? 1 : 2);
    auto names = columnsOf(line);
    if (names.size() > kMaxColumns || !layoutFromNames(names).hasThree(kX)) return false;
    names_ = std::move(names);
    names_line_ = number_;
    are_names_comment_ = comment;
    return true;
  }

  // PTS files have the number of points before these, for each of several scans.
  bool isCount(std::string_view line) {
    std::int64_t count = 0;
    const std::size_t digits = leadingDigits(line, count);
    line.remove_prefix(digits);
    skipSeparators(line);
    if (digits == 0 || !line.empty()) return false;
    counted_ += static_cast<std::uint64_t>(count);
    return true;
  }

  std::string_view text_;
  std::uint64_t number_ = 0;
  std::uint64_t points_ = 0;
  std::uint64_t counted_ = 0;
  std::vector<std::string_view> names_;
  std::uint64_t names_line_ = 0;
  bool are_names_comment_ = false;
};

// ---- Three columns by a sample of their values ----

struct Sample {
  double largest = 0.0;
  bool has_decimals = false;
  bool has_negative = false;
  bool has_zero = false;  ///< a vector without length, as where a program knew no normal
  bool has_unit = false;
  bool has_other = false;  ///< a vector of another length

  /// Colours may be of unit length, too, or black; they are never negative.
  bool isNormals() const { return has_unit && !has_other && (!has_zero || has_negative); }
  bool isUnitColors() const { return largest <= 1.0 && has_decimals; }
};

/// Looks at three columns of the first lines. Lines that cannot be read are left to those who read them all.
Sample sampleOf(PointLines lines, const std::array<std::size_t, 3>& at) {
  constexpr double kNearUnit = 0.02;  // a choice: programs write normals with two decimals or more
  Sample sample;
  std::string_view line;
  for (std::size_t i = 0; i < kSampleLines && lines.next(line); ++i) {
    const auto columns = columnsOf(line);
    glm::dvec3 v(0.0);
    for (int k = 0; k < 3; ++k) {
      const std::size_t c = at[static_cast<std::size_t>(k)];
      if (c >= columns.size() || !parseNumber(columns[c], v[k]) || !std::isfinite(v[k])) {
        v[k] = 0.0;
        continue;
      }
      sample.largest = std::max(sample.largest, v[k]);
      sample.has_negative |= v[k] < 0.0;
      sample.has_decimals |= columns[c].find_first_of(".eE") != std::string_view::npos;
    }
    const double length = glm::length(v);
    if (length == 0.0)
      sample.has_zero = true;
    else
      (std::abs(length - 1.0) <= kNearUnit ? sample.has_unit : sample.has_other) = true;
  }
  return sample;
}

// ---- Reading ----

class XyzReader {
 public:
  XyzReader(std::string_view text, MeshStream& out) : text_(text), lines_(text), out_(out) {}

  base::Result<void> read();

 private:
  base::Result<void> chooseLayout();
  base::Result<void> checkSeparators(std::string_view line) const;
  base::Result<Layout> layoutFromForm(std::size_t columns) const;
  base::Result<bool> readAll();
  base::Result<void> readLine(std::string_view line);
  base::Error wrongCount(std::string_view line) const;
  base::Error wrongColor() const;
  bool addPoint();
  base::Result<void> finish();

  std::string_view text_;
  PointLines lines_;  // where reading has come to
  MeshStream& out_;
  Layout layout_;
  std::string first_place_;   // the line of the first point
  bool unit_colors_ = false;  // colours go from 0 to 1, and not to 255
  std::array<double, kSlots> values_{};
};

base::Result<void> XyzReader::read() {
  LUMIGRID_TRY(chooseLayout());
  if (!out_.accepts_points) return unsupported(kOnlyPoints);
  // Only a colour above 1 begins the file again, and never twice.
  while (true) {
    LUMIGRID_ASSIGN_OR_RETURN(const bool done, readAll());
    if (done) return finish();
    LUMIGRID_TRY(out_.restart());
  }
}

base::Result<void> XyzReader::chooseLayout() {
  PointLines lines(text_);
  std::string_view line;
  if (!lines.next(line)) {
    if (lines.counted() > 0) return truncatedIn("point 0 of " + std::to_string(lines.counted()));
    return invalidInput("the file has no points");
  }
  first_place_ = lines.place();
  const auto columns = columnsOf(line);
  double number = 0.0;
  if (!parseNumber(columns.front(), number))
    return invalidInput(first_place_ + ": " + inQuotes(columns.front()) +
                        " is neither a number nor the first of the columns' names, such as \"x y z\"");
  LUMIGRID_TRY(checkSeparators(line));

  const auto& names = lines.names();
  if (names.size() == columns.size()) {
    layout_ = layoutFromNames(names);
  } else if (!names.empty() && !lines.areNamesComment()) {
    return invalidInput("line " + std::to_string(lines.namesLine()) + " names " + std::to_string(names.size()) +
                        " columns, and " + first_place_ + " has " + std::to_string(columns.size()));
  } else {
    LUMIGRID_ASSIGN_OR_RETURN(layout_, layoutFromForm(columns.size()));
  }
  if (!layout_.has_colors) return {};
  std::array<std::size_t, 3> at{};
  for (std::size_t c = 0; c < layout_.slots.size(); ++c)
    if (const Slot s = layout_.slots[c]; s >= kRed && s <= kBlue) at[static_cast<std::size_t>(s - kRed)] = c;
  unit_colors_ = sampleOf(PointLines(text_), at).isUnitColors();
  return {};
}

// A comma in a number would make two columns of it, and colours of decimals.
base::Result<void> XyzReader::checkSeparators(std::string_view line) const {
  nextColumn(line);
  const char first = skipSeparators(line);
  for (nextColumn(line); !line.empty(); nextColumn(line)) {
    const char mark = skipSeparators(line);
    if (mark != first && !line.empty())
      return invalidInput(first_place_ +
                          ": its columns are separated in two ways; separate all alike, and write decimals with a "
                          "point, not a comma");
  }
  return {};
}

base::Result<Layout> XyzReader::layoutFromForm(std::size_t columns) const {
  std::string all;
  for (const std::string_view form : kForms) {
    const auto names = columnsOf(form);
    if (names.size() == columns) {
      const bool normals = columns == 6 && sampleOf(PointLines(text_), {3, 4, 5}).isNormals();
      return layoutFromNames(normals ? columnsOf(kNormalForm) : names);
    }
    all.append(all.empty() ? "" : ", ").append(form);
  }
  const std::string count =
      columns > kMaxColumns ? "more than " + std::to_string(kMaxColumns) : std::to_string(columns);
  return invalidInput(first_place_ + ": columns without names are " + all + ", and there are " + count +
                      "; name them in a first line");
}

// False where colours turn out to go to 255.
base::Result<bool> XyzReader::readAll() {
  lines_ = PointLines(text_);
  std::string_view line;
  while (lines_.next(line)) {
    LUMIGRID_TRY(readLine(line));
    if (!addPoint()) return false;
    LUMIGRID_TRY(out_.flushFullBlocks(lines_.end()));
  }
  LUMIGRID_TRY(out_.flush(text_.data() + text_.size()));
  return true;
}

base::Result<void> XyzReader::readLine(std::string_view line) {
  const std::string_view whole = line;
  for (const Slot slot : layout_.slots) {
    const std::string_view column = nextColumn(line);
    if (column.empty()) return lines_.isCut() ? truncatedIn(lines_.place()) : wrongCount(whole);
    if (slot == kUnused) continue;
    if (!parseNumber(column, values_[slot]))
      return invalidInput(lines_.place() + ": " + inQuotes(column) + " is not a number");
    // Vectors without a direction are normals that nobody knows.
    if (slot <= kZ && !std::isfinite(values_[slot]))
      return invalidInput(lines_.place() + ": a coordinate is not finite (NaN or infinite); mend or remove the line");
  }
  if (!nextColumn(line).empty()) return wrongCount(whole);
  for (std::size_t s = kRed; layout_.has_colors && s <= kBlue; ++s)
    if (!(values_[s] >= 0.0 && values_[s] <= 255.0)) return wrongColor();
  return {};
}

base::Error XyzReader::wrongCount(std::string_view line) const {
  const std::size_t count = columnsOf(line).size();
  return invalidInput(lines_.place() + ": it has " +
                      (count > kMaxColumns ? "more than " + std::to_string(kMaxColumns) : std::to_string(count)) +
                      (count == 1 ? " column, and " : " columns, and ") + first_place_ + " has " +
                      std::to_string(layout_.slots.size()));
}

base::Error XyzReader::wrongColor() const {
  return invalidInput(lines_.place() +
                      ": a colour is not within 0 to 255; if the columns are none of red, green and blue, name them in "
                      "a first line, such as \"x y z nx ny nz\"");
}

// False where a colour shows that they go to 255, which then is set.
bool XyzReader::addPoint() {
  const auto& v = values_;
  if (layout_.has_colors) {
    if (unit_colors_ && std::max({v[kRed], v[kGreen], v[kBlue]}) > 1.0) {
      unit_colors_ = false;
      return false;
    }
    const double unit = unit_colors_ ? 1.0 : 255.0;
    out_.colors.emplace_back(byteFromUnit(v[kRed] / unit), byteFromUnit(v[kGreen] / unit),
                             byteFromUnit(v[kBlue] / unit), 255);
  }
  if (layout_.has_normals) out_.normals.emplace_back(glm::dvec3(v[kNx], v[kNy], v[kNz]));
  out_.positions.emplace_back(v[kX], v[kY], v[kZ]);
  return true;
}

base::Result<void> XyzReader::finish() {
  constexpr std::size_t kMaxNamed = 4;
  const std::uint64_t points = lines_.points(), counted = lines_.counted();
  if (points < counted) return truncatedIn("point " + std::to_string(points) + " of " + std::to_string(counted));
  auto& warnings = out_.summary.warnings;
  if (counted > 0 && points > counted)
    warnings.push_back("its count of points is " + std::to_string(counted) + ", and it has " + std::to_string(points) +
                       "; all are read");
  if (layout_.unused.empty()) return {};
  std::string unused;
  for (std::size_t i = 0; i < std::min(layout_.unused.size(), kMaxNamed); ++i)
    unused += (i == 0 ? "" : ", ") + layout_.unused[i];
  if (layout_.unused.size() > kMaxNamed)
    unused += " and " + std::to_string(layout_.unused.size() - kMaxNamed) + " more columns";
  warnings.push_back("its points are read without " + unused);
  return {};
}

}  // namespace

base::Result<void> readXyz(base::ByteView bytes, MeshStream& out) {
  return XyzReader(textOf(bytes), out).read();
}

}  // namespace mesh
