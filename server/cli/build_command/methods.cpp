#include "server/cli/build_command/methods.h"
#include "lod/patch/orientation.h"
#include "server/cli/up_axis.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <future>
#include <map>
#include <memory>
#include <optional>
#include <utility>

#include "base/crc32c.h"
#include "base/format_text.h"
#include "base/hash/sha256.h"
#include "base/parallel.h"
#include "repository/sampling/grid.h"
#include "server/cli/first_view.h"
#include "server/cli/streamed/hull.h"
#include "server/views/indoors.h"

namespace server::cli {
namespace {

namespace fs = std::filesystem;
using base::Result;

// A file that is built, as the scene lists it. A thread hashes it as soon as it is written, or while it is.
class PartFile {
 public:
  PartFile(const std::string& directory, const std::string& file) : path_(directory + "/" + file), file_(file) {}
  const std::string& path() const { return path_; }
  /// To be called once the file is there.
  std::function<void()> startHashing() {
    return [this] { hash_ = std::async(std::launch::async, [this] { return base::sha256OfFile(path_); }); };
  }
  /// To be called with all bytes of the file in their order, in place of that.
  std::function<void(base::Bytes)> hashBytes() {
    return [this](base::Bytes piece) {
      if (!pieces_) pieces_.emplace(1, kWaitingPieces);
      pieces_->submit([this, bytes = std::make_shared<base::Bytes>(std::move(piece))] { sha256_.add(*bytes); });
    };
  }
  /// Waits for the hash.
  Result<void> addTo(base::Scene& scene) {
    Result<std::string> hash = std::string();
    if (pieces_) {
      pieces_->drain();
      hash = base::hexOf(sha256_.finish());
    } else {
      hash = hash_.get();
    }
    if (!hash) return hash.error();
    std::erase_if(scene.parts, [&](const base::ScenePart& old) { return old.file == file_; });
    scene.parts.push_back({file_, fs::file_size(path_), *hash});
    return {};
  }

