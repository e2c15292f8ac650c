#pragma once
// The scene's annotations.json as it is served: looked at anew when the file changed, since people edit it while the
// scene is shown.
#include <filesystem>
#include <optional>
#include <string>

namespace server {

class Annotations {
 public:
  /// `directory`: the scene's; empty: `text` is served, as it was read from elsewhere. No text: an empty list.
  Annotations(std::string directory, std::string text);

  struct Document {
    std::string text;
    std::string etag;
  };
  /// The file's text; an empty list where there is none, or none that viewers would take: the log says once why.
  const Document& current();

 private:
  struct Stamp {
    std::filesystem::file_time_type time;
    std::uintmax_t size = 0;
    friend bool operator==(const Stamp&, const Stamp&) = default;
  };
  std::optional<Stamp> stampNow() const;
  void take(std::string text);
  void readAnew();

  const std::string directory_;
  std::optional<Stamp> stamp_;  ///< of what was read; none: there was no file
  Document document_;
};

}  // namespace server
