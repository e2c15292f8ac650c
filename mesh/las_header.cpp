#include "mesh/las_header.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "mesh/mesh_stream.h"

namespace mesh {
namespace {

// Bytes of the header in versions 1.0 to 1.2, whose fields the later ones have too, and in 1.4.
constexpr std::size_t kHeaderBytes = 227;
constexpr std::size_t kHeaderBytes14 = 375;

// Formats 0 to 10 of the specification, section 2.6: the least bytes of a point, and the place of its colour. Those
// with waveforms (4, 5, 9, 10) are read like 1, 3, 6 and 8, with whose fields they begin; the waveforms lie elsewhere.
constexpr std::array<std::size_t, 11> kBytes{20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};
constexpr std::array<std::size_t, 11> kColor{0, 0, 20, 28, 0, 28, 0, 30, 30, 0, 30};

LasPointFormat formatOf(std::size_t number) {
  if (number < 6) return {kColor[number], 15, 0x80, 15, 0x1F};
  return {kColor[number], 15, 0x04, 16, 0xFF};
}

base::Error wrongHeader(const std::string& message) {
  return invalidInput("header: " + message + "; export the file again");
}

base::Error compressed() {
  return unsupported(
      "LAZ, the compressed form of LAS, is not read; convert it: pdal translate in.laz out.las (PDAL, from pdal.io; "
      "Debian 12 has no package of it)");
}

// The fields of the header that decide how the points are read.
struct Fields {
  unsigned major = 0, minor = 0;
  std::size_t header_bytes = 0;
  std::uint64_t first_point = 0;
  std::uint32_t records = 0;  // variable length records
  unsigned format = 0;
  std::size_t record = 0;
  std::uint64_t legacy_points = 0;
  glm::dvec3 scale{1.0}, offset{0.0};
  std::uint64_t extended_at = 0;  // the remaining ones are of version 1.4
  std::uint32_t extended_records = 0;
  std::uint64_t points = 0;
};

base::Result<Fields> readFields(base::ByteView bytes) {
  if (textOf(bytes).substr(0, 4) != "LASF") return invalidInput("not a LAS file: it does not begin with \"LASF\"");
  if (bytes.size() < kHeaderBytes) return truncatedIn("the header");
  Fields f;
  base::ByteReader in(bytes);
  in.bytes(24);
  f.major = in.u8(), f.minor = in.u8();
  in.bytes(94 - 26);
  f.header_bytes = in.u16();
  f.first_point = in.u32();
  f.records = in.u32();
  f.format = in.u8();
  f.record = in.u16();
  f.legacy_points = in.u32();
  in.bytes(131 - 111);
  f.scale = in.read<glm::dvec3>();
  f.offset = in.read<glm::dvec3>();
  if (f.major != 1 || f.minor > 4)
    return unsupported("LAS " + std::to_string(f.major) + "." + std::to_string(f.minor) +
                       " is not read (1.0 to 1.4 are)");
  if (f.minor < 4) return f;
  if (bytes.size() < kHeaderBytes14) return truncatedIn("the header");
  in = base::ByteReader(bytes.subspan(235));
  f.extended_at = in.u64();
  f.extended_records = in.u32();
  f.points = in.u64();
  return f;
}

// One of two counts that need not agree: version 1.4 counts in 64 bits, and repeats it in 32 for older readers.
base::Result<std::uint64_t> pointsOf(const Fields& f) {
  if (f.points != 0 && f.legacy_points != 0 && f.points != f.legacy_points)
    return wrongHeader("it counts " + std::to_string(f.points) + " points in 64 bits and " +
                       std::to_string(f.legacy_points) + " in 32");
  const std::uint64_t points = std::max(f.points, f.legacy_points);
  if (points == 0) return invalidInput("the file has no points");
  return points;
}

base::Result<void> checkNumbers(const Fields& f) {
  for (int axis = 0; axis < 3; ++axis) {
    const std::string name(1, static_cast<char>('x' + axis));
    if (f.scale[axis] == 0.0 || !std::isfinite(f.scale[axis]))
      return wrongHeader("the scale of " + name + " is " + (f.scale[axis] == 0.0 ? "0" : "not finite"));
    if (!std::isfinite(f.offset[axis])) return wrongHeader("the offset of " + name + " is not finite");
  }
  return {};
}

// Checks that the points lie behind the header and inside the file.
base::Result<void> checkPlaces(const Fields& f, std::uint64_t points, std::size_t file_bytes) {
  const std::size_t least = f.minor < 4 ? kHeaderBytes : kHeaderBytes14;
  if (f.header_bytes < least)
    return wrongHeader("it says that it has " + std::to_string(f.header_bytes) + " bytes; " + std::to_string(least) +
                       " are the least");
  if (f.first_point < f.header_bytes)
    return wrongHeader("points begin at byte " + std::to_string(f.first_point) + ", inside the header of " +
                       std::to_string(f.header_bytes));
  if (f.record < kBytes[f.format])
    return wrongHeader("points have " + std::to_string(f.record) + " bytes; those of format " +
                       std::to_string(f.format) + " have " + std::to_string(kBytes[f.format]) + " at least");
  if (f.first_point > file_bytes)
    return truncatedIn("byte " + std::to_string(file_bytes) + ", before the points, which begin at " +
                       std::to_string(f.first_point));
  const std::uint64_t there = (file_bytes - f.first_point) / f.record;
  if (points > there) return truncatedIn("point " + std::to_string(there) + " of " + std::to_string(points));
  return {};
}

// ---- Variable length records ----

// The records that name the coordinate reference system; empty where there are none.
struct Projection {
  base::ByteView well_known_text, keys, names;
  bool has_compression = false;
};

// The user's name of a record, which is filled up with zeros.
std::string_view userOf(base::ByteView field) {
  const std::string_view text = textOf(field);
  return text.substr(0, text.find('\0'));
}

// Reads up to `count` records. Extended ones, of version 1.4, tell their length in 64 bits. Returns how many were read.
std::uint32_t readRecords(base::ByteView bytes, std::uint32_t count, bool extended, Projection& found) {
  base::ByteReader in(bytes);
  for (std::uint32_t i = 0; i < count; ++i) {
    in.u16();  // reserved
    const std::string_view user = userOf(in.bytes(16));
    const std::uint16_t number = in.u16();
    const std::uint64_t length = extended ? in.u64() : in.u16();
    in.bytes(32);  // description
    const base::ByteView content = in.bytes(static_cast<std::size_t>(length));
    if (!in.ok()) return i;
    if (user == "laszip encoded") found.has_compression = true;
    if (user != "LASF_Projection") continue;
    if (number == 2112) found.well_known_text = content;
    if (number == 34735) found.keys = content;
    if (number == 34737) found.names = content;
  }
  return count;
}

CrsDescription crsOf(const Projection& found) {
  // A megabyte is a hundred times what systems take; a record may claim the rest of the file.
  constexpr std::size_t kMaxText = 1 << 20;
  const CrsDescription keys = crsFromGeoKeys(found.keys, textOf(found.names));
  const CrsDescription text =
      crsFromWellKnownText(textOf(found.well_known_text.first(std::min(found.well_known_text.size(), kMaxText))));
  return text.code.empty() && (text.name.empty() || !keys.code.empty()) ? keys : text;
}

}  // namespace

base::Result<LasHeader> readLasHeader(base::ByteView bytes) {
  LUMIGRID_ASSIGN_OR_RETURN(auto f, readFields(bytes));

  // LASzip sets bit 7, and its first versions set bit 6.
  constexpr unsigned kCompressedBits = 0xC0;
  if ((f.format & kCompressedBits) != 0) return compressed();
  if (f.format >= kBytes.size())
    return unsupported("header: points of format " + std::to_string(f.format) + " are not read (0 to 10 are)");
  LUMIGRID_ASSIGN_OR_RETURN(const auto points, pointsOf(f));
  LUMIGRID_TRY(checkNumbers(f));
  LUMIGRID_TRY(checkPlaces(f, points, bytes.size()));

  Projection found;
  const auto first_point = static_cast<std::size_t>(f.first_point);
  const std::uint32_t read = readRecords(bytes.first(first_point).subspan(f.header_bytes), f.records, false, found);
  const bool is_inside = f.extended_at >= f.first_point && f.extended_at <= bytes.size();
  const std::size_t extended_at = is_inside ? static_cast<std::size_t>(f.extended_at) : bytes.size();
  const std::uint32_t extended = readRecords(bytes.subspan(extended_at), f.extended_records, true, found);
  if (found.has_compression) return compressed();

  LasHeader header;
  header.format = formatOf(f.format);
  header.points = points;
  header.first_point = first_point;
  header.record = f.record;
  header.scale = f.scale, header.offset = f.offset;
  header.crs = crsOf(found);
  const std::uint64_t lost = std::uint64_t{f.records} - read + f.extended_records - extended;
  if (lost > 0)
    header.warning = std::to_string(lost) + " of the records beside its points cannot be read, which may have told " +
                     "its coordinate reference system";
  return header;
}

}  // namespace mesh