 private:
  std::string path_;
  std::string file_;
  std::future<Result<std::string>> hash_;
  static constexpr std::size_t kWaitingPieces = 4;  // a choice: of some megabytes at most
  base::Sha256 sha256_;
  std::optional<base::ThreadPool> pieces_;  // the last member, so that its thread ends first
};

// Each output and method has a place of its own, so that several builds can share --tmpdir.
std::string workDirectory(const BuildArguments& a, const std::string& name, const std::string& suffix) {
  if (a.tmpdir.empty()) return a.output + "/" + name;
  const std::string output = fs::absolute(a.output).lexically_normal().string();
  return a.tmpdir + base::formatText("/lumigrid-%08x", base::crc32c(base::viewOfText(output))) + suffix;
}
std::string workDirectory(const BuildArguments& a, const FileMethod& method) {
  const bool first = method.file == std::string(kPatches.file);
  return workDirectory(a, method.work_files, first ? "" : std::string("-") + method.method);
}
std::string sourceDirectory(const BuildArguments& a) {
  return workDirectory(a, kSourceWorkFiles, "-source");
}

// The hashes of the sources decide the hierarchy besides its own options. `sources` must outlive the key.
lod::ingest::ResumeKey resumeKey(const SceneSources& sources) {
  return [&sources]() -> Result<std::string> {
    LUMIGRID_ASSIGN_OR_RETURN(const auto list, sources.all());
    std::string key;
    for (const base::SceneSource& source : list) key += source.sha256 + " ";
    return key;
  };
}

void printPlan(const BuildArguments& a, ProgressLine& line, const lod::ingest::BuildPlan& plan) {
  if (a.quiet) return;
  line.finish();
  const bool points = plan.triangles == 0;
  std::fprintf(stderr, "%s %s: about %s in the scene, up to %s of work files, about %s\n",
               formatCount(points ? plan.vertices : plan.triangles).c_str(), points ? "points" : "triangles",
               formatBytes(plan.output_bytes).c_str(), formatBytes(plan.work_bytes).c_str(),
               formatSeconds(plan.seconds).c_str());
}

lod::ingest::Progress progressOn(ProgressLine& line, const std::string& part) {
  return [&line, part](const std::string& stage, double done) {
    line.show(part + ": " + stage, done);
    return !stopRequested();
  };
}

// Methods of one source mostly warn of the same. A warning is printed at once, since images may take hours yet, and
// may fail.
void addWarnings(const lod::ingest::SourceSummary& summary, BuildReport& report) {
  for (const std::string& warning : summary.warnings) {
    if (std::find(report.warnings.begin(), report.warnings.end(), warning) != report.warnings.end()) continue;
    report.warnings.push_back(warning);
    std::fprintf(stderr, "lumigrid: warning: %s\n", warning.c_str());
  }
}

/// An up that the source's coordinates have by definition.
struct DefinedUp {
  glm::dvec3 up;
  const char* reason;
};

/// The axis of heights, where the coordinates are those of a map: eastings and northings are far from 0 on the maps of
/// all countries, at least 50 km, and heights are not. 1 or 2: some programs write heights as y; -1: they are no map's.
int heightAxis(const glm::dvec3& middle) {
  constexpr double kNearest = 5e4, kFarthest = 2e7, kHighest = 1.2e4;  // metres or feet
  constexpr double kEarth = 6.371e6;                                   // geocentric coordinates are no map's
  if (std::abs(glm::length(middle) / kEarth - 1.0) < 0.01) return -1;
  const auto isFar = [&](int axis) {
    return std::abs(middle[axis]) >= kNearest && std::abs(middle[axis]) <= kFarthest;
  };
  for (const int axis : {2, 1})
    if (std::abs(middle[axis]) <= kHighest && isFar(0) && isFar(3 - axis)) return axis;
  return -1;
}

std::optional<DefinedUp> definedUp(const lod::ingest::SourceSummary& built) {
  using Up = mesh::Georeference::Up;
  if (built.georeference.up == Up::kZ) return DefinedUp{{0, 0, 1}, "z, since tilesets have it so"};
  if (built.georeference.up == Up::kY) return DefinedUp{{0, 1, 0}, "y, since glTF has it so"};
  if (built.georeference.crs != "EPSG:4978") {
    const int axis = heightAxis(0.5 * (built.box_min + built.box_max));
    if (axis == 2) return DefinedUp{{0, 0, 1}, "z, since its coordinates are a map's"};
    if (axis == 1) return DefinedUp{{0, 1, 0}, "y, since its coordinates are a map's"};
    return std::nullopt;
  }
  // The vertical of the ellipsoid WGS 84, whose half axes are in metres.
  constexpr double kEquatorial = 6378137.0, kPolar = 6356752.314245;
  const glm::dvec3 middle = 0.5 * (built.box_min + built.box_max);
  const glm::dvec3 normal = middle / glm::dvec3(kEquatorial * kEquatorial, kEquatorial * kEquatorial, kPolar * kPolar);
  if (!(glm::length(normal) > 0.0)) return std::nullopt;
  return DefinedUp{glm::normalize(normal), "away from the earth, since the coordinates are geocentric"};
}

// Points have no surface to ask. A flat open scan stands on its shortest axis, on the side that it faces.
// Anything else is taken for a model with +y up, as glTF says and scanners of objects write. `size`: how far it reaches
// along each axis.
glm::dvec3 guessUp(const lod::ingest::SourceSummary& built, const BuildArguments& a, const glm::dvec3& size) {
  if (a.up != "auto") return axisNamed(a.up);
  if (const auto defined = definedUp(built)) return defined->up;
  const int flat = size.x <= size.y && size.x <= size.z ? 0 : size.y <= size.z ? 1 : 2;
  const double second = std::min(size[(flat + 1) % 3], size[(flat + 2) % 3]);
  if (size[flat] > 0.5 * second) return {0, 1, 0};
  glm::dvec3 up(0.0);
  up[flat] = built.facing[flat] < 0.0 ? -1.0 : 1.0;
  return up;
}

bool isLit(const BuildArguments& a, bool is_scanned) {
  return lightModeOf(a, is_scanned) != base::LightMode::kUnlit;
}

// Colours that are shown as scanned need no normals.
void setNormals(const BuildArguments& a, lod::patch::builder::HierarchyOptions& options) {
  using lod::patch::StoredNormals;
  const auto choose = [&a](bool is_scanned) {
    const bool needed = a.normals == kAuto ? isLit(a, is_scanned) : a.normals == "vertices";
    return needed ? StoredNormals::kOfVertices : StoredNormals::kOfFacets;
  };
  options.normals_beside_colors = choose(true);
  options.normals_without_colors = choose(false);
}

/// Chooses the light by the scene's colours, box, up and first view.
Result<base::Light> chooseLight(const BuildArguments& a, const lod::ingest::SourceSummary& built,
                                const base::Scene& scene) {
  base::Light light;
  light.mode = lightModeOf(a, built.has_colors && !built.is_painted);
  // The light comes from above and a little from the side, whichever way up is, and over the shoulder of who looks
  // first.
  const glm::vec3 z = glm::vec3(glm::normalize(scene.up));
  glm::vec3 side = glm::normalize(glm::cross(z, std::abs(z.x) < 0.9F ? glm::vec3(1, 0, 0) : glm::vec3(0, 1, 0)));
  if (scene.start_direction) {
    const glm::vec3 toward = -glm::vec3(*scene.start_direction);
    side = glm::normalize(toward - glm::dot(toward, z) * z);
  }
  light.direction = glm::normalize(0.8F * z + 0.45F * side + 0.35F * glm::cross(side, z));
  LUMIGRID_TRY(placeLight(a.light_place, scene, light));
  return light;
}

// So many steps of a grid are as wide as the rooms. A choice (docs/decisions/interiors.md).
constexpr float kStepsPerWidth = 2.0F;
// A grid of more points along a side, or in all, would take longer to choose from than the hierarchy to build.
constexpr std::uint32_t kMostPerSide = 128;
constexpr std::uint64_t kMostPoints = 200'000;

/// Points along the longest side of the rooms' box, so that each room or passage has some.
std::uint32_t gridOfRooms(const Indoors& rooms) {
  const glm::vec3 size = rooms.box().size();
  const float longest = std::max({size.x, size.y, size.z});
  const float steps = std::min(kStepsPerWidth * longest / std::max(rooms.width(), longest / kMostPerSide),
                               static_cast<float>(kMostPerSide - 1));
  auto points = std::max(kUsualGrid, static_cast<std::uint32_t>(std::ceil(steps)) + 1);
  while (points > kUsualGrid && repository::makeGrid(rooms.box(), points, 0.0F, 512).pointCount() > kMostPoints)
    --points;
  return points;
}

// Where the first view looks, and with `--up auto` which way is up, as the coordinates or the surface itself tell; says
// how sure that is.
base::Result<void> orientBySurface(const BuildArguments& a, const lod::ingest::SourceSummary& built,
                                   const std::string& patches, base::Scene& scene) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, lod::patch::PatchFile::open(patches));
  const auto defined = a.up == "auto" ? definedUp(built) : std::nullopt;
  const bool is_known = a.up != "auto" || defined;
  const glm::vec3 known(scene.up);
  LUMIGRID_ASSIGN_OR_RETURN(const lod::patch::Orientation found,
                            lod::patch::findOrientation(file, is_known ? &known : nullptr, interiorChoiceOf(scene)));
  if (!is_known) scene.up = glm::dvec3(found.up);
  scene.interior = found.is_interior;  // unless no room is found
  LUMIGRID_ASSIGN_OR_RETURN(const auto rooms, Indoors::ofScene(scene, file));
  scene.interior = rooms.has_value();
  setFirstView(found, rooms ? &*rooms : nullptr, scene);
  const std::uint32_t grid = rooms ? gridOfRooms(*rooms) : kUsualGrid;
  scene.interior_grid = grid > kUsualGrid ? grid : 0;
  LUMIGRID_ASSIGN_OR_RETURN(scene.light, chooseLight(a, built, scene));
  if (found.section_height && !a.quiet)
    std::fprintf(stderr,
                 "first view: an interior, cut open below its ceilings (Esc takes the cut away, `lumigrid set "
                 "--start-view ''` for good)\n");
  if (scene.interior && !found.section_height && !a.quiet)
    std::fprintf(stderr, "first view: from within, since no cut opens half of its rooms\n");
  if (scene.interior && !a.margin && !a.quiet)
    std::fprintf(stderr,
                 "interior: images are for eyes in its rooms (for eyes around it, too: --margin 0.5; if it is none: "
                 "--interior off)\n");
  if (!scene.interior && a.interior == "on" && !a.quiet)
    std::fprintf(stderr, "--interior on: no room is found in it, so it is looked at from around\n");
  if (!scene.interior && found.is_enclosed && a.interior == kAuto && !a.quiet)
    std::fprintf(stderr,
                 "its surface faces inwards everywhere, as a cave's does or that of an object turned inside out; it is "
                 "looked at from around it, or with --interior on from within\n");
  if (!built.georeference.moved.empty() && !a.quiet)
    std::fprintf(stderr, "coordinates: %s\n", built.georeference.moved.c_str());
  if (defined && !a.quiet) std::fprintf(stderr, "up: %s\n", defined->reason);
  if (a.quiet || is_known) return {};
  const int axis = std::abs(found.up.x) > 0.5F ? 0 : std::abs(found.up.y) > 0.5F ? 1 : 2;
  std::fprintf(stderr, "up: %s%c, since %s%s\n", found.up[axis] < 0.0F ? "-" : "", 'x' + axis, found.reason.c_str(),
               found.is_sure ? "" : " (not sure: see the first view, and `lumigrid set --up`)");
  return {};
}

