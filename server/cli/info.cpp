#include <array>
#include <cmath>
#include <cstdio>
#include <ctime>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>

#include "base/hash/sha256.h"
#include "base/json/annotations_file.h"
#include "base/json/parse.h"
#include "lod/qsplat/splat_file.h"
#include "lod/texture/format.h"
#include "repository/verify.h"
#include "server/cli/auto_choice.h"
#include "server/cli/build_command/build_record.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"
#include "server/cli/method_digest.h"
#include "server/cli/streamed/info.h"
#include "server/cli/tuned.h"
#include "server/scene/open_scene.h"

namespace server::cli {
namespace {

constexpr std::size_t kMaxVisitedPoints = 10;  // listed of the access counts: a screenful

struct InfoArguments {
  std::string scene;
  std::vector<std::string> access_files;
  bool json = false;
  bool digest = false;
};

struct LevelSummary {
  std::uint64_t triangles = 0, patches = 0;
  float max_error = 0.0F;
  float max_color_error = 0.0F;  // share of black to white, 0 … 1
  double typical_error = 0.0;    // root mean squares over the level's triangles
  double typical_color_error = 0.0;
};
NLOHMANN_DEFINE_TYPE_NON_INTRUSIVE(LevelSummary, triangles, patches, max_error, max_color_error, typical_error,
                                   typical_color_error)

std::string countIn(const nlohmann::json& object, const char* name) {
  return formatCount(object[name].get<std::uint64_t>());
}
std::string bytesIn(const nlohmann::json& object, const char* name) {
  return formatBytes(object[name].get<std::uint64_t>());
}
std::string textIn(const nlohmann::json& object, const char* name) {
  return object[name].get<std::string>();
}

std::vector<LevelSummary> levelsOf(const lod::patch::Hierarchy& hierarchy) {
  std::vector<LevelSummary> levels;
  for (const lod::patch::Patch& patch : hierarchy.patches) {
    if (levels.size() <= patch.level) levels.resize(patch.level + 1);
    LevelSummary& level = levels[patch.level];
    level.triangles += patch.triangles;
    ++level.patches;
    if (patch.producer == lod::patch::kNoGroup) continue;
    const lod::patch::Group& group = hierarchy.groups[patch.producer];
    level.max_error = std::max(level.max_error, group.error);
    level.max_color_error = std::max(level.max_color_error, group.attribute_error);
    const auto squareOf = [&](float error) {
      return patch.triangles * static_cast<double>(error) * static_cast<double>(error);
    };
    level.typical_error += squareOf(group.typical_error);
    level.typical_color_error += squareOf(group.typical_color_error);
  }
  for (LevelSummary& level : levels)
    for (double* sum : {&level.typical_error, &level.typical_color_error})
      *sum = std::sqrt(*sum / static_cast<double>(std::max<std::uint64_t>(1, level.triangles)));
  return levels;
}

nlohmann::json describeHierarchy(const OpenScene& open) {
  const lod::patch::Hierarchy& h = open.patches.hierarchy();
  return {
      {"bytes", open.patches.fileBytes()},
      {"groups", h.groups.size()},
      {"patches", h.patches.size()},
      {"lattice_step", h.lattice.step},
      {"position_error", h.lattice.positionError() + (open.scene.border ? open.scene.border->largest_movement : 0.0)},
      {"levels", levelsOf(h)}};
}

/// A repository is published when all its faces are there.
repository::StoreContents contentsOf(const repository::IndexRoot& root, std::uint64_t expected_faces) {
  return {root.keys, expected_faces, root.empty, root.totals.jpeg_bytes, root.totals.coverage_bytes, 0};
}

nlohmann::json describeImages(const OpenScene& open, const repository::StoreContents& contents) {
  const repository::Grid& grid = open.data.welcome.grid;
  const std::uint64_t points = open.points.count();
  return {{"images", contents.values - contents.empty},
          {"faces", contents.faces},
          {"empty", contents.empty},
          {"points", points},
          {"grid_points", grid.pointCount()},
          {"expected", 6 * points},
          {"jpeg_bytes", contents.jpeg_bytes},
          {"coverage_bytes", contents.coverage_bytes},
          {"unreadable", contents.unreadable},
          {"grid", {grid.count.x, grid.count.y, grid.count.z}},
          {"spacing", grid.spacing},
          {"face_size", grid.face_size},
          {"tile_depth", grid.tile_depth},
          {"image_size", grid.imageSide()}};
}

/// Adds the light of the images where it is no longer the scene's.
void addImagesLight(const base::Scene& scene, nlohmann::json& images) {
  if (!scene.images_light) return;
  images["images_light"] = base::nameOf(scene.images_light->mode);
  images["to_draw_again"] = images["expected"];
}

/// The counts in the files that were named, else in the scene; nothing where no server has counted.
base::Result<std::optional<repository::AccessCounts>> loadCounts(const OpenScene& open, const InfoArguments& a) {
  const repository::AccessIdentity identity = accessIdentityOf(open);
  if (!a.access_files.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(auto counts, repository::loadAccess(a.access_files, identity));
    return std::optional(std::move(counts));
  }
  LUMIGRID_ASSIGN_OR_RETURN(const auto files, repository::loadSceneAccess(a.scene, identity.hierarchy));
  std::optional<repository::AccessCounts> sum;
  for (const repository::AccessFile& file : files)
    if (file.identity == identity) sum = repository::addCounts(sum.value_or(repository::AccessCounts()), file.counts);
  if (!sum && !files.empty()) return repository::anotherSceneError(repository::accessFileOf(a.scene));
  return sum;
}

/// Nothing when no server has counted. Counts that cannot be read are told as such and no error: they are no part of
/// the scene.
nlohmann::json describeAccess(const OpenScene& open, const InfoArguments& a) {
  const auto counts = loadCounts(open, a);
  if (!counts) return {{"error", counts.error().message}};
  if (!counts->has_value()) return nullptr;

  nlohmann::json j{{"faces_sent", (*counts)->facesSent()},
                   {"groups_sent", (*counts)->groupsSent()},
                   {"uncounted", (*counts)->uncounted},
                   {"faces", (*counts)->faces.size()},
                   {"since", (*counts)->since},
                   {"until", (*counts)->until},
                   {"points", nlohmann::json::array()}};
  const auto points = repository::rankPoints(**counts);
  for (std::size_t i = 0; i < std::min(points.size(), kMaxVisitedPoints); ++i) {
    const glm::uvec3 p = points[i].point;
    const glm::dvec3 at = open.scene.origin + glm::dvec3(open.data.welcome.grid.point(p.x, p.y, p.z));
    j["points"].push_back({{"point", {p.x, p.y, p.z}}, {"position", {at.x, at.y, at.z}}, {"sent", points[i].sent}});
  }
  return j;
}

/// Nothing when the scene has no annotations.
nlohmann::json describeAnnotations(const OpenScene& open) {
  if (open.directory.empty())
    return open.annotations_json.empty() ? nlohmann::json() : nlohmann::json{{"bytes", open.annotations_json.size()}};
  const auto read = base::readAnnotations(open.directory);
  if (!read) return {{"error", read.error().message}};
  if (!*read) return nullptr;
  return {{"count", (*read)->notes}, {"bytes", (*read)->text.size()}};
}

void printAnnotations(const nlohmann::json& annotations) {
  if (annotations.contains("error"))
    std::printf("annotations: not served: %s\n", textIn(annotations, "error").c_str());
  else if (annotations.contains("count"))
    std::printf("annotations: %s\n", countIn(annotations, "count").c_str());
}

std::string dateOf(std::int64_t unix_seconds) {
  const std::time_t time = unix_seconds;
  std::tm parts{};
  std::array<char, 64> text{};
  if (::gmtime_r(&time, &parts) == nullptr || std::strftime(text.data(), text.size(), "%F %T UTC", &parts) == 0)
    return "an unknown time";
  return text.data();
}

void printDigest(const nlohmann::json& part, const char* of) {
  if (part.contains("sha256")) std::printf("  SHA-256 of %s %s\n", of, textIn(part, "sha256").c_str());
}

void printAccess(const nlohmann::json& access) {
  if (access.contains("error")) {
    std::printf("sent to viewers: %s\n", textIn(access, "error").c_str());
    return;
  }
  std::printf("sent to viewers from %s to %s: %s images (%s different ones), %s groups\n",
              dateOf(access["since"].get<std::int64_t>()).c_str(), dateOf(access["until"].get<std::int64_t>()).c_str(),
              countIn(access, "faces_sent").c_str(), countIn(access, "faces").c_str(),
              countIn(access, "groups_sent").c_str());
  if (access["uncounted"].get<std::uint64_t>() != 0)
    std::printf("  and %s more, not kept apart for want of memory\n", countIn(access, "uncounted").c_str());
  for (const auto& point : access["points"])
    std::printf("  %12s from point %s at %s\n", countIn(point, "sent").c_str(), point["point"].dump().c_str(),
                point["position"].dump().c_str());
}

void printImages(const nlohmann::json& i, const std::string& tuned) {
  const auto images = i["images"].get<std::uint64_t>();
  const auto missing = i["expected"].get<std::uint64_t>() - i["faces"].get<std::uint64_t>();
  std::printf("images: %s of %d x %d pixels, %s faces see nothing; grid %s, spacing %g\n", formatCount(images).c_str(),
              i["image_size"].get<int>(), i["image_size"].get<int>(), countIn(i, "empty").c_str(),
              i["grid"].dump().c_str(), i["spacing"].get<double>());
  if (i["tile_depth"].get<int>() > 0)
    std::printf("  tiles of %s faces, which have %d x %d pixels at depth %d, where they are finest\n",
                countIn(i, "faces").c_str(), i["face_size"].get<int>(), i["face_size"].get<int>(),
                i["tile_depth"].get<int>());
  std::printf(
      "  %s pictures, %s coverage, %s an image\n", bytesIn(i, "jpeg_bytes").c_str(),
      bytesIn(i, "coverage_bytes").c_str(),
      formatBytes(
          images == 0 ? 0 : (i["jpeg_bytes"].get<std::uint64_t>() + i["coverage_bytes"].get<std::uint64_t>()) / images)
          .c_str());
  if (!tuned.empty()) std::printf("  %s\n", tuned.c_str());
  printDigest(i, "all values");
  if (i["points"] != i["grid_points"])
    std::printf("  %s of the grid's %s points are sampled\n", countIn(i, "points").c_str(),
                countIn(i, "grid_points").c_str());
  if (i.contains("images_light"))
    std::printf(
        "  drawn %s, by another light than the scene's: all %s faces are to be drawn again: lumigrid build -o "
        "SCENE, where it was built\n",
        textIn(i, "images_light").c_str(), countIn(i, "to_draw_again").c_str());
  if (missing != 0)
    std::printf("  %s faces are missing; run the same `lumigrid build` again\n", formatCount(missing).c_str());
}

// The SHA-256 is taken over every key (8 bytes, big-endian), length (8, little-endian) and value in the order of keys:
// it is equal exactly when the repositories are, value by value, however they are divided into shards or packs.
base::Result<std::string> digestOf(const repository::Store& store) {
  base::Sha256 hash;
  LUMIGRID_TRY(store.forEach([&](const repository::FaceKey& key, base::ByteView value) {
    base::ByteWriter head;
    for (int shift = 56; shift >= 0; shift -= 8) head.u8(static_cast<std::uint8_t>(key.code() >> shift));
    head.u64(value.size());
    hash.add(head.view());
    hash.add(value);
    return true;
  }));
  return base::hexOf(hash.finish());
}

/// Prints what `lumigrid set` has said of the scene's place on earth and of how it is shown.
void printAppearance(const nlohmann::json& j) {
  const auto& s = j["scene"];
  const std::pair<const char*, const char*> kTexts[] = {{"title", "title"},
                                                        {"attribution", "attribution"},
                                                        {"crs", "coordinates"},
                                                        {"background", "background"},
                                                        {"start_view", "first view"}};
  for (const auto& [member, name] : kTexts)
    if (s.contains(member)) std::printf("%s: %s\n", name, textIn(s, member).c_str());
  if (s.contains("north"))
    std::printf("north: %g degrees, towards %s\n", s["north"].get<double>(), j["north_direction"].dump().c_str());
}

/// The points of a scene that was made from points; nothing for others, and where the scene is far away.
std::optional<std::uint64_t> sourcePoints(const nlohmann::json& j) {
  if (j["scene"]["triangles"].get<std::uint64_t>() != 0) return std::nullopt;
  if (j.contains("qsplat")) return j["qsplat"]["leaves"].get<std::uint64_t>();
  if (j.contains("pmr")) return j["pmr"]["points"].get<std::uint64_t>();
  return std::nullopt;
}

void printScene(const InfoArguments& a, const nlohmann::json& j) {
  const auto& s = j["scene"];
  const auto points = sourcePoints(j);
  std::printf("%s: %s %s, colours: %s, light: %s, units: %s\n", a.scene.c_str(),
              formatCount(points.value_or(s["triangles"].get<std::uint64_t>())).c_str(),
              points ? "points" : "triangles", s["has_colors"].get<bool>() ? "yes" : "no",
              textIn(s["light"], "mode").c_str(), textIn(s, "units").c_str());
  std::printf("box %s to %s\n", s["box_min"].dump().c_str(), s["box_max"].dump().c_str());
  if (s.contains("interior")) std::printf("an interior, seen from its rooms\n");
  printAppearance(j);
  for (const auto& source : s["sources"])
    std::printf("source %s, %s\n", textIn(source, "path").c_str(), bytesIn(source, "bytes").c_str());
  for (const auto& [repair, count] : s["repairs"].items())
    std::printf("repaired: %s %s\n", formatCount(count.get<std::uint64_t>()).c_str(), repair.c_str());
  for (const auto& warning : j["warnings"]) std::printf("warning: %s\n", warning.get<std::string>().c_str());
  if (!j.contains("open_edges")) return;
  if (j["source_open_edges"] == 0 && j["open_edges"] == 0)
    std::printf("border: none; the surface is closed\n");
  else
    std::printf("border: %s open edges in the source, %s here; stitching moved nothing farther than %g\n",
                countIn(j, "source_open_edges").c_str(), countIn(j, "open_edges").c_str(),
                s["largest_movement"].get<double>());
}

void printHierarchy(const nlohmann::json& h) {
  std::printf("hierarchy: %s patches in %s groups, %s; positions within %g\n", countIn(h, "patches").c_str(),
              countIn(h, "groups").c_str(), bytesIn(h, "bytes").c_str(), h["position_error"].get<double>());
  printDigest(h, "content");
  int number = 0;
  for (const auto& level : h["levels"])
    std::printf("  level %2d: %12s triangles %8s patches, error typically %.3g, nowhere above %.3g\n", number++,
                countIn(level, "triangles").c_str(), countIn(level, "patches").c_str(),
                level["typical_error"].get<double>(), level["max_error"].get<double>());
}

void printTextures(const nlohmann::json& t) {
  std::printf("textures: %s pictures, %s texels on %s triangles (%.0f each), a texel is %.3g across; %s\n",
              countIn(t, "images").c_str(), countIn(t, "texels").c_str(), countIn(t, "triangles").c_str(),
              t["texels_per_triangle"].get<double>(), t["texel"].get<double>(), bytesIn(t, "bytes").c_str());
  if (t["reduced_pages"] != 0)
    std::printf("  %s of %s pages were too large and have coarser texels\n", countIn(t, "reduced_pages").c_str(),
                countIn(t, "pages").c_str());
}

/// The texts that describe how the scene's images were chosen; empty where they were not.
struct ChoiceTexts {
  std::string methods, tuning;
};

void print(const InfoArguments& a, const nlohmann::json& j, const ChoiceTexts& choices) {
  printScene(a, j);
  if (!choices.methods.empty()) std::printf("auto: %s\n", choices.methods.c_str());
  if (j.contains("hierarchy")) printHierarchy(j["hierarchy"]);
  if (j.contains("texture")) printTextures(j["texture"]);
  if (j.contains("qsplat")) {
    std::printf("splats: %s\n", describeSplats(j["qsplat"]).c_str());
    printDigest(j["qsplat"], "content");
  }
  if (j.contains("pmr")) {
    std::printf("umbrellas: %s\n", describeUmbrellas(j["pmr"]).c_str());
    printDigest(j["pmr"], "content");
  }
  if (j.contains("hlod")) {
    std::printf("octree: %s\n", describeHlod(j["hlod"]).c_str());
    printDigest(j["hlod"], "content");
  }
  if (j.contains("images"))
    printImages(j["images"], choices.tuning);
  else
    std::printf("images: none\n");
  if (j.contains("annotations")) printAnnotations(j["annotations"]);
  if (j.contains("access")) printAccess(j["access"]);
}

/// With the digest where it is asked for and the scene is on this machine.
base::Result<nlohmann::json> describePatchFile(const InfoArguments& a, const OpenScene& open) {
  nlohmann::json j = describeHierarchy(open);
  if (!a.digest || open.directory.empty()) return j;
  LUMIGRID_ASSIGN_OR_RETURN(j["sha256"], methodDigest(base::patchPath(open.directory, open.scene)));
  return j;
}

/// Nothing when the scene keeps no textures, or is not on this machine.
base::Result<nlohmann::json> describeTextures(const OpenScene& open) {
  const auto file = base::partFile(open.scene, "texture", ".lgt");
  if (open.directory.empty() || !file) return nlohmann::json();
  LUMIGRID_ASSIGN_OR_RETURN(const auto textures, lod::texture::TextureFile::open(open.directory + "/" + *file));
  const lod::texture::TextureSummary& s = textures.summary();
  double texels = 0.0, area = 0.0;
  for (const lod::texture::PageRecord& page : textures.pages()) {
    const double count = static_cast<double>(page.width) * static_cast<double>(page.height);
    texels += count;
    area += count * static_cast<double>(page.texel) * static_cast<double>(page.texel);
  }
  const auto triangles = static_cast<double>(std::max<std::uint64_t>(1, s.triangles));
  return nlohmann::json{{"images", s.pictures},
                        {"texels", s.texels},
                        {"triangles", s.triangles},
                        {"texels_per_triangle", static_cast<double>(s.texels) / triangles},
                        {"texel", std::sqrt(area / std::max(texels, 1.0))},
                        {"typical_error", s.typical_error},
                        {"pages", textures.pages().size()},
                        {"reduced_pages", s.reduced_pages},
                        {"bytes", textures.fileBytes()}};
}

/// Nothing when the scene has no tree of splats, or is not on this machine.
base::Result<nlohmann::json> describeSplatFile(const InfoArguments& a, const OpenScene& open) {
  if (open.directory.empty() || !base::partFile(open.scene, "qsplat", ".lgq")) return nlohmann::json();
  const std::string path = base::splatPath(open.directory, open.scene);
  LUMIGRID_ASSIGN_OR_RETURN(const auto splats, lod::qsplat::SplatFile::open(path));
  nlohmann::json j = splatsJson(splats.header());
  if (a.digest) {
    LUMIGRID_ASSIGN_OR_RETURN(j["sha256"], methodDigest(path));
  }
  return j;
}

/// Adds what `read` says of the method's file, unless the scene has none, or is not on this machine.
base::Result<void> addStreamedFile(const InfoArguments& a, const OpenScene& open, const base::StreamedMethod& method,
                                   std::uint32_t header_bytes,
                                   base::Result<nlohmann::json> (*read)(const std::string& path), nlohmann::json& j) {
  if (open.directory.empty() || streamedFile(open, method) == nullptr) return {};
  const std::string path = base::streamedPath(open.directory, open.scene, method);
  LUMIGRID_ASSIGN_OR_RETURN(auto told, read(path));
  if (a.digest) {
    LUMIGRID_ASSIGN_OR_RETURN(told["sha256"], methodDigest(path, header_bytes));
  }
  j[method.name] = std::move(told);
  return {};
}

/// With the digest where it is asked for, and the choice of --tune where there is one.
base::Result<nlohmann::json> describeImageStore(const InfoArguments& a, const OpenScene& open) {
  // A published repository counts what it holds, so that nothing need be fetched.
  repository::StoreContents contents;
  if (open.packs != nullptr) {
    contents = contentsOf(open.packs->root(), 6 * open.points.count());
  } else {
    LUMIGRID_ASSIGN_OR_RETURN(contents, repository::contentsOf(*open.images));
  }
  nlohmann::json j = describeImages(open, contents);
  addImagesLight(open.scene, j);
  if (a.digest) {
    LUMIGRID_ASSIGN_OR_RETURN(j["sha256"], digestOf(*open.images));
  }
  const auto tuned = storedChoice(open.scene.parameters);
  if (!tuned) return base::within(a.scene + "/scene.json", tuned.error());
  if (*tuned) j["tuned"] = tunedJson(**tuned);
  return j;
}

base::Result<nlohmann::json> describe(const InfoArguments& a, const OpenScene& open) {
  nlohmann::json j;
  j["scene"] = base::parseJson(open.scene_json);
  j["triangles"] = open.scene.triangles;
  j["repairs"] = open.scene.repairs;
  j["warnings"] = open.directory.empty() ? std::vector<std::string>() : recordedWarnings(open.directory);
  if (const glm::dvec3 north = base::northOf(open.scene); open.scene.north)
    j["north_direction"] = {north.x, north.y, north.z};
  if (const auto& border = open.scene.border) {
    j["source_open_edges"] = border->source_open_edges;
    j["open_edges"] = border->open_edges;
    for (const char* repair : {"stitched_vertices", "closed_holes"})
      if (!j["repairs"].contains(repair)) j["repairs"][repair] = 0;
  }
  const auto trial = storedTrial(open.scene.parameters);
  if (!trial) return base::within(a.scene + "/scene.json", trial.error());
  if (*trial) j["auto"] = trialJson(**trial);
  if (open.data.patches != nullptr) {
    LUMIGRID_ASSIGN_OR_RETURN(j["hierarchy"], describePatchFile(a, open));
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto splats, describeSplatFile(a, open));
  if (!splats.is_null()) j["qsplat"] = std::move(splats);
  LUMIGRID_TRY(addStreamedFile(a, open, base::kUmbrellaMethod, lod::pmr::kHeaderBytes, readUmbrellasJson, j));
  LUMIGRID_TRY(addStreamedFile(a, open, base::kHlodMethod, lod::hlod::kHeaderBytes, readHlodJson, j));
  LUMIGRID_ASSIGN_OR_RETURN(auto textures, describeTextures(open));
  if (!textures.is_null()) j["texture"] = std::move(textures);
  if (open.images) {
    LUMIGRID_ASSIGN_OR_RETURN(j["images"], describeImageStore(a, open));
  }
  if (auto annotations = describeAnnotations(open); !annotations.is_null()) j["annotations"] = std::move(annotations);
  if (auto access = describeAccess(open, a); !access.is_null()) j["access"] = std::move(access);
  return j;
}

ChoiceTexts choicesOf(const Parameters& parameters) {
  ChoiceTexts texts;
  const auto trial = storedTrial(parameters);
  if (trial && *trial) texts.methods = describeTrial(**trial);
  const auto tuned = storedChoice(parameters);
  if (!tuned || !*tuned) return texts;
  const auto asked = parameters.find("tune");
  texts.tuning = "tuned to " + (asked == parameters.end() ? "?" : asked->second) + " dB: " + describeChoice(**tuned);
  return texts;
}

int run(const InfoArguments& a) {
  const auto open = openScene(a.scene);
  if (!open) return fail(open.error());
  const auto j = describe(a, **open);
  if (!j) return fail(j.error());
  if (a.json)
    std::printf("%s\n", j->dump(2).c_str());
  else
    print(a, *j, choicesOf((*open)->scene.parameters));
  return kDone;
}

}  // namespace

RunCommand addInfo(CLI::App& command) {
  auto a = std::make_shared<InfoArguments>();
  command.add_option("SCENE", a->scene, "scene directory")->required();
  command
      .add_option("--access-file", a->access_files,
                  "files of access counts to add up; default: those in the scene, when they are there")
      ->default_str("");
  command.add_flag(
      "--digest", a->digest,
      "also SHA-256s: over the keys and values of all images, the same however they are divided; and, of a "
      "scene on this machine, over patch.lgp, qsplat.lgq, pmr.lgm and hlod.lgh without the version of their format");
  command.add_flag("--json", a->json, "as JSON");
  return [a] { return run(*a); };
}

}  // namespace server::cli
