#include "client/native/user_files.h"

#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "base/file.h"
#include "base/format_text.h"
#include "base/json/parse.h"
#include "client/app/permalink.h"

namespace client {
namespace {

using nlohmann::json;

constexpr const char* kSettingsFile = "/settings.json";
constexpr const char* kBookmarksFile = "/bookmarks.json";
constexpr std::size_t kMaxSettingsFile = 64 * 1024;
constexpr std::size_t kMaxBookmarksFile = 1024 * 1024;
constexpr int kBookmarksVersion = 1;

std::string fromEnvironment(const char* name) {
  const char* value = std::getenv(name);
  return value != nullptr ? value : "";
}

/// Returns the text of a file, empty when there is none.
base::Result<std::string> textOf(const std::string& path, std::size_t limit) {
  std::error_code error;
  if (!std::filesystem::exists(path, error)) return std::string();
  if (std::filesystem::file_size(path, error) > limit)
    return base::Error{base::ErrorCode::kInvalidInput, path + ": has more than " + std::to_string(limit) + " bytes"};
  LUMIGRID_ASSIGN_OR_RETURN(const auto bytes, base::readFile(path));
  return std::string(bytes.begin(), bytes.end());
}

base::Result<void> writeText(const std::string& directory, const char* file, const std::string& text) {
  if (directory.empty())
    return base::Error{base::ErrorCode::kNotFound, "neither XDG_CONFIG_HOME nor HOME says where to keep settings"};
  std::error_code error;
  std::filesystem::create_directories(directory, error);
  if (error) return base::Error{base::ErrorCode::kIo, directory + ": cannot be made: " + error.message()};
  return base::writeFileAtomically(directory + file, base::Bytes(text.begin(), text.end()));
}

/// Returns a JSON member's value as the table of settings keeps it.
base::Result<double> settingFrom(const SettingField& field, const json& value) {
  switch (field.kind) {
    case SettingKind::kFlag:
      if (value.is_boolean()) return value.get<bool>() ? 1.0 : 0.0;
      break;
    case SettingKind::kChoice:
      if (value.is_string()) return choiceValue(field, value.get<std::string>());
      break;
    case SettingKind::kNumber:
    case SettingKind::kInteger:
      if (value.is_number()) return value.get<double>();
      break;
  }
  return base::Error{base::ErrorCode::kInvalidInput,
                     "setting " + std::string(field.name) + ": is of the wrong kind (docs/formats/settings.md)"};
}

json settingTo(const SettingField& field, double value) {
  if (field.kind == SettingKind::kFlag) return value != 0.0;
  if (field.kind == SettingKind::kChoice) return std::string(choiceName(field, value));
  if (field.kind == SettingKind::kInteger) return static_cast<std::int64_t>(value);
  return value;
}

base::Result<json> bookmarksIn(const std::string& directory) {
  const std::string path = directory + kBookmarksFile;
  LUMIGRID_ASSIGN_OR_RETURN(const auto text, textOf(path, kMaxBookmarksFile));
  if (text.empty()) return json{{"version", kBookmarksVersion}, {"scenes", json::object()}};
  json document = base::parseJson(base::viewOfText(text));
  const bool fine = document.is_object() && document.contains("version") && document["version"] == kBookmarksVersion &&
                    document.contains("scenes") && document["scenes"].is_object();
  if (!fine)
    return base::Error{base::ErrorCode::kInvalidInput,
                       path + ": is no file of bookmarks, version 1; move it away (docs/formats/settings.md)"};
  return document;
}

}  // namespace

std::string userConfigDirectory() {
  const std::string config = fromEnvironment("XDG_CONFIG_HOME");
  if (!config.empty()) return config + "/lumigrid";
  const std::string home = fromEnvironment("HOME");
  return home.empty() ? "" : home + "/.config/lumigrid";
}

ReadSettings parseSettings(const std::string& text) {
  ReadSettings read;
  const json document = base::parseJson(base::viewOfText(text));
  if (!document.is_object() || !document.contains("version") || document["version"] != kSettingsVersion) {
    read.complaints.push_back("settings: not a JSON object of version 1; the defaults hold");
    return read;
  }
  for (const auto& [name, value] : document.items()) {
    if (name == "version") continue;
    const SettingField* field = findSetting(name);
    if (field == nullptr) {
      read.complaints.push_back("setting " + name.substr(0, 64) + ": there is no such setting");
      continue;
    }
    const auto number = settingFrom(*field, value);
    const auto set = number ? setSetting(read.settings, name, *number) : base::Result<void>(number.error());
    if (!set) read.complaints.push_back(set.error().message);
  }
  return read;
}

std::string formatSettings(const Settings& settings) {
  const Settings standard;
  nlohmann::ordered_json document{{"version", kSettingsVersion}};
  for (const SettingField& field : settingFields()) {
    const double value = settings.*(field.value);
    if (value != standard.*(field.value)) document[std::string(field.name)] = settingTo(field, value);
  }
  return document.dump(1) + "\n";
}

ReadSettings readSettings(const std::string& directory) {
  if (directory.empty()) return {};
  const auto text = textOf(directory + kSettingsFile, kMaxSettingsFile);
  if (!text) return {{}, {text.error().message}};
  return text->empty() ? ReadSettings{} : parseSettings(*text);
}

base::Result<void> writeSettings(const std::string& directory, const Settings& settings) {
  return writeText(directory, kSettingsFile, formatSettings(settings));
}

std::string bookmarkKey(const protocol::Welcome& welcome) {
  return welcome.scene_name + base::formatText("@%.9g,%.9g,%.9g", welcome.origin.x, welcome.origin.y, welcome.origin.z);
}

base::Result<Bookmarks> readBookmarks(const std::string& directory, const std::string& scene) {
  Bookmarks bookmarks;
  if (directory.empty()) return bookmarks;
  LUMIGRID_ASSIGN_OR_RETURN(const auto document, bookmarksIn(directory));
  const json& scenes = document["scenes"];
  const auto mine = scenes.find(scene);
  if (mine == scenes.end() || !mine->is_object()) return bookmarks;
  for (std::size_t slot = 1; slot < bookmarks.size(); ++slot) {
    const auto link = mine->find(std::to_string(slot));
    if (link == mine->end() || !link->is_string()) continue;
    if (parsePermalink(link->get<std::string>())) bookmarks[slot] = link->get<std::string>();
  }
  return bookmarks;
}

base::Result<void> writeBookmarks(const std::string& directory, const std::string& scene, const Bookmarks& bookmarks) {
  LUMIGRID_ASSIGN_OR_RETURN(auto document, bookmarksIn(directory));
  json mine = json::object();
  for (std::size_t slot = 1; slot < bookmarks.size(); ++slot)
    if (!bookmarks[slot].empty()) mine[std::to_string(slot)] = bookmarks[slot];
  document["scenes"][scene] = std::move(mine);
  return writeText(directory, kBookmarksFile, document.dump(1, ' ', false, json::error_handler_t::replace) + "\n");
}

}  // namespace client