// Guesses again by the hull, since strays far above a flat survey make its box a tall one.
base::Result<void> orientByHull(const BuildArguments& a, const lod::ingest::SourceSummary& built, base::Scene& scene) {
  if (scene.hull.empty()) return {};
  glm::dvec3 least = scene.hull.front(), most = least;
  for (const glm::dvec3& point : scene.hull) least = glm::min(least, point), most = glm::max(most, point);
  scene.up = guessUp(built, a, most - least);
  LUMIGRID_ASSIGN_OR_RETURN(scene.light, chooseLight(a, built, scene));
  return {};
}

base::SceneBorder borderOf(const lod::ingest::SourceSummary& built) {
  return {built.border.source_open_edges, built.border.open_edges, built.border.largest_movement};
}

Result<base::Scene> describeScene(const BuildArguments& a, const SceneSources& sources,
                                  const lod::ingest::SourceSummary& built) {
  base::Scene scene;
  LUMIGRID_ASSIGN_OR_RETURN(scene.sources, sources.all());
  scene.parameters = parametersOf(a);
  scene.origin = built.origin;
  scene.box_min = built.box_min;
  scene.box_max = built.box_max;
  const mesh::Georeference& georeference = built.georeference;
  if (base::isCrsName(georeference.crs)) scene.crs = georeference.crs;
  scene.units = a.units == "unknown" && !georeference.units.empty() ? georeference.units : a.units;
  scene.up = guessUp(built, a, built.box_max - built.box_min);
  scene.has_colors = built.has_colors;
  LUMIGRID_ASSIGN_OR_RETURN(scene.light, chooseLight(a, built, scene));
  scene.triangles = built.triangles;
  scene.repairs = built.repairs.counts;
  return scene;
}

}  // namespace

