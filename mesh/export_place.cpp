#include "mesh/export_place.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <utility>

#include "base/file.h"
#include "mesh/mesh_stream.h"

namespace mesh {
namespace {

namespace fs = std::filesystem;

constexpr const char* kMetadataXml = "metadata.xml";
constexpr const char* kCoordsTxt = "odm_georeferencing/coords.txt";
constexpr const char* kOffsetXyz = "_offset.xyz";
constexpr const char* kWktPrj = "_wkt.prj";
constexpr std::uintmax_t kMaxBytes = 1'000'000;  // well-known text of a system takes some thousands
constexpr std::uintmax_t kMaxOffsetBytes = 200;  // what is larger is a cloud of points
constexpr int kFolders = 3;                      // that of the mesh, and the two above it

/// The text of the first element of this name, which has no attributes in files of this kind; nothing where there is
/// none.
std::optional<std::string_view> textOfElement(std::string_view xml, const std::string& name) {
  const std::string start = "<" + name + ">";
  const std::size_t begin = xml.find(start);
  if (begin == std::string_view::npos) return std::nullopt;
  std::string_view text = xml.substr(begin + start.size());
  const std::size_t end = text.find("</" + name + ">");
  if (end == std::string_view::npos) return std::nullopt;
  text = text.substr(0, end);
  return restOfLine(text);
}

/// Resolves the entities that XML defines itself.
std::string unescaped(std::string_view text) {
  constexpr std::pair<std::string_view, char> kEntities[] = {
      {"&quot;", '"'}, {"&apos;", '\''}, {"&lt;", '<'}, {"&gt;", '>'}, {"&amp;", '&'}};
  std::string out;
  while (!text.empty()) {
    char next = text.front();
    std::size_t length = 1;
    for (const auto& [name, character] : kEntities)
      if (text.substr(0, name.size()) == name) next = character, length = name.size();
    out += next;
    text.remove_prefix(length);
  }
  return out;
}

/// Removes `count` finite numbers from the front of `text`, with commas, semicolons or spaces between them, and returns
/// them, and 0 for others; nothing where there are fewer.
std::optional<glm::dvec3> takeNumbers(std::string_view& text, int count) {
  glm::dvec3 out(0.0);
  for (int axis = 0; axis < count; ++axis) {
    const std::size_t begin = text.find_first_not_of(axis == 0 ? " \t\r\n+" : " \t\r\n,;+");
    if (begin == std::string_view::npos) return std::nullopt;
    text.remove_prefix(begin);
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out[axis]);
    if (error != std::errc() || !std::isfinite(out[axis])) return std::nullopt;
    text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  }
  return out;
}

/// Three finite numbers and nothing else.
std::optional<glm::dvec3> vectorOf(std::string_view text) {
  const auto numbers = takeNumbers(text, 3);
  return skipSpaces(text) ? std::nullopt : numbers;
}

/// The system that an SRS element names: an authority's code, or well-known text.
CrsDescription systemOf(std::string_view text) {
  const std::string name = unescaped(text);
  if (name.find('[') != std::string::npos) return crsFromWellKnownText(name);
  CrsDescription crs;
  const std::string_view digits = std::string_view(name).substr(std::min<std::size_t>(5, name.size()));
  const bool is_code = name.rfind("EPSG:", 0) == 0 && !digits.empty() && digits.size() <= 20 &&
                       digits.find_first_not_of("0123456789+") == std::string_view::npos && digits.front() != '+' &&
                       digits.back() != '+';
  if (is_code) crs.code = name;
  return crs;
}

/// Whether the origin is in degrees, which cannot be added to metres. Of systems that are named by code, those that
/// such exports have: WGS 84, CGCS2000, NAD83, ETRS89.
bool isGeographic(const CrsDescription& crs) {
  constexpr std::string_view kCodes[] = {"EPSG:4326", "EPSG:4979", "EPSG:4490", "EPSG:4480",
                                         "EPSG:4269", "EPSG:4258", "EPSG:4937"};
  return crs.has_degrees || std::find(std::begin(kCodes), std::end(kCodes), crs.code) != std::end(kCodes);
}

/// The code of a zone of UTM on WGS 84; "" where there is no such zone.
std::string codeOfZone(std::string_view digits, bool is_south) {
  int zone = 0;
  if (!parseNumber(digits, zone) || zone < 1 || zone > 60) return {};
  return "EPSG:" + std::to_string((is_south ? 32700 : 32600) + zone);
}

/// The value of a parameter of a PROJ string, "" where it has none: "32" of "+zone=32".
std::string_view parameterOf(std::string_view proj, const std::string& name) {
  const std::size_t begin = proj.find("+" + name + "=");
  if (begin == std::string_view::npos) return {};
  const std::string_view value = proj.substr(begin + name.size() + 2);
  return value.substr(0, value.find(' '));
}

/// The system of the first line of a coords.txt.
CrsDescription systemOfLine(std::string_view line) {
  constexpr std::string_view kUtm = "WGS84 UTM ";
  CrsDescription crs;
  if (line.substr(0, kUtm.size()) == kUtm && line.size() > kUtm.size() + 1) {
    const bool is_south = line.back() == 'S';
    if (is_south || line.back() == 'N')
      crs.code = codeOfZone(line.substr(kUtm.size(), line.size() - kUtm.size() - 1), is_south);
  } else if (parameterOf(line, "proj") == "utm" &&
             (parameterOf(line, "datum") == "WGS84" || parameterOf(line, "ellps") == "WGS84")) {
    crs.code = codeOfZone(parameterOf(line, "zone"), line.find("+south") != std::string_view::npos);
  } else if (line.substr(0, 5) == "EPSG:" || line.substr(0, 5) == "epsg:") {
    return systemOf("EPSG:" + std::string(line.substr(5)));
  }
  if (!crs.code.empty()) crs.unit = "m";
  return crs;
}

/// A file's text, "" where there is none or it is larger than `most` bytes.
base::Result<std::string> textOfFile(const fs::path& file, std::uintmax_t most) {
  std::error_code absent;
  if (!fs::is_regular_file(file, absent) || fs::file_size(file, absent) > most || absent) return std::string();
  LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, base::readFile(file.string()));
  return std::string(textOf(bytes));
}

