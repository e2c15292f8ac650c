#pragma once
// The documents of a local scene that people change while it is served: scene.json, of which `lumigrid set` changes how
// the scene is shown, and annotations.json. A thread that may wait for a disk reads them; whoever answers takes up what
// it read.
#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>

#include "base/bytes.h"
#include "base/json/scene_file.h"

namespace server {

/// When a file was written and how long it is; nothing where it is not there.
struct FileStamp {
  std::filesystem::file_time_type time;
  std::uintmax_t size = 0;
  friend bool operator==(const FileStamp&, const FileStamp&) = default;
};
/// `unknown`: what is returned where the disk does not tell.
std::optional<FileStamp> stampOf(const std::filesystem::path& path, const std::optional<FileStamp>& unknown);

/// The files as they were read last.
struct DocumentStamps {
  std::optional<FileStamp> scene, annotations;
};

/// A scene.json, and as it is served.
struct SceneDocument {
  base::Scene scene;
  base::Bytes bytes;
  std::string etag;
};

/// An annotations.json as it is served.
struct AnnotationsDocument {
  std::string text;
  std::string etag;
};
/// An empty `text` is an empty list.
AnnotationsDocument annotationsOf(std::string text);

/// The documents that differ from those of the stamps.
struct ChangedDocuments {
  DocumentStamps stamps;               ///< as they are now
  std::optional<SceneDocument> scene;  ///< nothing as well where it cannot be read, as during a build
  /// An empty list where there is no such file, or viewers would refuse it; nothing as well where it cannot be read.
  std::optional<AnnotationsDocument> annotations;
};
/// `directory`: the scene's. The log tells once of a file that is wrong. Any thread; waits for the disk.
ChangedDocuments readChanges(const std::string& directory, const DocumentStamps& known);

}  // namespace server