Result<void> needMeshes(const BuildArguments& a, const std::string& part) {
  if (!a.meshes.empty()) return {};
  return base::Error{base::ErrorCode::kNotFound, a.output + ": holds no " + part + " yet; give the meshes too"};
}

std::unique_ptr<lod::ingest::SharedSource> shareSource(const BuildArguments& a, const SceneSources& sources,
                                                       const std::function<bool(const FileMethod&)>& lacks) {
  const auto wanted = std::count_if(std::begin(kFileMethods), std::end(kFileMethods),
                                    [&](const FileMethod& method) { return wants(a, method.method); });
  if (wanted < 2) return nullptr;
  lod::ingest::SharedSourceOptions options;
  options.work_directory = sourceDirectory(a);
  options.resume_key = resumeKey(sources);
  options.stitch = *lod::ingest::parseStitch(a.stitch);
  options.position_bits = a.hierarchy.position_bits;
  options.keeps_textures = wants(a, kPatches.method) && a.textures == "keep";
  options.spool_users = (lacks(kSplats) ? 1U : 0U) + (lacks(kUmbrellas) ? 1U : 0U);
  options.bucket_users = (lacks(kPatches) ? 1U : 0U) + (lacks(kHlod) ? 1U : 0U);
  return std::make_unique<lod::ingest::SharedSource>(std::move(options));
}

