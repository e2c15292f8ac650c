#pragma once
// One scene of a server with everything that answers for it.
#include <cstddef>
#include <memory>
#include <string>

#include "server/net/access_log.h"
#include "server/net/open_scene.h"
#include "server/net/pick.h"
#include "server/net/server.h"
#include "server/net/site.h"

namespace server {

struct HostedScene {
  HostedScene(std::size_t position, std::string served_as, std::unique_ptr<OpenScene> opened)
      : number(position), name(std::move(served_as)), scene(std::move(opened)) {}

  const std::size_t number;  ///< position in the server's list; the renderer knows the scene by it
  const std::string name;    ///< first part of its addresses; empty for an only scene, which is at "/"
  std::unique_ptr<OpenScene> scene;
  std::unique_ptr<Site> site;
  std::unique_ptr<Picker> picker;     ///< null: the scene is splats-only
  std::unique_ptr<AccessLog> access;  ///< null: nothing is counted

  bool hasPatches() const { return scene->data.patches != nullptr; }
  /// Starts to count what is sent, in the file that the options name or in the scene's directory. A scene without
  /// patches has nothing to count; where the counts would have no place, the log says so.
  void startAccessLog(const ServerOptions& options, const std::string& scene_directory);
  /// Writes what was counted; nothing is counted from here on.
  void endAccessLog();
};

/// Writes to the log which published images cannot be read. Each message is logged once, at most 100 of them: a
/// missing pack holds hundreds of faces, and viewers ask for them again and again.
void logImageErrors(OpenScene& scene);

}  // namespace server
