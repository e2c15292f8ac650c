#pragma once
// Names of the pictures that the window saves, and the request for one that the server draws.
#include <array>
#include <string>

#include "client/app/app.h"

namespace client {

/// Names a picture after the scene and the time: "lumigrid-skull-20260504-153012.png". Characters that file names
/// cannot have become '-'.
std::string pictureName(const std::string& scene);
/// Returns a path in the folder that does not exist yet.
std::string freePath(const std::string& directory, const std::string& name);
/// Returns the path and query of the server's picture, in the window's size and on its background (RGBA, 0 … 1).
std::string renderTarget(const Request& request, const std::array<float, 4>& background);

}  // namespace client
