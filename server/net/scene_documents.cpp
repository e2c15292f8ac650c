#include "server/net/scene_documents.h"

#include <system_error>
#include <utility>

#include "base/file.h"
#include "base/json/annotations_file.h"
#include "server/net/http_text.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

constexpr const char* kNoAnnotations = "{\"version\": 1, \"annotations\": []}\n";

bool isMissing(const std::error_code& ec) {
  return ec == std::errc::no_such_file_or_directory || ec == std::errc::not_a_directory;
}

/// Whether the file itself is wrong, not the reading of it.
bool isOfTheFile(const base::Error& error) {
  return error.code == base::ErrorCode::kInvalidInput || error.code == base::ErrorCode::kVersion;
}

std::optional<SceneDocument> readSceneDocument(const std::string& path, const base::Bytes& bytes) {
  auto scene = base::parseScene(std::string(bytes.begin(), bytes.end()), path);
  if (!scene) {
    spdlog::warn("scene.json is served as it was: {}", scene.error().message);
    return std::nullopt;
  }
  return SceneDocument{std::move(*scene), bytes, entityTag(bytes)};
}

/// Nothing where it cannot be read now.
std::optional<AnnotationsDocument> readAnnotationsDocument(const std::string& directory) {
  auto read = base::readAnnotations(directory);
  if (!read && !isOfTheFile(read.error())) {
    spdlog::warn("annotations are served as they were: {}", read.error().message);
    return std::nullopt;
  }
  if (!read) spdlog::warn("no annotations: {}", read.error().message);
  return annotationsOf(read && *read ? std::move((*read)->text) : std::string());
}

}  // namespace

std::optional<FileStamp> stampOf(const std::filesystem::path& path, const std::optional<FileStamp>& unknown) {
  std::error_code ec;
  FileStamp stamp;
  stamp.time = std::filesystem::last_write_time(path, ec);
  if (!ec) stamp.size = std::filesystem::file_size(path, ec);
  if (!ec) return stamp;
  return isMissing(ec) ? std::nullopt : unknown;
}

AnnotationsDocument annotationsOf(std::string text) {
  AnnotationsDocument document{text.empty() ? kNoAnnotations : std::move(text), {}};
  document.etag = entityTag(base::viewOfText(document.text));
  return document;
}

ChangedDocuments readChanges(const std::string& directory, const DocumentStamps& known) {
  const std::string scene_path = directory + "/scene.json";
  ChangedDocuments changed;
  changed.stamps = {stampOf(scene_path, known.scene),
                    stampOf(std::filesystem::path(directory) / base::kAnnotationsFile, known.annotations)};
  // A file that cannot be read now, as while a build replaces the scene, is tried again the next time.
  if (changed.stamps.scene != known.scene) {
    if (const auto bytes = base::readFile(scene_path))
      changed.scene = readSceneDocument(scene_path, *bytes);
    else
      changed.stamps.scene = known.scene;
  }
  if (changed.stamps.annotations != known.annotations) {
    changed.annotations = readAnnotationsDocument(directory);
    if (!changed.annotations) changed.stamps.annotations = known.annotations;
  }
  return changed;
}

}  // namespace server
