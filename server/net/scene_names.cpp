#include "server/net/scene_names.h"

#include <algorithm>
#include <filesystem>
#include <set>

#include "base/text.h"

namespace server {
namespace {

constexpr std::string_view kAddressCharacters = "abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789._-";

/// The canonical path of a place in the file system, so that no scene is opened under two names, which LMDB forbids.
std::string realPlace(const std::string& place) {
  std::error_code failed;
  const auto canonical = std::filesystem::weakly_canonical(place, failed);
  return failed || place.find("://") != std::string::npos ? place : canonical.string();
}

std::string servedName(std::string place) {
  while (!place.empty() && place.back() == '/') place.pop_back();
  std::string name = place.substr(place.rfind('/') + 1);
  for (char& c : name)
    if (kAddressCharacters.find(c) == std::string_view::npos) c = '-';
  return name;
}

}  // namespace

base::Result<std::vector<std::string>> sceneNames(const std::vector<std::string>& places) {
  std::vector<std::string> names;
  std::set<std::string> taken;
  for (const std::string& place : places) {
    const std::string name = servedName(realPlace(place));
    if (name.empty() || name.find_first_not_of('.') == std::string::npos)
      return base::Error{base::ErrorCode::kInvalidInput,
                         place + ": has no name to be served under; give its directory one"};
    if (!taken.insert(name).second)
      return base::Error{base::ErrorCode::kInvalidInput,
                         place + ": another scene is served as '" + name +
                             "' already; names are the last parts of the places, rename one directory or serve it at "
                             "another port"};
    names.push_back(name);
  }
  return names;
}

NamedTarget splitTarget(std::string_view target) {
  if (!target.starts_with('/')) return {};
  const std::size_t end = target.find_first_of("/?", 1);
  const std::string_view name = target.substr(1, end == std::string_view::npos ? end : end - 1);
  if (end == std::string_view::npos || target[end] == '?') return {name, {}};
  return {name, target.substr(end)};
}

std::string sceneListPage(const std::vector<ListedScene>& scenes, const std::string& place) {
  std::string html =
      "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><meta name=\"viewport\" "
      "content=\"width=device-width\">"
      "<meta name=\"color-scheme\" content=\"light dark\"><link rel=\"icon\" href=\"data:,\"><title>Scenes - "
      "Lumigrid</title>\n"
      "<style>body { font: 16px/1.6 system-ui, sans-serif; max-width: 42rem; margin: 3rem auto; padding: 0 1rem } "
      "code, small { opacity: 0.7 } li { margin: 0.6rem 0 }</style>\n<h1>Scenes</h1>\n<ul>\n";
  // Names need no escaping: they hold only kAddressCharacters.
  for (const ListedScene& scene : scenes)
    html += "<li><a href=\"" + scene.name + "/\">" + scene.name + "</a> <small>" + base::formatCount(scene.triangles) +
            " triangles</small><br><code>lumigrid-view " + place + "/" + scene.name + "/</code></li>\n";
  return html + "</ul>\n</html>\n";
}

}  // namespace server
