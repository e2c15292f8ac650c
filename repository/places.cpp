#include "repository/places.h"

#include <string_view>

namespace repository {
namespace {

using base::Error;
using base::ErrorCode;

constexpr std::string_view kFile = "file://";

// "s3" of "s3://bucket"; empty for a path.
std::string_view schemeOf(std::string_view place) {
  const auto end = place.find("://");
  return end == std::string_view::npos ? std::string_view() : place.substr(0, end);
}

}  // namespace

base::Result<std::unique_ptr<ObjectSink>> openSink(const std::string& place) {
  const std::string_view scheme = schemeOf(place);
  if (scheme.empty()) return openDirectorySink(place);
  if (scheme == "file") return openDirectorySink(place.substr(kFile.size()));
  if (scheme == "http" || scheme == "https")
    return Error{ErrorCode::kUnsupported,
                 place + ": cannot be written to; publish to a directory and let a web server serve that"};
  if (scheme == "s3")
    return Error{ErrorCode::kUnsupported,
                 place + ": buckets cannot be written to; publish to a directory and copy that, scene.json last"};
  return Error{ErrorCode::kUnsupported, place + ": no such kind of place; it can be a directory"};
}

}  // namespace repository