base::Result<std::optional<ExportPlace>> findMetadataXml(const fs::path& folder) {
  LUMIGRID_ASSIGN_OR_RETURN(const std::string text, textOfFile(folder / kMetadataXml, kMaxBytes));
  auto place = readMetadataXml(text);
  if (!place) return base::within((folder / kMetadataXml).string(), place.error());
  if (*place) (*place)->file = kMetadataXml;
  return place;
}

/// The one whose name fits the mesh's, of several the longest. Names are tried, since a folder of tiles has thousands
/// of files, and all of them would be listed for each.
base::Result<std::optional<ExportPlace>> findOffsetXyz(const fs::path& folder, const std::string& mesh) {
  std::error_code absent;
  std::string best = fs::is_directory(folder, absent) ? mesh : "";
  while (!best.empty() && !fs::is_regular_file(folder / (best + kOffsetXyz), absent)) best.pop_back();
  if (best.empty()) return std::optional<ExportPlace>();
  const fs::path file = folder / (best + kOffsetXyz);
  LUMIGRID_ASSIGN_OR_RETURN(const std::string offset, textOfFile(file, kMaxOffsetBytes));
  if (offset.empty()) return std::optional<ExportPlace>();
  LUMIGRID_ASSIGN_OR_RETURN(const std::string system, textOfFile(folder / (best + kWktPrj), kMaxBytes));
  auto place = readOffsetXyz(offset, system);
  if (!place) return base::within(file.string(), place.error());
  if (isGeographic(place->crs)) return std::optional<ExportPlace>();
  place->file = file.filename().string();
  return std::optional(*std::move(place));
}

base::Result<std::optional<ExportPlace>> findCoordsTxt(const fs::path& folder) {
  LUMIGRID_ASSIGN_OR_RETURN(const std::string text, textOfFile(folder / kCoordsTxt, kMaxBytes));
  if (text.empty()) return std::optional<ExportPlace>();
  auto place = readCoordsTxt(text);
  if (!place) return base::within((folder / kCoordsTxt).string(), place.error());
  if (isGeographic(place->crs)) return std::optional<ExportPlace>();
  place->file = kCoordsTxt;
  return std::optional(*std::move(place));
}

}  // namespace

base::Result<std::optional<ExportPlace>> readMetadataXml(std::string_view xml) {
  if (xml.find("<ModelMetadata") == std::string_view::npos) return std::optional<ExportPlace>();
  const auto origin = textOfElement(xml, "SRSOrigin");
  if (!origin) return std::optional<ExportPlace>();
  const auto place = vectorOf(*origin);
  if (!place)
    return invalidInput(
        "SRSOrigin is not three numbers, by which the mesh's coordinates are moved; correct it, or take the file away");
  CrsDescription crs = systemOf(textOfElement(xml, "SRS").value_or(""));
  if (isGeographic(crs)) return std::optional<ExportPlace>();
  return std::optional<ExportPlace>({*place, std::move(crs), {}});
}

base::Result<ExportPlace> readOffsetXyz(std::string_view offset, std::string_view system) {
  skipMark(offset), skipMark(system);
  const auto place = vectorOf(offset);
  if (!place)
    return invalidInput(
        "it is not three numbers, by which the mesh's coordinates are moved; correct it, or take the file away");
  return ExportPlace{*place, crsFromWellKnownText(system), {}};
}

base::Result<ExportPlace> readCoordsTxt(std::string_view text) {
  skipMark(text);
  std::string_view system = nextLine(text);
  std::string_view offset = nextLine(text);
  const auto place = takeNumbers(offset, 2);
  if (!place)
    return invalidInput(
        "line 2 is not two numbers, by which the mesh's coordinates are moved; correct it, or take the file away");
  return ExportPlace{*place, systemOfLine(restOfLine(system)), {}};
}

base::Result<std::optional<ExportPlace>> findExportPlace(const std::string& mesh) {
  std::error_code failed;
  const fs::path path = fs::absolute(mesh, failed).lexically_normal();
  const std::string name = path.filename().string();
  const bool is_odm = name.rfind("odm_textured_model_geo", 0) == 0;
  fs::path folder = path.parent_path();
  for (int i = 0; i < kFolders && !failed; ++i, folder = folder.parent_path()) {
    LUMIGRID_ASSIGN_OR_RETURN(auto place, findMetadataXml(folder));
    for (const fs::path& where : {folder, folder / "1_initial" / "params"})
      if (!place) {
        LUMIGRID_ASSIGN_OR_RETURN(place, findOffsetXyz(where, name));
      }
    if (!place && is_odm) {
      LUMIGRID_ASSIGN_OR_RETURN(place, findCoordsTxt(folder));
    }
    if (place) return place;
  }
  return std::optional<ExportPlace>();
}

}  // namespace mesh
