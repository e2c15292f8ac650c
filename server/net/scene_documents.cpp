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

std::optional<SceneDocument> readSceneDocument(const std::string& path) {
  auto bytes = base::readFile(path);
  if (!bytes) return std::nullopt;  // a build is replacing the scene
  auto scene = base::parseScene(std::string(bytes->begin(), bytes->end()), path);
  if (!scene) {
    spdlog::warn("scene.json is served as it was: {}", scene.error().message);
    return std::nullopt;
  }
  std::string etag = entityTag(*bytes);
  return SceneDocument{std::move(*scene), std::move(*bytes), std::move(etag)};
}

AnnotationsDocument readAnnotationsDocument(const std::string& directory) {
  auto read = base::readAnnotations(directory);
  if (!read) spdlog::warn("no annotations: {}", read.error().message);
  return annotationsOf(read && *read ? std::move((*read)->text) : std::string());
}

}  // namespace

std::optional<FileStamp> stampOf(const std::filesystem::path& path) {
  std::error_code ec;
  FileStamp stamp;
  stamp.time = std::filesystem::last_write_time(path, ec);
  if (ec) return std::nullopt;
  stamp.size = std::filesystem::file_size(path, ec);
  return stamp;
}

AnnotationsDocument annotationsOf(std::string text) {
  AnnotationsDocument document{text.empty() ? kNoAnnotations : std::move(text), {}};
  document.etag = entityTag(base::viewOfText(document.text));
  return document;
}

ChangedDocuments readChanges(const std::string& directory, const DocumentStamps& known) {
  const std::string scene_path = directory + "/scene.json";
  ChangedDocuments changed;
  changed.stamps = {stampOf(scene_path), stampOf(std::filesystem::path(directory) / base::kAnnotationsFile)};
  if (changed.stamps.scene != known.scene) changed.scene = readSceneDocument(scene_path);
  if (changed.stamps.annotations != known.annotations) changed.annotations = readAnnotationsDocument(directory);
  return changed;
}

}  // namespace server
