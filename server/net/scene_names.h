#pragma once
// Several scenes on one port: each below its name, and a page at "/" that lists them (docs/formats/http.md).
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"

namespace server {

/// The names under which the scenes at these places are served, in their order: the last part of each place, with '-'
/// for what does not belong into an address. Errors: two that are the same, one that has none.
base::Result<std::vector<std::string>> namesOf(const std::vector<std::string>& places);

/// "/tower/scene.json?x" as "tower" and "/scene.json?x"; no rest for "/tower".
struct NamedTarget {
  std::string_view name, rest;
};
NamedTarget splitTarget(std::string_view target);

struct ListedScene {
  std::string name;
  std::uint64_t triangles = 0;
};
/// HTML. `host`: as a visitor would write it in an address.
std::string sceneList(const std::vector<ListedScene>& scenes, const std::string& host);

}  // namespace server
