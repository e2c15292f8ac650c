#pragma once
// What a person keeps between two runs: settings.json and bookmarks.json in the user's config directory
// (docs/formats/settings.md).
#include <array>
#include <string>
#include <vector>

#include "base/error.h"
#include "client/app/app.h"
#include "client/app/settings.h"

namespace client {

/// $XDG_CONFIG_HOME/lumigrid, else $HOME/.config/lumigrid; empty when neither is set. Not made yet.
std::string userConfigDirectory();

struct ReadSettings {
  Settings settings;                    ///< defaults where the file says nothing, or nonsense
  std::vector<std::string> complaints;  ///< one line each
};
/// Of settings.json's text. Never fails: what is wrong is passed over and complained about.
ReadSettings parseSettings(const std::string& text);
/// What differs from the defaults.
std::string formatSettings(const Settings& settings);
/// No file: the defaults, without complaint.
ReadSettings readSettings(const std::string& directory);
/// Makes the directory.
base::Result<void> writeSettings(const std::string& directory, const Settings& settings);

/// Permalinks by slot, 0 unused; empty: none.
using Bookmarks = std::array<std::string, kBookmarks>;
/// How bookmarks.json calls a scene.
std::string bookmarkKey(const protocol::Welcome& welcome);
/// No file, or nothing for this scene: no bookmarks. Error: the file is there and is none.
base::Result<Bookmarks> readBookmarks(const std::string& directory, const std::string& scene);
/// Replaces those of this scene, keeps all others. A file that cannot be read is not overwritten: an error.
base::Result<void> writeBookmarks(const std::string& directory, const std::string& scene, const Bookmarks& bookmarks);

}  // namespace client
