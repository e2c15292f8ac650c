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

constexpr const char* kFileName = "metadata.xml";
constexpr std::uintmax_t kMaxBytes = 1'000'000;  // well-known text of a system takes some thousands
constexpr int kFolders = 3;                      // that of the mesh, and the two above it

std::string_view trimmed(std::string_view text) {
  constexpr std::string_view kSpace = " \t\r\n";
  const std::size_t begin = text.find_first_not_of(kSpace);
  if (begin == std::string_view::npos) return {};
  return text.substr(begin, text.find_last_not_of(kSpace) + 1 - begin);
}

/// The text of the first element of this name, which has no attributes in files of this kind; nothing where there is
/// none.
std::optional<std::string_view> textOfElement(std::string_view xml, const std::string& name) {
  const std::string start = "<" + name + ">";
  const std::size_t begin = xml.find(start);
  if (begin == std::string_view::npos) return std::nullopt;
  const std::string_view rest = xml.substr(begin + start.size());
  const std::size_t end = rest.find("</" + name + ">");
  if (end == std::string_view::npos) return std::nullopt;
  return trimmed(rest.substr(0, end));
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

/// Three finite numbers with commas, semicolons or spaces between them.
std::optional<glm::dvec3> vectorOf(std::string_view text) {
  glm::dvec3 out(0.0);
  for (int axis = 0; axis < 3; ++axis) {
    const std::size_t begin = text.find_first_not_of(axis == 0 ? " \t\r\n+" : " \t\r\n,;+");
    if (begin == std::string_view::npos) return std::nullopt;
    text.remove_prefix(begin);
    const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), out[axis]);
    if (error != std::errc() || !std::isfinite(out[axis])) return std::nullopt;
    text.remove_prefix(static_cast<std::size_t>(end - text.data()));
  }
  return trimmed(text).empty() ? std::optional(out) : std::nullopt;
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

}  // namespace

base::Result<std::optional<ExportPlace>> readExportPlace(std::string_view xml) {
  if (xml.find("<ModelMetadata") == std::string_view::npos) return std::optional<ExportPlace>();
  const auto origin = textOfElement(xml, "SRSOrigin");
  if (!origin) return std::optional<ExportPlace>();
  const auto place = vectorOf(*origin);
  if (!place)
    return invalidInput(
        "SRSOrigin is not three numbers, by which the mesh's coordinates are moved; correct it, or take the file away");
  CrsDescription crs = systemOf(textOfElement(xml, "SRS").value_or(""));
  if (isGeographic(crs)) return std::optional<ExportPlace>();
  return std::optional<ExportPlace>({*place, std::move(crs)});
}

base::Result<std::optional<ExportPlace>> findExportPlace(const std::string& mesh) {
  std::error_code failed;
  fs::path folder = fs::absolute(mesh, failed).lexically_normal().parent_path();
  for (int i = 0; i < kFolders && !failed; ++i, folder = folder.parent_path()) {
    const fs::path file = folder / kFileName;
    std::error_code absent;
    if (!fs::is_regular_file(file, absent) || fs::file_size(file, absent) > kMaxBytes || absent) continue;
    LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, base::readFile(file.string()));
    auto place = readExportPlace(textOf(bytes));
    if (!place) return base::within(file.string(), place.error());
    if (*place) return place;
  }
  return std::optional<ExportPlace>();
}

}  // namespace mesh
