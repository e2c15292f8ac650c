#include "base/json/annotations_file.h"

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string_view>
#include <system_error>

#include "base/file.h"
#include "base/json/camera_file.h"

namespace base {
namespace {

using nlohmann::json;

constexpr int kVersion = 1;
constexpr std::size_t kMostNotes = 500;
constexpr std::size_t kLongestTitle = 200;    // bytes
constexpr std::size_t kLongestText = 10'000;  // bytes
constexpr double kFarthest = 1e12;            // world units, either sign

Error bad(const std::string& name, const std::string& what) {
  return {ErrorCode::kInvalidInput, name + ": " + what + " (docs/formats/annotations.md)"};
}

bool isVector(const json& value) {
  if (!value.is_array() || value.size() != 3) return false;
  for (const json& number : value)
    if (!number.is_number() || !(std::abs(number.get<double>()) <= kFarthest)) return false;
  return true;
}

/// That it is UTF-8 was found by the JSON parser.
bool isText(const json& value, std::size_t least, std::size_t most, std::string_view allowed_controls) {
  if (!value.is_string()) return false;
  const auto& text = value.get_ref<const std::string&>();
  if (text.size() < least || text.size() > most) return false;
  for (const char c : text)
    if ((static_cast<unsigned char>(c) < 0x20 || c == 0x7F) && allowed_controls.find(c) == std::string_view::npos)
      return false;
  return true;
}

Result<void> checkNote(const json& note, const std::string& place) {
  if (!note.is_object()) return bad(place, "is not an object");
  if (!note.contains("position") || !isVector(note["position"]))
    return bad(place, "position must be three numbers within 1e12");
  if (note.contains("normal") && !isVector(note["normal"]))
    return bad(place, "normal must be three numbers within 1e12");
  if (!note.contains("title") || !isText(note["title"], 1, kLongestTitle, ""))
    return bad(place, "title must be one line of 1 to " + std::to_string(kLongestTitle) + " bytes");
  if (note.contains("text") && !isText(note["text"], 0, kLongestText, "\n\t"))
    return bad(place, "text must be at most " + std::to_string(kLongestText) +
                          " bytes without control characters but line breaks and tabs");
  if (!note.contains("camera")) return {};
  auto camera = parseCamera(note["camera"].dump(), place + ": camera");
  if (!camera) return camera.error();
  if (!isVector(note["camera"]["position"])) return bad(place, "camera: position must lie within 1e12");
  return {};
}

}  // namespace

Result<std::size_t> checkAnnotations(ByteView text, const std::string& name) {
  if (text.size() > kMaxAnnotationsBytes)
    return bad(name, "has more than " + std::to_string(kMaxAnnotationsBytes >> 20) + " MiB");
  const json document = json::parse(text.begin(), text.end(), nullptr, false);
  if (document.is_discarded() || !document.is_object()) return bad(name, "is no JSON object in UTF-8");
  if (!document.contains("version") || document["version"] != kVersion)
    return Error{ErrorCode::kVersion, name + ": version must be 1 (docs/formats/annotations.md)"};
  if (!document.contains("annotations") || !document["annotations"].is_array())
    return bad(name, "annotations must be a list");
  const json& notes = document["annotations"];
  if (notes.size() > kMostNotes) return bad(name, "has more than " + std::to_string(kMostNotes) + " annotations");
  for (std::size_t i = 0; i < notes.size(); ++i)
    LUMIGRID_TRY(checkNote(notes[i], name + ": annotation " + std::to_string(i)));
  return notes.size();
}

Result<std::optional<AnnotationsText>> readAnnotations(const std::string& directory) {
  const std::string path = directory + "/" + kAnnotationsFile;
  std::error_code ec;
  const std::uintmax_t size = std::filesystem::file_size(path, ec);
  if (ec == std::errc::no_such_file_or_directory) return std::optional<AnnotationsText>();
  // A directory, a pipe, one that may not be read: the reader names it.
  if (!ec && size > kMaxAnnotationsBytes)
    return bad(path, "has more than " + std::to_string(kMaxAnnotationsBytes >> 20) + " MiB");
  auto bytes = readFile(path);
  if (!bytes) return bytes.error();
  auto notes = checkAnnotations(*bytes, path);
  if (!notes) return notes.error();
  return std::optional(AnnotationsText{std::string(bytes->begin(), bytes->end()), *notes});
}

}  // namespace base