void removeSharedSource(const BuildArguments& a, lod::ingest::SharedSource* shared) {
  if (shared != nullptr)
    shared->remove();
  else
    lod::ingest::SharedSource::remove(sourceDirectory(a));
}

Result<void> buildPatches(const MethodBuilds& builds, std::optional<base::Scene>& scene) {
  const BuildArguments& a = builds.arguments;
  const SceneSources& sources = builds.sources;
  BuildReport& report = builds.report;
  LUMIGRID_TRY(needMeshes(a, "hierarchy"));
  PartFile part(a.output, kPatches.file);
  lod::patch::builder::HierarchyOptions options = a.hierarchy;
  options.limits = a.limits;
  options.stitch = *lod::ingest::parseStitch(a.stitch);
  options.regroup = a.regroup == "on";
  setNormals(a, options);
  options.work_directory = workDirectory(a, kPatches);
  options.resume_key = resumeKey(sources);
  options.shared = builds.shared;
  options.on_plan = [&](const lod::ingest::BuildPlan& plan) { printPlan(a, builds.line, plan); };
  PartFile textures(a.output, kTextureFile);
  if (a.textures == "keep") options.texture_path = textures.path();
  options.on_texture_bytes = textures.hashBytes();
  options.on_written = part.startHashing();
  auto summary = lod::patch::builder::buildHierarchyFromFiles(a.meshes, options, part.path(),
                                                              progressOn(builds.line, "hierarchy"));
  builds.line.finish();
  if (!summary) return summary.error();
  addWarnings(*summary, report);

  // The patches are the scene as it is looked at, so what they say of the source replaces what splats said.
  LUMIGRID_ASSIGN_OR_RETURN(auto described, describeScene(a, sources, *summary));
  described.border = borderOf(*summary);
  if (scene) {
    const Parameters wanted = std::move(described.parameters);
    described.parameters = scene->parameters;  // with the division into shards
    for (const char* name : kHierarchyParameters) described.parameters[name] = wanted.at(name);
    described.parameters.erase(kTexturesParameter);
    if (const auto it = wanted.find(kTexturesParameter); it != wanted.end()) described.parameters.insert(*it);
    described.parts = scene->parts;
  }
  scene = std::move(described);
  LUMIGRID_TRY(orientBySurface(a, *summary, part.path(), *scene));
  std::erase_if(scene->parts, [](const base::ScenePart& old) { return old.file == kTextureFile; });
  if (summary->texture) LUMIGRID_TRY(textures.addTo(*scene));
  report.hierarchy = std::move(*summary);
  return part.addTo(*scene);
}

