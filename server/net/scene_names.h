#pragma once
// Addresses of several scenes on one port: each is below its name, and a page at "/" lists them (docs/formats/http.md).
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"

namespace server {

/// The names under which the scenes at these places are served, in the same order: the last part of each place, with
/// '-' for characters that do not belong into an address. Errors: two equal names, a place without a name.
base::Result<std::vector<std::string>> sceneNames(const std::vector<std::string>& places);

/// Splits "/tower/scene.json?x" into "tower" and "/scene.json?x"; "/tower" has no rest.
struct NamedTarget {
  std::string_view name, rest;
};
NamedTarget splitTarget(std::string_view target);

struct ListedScene {
  std::string name;
  std::uint64_t triangles = 0;
};
/// The page as HTML. `place`: the server's, as a viewer is given it, "ws://host:port".
std::string sceneListPage(const std::vector<ListedScene>& scenes, const std::string& place);

}  // namespace server
