#pragma once
// Reads and writes what a user keeps between two runs: settings.json and bookmarks.json in the user's configuration
// folder (docs/formats/settings.md).
#include <array>
#include <string>
#include <vector>

#include "base/error.h"
#include "client/app/app.h"
#include "client/app/settings.h"

namespace client {

/// Returns $XDG_CONFIG_HOME/lumigrid, else $HOME/.config/lumigrid, or the empty text when neither is set. The folder
/// may not exist yet.
std::string userConfigDirectory();

struct ReadSettings {
  Settings settings;                    ///< defaults where the file has no valid value
  std::vector<std::string> complaints;  ///< one line each
};
/// Reads the text of settings.json. Never fails: invalid values are skipped, with a complaint.
ReadSettings parseSettings(const std::string& text);
/// Writes the settings that differ from their defaults.
std::string formatSettings(const Settings& settings);
/// Reads the file; without one, returns the defaults without complaint.
ReadSettings readSettings(const std::string& directory);
/// Writes the file, and makes its folder.
base::Result<void> writeSettings(const std::string& directory, const Settings& settings);

/// Permalinks by slot; slot 0 is unused, an empty text means no bookmark.
using Bookmarks = std::array<std::string, kBookmarks>;
/// Returns the name of a scene in bookmarks.json.
std::string bookmarkKey(const protocol::Welcome& welcome);
/// Reads the bookmarks of a scene; none when there is no file or no entry. An error means that the file exists but is
/// invalid.
base::Result<Bookmarks> readBookmarks(const std::string& directory, const std::string& scene);
/// Replaces the bookmarks of this scene and keeps all others. An invalid file is not overwritten but is an error.
base::Result<void> writeBookmarks(const std::string& directory, const std::string& scene, const Bookmarks& bookmarks);

}  // namespace client