namespace {

/// Builds a method's file from files of meshes or points. The method describes the scene only where no other one has.
template <class Summary, class Options, class Build>
Result<void> buildStreamed(const MethodBuilds& builds, const FileMethod& method, const char* name, Options options,
                           const Build& build, std::optional<base::Scene>& scene,
                           std::optional<Summary> BuildReport::*place) {
  const BuildArguments& a = builds.arguments;
  const SceneSources& sources = builds.sources;
  PartFile part(a.output, method.file);
  options.limits = a.limits;
  options.work_directory = workDirectory(a, method);
  options.resume_key = resumeKey(sources);
  options.shared = builds.shared;
  options.on_plan = [&](const lod::ingest::BuildPlan& plan) { printPlan(a, builds.line, plan); };
  options.on_written = part.startHashing();
  auto summary = build(a.meshes, options, part.path(), progressOn(builds.line, name));
  builds.line.finish();
  if (!summary) return summary.error();
  addWarnings(*summary, builds.report);
  const bool is_first = !scene;
  if (is_first) {
    LUMIGRID_ASSIGN_OR_RETURN(scene, describeScene(a, sources, *summary));
  }
  LUMIGRID_TRY(part.addTo(*scene));
  if (scene->hull.empty()) LUMIGRID_TRY(setStreamedHull(a.output, *scene));
  if (is_first) LUMIGRID_TRY(orientByHull(a, *summary, *scene));
  builds.report.*place = std::move(*summary);
  return {};
}

}  // namespace

Result<void> buildSplats(const MethodBuilds& builds, std::optional<base::Scene>& scene) {
  const BuildArguments& a = builds.arguments;
  LUMIGRID_TRY(needMeshes(a, "tree of splats"));
  lod::qsplat::builder::BuildOptions options;
  options.dice = a.splats_dice;
  options.coded = a.splats_coded;
  options.position_bits = a.hierarchy.position_bits;
  return buildStreamed(builds, kSplats, "splats", options, lod::qsplat::builder::buildFromFiles, scene,
                       &BuildReport::splats);
}

namespace {

lod::hlod::builder::Appearance appearanceNamed(const std::string& name) {
  using lod::hlod::builder::Appearance;
  const std::map<std::string, Appearance> names{{"auto", Appearance::kAuto},
                                                {"normals", Appearance::kNormals},
                                                {"colors", Appearance::kColors},
                                                {"both", Appearance::kColorsAndNormals},
                                                {"none", Appearance::kShape}};
  return names.at(name);
}

}  // namespace

Result<void> buildHlod(const MethodBuilds& builds, std::optional<base::Scene>& scene) {
  const BuildArguments& a = builds.arguments;
  LUMIGRID_TRY(needMeshes(a, "octree of triangles and points"));
  lod::hlod::builder::BuildOptions options = a.hlod;
  options.stitch = *lod::ingest::parseStitch(a.stitch);
  options.appearance = appearanceNamed(a.appearance);
  options.position_bits = a.hierarchy.position_bits;
  const bool describes_scene = !scene;
  LUMIGRID_TRY(
      buildStreamed(builds, kHlod, "octree", options, lod::hlod::builder::buildFromFiles, scene, &BuildReport::hlod));
  if (describes_scene) scene->border = borderOf(*builds.report.hlod);
  return {};
}

#ifdef LUMIGRID_PMR

Result<void> needUmbrellaBuilder() {
  return {};
}

Result<void> buildUmbrellas(const MethodBuilds& builds, std::optional<base::Scene>& scene) {
  LUMIGRID_TRY(needMeshes(builds.arguments, "points and umbrellas"));
  return buildStreamed(builds, kUmbrellas, "umbrellas", lod::pmr::builder::BuildOptions(),
                       lod::pmr::builder::buildFromFiles, scene, &BuildReport::umbrellas);
}

#else

Result<void> needUmbrellaBuilder() {
  return base::Error{base::ErrorCode::kInvalidInput,
                     "--methods pmr: this program was built without it, since it needs CGAL, which is under GPL-3; "
                     "build Lumigrid with cmake -DLUMIGRID_PMR=ON (docs/pmr.md)"};
}

Result<void> buildUmbrellas(const MethodBuilds&, std::optional<base::Scene>&) {
  return needUmbrellaBuilder();
}

#endif

}  // namespace server::cli
