#pragma once
// The scene's annotations.json as it is served. The file is read again when it changed, since people edit it while the
// scene is shown.
#include <filesystem>
#include <optional>
#include <string>

namespace server {

class Annotations {
 public:
  /// `directory`: the scene's; empty for a remote scene, whose `text` is served then. Without a text, an empty list is
  /// served.
  Annotations(std::string directory, std::string text);

  struct Document {
    std::string text;
    std::string etag;
  };
  /// The file's text; an empty list where there is no file or viewers would refuse it, which the log tells once.
  const Document& current();

 private:
  struct FileStamp {
    std::filesystem::file_time_type time;
    std::uintmax_t size = 0;
    friend bool operator==(const FileStamp&, const FileStamp&) = default;
  };
  std::optional<FileStamp> currentStamp() const;
  void setText(std::string text);
  void readFile();

  const std::string directory_;
  std::optional<FileStamp> stamp_;  ///< stamp of the file that was read; none: there was no file
  Document document_;
};

}  // namespace server
