#pragma once
// The options of `lumigrid build`, which of them go together, and those that a scene records.
#include <CLI/CLI.hpp>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "base/resource_limits.h"
#include "lod/hlod/builder/build.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "lod/qsplat/builder/build.h"
#include "server/bake/bake.h"
#include "server/cli/first_view.h"
#include "server/cli/tuned.h"
#include "server/render/scene_light.h"

namespace server::cli {

struct BuildArguments {
  std::vector<std::string> meshes;
  std::string output;
  std::vector<std::string> methods{"patch", "images"};
  bool usual_methods = false;  ///< --methods was not given
  bool automatic = false;      ///< --methods auto: `methods` has patch, and images once they were found worth it
  bool force = false, json = false, quiet = false, missing = false, splats_coded = false;
  std::string shard;         ///< i/n or auto, as given
  std::uint32_t shards = 0;  ///< 0: as the scene records, or one store
  std::string light = "auto", up = "auto", interior = "auto", units = "unknown", subsampling = "420", tune = "off";
  lod::hlod::LightArguments light_place;  ///< of a light that throws shadows
  std::optional<double> tune_db;          ///< --tune in dB, nothing: off
  std::optional<std::uint32_t> grid;      ///< as given; nothing: usualGrid()
  std::uint32_t face = 0;                 ///< pixels; 0: not given, so faces are tiles
  std::string tiles;                      ///< off, auto or a depth, as given; usageError() fills in what was not
  std::uint32_t tile_depth = 0;           ///< --tiles as a depth; 0: plain faces of `face` pixels
  double view_pixels = 24.0;
  std::string codec;             ///< jpeg or webp, as given; usageError() fills in what was not
  std::optional<int> quality;    ///< as given; nothing: the codec's usual one
  std::optional<double> margin;  ///< as given; nothing: usualMargin()
  std::string tmpdir, regroup = "on", stitch = "auto", normals = "auto", textures = "keep", appearance = "auto";
  std::string views_from;  ///< a scene; empty: views are drawn anywhere
  base::ResourceLimits limits;
  lod::patch::builder::HierarchyOptions hierarchy;  ///< without the limits, which all methods share
  double splats_dice = lod::qsplat::builder::kDefaultDice;
  lod::hlod::builder::BuildOptions hlod;  ///< the same, and without stitching and appearance
  BakeOptions bake;                       ///< without the limits
};

/// A method of which the scene keeps one file. Its work files lie beside that, unless --tmpdir says otherwise.
struct FileMethod {
  const char* method;
  const char* file;
  const char* work_files;
};
inline constexpr FileMethod kPatches{"patch", "patch.lgp", "patch.lgp.work"};
inline constexpr FileMethod kSplats{"qsplat", "qsplat.lgq", "qsplat.lgq.work"};
inline constexpr FileMethod kUmbrellas{"pmr", "pmr.lgm", "pmr.lgm.work"};
inline constexpr FileMethod kHlod{"hlod", "hlod.lgh", "hlod.lgh.work"};
/// Where the source has textures: the leaves' part of them.
inline constexpr const char* kTextureFile = "texture.lgt";
/// The work files that all of them share.
inline constexpr const char* kSourceWorkFiles = "source.work";
inline constexpr FileMethod kFileMethods[] = {kPatches, kSplats, kUmbrellas, kHlod};
inline constexpr const char* kMethods[] = {"patch", "images", "qsplat", "pmr", "hlod"};
/// Chooses among them.
inline constexpr const char* kAuto = "auto";

/// Recorded options that decide what scene.json says of the source, and the patch hierarchy besides. The light's place
/// is recorded where it was given.
inline constexpr const char* kSourceParameters[] = {"light", "light-direction", "light-position",  "light-size",
                                                    "up",    "units",           kInteriorParameter};
inline constexpr const char* kHierarchyParameters[] = {
    "voxel-triangles", "leaf-triangles", "node-triangles", "position-bits", "regroup", "stitch", "normals"};
/// Recorded as "vertex" where textures only coloured the vertices.
inline constexpr const char* kTexturesParameter = "textures";
/// Recorded where the tree of splats is in the coded form.
inline constexpr const char* kSplatsCoded = "qsplat-coded";
/// Recorded where the scene has a tree of splats: how its triangles were diced.
inline constexpr const char* kSplatsDice = "qsplat-dice";
/// Recorded where the scene has an octree of triangles and points.
inline constexpr const char* kHlodTriangles = "hlod-triangles";
inline constexpr const char* kHlodResolution = "hlod-resolution";
inline constexpr const char* kHlodAppearance = "appearance";
/// Options of one method, recorded where the scene has it.
struct MethodParameter {
  const char* method;
  const char* name;
};
inline constexpr MethodParameter kMethodParameters[] = {
    {"qsplat", kSplatsDice}, {"hlod", kHlodTriangles}, {"hlod", kHlodResolution}, {"hlod", kHlodAppearance}};
/// A parameter of the source's import, and the methods of a scene that must have it alike.
struct SharedParameter {
  const char* name;
  std::vector<const char*> methods;
};
inline const SharedParameter kSharedParameters[] = {{"stitch", {"patch", "hlod"}},
                                                    {"position-bits", {"patch", "hlod", "qsplat"}}};

bool wants(const BuildArguments& a, const char* method);
/// The light that --light names. For auto: unlit where colours are scanned ones, which hold the light of their place.
base::LightMode lightModeOf(const BuildArguments& a, bool is_scanned);
/// Whether recorded parameters name the method among --methods.
bool hasMethod(const Parameters& parameters, const std::string& method);
/// The methods that `includes` takes, as parameters record them: "patch,images".
std::string listMethods(const std::function<bool(const char* method)>& includes);

/// The options that decide what the scene holds, as scene.json keeps them. Threads, batches and messages are not among
/// them.
Parameters parametersOf(const BuildArguments& a);
/// Points along the longest side of the viewing box where --grid is not given: kUsualGrid, or more in an interior that
/// asks for it.
inline constexpr std::uint32_t kUsualGrid = 12;
std::uint32_t usualGrid(const base::Scene& scene);
/// The margin of the viewing box where none is given, in longest sides of the model: an interior is seen from its
/// rooms.
double usualMargin(const base::Scene& scene);

/// Declares the options, each with its default.
void declareBuildOptions(CLI::App& command, BuildArguments& a);
/// Why options do not go together that are right each by itself; empty when they do. Sets tune_db, tile_depth
/// and automatic.
std::string usageError(const CLI::App& command, BuildArguments& a);

/// For a command without meshes: the options that it does not give are those that the scene in its output records.
base::Result<BuildArguments> withRecordedOptions(const CLI::App& given, const BuildArguments& a);

}  // namespace server::cli
