#include "repository/objects/open_objects.h"

#include "repository/objects/s3_objects.h"
#include "repository/objects/web_source.h"

namespace repository {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;

// Returns "https" for "https://host" and "" for a path.
std::string schemeOf(const std::string& place) {
  const auto end = place.find("://");
  return end == std::string::npos ? "" : place.substr(0, end);
}

bool isWeb(const std::string& scheme) {
  return scheme == "http" || scheme == "https";
}

// The path in "file:///a%20b". RFC 8089 allows nothing or "localhost" between the second and the third slash.
Result<std::string> pathOfFileUrl(const std::string& place) {
  std::string rest = place.substr(7);
  if (rest.rfind("localhost/", 0) == 0) rest.erase(0, 9);
  if (rest.empty() || rest[0] != '/')
    return Error{ErrorCode::kInvalidInput, place + ": a file on another machine; write file:///path"};
  std::string path;
  for (std::size_t i = 0; i < rest.size(); ++i) {
    if (rest[i] != '%') {
      path += rest[i];
      continue;
    }
    const std::string digits = rest.substr(i + 1, 2);
    if (digits.size() != 2 || digits.find_first_not_of("0123456789abcdefABCDEF") != std::string::npos || digits == "00")
      return Error{ErrorCode::kInvalidInput,
                   place + ": '%' without two hexadecimal digits; write %25 for a percent sign"};
    path += static_cast<char>(std::stoi(digits, nullptr, 16));
    i += 2;
  }
  return path;
}

// Opens a place by the function for its kind. A file URL is a directory.
template <class OpenDirectory, class OpenWeb, class OpenS3>
auto openPlace(const std::string& place, OpenDirectory open_directory, OpenWeb open_web, OpenS3 open_s3)
    -> decltype(open_directory(place)) {
  const std::string scheme = schemeOf(place);
  if (scheme.empty()) return open_directory(place);
  if (isWeb(scheme)) return open_web(place);
  if (scheme == "s3") {
    const auto config = readS3Config();
    return config ? open_s3(place, *config) : base::within(place, config.error());
  }
  if (scheme != "file")
    return Error{ErrorCode::kInvalidInput, place +
                                               ": no place that we know; write a directory, file:///…, http://…, "
                                               "https://… or s3://bucket/prefix"};
  LUMIGRID_ASSIGN_OR_RETURN(const auto path, pathOfFileUrl(place));
  return open_directory(path);
}

}  // namespace

bool isRemotePlace(const std::string& place) {
  const std::string scheme = schemeOf(place);
  return isWeb(scheme) || scheme == "s3";
}

Result<std::unique_ptr<ObjectSource>> openObjectSource(const std::string& place) {
  const auto open_web = [](const std::string& url) { return openHttpSource(url, httpOptionsFromEnvironment()); };
  return openPlace(place, openDirectorySource, open_web, openS3Source);
}

Result<std::unique_ptr<ObjectSink>> openObjectSink(const std::string& place) {
  const auto refuse_web = [](const std::string& url) {
    return Error{ErrorCode::kUnsupported,
                 url + ": a web server takes no objects; publish to a directory that it serves, or to s3://…"};
  };
  return openPlace(place, openDirectorySink, refuse_web, openS3Sink);
}

}  // namespace repository
