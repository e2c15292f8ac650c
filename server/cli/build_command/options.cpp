#include "server/cli/build_command/options.h"

#include <algorithm>
#include <filesystem>
#include <iterator>
#include <nlohmann/json.hpp>
#include <numbers>

#include "base/json/scene_file.h"
#include "repository/sampling/shard.h"
#include "repository/sampling/tile.h"
#include "server/bake/tune.h"
#include "server/cli/scene_images.h"

namespace server::cli {
namespace {

namespace fs = std::filesystem;
using base::Error;
using base::ErrorCode;

void declareMethodOptions(CLI::App& command, BuildArguments& a) {
  command
      .add_option(
          "MESH", a.meshes,
          "PLY, OBJ, STL, OFF, glTF, 3D Tiles, LAS, PTX or XYZ files; several make one scene. May be left out "
          "once the scene has its hierarchy: then the options that are not given are those that the scene records")
      ->default_str("");
  command.add_option("-o,--output", a.output, "scene directory to make, or to go on with")->required();
  command.add_flag("--force", a.force, "replace a scene that is there");
  command
      .add_option(
          "--methods", a.methods,
          "parts to build: patch (the hierarchy), images (the repository; needs patch), qsplat (a tree of "
          "splats), pmr (points, and triangles around each), hlod (an octree of triangles, and points where they "
          "are small, all within a stated error); qsplat and pmr also from point clouds, which are LAS and PTX files, "
          "text with a point on each line (XYZ, PTS, CSV) and files of meshes without faces; of these qsplat is "
          "built if nothing is said. auto: patch, and images where a few held-out views are nearer "
          "to the full model with them; says what it measured. A scene that is there gets what it lacks")
      ->delimiter(',')
      ->check(CLI::IsMember([] {
        std::vector<std::string> names(std::begin(kMethods), std::end(kMethods));
        names.emplace_back(kAuto);
        return names;
      }()));
  command.add_flag("--qsplat-coded", a.splats_coded,
                   "write the tree of splats entropy-coded: about half of the bytes, on disk and over a link, for some "
                   "of the viewer's time (default: plain)");
}

void declareSamplingOptions(CLI::App& command, BuildArguments& a) {
  command
      .add_option("--grid", a.grid,
                  "sampling points along the longest side of the viewing box (default: 12, and in an interior as many "
                  "more as its rooms or passages are narrow, so that each has some)")
      ->check(CLI::Range(2, 1024));
  command
      .add_option("--margin", a.margin,
                  "viewing box beyond the model on every side, in longest sides of the model (default: 0.5, and 0 for "
                  "an interior, which is seen from its rooms)")
      ->check(CLI::Range(0.0, 100.0));
  PointSelection& selection = a.bake.selection;
  command
      .add_option("--views", selection.views,
                  "sampling by use: keep only the points of the grid that a client would be sent in this many random "
                  "views of the viewing box, e.g. 1000; 0: the whole grid")
      ->check(CLI::Range(0, 1'000'000));
  command
      .add_option("--worth", selection.worth,
                  "sampling by use: points are left out while what is left is worth this share of the whole grid to "
                  "these views")
      ->check(CLI::Range(0.01, 1.0));
  command
      .add_option("--budget", selection.budget_bytes,
                  "sampling by use: leave out more points until images and masks take at most about this many bytes, "
                  "e.g. 200M; 0: no limit")
      ->transform(CLI::AsSizeValue(false));
  command.add_option("--views-from", a.views_from,
                     "sampling by use: another scene of the same place that was served; the views are drawn where its "
                     "access counts say that viewers were");
}

void declareTileOptions(CLI::App& command, BuildArguments& a) {
  command
      .add_option(
          "--tiles", a.tiles,
          "a depth from 1 to 5: each face is a pyramid of tiles, of 248 pixels a side in its one first tile and "
          "of 248 x 2^depth where it is finest, and tiles that show nothing new are left out; auto: the depth "
          "that --view-pixels asks for; off: faces are plain images (default: auto, and off with --face)")
      ->check(CLI::IsMember({"off", "auto", "1", "2", "3", "4", "5"}));
  command
      .add_option(
          "--view-pixels", a.view_pixels,
          "for --tiles auto: pixels a degree, in the middle of a face, that are worth storing; the depth is the "
          "greatest, up to 4, whose faces have no more")
      ->check(CLI::Range(1.0, 1000.0));
}

void declareImageOptions(CLI::App& command, BuildArguments& a) {
  command
      .add_option("--face", a.face,
                  "instead of tiles, plain images of so many pixels along one side, as the paper's (512)")
      ->check(CLI::Range(16, 4096));
  declareTileOptions(command, a);
  command
      .add_option("--codec", a.codec,
                  "how images are coded: webp takes about half of the bytes; jpeg also serves viewers that decode "
                  "nothing else (default: webp for tiles, and jpeg for plain images and with --tune or --subsampling)")
      ->check(CLI::IsMember({"jpeg", "webp"}));
  command.add_option("--quality", a.quality, "quality of JPEG or WebP (default: 85 for JPEG, 80 for WebP)")
      ->check(CLI::Range(1, 100));
  command
      .add_option("--subsampling", a.subsampling,
                  "JPEG chroma subsampling; 420 halves the bytes, 444 keeps strong colours")
      ->check(CLI::IsMember({"420", "422", "444"}));
  command.add_option(
      "--tune", a.tune,
      "off, or a PSNR in dB, e.g. 36: takes the quality and subsampling of fewest bytes that reach it on the "
      "model's pixels of a sample of " +
          std::to_string(kTuneFaces) + " images");
  command.add_option("--tolerance", a.bake.tolerance_px, "largest projected error in the images, face pixels")
      ->check(CLI::Range(0.0F, 100.0F));
  command.add_option("--supersampling", a.bake.supersampling, "n x n samples per face pixel")->check(CLI::Range(1, 8));
  command.add_option("--batch", a.bake.batch_faces, "images per commit: the most a killed build loses")
      ->check(CLI::Range(1, 100000));
  command
      .add_option("--light", a.light,
                  "unlit: colours as scanned; soft: a soft directional light; hard-shadows, soft-shadows: a light that "
                  "throws shadows, which images and exact frames show (needs --methods hlod); auto: unlit where the "
                  "mesh has scanned colours or a texture, which are more than 256 colours")
      ->check(CLI::IsMember({"auto", "unlit", "soft", "hard-shadows", "soft-shadows"}));
  lod::hlod::declareLightOptions(command, a.light_place, kLightWords);
  command.add_option("--up", a.up, "axis that points up in the first view")
      ->check(CLI::IsMember({"auto", "x", "y", "z", "-x", "-y", "-z"}));
  command
      .add_option("--interior", a.interior,
                  "on: the scan is looked at from within, as rooms, a cave or a mine are; off: from around it; auto: "
                  "by its surface, which it says")
      ->check(CLI::IsMember({kAuto, "on", "off"}));
  command.add_option("--units", a.units, "unit of length of the mesh, e.g. m; kept in scene.json");
}

void declareHierarchyOptions(CLI::App& command, BuildArguments& a) {
  command.add_option("--stitch", a.stitch,
                     "seams of the source, whose two sides were rounded apart, are closed, and its smallest holes: "
                     "auto: how far apart is found from the borders; off; or a length in units of the mesh");
  command.add_option("--voxel-triangles", a.hierarchy.voxel_triangles, "Nv: most triangles in a voxel")
      ->check(CLI::Range(1, 1'000'000));
  command.add_option("--leaf-triangles", a.hierarchy.leaf_triangles, "Nl: most triangles in a leaf patch")
      ->check(CLI::Range(16, 20'000));
  command.add_option("--node-triangles", a.hierarchy.node_triangles, "Nn: most triangles in any other patch")
      ->check(CLI::Range(16, 20'000));
  command
      .add_option("--position-bits", a.hierarchy.position_bits,
                  "lattice steps along the longest side of a mesh, as a power of two, 10 to 21, for all methods but "
                  "pmr; triangles smaller than a step are lost; 0: chosen from a sample of the edges")
      ->check(CLI::Range(0, 21));
  command
      .add_option(
          "--qsplat-dice", a.splats_dice,
          "tree of splats from a mesh: edges longer than this many times the usual length around them are cut, so "
          "that large triangles make no large splats; adds up to as many splats again; 0: none are")
      ->check(CLI::Range(0.0, 1e6));
  command
      .add_option(
          "--normals", a.normals,
          "normals of the levels above the source's own. facets: triangles give them, which makes patches a fifth "
          "smaller; vertices: stored, for shading finer than triangles; auto: facets where colours are shown as "
          "scanned (--light), and vertices where light shades the model")
      ->check(CLI::IsMember({kAuto, "facets", "vertices"}));
  command
      .add_option("--textures", a.textures,
                  "keep: textures stay at their own resolution on the server, which draws images and frames with them; "
                  "vertex: they only colour the vertices")
      ->check(CLI::IsMember({"keep", "vertex"}));
  command
      .add_option("--regroup", a.regroup,
                  "on: new groups of patches at each level; off: the paper's binary tree, whose locked borders pile up")
      ->check(CLI::IsMember({"on", "off"}));
}

void declareHlodOptions(CLI::App& command, BuildArguments& a) {
  command
      .add_option("--hlod-triangles", a.hlod.leaf_triangles,
                  "Tmax of --methods hlod: cells with more triangles are divided")
      ->check(CLI::Range(1, 1'000'000));
  command
      .add_option("--hlod-resolution", a.hlod.resolution,
                  "res of --methods hlod: the error of a cell is at most its edge divided by this; more makes more, "
                  "smaller cells of a view")
      ->check(CLI::Range(4.0, 65536.0));
  command
      .add_option("--appearance", a.appearance,
                  "that --methods hlod keeps within its error besides the shape: normals, colors, both or none. auto: "
                  "colors where the mesh has them, else normals")
      ->check(CLI::IsMember({kAuto, "normals", "colors", "both", "none"}));
}

void declareRunOptions(CLI::App& command, BuildArguments& a) {
  command.add_option("--threads", a.limits.threads, "0: all cores; the result does not depend on it");
  command
      .add_option("--memory", a.limits.memory_bytes,
                  "most memory to use, e.g. 4G, at least 256M: of this process, and of those that draw images with it "
                  "together; 0: 60 % of the machine's; the result does not depend on it")
      ->transform(CLI::AsSizeValue(false));
  command.add_option("--tmpdir", a.tmpdir,
                     "directory for work files, about 70 bytes per triangle; default: within the scene");
  command
      .add_option("--shard", a.shard,
                  "i/n: render only the i-th (0 to n-1) of n contiguous ranges of the grid, into a store of its own; "
                  "any number of such commands may run at a time, on one scene. auto: i and n from a Slurm job array "
                  "(times the rank within a task), an MPI launcher or srun. Default: all, or the rank where mpirun "
                  "started several")
      ->check([](const std::string& text) {
        const auto shard = repository::parseShard(text);
        return text == "auto" || shard ? std::string() : shard.error().message;
      });
  command
      .add_option("--shards", a.shards,
                  "divide the images into n stores and build all of them; 0: as the scene is divided, else one store")
      ->check(CLI::Range(std::uint32_t{0}, repository::kMaxShards));
  command.add_flag("--missing", a.missing,
                   "build nothing; list what this command would still have to make. Status 0: nothing, 3: something, "
                   "1: it cannot be told");
  command.add_flag("--json", a.json, "summary as JSON");
  command.add_flag("--quiet", a.quiet, "no progress");
}

/// In the middle of a face of tiles of this depth, where it has fewest.
double pixelsPerDegree(std::uint32_t depth) {
  return 0.5 * static_cast<double>(repository::kTileCore << depth) * std::numbers::pi / 180.0;
}

bool isGiven(const CLI::App& command, const std::string& option) {
  return command.get_option(option)->count() > 0;
}

/// The values as one may give them again, each by itself: what stood between commas belongs together.
std::vector<std::string> valuesOf(const CLI::Option& option) {
  if (option.get_delimiter() == '\0' || option.results().empty()) return option.results();
  std::string joined;
  for (const std::string& value : option.results()) joined += (joined.empty() ? "" : ",") + value;
  return {joined};
}

// The depth of --tiles; 0: off.
std::uint32_t tileDepthOf(const std::string& tiles, double view_pixels) {
  if (tiles == "off") return 0;
  if (tiles != kAuto) return static_cast<std::uint32_t>(std::stoul(tiles));
  constexpr std::uint32_t kMaxAutoDepth = 4;  // a face takes 16 Mi pixels to draw then, and one deeper four times these
  std::uint32_t depth = 1;
  while (depth < kMaxAutoDepth && pixelsPerDegree(depth + 1) <= view_pixels) ++depth;
  return depth;
}

// The recorded parameters but for those that the given options overrule: how images are encoded is either said or
// tuned.
Parameters recordedBeside(const CLI::App& given, const Parameters& parameters) {
  Parameters recorded = withoutChoice(parameters);
  recorded.try_emplace("stitch", "off");  // scenes of programs that did not stitch
  if (recorded.contains("tune")) recorded.erase("subsampling");
  recorded.try_emplace("codec", "jpeg");  // scenes of programs that knew no other
  const bool is_light_moved = isGiven(given, "--light-direction") || isGiven(given, "--light-position");
  if (isGiven(given, "--light") || is_light_moved)
    for (const char* name : kPlaceOptions) recorded.erase(name);
  if (isGiven(given, "--face")) recorded.erase("tiles");
  if (isGiven(given, "--tiles")) recorded.erase("face");
  if (isGiven(given, "--quality") || isGiven(given, "--subsampling")) recorded.erase("tune");
  if (isGiven(given, "--tune") && given.get_option("--tune")->as<std::string>() != "off")
    for (const char* name : {"quality", "subsampling"}) recorded.erase(name);
  if (isGiven(given, "--codec") && given.get_option("--codec")->as<std::string>() == "webp")
    for (const char* name : {"tune", "subsampling"}) recorded.erase(name);
  return recorded;
}

}  // namespace

void declareBuildOptions(CLI::App& command, BuildArguments& a) {
  declareMethodOptions(command, a);
  declareSamplingOptions(command, a);
  declareImageOptions(command, a);
  declareHierarchyOptions(command, a);
  declareHlodOptions(command, a);
  declareRunOptions(command, a);
}

bool wants(const BuildArguments& a, const char* method) {
  return std::find(a.methods.begin(), a.methods.end(), method) != a.methods.end();
}

base::LightMode lightModeOf(const BuildArguments& a, bool is_scanned) {
  return base::lightModeNamed(a.light).value_or(is_scanned ? base::LightMode::kUnlit : base::LightMode::kSoft);
}

bool hasMethod(const Parameters& parameters, const std::string& method) {
  const auto it = parameters.find("methods");
  if (it == parameters.end()) return false;
  return ("," + it->second + ",").find("," + method + ",") != std::string::npos;
}

std::string listMethods(const std::function<bool(const char* method)>& includes) {
  std::string methods;
  for (const char* method : kMethods)
    if (includes(method)) methods += (methods.empty() ? "" : ",") + std::string(method);
  return methods;
}

double usualMargin(const base::Scene& scene) {
  return scene.interior ? 0.0 : 0.5;
}

std::uint32_t usualGrid(const base::Scene& scene) {
  return std::max(kUsualGrid, scene.interior_grid);
}

Parameters parametersOf(const BuildArguments& a) {
  auto number = [](auto v) { return nlohmann::json(v).dump(); };
  Parameters parameters{{"methods", listMethods([&](const char* method) { return wants(a, method); })},
                        {a.tile_depth == 0 ? "face" : "tiles", number(a.tile_depth == 0 ? a.face : a.tile_depth)},
                        {"codec", a.codec},
                        {"light", a.light},
                        {"up", a.up},
                        {"units", a.units},
                        {a.tune_db ? "tune" : "quality", a.tune_db ? number(*a.tune_db) : number(a.bake.quality)},
                        {"tolerance", number(a.bake.tolerance_px)},
                        {"supersampling", number(a.bake.supersampling)},
                        {"voxel-triangles", number(a.hierarchy.voxel_triangles)},
                        {"leaf-triangles", number(a.hierarchy.leaf_triangles)},
                        {"node-triangles", number(a.hierarchy.node_triangles)},
                        {"position-bits", number(a.hierarchy.position_bits)},
                        {"regroup", a.regroup},
                        {"stitch", a.stitch},
                        {"normals", a.normals}};
  if (a.grid) parameters["grid"] = number(*a.grid);
  if (a.margin) parameters["margin"] = number(*a.margin);
  if (a.interior != "auto") parameters[kInteriorParameter] = a.interior;
  const lod::hlod::LightArguments& place = a.light_place;
  if (!place.direction.empty()) parameters["light-direction"] = vectorText(lod::hlod::vectorOf(place.direction));
  if (!place.position.empty()) parameters["light-position"] = vectorText(lod::hlod::vectorOf(place.position));
  if (place.size) parameters["light-size"] = sizeText(*place.size);
  if (a.textures == "vertex") parameters[kTexturesParameter] = a.textures;
  if (a.codec == "jpeg") parameters["subsampling"] = a.tune_db ? "tuned" : a.subsampling;
  const PointSelection& selection = a.bake.selection;
  if (selection.views != 0) {
    parameters["views"] = number(selection.views);
    parameters["worth"] = number(selection.worth);
  }
  if (selection.budget_bytes != 0) parameters["budget"] = number(selection.budget_bytes);
  if (!a.views_from.empty()) parameters["views-from"] = a.views_from;
  if (wants(a, "qsplat")) parameters[kSplatsDice] = number(a.splats_dice);
  if (a.splats_coded) parameters[kSplatsCoded] = "true";
  if (wants(a, "hlod")) {
    parameters[kHlodTriangles] = number(a.hlod.leaf_triangles);
    parameters[kHlodResolution] = number(a.hlod.resolution);
    parameters[kHlodAppearance] = a.appearance;
  }
  return parameters;
}

std::string usageError(const CLI::App& command, BuildArguments& a) {
  a.usual_methods = !isGiven(command, "--methods") && !a.meshes.empty();
  if (std::erase(a.methods, kAuto) != 0) a.automatic = true;
  if (a.automatic && wants(a, "images")) return "--methods auto decides on images: leave out one of the two";
  if (a.automatic && !wants(a, "patch")) a.methods.emplace_back("patch");
  if (wants(a, "images") && !wants(a, "patch")) return "--methods images needs patch as well";
  const lod::hlod::Shadows shadows = shadowsOfMode(lightModeOf(a, true));
  if (const std::string problem = lod::hlod::lightProblem(a.light_place, shadows, kLightWords); !problem.empty())
    return problem;
  if (shadows != lod::hlod::Shadows::kNone && !wants(a, "hlod"))
    return "--light " + a.light + " needs the octree, whose nodes throw the shadows: give --methods hlod as well";
  if (const auto stitch = lod::ingest::parseStitch(a.stitch); !stitch) return stitch.error().message;
  if (!parseTune(a.tune, a.tune_db))
    return "--tune " + a.tune + ": give off, or a PSNR in dB above 0 and below 99, e.g. 36";
  if (a.tune_db && !wants(a, "images") && !a.automatic)
    return "--tune chooses quality and subsampling of the images: leave out --tune, or build images";
  if (a.tune_db && (isGiven(command, "--quality") || isGiven(command, "--subsampling")))
    return "--tune chooses quality and subsampling of the images: leave out --quality and --subsampling, or --tune";
  constexpr std::uint32_t kUsualFace = 512;  // the paper's
  if (a.face != 0 && !a.tiles.empty() && a.tiles != "off")
    return "--face gives the size of plain images, and --tiles makes others: leave out one of the two";
  if (a.tiles.empty()) a.tiles = a.face != 0 ? "off" : kAuto;
  if (a.face == 0) a.face = kUsualFace;
  const bool needs_jpeg = a.tune_db || isGiven(command, "--subsampling");
  if (a.codec == "webp" && needs_jpeg)
    return "--tune and --subsampling are for JPEG: leave them out, or give --codec jpeg";
  if (a.codec.empty()) a.codec = a.tiles == "off" || needs_jpeg ? "jpeg" : "webp";
  a.bake.codec = *repository::imageCodecOf(a.codec);
  const bool is_webp = a.bake.codec == repository::ImageCodec::kWebp;
  a.bake.quality = a.quality.value_or(is_webp ? base::ViewDefaults::kWebpQuality : base::ViewDefaults::kQuality);
  if (a.tiles != kAuto && isGiven(command, "--view-pixels")) return "--view-pixels belongs to --tiles auto";
  a.tile_depth = tileDepthOf(a.tiles, a.view_pixels);
  const bool selects = isGiven(command, "--worth") || a.bake.selection.budget_bytes != 0 || !a.views_from.empty();
  if (a.bake.selection.views == 0 && selects)
    return "--worth, --budget and --views-from belong to sampling by use: give --views too";
  if (isGiven(command, "--qsplat-coded") && !wants(a, "qsplat"))
    return "--qsplat-coded belongs to the tree of splats: give --methods qsplat too";
  for (const char* option : {"--hlod-triangles", "--hlod-resolution", "--appearance"})
    if (isGiven(command, option) && !wants(a, "hlod"))
      return std::string(option) + " belongs to the octree: give --methods hlod too";
  return "";
}

base::Result<BuildArguments> withRecordedOptions(const CLI::App& given, const BuildArguments& a) {
  const std::string finished = a.output + "/scene.json";
  const std::string building = a.output + "/" + base::kBuildingFile;
  const std::string file = fs::exists(finished) ? finished : building;
  if (!fs::exists(file) && a.missing) return a;
  if (!fs::exists(file))
    return Error{ErrorCode::kNotFound, a.output + ": no scene is here to go on with; give the meshes too"};
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readSceneFile(file));

  BuildArguments completed;
  CLI::App options;
  declareBuildOptions(options, completed);
  std::vector<std::string> words;
  for (const CLI::Option* option : given.get_options())
    if (!option->get_lnames().empty())
      for (const std::string& value : valuesOf(*option))
        words.push_back("--" + option->get_lnames().front() + "=" + value);
  for (const auto& [name, value] : recordedBeside(given, scene.parameters)) {
    const CLI::Option* option = given.get_option_no_throw("--" + name);
    if (name != kShardsParameter && option != nullptr && option->count() == 0)
      words.push_back("--" + name + "=" + value);
  }
  try {
    options.parse(words);
  } catch (const CLI::ParseError& error) {
    return Error{ErrorCode::kInvalidInput, file + ": records an option that this program does not take: " +
                                               error.what() + "; build the scene again from its meshes"};
  }
  return completed;
}

}  // namespace server::cli
