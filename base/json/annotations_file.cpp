#include "base/json/annotations_file.h"

#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>
#include <utility>

#include "base/file.h"
#include "base/json/camera_file.h"
#include "base/json/parse.h"
#include "base/json/vector.h"

namespace base {
namespace {

using nlohmann::json;

Error badNote(const std::string& name, const std::string& problem) {
  return {ErrorCode::kInvalidInput, name + ": " + problem + " (docs/formats/annotations.md)"};
}

/// Members may be absent; checkedAnnotation() checks the limits.
bool readVectorIfAny(const json& note, const char* key, glm::dvec3& v) {
  const auto it = note.find(key);
  if (it == note.end()) return true;
  const auto read = vectorFrom(*it);
  v = read.value_or(v);
  return read.has_value();
}

bool readText(const json& note, const char* key, std::string& text) {
  const auto it = note.find(key);
  if (it == note.end()) return true;
  if (it->is_string()) text = it->get<std::string>();
  return it->is_string();
}

Result<Annotation> readNote(const json& note, const std::string& place) {
  if (!note.is_object()) return badNote(place, "is not an object");
  Annotation annotation;
  if (!note.contains("position") || !readVectorIfAny(note, "position", annotation.position))
    return badNote(place, "position must be three numbers");
  if (!readVectorIfAny(note, "normal", annotation.normal)) return badNote(place, "normal must be three numbers");
  if (!readText(note, "title", annotation.title)) return badNote(place, "title must be text");
  if (!readText(note, "text", annotation.text)) return badNote(place, "text must be text");
  if (const auto it = note.find("camera"); it != note.end()) {
    LUMIGRID_ASSIGN_OR_RETURN(annotation.camera, parseCamera(it->dump(), place + ": camera"));
  }
  auto checked = checkedAnnotation(std::move(annotation));
  if (!checked) return within(place, checked.error());
  return checked;
}

}  // namespace

Result<std::vector<Annotation>> parseAnnotations(ByteView text, const std::string& name) {
  if (text.size() > kMaxAnnotationsBytes)
    return badNote(name, "has more than " + std::to_string(kMaxAnnotationsBytes >> 20) + " MiB");
  const json document = parseJson(text);
  if (document.is_discarded() || !document.is_object()) return badNote(name, "is no JSON object in UTF-8");
  if (!document.contains("version") || document["version"] != kAnnotationsVersion)
    return Error{ErrorCode::kVersion, name + ": version must be 1 (docs/formats/annotations.md)"};
  if (!document.contains("annotations") || !document["annotations"].is_array())
    return badNote(name, "annotations must be a list");
  const json& notes = document["annotations"];
  if (notes.size() > kMaxAnnotations)
    return badNote(name, "has more than " + std::to_string(kMaxAnnotations) + " annotations");
  std::vector<Annotation> annotations;
  for (const json& note : notes) {
    LUMIGRID_ASSIGN_OR_RETURN(auto read, readNote(note, name + ": annotation " + std::to_string(annotations.size())));
    annotations.push_back(std::move(read));
  }
  return annotations;
}

Result<std::optional<AnnotationsText>> readAnnotations(const std::string& directory) {
  const std::string path = directory + "/" + kAnnotationsFile;
  std::error_code ec;
  const std::uintmax_t size = std::filesystem::file_size(path, ec);
  if (ec == std::errc::no_such_file_or_directory) return std::optional<AnnotationsText>();
  // For a directory, a pipe or an unreadable file, readFile gives an error that names it.
  if (!ec && size > kMaxAnnotationsBytes)
    return badNote(path, "has more than " + std::to_string(kMaxAnnotationsBytes >> 20) + " MiB");
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, readFile(path));
  LUMIGRID_ASSIGN_OR_RETURN(auto notes, parseAnnotations(bytes, path));
  return std::optional(AnnotationsText{std::string(bytes.begin(), bytes.end()), notes.size()});
}

}  // namespace base
