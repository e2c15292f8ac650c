#include "client/app/settings.h"

#include <array>
#include <cmath>
#include <string>

namespace client {
namespace {

using Kind = SettingKind;

constexpr std::array<SettingField, 27> kFields{{
    {"method", "What is shown, where the scene has it", Kind::kChoice, 0, 4, &Settings::method,
     "lumigraph patches qsplat pmr hlod", true},
    {"splat", "Shape of splats", Kind::kChoice, 0, 3, &Settings::splat, "square circle fuzzy ellipse"},
    {"cutoff", "Size of splats at rest, pixels", Kind::kNumber, 0, 1000, &Settings::cutoff},
    {"tolerance", "Size of umbrellas at rest, pixels", Kind::kNumber, 0.25, 1000, &Settings::tolerance},
    {"error_px", "Error of hlod at rest, pixels", Kind::kNumber, 0.125, 1000, &Settings::error_px},
    {"shadows", "Shadows of hlod", Kind::kChoice, 0, 2, &Settings::shadows, "none hard soft"},
    {"frame_rate", "Pictures a second of qsplat, pmr and hlod while moving; 0: as fine as at rest", Kind::kNumber, 0,
     1000, &Settings::frame_rate},
    {"fps", "Pictures a second while moving, coarser if need be; 0: as fine as at rest", Kind::kNumber, 0, 1000,
     &Settings::fps, "", true},
    {"cache_megabytes", "Memory for images and patches as they came, MB", Kind::kInteger, 8, 65536,
     &Settings::cache_megabytes, "", true},
    {"memory_megabytes", "All memory that grows with the scene, MB", SettingKind::kInteger, 16, 65536,
     &Settings::memory_megabytes, "", true},
    {"gpu_megabytes", "Graphics memory, MB", Kind::kInteger, 16, 65536, &Settings::gpu_megabytes, "", true},
    {"patch_tolerance", "Error up to which shape is refined, pixels", Kind::kNumber, 0, 1000,
     &Settings::patch_tolerance, "", true},
    {"alone_tolerance", "The same where no images are used", Kind::kNumber, 0, 1000, &Settings::alone_tolerance, "",
     true},
    {"guarantee", "Refine until every point is proved to be within that error", Kind::kFlag, 0, 1, &Settings::guarantee,
     "", true},
    {"max_triangles", "Most triangles in a picture", Kind::kInteger, 1'000, 1'000'000'000, &Settings::max_triangles, "",
     true},
    {"points", "Places whose images are asked for", Kind::kInteger, 1, 64, &Settings::points, "", true},
    {"samples", "Images blended in a picture", Kind::kInteger, 1, 32, &Settings::samples, "", true},
    {"images", "Use images", Kind::kFlag, 0, 1, &Settings::images, "", true},
    {"frames", "Ask for the exact picture at rest", Kind::kFlag, 0, 1, &Settings::frames, "", true},
    {"refine", "Refine the picture at rest until it is exact; takes more data", Kind::kFlag, 0, 1, &Settings::refine,
     "", true},
    {"antialias", "Smooth edges, where memory and frame times allow", Kind::kFlag, 0, 1, &Settings::antialias, "",
     true},
    {"fov_degrees", "Vertical angle of view, degrees", Kind::kNumber, 5, 120, &Settings::fov_degrees},
    {"orbit_speed", "Speed of turning", Kind::kNumber, 0.1, 10, &Settings::orbit_speed},
    {"zoom_speed", "Speed of zooming; below 0 the wheel works the other way", Kind::kNumber, -10, 10,
     &Settings::zoom_speed},
    {"fly_speed", "Speed of flying", Kind::kNumber, 0.1, 10, &Settings::fly_speed},
    {"reduced_motion", "Jump instead of gliding", Kind::kChoice, 0, 2, &Settings::reduced_motion, "system on off"},
    {"theme", "Light or dark", Kind::kChoice, 0, 2, &Settings::theme, "system light dark"},
}};

base::Error bad(std::string_view name, const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, "setting " + std::string(name.substr(0, 64)) + ": " + problem};
}

/// Writes a bound without superfluous decimals.
std::string plain(double value) {
  std::string text = std::to_string(value);
  text.erase(text.find_last_not_of('0') + 1);
  if (text.back() == '.') text.pop_back();
  return text;
}

/// Returns word number `place` of a list separated by blanks; empty beyond the last.
std::string_view word(std::string_view words, int place) {
  for (; place > 0; --place) {
    const std::size_t blank = words.find(' ');
    if (blank == std::string_view::npos) return {};
    words.remove_prefix(blank + 1);
  }
  return words.substr(0, words.find(' '));
}

}  // namespace

Method methodOf(const Settings& settings) {
  return *methodFromName(choiceName(*findSetting("method"), settings.method));
}

std::span<const SettingField> settingFields() {
  return kFields;
}

const SettingField* findSetting(std::string_view name) {
  for (const SettingField& field : kFields)
    if (field.name == name) return &field;
  return nullptr;
}

base::Result<void> setSetting(Settings& settings, std::string_view name, double value) {
  const SettingField* field = findSetting(name);
  if (field == nullptr) return bad(name, "there is no such setting");
  if (!(value >= field->min && value <= field->max))
    return bad(name, "must lie between " + plain(field->min) + " and " + plain(field->max));
  if (field->kind != Kind::kNumber && value != std::floor(value)) return bad(name, "must be a whole number");
  settings.*(field->value) = value;
  return {};
}

base::Result<double> choiceValue(const SettingField& field, std::string_view choice) {
  for (int place = 0; place <= static_cast<int>(field.max); ++place)
    if (!choice.empty() && word(field.choices, place) == choice) return static_cast<double>(place);
  return bad(field.name, "must be one of: " + std::string(field.choices));
}

std::string_view choiceName(const SettingField& field, double value) {
  return word(field.choices, static_cast<int>(value));
}

}  // namespace client
