#pragma once
// The settings that people keep (docs/formats/settings.md): one table of names, kinds, ranges and defaults, which the
// native program writes as JSON and the page shows and keeps in its own way.
#include <cstdint>
#include <span>
#include <string_view>

#include "base/error.h"
#include "base/view_defaults.h"
#include "client/source/method.h"
#include "lod/hlod/shadow_options.h"

namespace client {

inline constexpr int kSettingsVersion = 1;

enum class ReducedMotion : std::uint8_t { kSystem, kOn, kOff };
enum class Theme : std::uint8_t { kSystem, kLight, kDark };

struct Settings {
  double method = 0.0;               ///< place in "lumigraph patches qsplat pmr hlod"; from the next start on
  double splat = 1.0;                ///< lod::draw::SplatKernel
  double cutoff = 1.0;               ///< diameter of a splat at rest, pixels; 0: refine down to the leaves
  double tolerance = 1.0;            ///< radius of umbrellas at rest, pixels
  double error_px = 0.5;             ///< error of hlod's nodes on the screen at rest, pixels
  double shadows = 0.0;              ///< lod::hlod::Shadows
  double frame_rate = 10.0;          ///< pictures of streamed methods a second while the view moves
  double fps = 30.0;                 ///< the same of patches and images
  double cache_megabytes = 50.0;     ///< compressed images and patches kept; from the next start on
  double memory_megabytes = 1000.0;  ///< all memory together, on the GPU and off; from the next start on
  double gpu_megabytes = 512.0;      ///< textures; from the next start on
  double patch_tolerance = base::ViewDefaults::kPatchTolerance;  ///< pixels, of patches under images
  double alone_tolerance = base::ViewDefaults::kAloneTolerance;  ///< pixels, of patches without images
  double guarantee = 0.0;                                        ///< tolerances hold for proved bounds
  double max_triangles = base::ViewDefaults::kMaxTriangles;
  double points = base::ViewDefaults::kPoints;   ///< sampling points whose images are asked for
  double samples = base::ViewDefaults::kImages;  ///< images blended in a picture
  double images = 1.0;                           ///< flags are 0 or 1
  double frames = 1.0;
  double refine = 1.0;  ///< finer patches at rest, or a frame without loss
  double antialias = 1.0;
  double fov_degrees = 45.0;  ///< vertical
  double orbit_speed = 1.0;
  double zoom_speed = 1.0;  ///< below 0 the wheel works the other way
  double fly_speed = 1.0;
  double reduced_motion = 0.0;  ///< ReducedMotion
  double theme = 0.0;           ///< Theme
  friend bool operator==(const Settings&, const Settings&) = default;
};

enum class SettingKind : std::uint8_t { kNumber, kInteger, kFlag, kChoice };

struct SettingField {
  std::string_view name;   ///< in JSON: "patch_tolerance"
  std::string_view label;  ///< for people: "Patch tolerance, pixels"
  SettingKind kind;
  double min, max;
  double Settings::*value;
  /// kChoice: names separated by blanks, "system light dark"; the value is the position in the list.
  std::string_view choices = {};
  bool from_next_start = false;  ///< takes effect when the viewer is opened again
};

/// Returns the method that Settings::method names.
Method methodOf(const Settings& settings);
/// Returns Settings::shadows.
inline lod::hlod::Shadows shadowsOf(const Settings& settings) {
  return static_cast<lod::hlod::Shadows>(static_cast<int>(settings.shadows));
}

/// All settings, in the order in which they are shown. Their defaults are those of Settings.
std::span<const SettingField> settingFields();
const SettingField* findSetting(std::string_view name);  ///< null when there is none

/// Sets one by name. Errors, which change nothing: no such name, out of range, not finite, a fraction where a whole
/// number is needed.
base::Result<void> setSetting(Settings& settings, std::string_view name, double value);
/// Returns the position of a choice's name in its field's list; an error when it is not one of them.
base::Result<double> choiceValue(const SettingField& field, std::string_view choice);
std::string_view choiceName(const SettingField& field, double value);

}  // namespace client
