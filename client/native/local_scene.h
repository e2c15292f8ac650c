#pragma once
// Opens a scene that is a folder on this machine, without a server: the files of streamed methods as they lie on the
// disk, and a published scene's patches and images.
#include <memory>
#include <optional>
#include <string>

#include "client/native/link.h"

namespace client {

/// Returns the folder when the text names a scene on this machine: a folder with a scene.json, or that file. nullopt
/// for anything else, and for any text with "://".
std::optional<std::string> localSceneDirectory(const std::string& text);

/// Opens a link for patches and images. The session is refused where the folder is as `lumigrid build` wrote it: its
/// images are for a server. Errors: those of reading scene.json.
base::Result<std::unique_ptr<Link>> openLocalScene(const std::string& directory);
/// Opens a link for a method for which isStreamed(). Errors: those of reading scene.json and of the method's file.
base::Result<std::unique_ptr<Link>> openLocalFile(const std::string& directory, Method method,
                                                  const StreamedOptions& options);

}  // namespace client
