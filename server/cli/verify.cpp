#include <stdlib.h>
#include <cerrno>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <utility>

#include "base/file.h"
#include "base/hash/sha256.h"
#include "base/json/annotations_file.h"
#include "lod/disk_bytes.h"
#include "lod/hlod/check_file.h"
#include "lod/pmr/check_file.h"
#include "lod/qsplat/splat_file.h"
#include "lod/texture/format.h"
#include "repository/access.h"
#include "repository/objects/mirror.h"
#include "repository/objects/open_objects.h"
#include "repository/packs/prefetch.h"
#include "repository/repository.h"
#include "repository/sampling/expected_points.h"
#include "repository/sampling/parameters.h"
#include "repository/verify.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"
#include "server/cli/scene_images.h"
#include "server/cli/verify_cuts.h"
#include "server/scene/open_scene.h"

namespace server::cli {
namespace {

namespace fs = std::filesystem;

struct VerifyArguments {
  std::string scene;
  bool json = false, quiet = false;
  std::uint32_t cuts = 0;  ///< 0: none are checked
  std::uint64_t seed = 1;
};

/// The value; where there is an error, nothing, and its message among the faults.
template <class T>
std::optional<T> valueOrFault(base::Result<T> result, Faults& faults) {
  if (result) return std::move(*result);
  faults.push_back(result.error().message);
  return std::nullopt;
}

// ---- Parts, wherever the scene lies

// Checks a tree of splats on the disk: all that SplatFile::verify finds, and that it agrees with scene.json.
void verifySplats(const std::string& path, const base::Scene& scene, Faults& faults) {
  const auto splats = valueOrFault(lod::qsplat::SplatFile::open(path), faults);
  if (!splats) return;
  for (const std::string& fault : splats->verify()) faults.push_back(path + ": " + fault);
  const lod::qsplat::Header& header = splats->header();
  if (header.colors != scene.has_colors) faults.push_back(path + ": colours do not agree with scene.json");
  const base::Aabb box = scene.localBox();
  const float slack = header.root.radius + 1e-6F * box.diagonal();
  if (!base::Aabb{box.min - slack, box.max + slack}.contains(header.root.center))
    faults.push_back(path + ": its root lies outside the scene's box");
}

// Checks a method's file on the disk in the same way; the functions are the method's.
template <class Header>
void verifyStreamed(const std::string& path, const base::Scene& scene, Faults& faults, std::uint32_t header_bytes,
                    Faults (*check_file)(const lod::FileBytes& file),
                    base::Result<Header> (*read_header)(base::ByteView front)) {
  auto opened = valueOrFault(base::PositionedFile::open(path), faults);
  if (!opened) return;
  const lod::DiskBytes file(std::move(*opened));
  for (const std::string& fault : check_file(file)) faults.push_back(path + ": " + fault);
  base::Bytes front(header_bytes);
  if (!file.read(0, front)) return;
  const auto header = read_header(front);
  if (!header) return;
  if (header->colors != scene.has_colors) faults.push_back(path + ": colours do not agree with scene.json");
  const base::Aabb box = scene.localBox();
  const float slack = header->bounds.radius + 1e-6F * box.diagonal();
  if (!base::Aabb{box.min - slack, box.max + slack}.contains(header->bounds.center))
    faults.push_back(path + ": what it shows lies outside the scene's box");
}

void verifyUmbrellas(const std::string& path, const base::Scene& scene, Faults& faults) {
  verifyStreamed(path, scene, faults, lod::pmr::kHeaderBytes, lod::pmr::checkFile, lod::pmr::readHeader);
}

void verifyHlod(const std::string& path, const base::Scene& scene, Faults& faults) {
  verifyStreamed(path, scene, faults, lod::hlod::kHeaderBytes, lod::hlod::checkFile, lod::hlod::readHeader);
}

// Checks a patch hierarchy on the disk in the same way.
void verifyPatches(const std::string& path, const base::Scene& scene, Faults& faults) {
  const auto patches = valueOrFault(lod::patch::PatchFile::open(path), faults);
  if (!patches) return;
  for (const std::string& fault : patches->verify()) faults.push_back(fault);
  const lod::patch::Hierarchy& h = patches->hierarchy();
  if (h.has_colors != scene.has_colors) faults.push_back(path + ": colours do not agree with scene.json");
  base::Aabb box = scene.localBox();
  const float slack = static_cast<float>(h.lattice.positionError()) + 1e-6F * box.diagonal();
  box.min -= slack;
  box.max += slack;
  for (std::size_t i = 0; i < h.patches.size(); ++i)
    if (h.patches[i].level == 0 && !(box.contains(h.patches[i].box.min) && box.contains(h.patches[i].box.max)))
      faults.push_back(path + ": leaf patch " + std::to_string(i) + " lies outside the scene's box");
}

using VerifyFile = void (*)(const std::string& path, const base::Scene& scene, Faults& faults);

/// A method's one file.
struct MethodFile {
  const char* stem;
  const char* extension;
  VerifyFile verify;
};
constexpr MethodFile kMethodFiles[] = {{"patch", ".lgp", verifyPatches},
                                       {base::kSplatMethod.name, base::kSplatMethod.extension, verifySplats},
                                       {base::kUmbrellaMethod.name, base::kUmbrellaMethod.extension, verifyUmbrellas},
                                       {base::kHlodMethod.name, base::kHlodMethod.extension, verifyHlod}};

// Checks the textures of the leaves.
void verifyTextures(const std::string& path, const std::string& patch_path, Faults& faults) {
  const auto textures = valueOrFault(lod::texture::TextureFile::open(path), faults);
  if (!textures) return;
  for (const std::string& fault : textures->verify()) faults.push_back(fault);
  const auto patches = lod::patch::PatchFile::open(patch_path);  // whose own faults are told elsewhere
  if (!patches) return;
  const std::vector<lod::patch::Patch>& rows = patches->hierarchy().patches;
  if (textures->summary().patches != rows.size())
    return faults.push_back(path + ": belongs to a hierarchy of " + std::to_string(textures->summary().patches) +
                            " patches, this one has " + std::to_string(rows.size()));
  for (const lod::texture::PageRecord& page : textures->pages()) {
    const lod::patch::Patch& patch = rows[page.patch];
    if (patch.level != 0 || page.triangles > patch.triangles)
      faults.push_back(path + ": patch " + std::to_string(page.patch) + " cannot have its page");
  }
}

// Checks published images; messages name the path of their index.
void verifyPacks(const base::Result<std::unique_ptr<repository::PackStore>>& packs, const std::string& path,
                 const VerifyProgress& progress, Faults& faults) {
  const auto meta = valueOrFault(packs ? (*packs)->readMeta() : packs.error(), faults);
  if (!meta) return;
  if (!meta->has_value()) return faults.push_back(path + ": does not say which grid it belongs to");
  const auto points = valueOrFault(repository::sampledPointsFromMeta(**meta, path), faults);
  if (!points) return;
  const double all = static_cast<double>(std::max<std::uint64_t>(1, (*packs)->root().keys));
  const auto report = [&](std::uint64_t values) {
    return !progress || progress(std::min(1.0, static_cast<double>(values) / all));
  };
  for (std::string& fault : repository::verify(**packs, points->grid, points->treeOrNull(), 0, report))
    faults.push_back(std::move(fault));
}

// ---- A scene on the disk

// Checks that every part that scene.json lists is there, with its size and hash.
void verifyParts(const std::string& directory, const base::Scene& scene, Faults& faults) {
  for (const base::ScenePart& part : scene.parts) {
    if (!repository::isObjectName(part.file)) {
      faults.push_back(directory + ": scene.json lists a part '" + part.file + "', which cannot be");
      continue;
    }
    const std::string path = directory + "/" + part.file;
    if (!fs::exists(path)) {
      faults.push_back(path + ": is missing, but scene.json lists it");
      continue;
    }
    if (fs::is_directory(path)) continue;
    if (fs::file_size(path) != part.bytes)
      faults.push_back(path + ": has " + std::to_string(fs::file_size(path)) + " bytes, scene.json says " +
                       std::to_string(part.bytes));
    const auto hash = valueOrFault(base::sha256OfFile(path), faults);
    if (hash && *hash != part.sha256)
      faults.push_back(path + ": its SHA-256 is " + *hash + ", scene.json says " + part.sha256);
  }
}

// Checks one store, whose parameters must be those of all others.
void verifyStore(const std::string& path, const repository::Shard& shard, const std::string& meta,
                 const repository::SampledPoints& points, Faults& faults) {
  const bool is_empty = repository::ExpectedPoints(points.grid, shard, points.treeOrNull()).size() == 0;
  if (is_empty && !repository::isLmdbStore(path)) return;
  const auto store = repository::openLmdbStore(path, repository::StoreMode::kRead);
  const auto own = valueOrFault(store ? (*store)->readMeta() : store.error(), faults);
  if (!own) return;
  if (!own->has_value()) return faults.push_back(path + ": does not say which grid it belongs to");
  if (*own != meta)
    return faults.push_back(
        path + ": was built with other parameters than other shards: " + repository::firstDifference(meta, **own));
  const auto found = valueOrFault(repository::verify(**store, points.grid, points.treeOrNull(), 0, shard), faults);
  for (const std::string& fault : found.value_or(Faults())) faults.push_back(path + ": " + fault);
}

// The parameters of the first store that can be read. verifyStore says why others cannot be.
std::optional<std::string> firstMeta(const std::string& images, std::uint32_t shards) {
  for (std::uint32_t i = 0; i < std::max(shards, 1U); ++i) {
    auto store = repository::openLmdbStore(repository::storeDirectory(images, shards, i), repository::StoreMode::kRead);
    if (!store) continue;
    if (auto meta = (*store)->readMeta(); meta && meta->has_value()) return **meta;
  }
  return std::nullopt;
}

// Checks every store of the scene's division, and that there are no others.
void verifyImages(const std::string& images, const base::Scene& scene, Faults& faults) {
  auto shards = shardsOf(scene);
  const auto orphans = valueOrFault(shards ? orphanStores(images, *shards) : shards.error(), faults);
  if (!orphans) return;
  for (const std::string& orphan : *orphans)
    faults.push_back(orphan + ": is not of this scene's division of the images");
  const auto meta = firstMeta(images, *shards);
  if (!meta) return faults.push_back(images + ": no store here says which grid it belongs to");
  const auto points = valueOrFault(repository::sampledPointsFromMeta(*meta, images), faults);
  if (!points) return;
  const std::uint32_t count = std::max(*shards, 1U);
  for (std::uint32_t i = 0; i < count; ++i)
    verifyStore(repository::storeDirectory(images, *shards, i), {i, count}, *meta, *points, faults);
}

// Servers write the file: a scene has none until it was served.
void verifyAccess(const std::string& path, Faults& faults) {
  if (!fs::exists(path)) return;
  const auto bytes = valueOrFault(base::readFile(path), faults);
  if (!bytes) return;
  if (const auto file = repository::decodeAccess(*bytes); !file) faults.push_back(path + ": " + file.error().message);
}

// Lists the faults of a scene on the disk.
base::Result<Faults> verifyHere(const std::string& directory, const VerifyProgress& progress, bool& is_published) {
  LUMIGRID_ASSIGN_OR_RETURN(auto scene, base::readScene(directory));
  Faults faults;
  verifyParts(directory, scene, faults);
  bool has_method = false;
  for (const MethodFile& method : kMethodFiles) {
    const auto file = base::partFile(scene, method.stem, method.extension);
    if (file) method.verify(directory + "/" + *file, scene, faults);
    has_method = has_method || file;
  }
  if (!has_method) verifyPatches(base::patchPath(directory, scene), scene, faults);  // says that there are none
  if (const auto textures = base::partFile(scene, "texture", ".lgt"))
    verifyTextures(directory + "/" + *textures, base::patchPath(directory, scene), faults);
  const auto index = base::partFile(scene, "images/index", ".lgi");
  is_published = index.has_value();
  if (index)
    verifyPacks(openPacks(directory, *index), directory + "/" + *index, progress, faults);
  else if (fs::is_directory(directory + "/images"))
    verifyImages(directory + "/images", scene, faults);
  verifyAccess(repository::accessFileOf(directory), faults);
  valueOrFault(base::readAnnotations(directory), faults);
  return faults;
}

// ---- A published scene behind a network

constexpr unsigned kReads = 8;                                 // under way at a time: hides a distant store's latency
constexpr std::uint64_t kRangeBytes = std::uint64_t{4} << 20;  // eight of them are held at a time

/// A directory for temporary files that the destructor removes.
class WorkFolder {
 public:
  static base::Result<std::unique_ptr<WorkFolder>> make() {
    std::error_code error;
    std::string path = (fs::temp_directory_path(error) / "lumigrid-verify-XXXXXX").string();
    if (error || ::mkdtemp(path.data()) == nullptr) return base::systemError(path, "make this directory", errno);
    return std::unique_ptr<WorkFolder>(new WorkFolder(path));
  }
  ~WorkFolder() {
    std::error_code ignored;
    fs::remove_all(path_, ignored);
  }
  WorkFolder(const WorkFolder&) = delete;
  WorkFolder& operator=(const WorkFolder&) = delete;
  const std::string& path() const { return path_; }

 private:
  explicit WorkFolder(std::string path) : path_(std::move(path)) {}
  const std::string path_;
};

// The SHA-256 of an object, which is read by ranges.
base::Result<std::string> hashOf(const repository::ObjectSource& source, const std::string& name, std::uint64_t bytes) {
  base::Sha256 hash;
  std::optional<base::Error> failed;
  const auto offset = [](std::size_t i) { return i * kRangeBytes; };
  const auto length = [&](std::size_t i) { return std::min(kRangeBytes, bytes - offset(i)); };
  repository::prefetchInOrder((bytes + kRangeBytes - 1) / kRangeBytes, {kReads, kReads * kRangeBytes}, length,
                              [&](std::size_t i) { return source.read(name, offset(i), length(i)); },
                              [&](std::size_t, const base::Result<base::Bytes>& piece) {
                                if (piece)
                                  hash.add(*piece);
                                else
                                  failed = piece.error();
                                return piece.operator bool();
                              });
  if (failed) return *failed;
  return base::hexOf(hash.finish());
}

// Checks that a part is as scene.json lists it.
void verifyPart(const repository::ObjectSource& source, const base::ScenePart& part, Faults& faults) {
  const std::string object = source.place() + "/" + part.file;
  const auto bytes = valueOrFault(source.size(part.file), faults);
  if (!bytes) return;
  if (*bytes != part.bytes)
    return faults.push_back(object + ": has " + std::to_string(*bytes) + " bytes, scene.json says " +
                            std::to_string(part.bytes));
  const auto hash = valueOrFault(hashOf(source, part.file, *bytes), faults);
  if (hash && *hash != part.sha256)
    faults.push_back(object + ": its SHA-256 is " + *hash + ", scene.json says " + part.sha256);
}

// Checks a method's file through a local copy, since it is read out of order; length and SHA-256 are compared while it
// is copied.
void verifyFarFile(const repository::ObjectSource& source, const base::ScenePart& part, const base::Scene& scene,
                   VerifyFile verify, const VerifyProgress& progress, Faults& faults) {
  const auto folder = valueOrFault(WorkFolder::make(), faults);
  if (!folder) return;
  repository::MirrorOptions options;
  options.progress = [&](std::uint64_t, std::uint64_t) { return progress(0.0); };
  const auto path =
      valueOrFault(repository::mirrorObject(source, part.file, (*folder)->path(), part.sha256, options), faults);
  if (!path) return;
  Faults found;
  verify(*path, scene, found);
  for (std::string& fault : found) {
    // Messages name the object at the place, not the local copy.
    if (fault.starts_with(*path)) fault = source.place() + "/" + part.file + fault.substr(path->size());
    faults.push_back(std::move(fault));
  }
}

// Annotations are no part of the scene, so there may be none.
void verifyFarAnnotations(const repository::ObjectSource& source, Faults& faults) {
  const auto size = source.size(base::kAnnotationsFile);
  if (!size && size.error().code == base::ErrorCode::kNotFound) return;
  const auto bytes = valueOrFault(
      size ? source.read(base::kAnnotationsFile, 0, std::min<std::uint64_t>(*size, base::kMaxAnnotationsBytes + 1))
           : size.error(),
      faults);
  if (bytes) valueOrFault(base::parseAnnotations(*bytes, source.place() + "/" + base::kAnnotationsFile), faults);
}

/// Reads everything of the scene at a place ("https://host/scene", "s3://bucket/scene") by ranges, several at a time,
/// and past every cache: each part's length and SHA-256 against scene.json; hierarchies, through a file in the
/// directory for temporary files; each pack and value; annotations. Memory does not grow with the scene. Errors: those
/// of reading scene.json, and no published scene there.
base::Result<Faults> verifyFar(const std::string& place, const VerifyProgress& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(const std::shared_ptr<const repository::ObjectSource> source,
                            repository::openObjectSource(place));
  LUMIGRID_ASSIGN_OR_RETURN(const auto json, readSceneJson(*source));
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene,
                            base::parseScene(std::string(json.begin(), json.end()), source->place() + "/scene.json"));
  const auto methodOf = [&](const base::ScenePart& part) {
    return std::find_if(std::begin(kMethodFiles), std::end(kMethodFiles), [&](const MethodFile& method) {
      return base::isPublishedName(part.file) && base::partFile(scene, method.stem, method.extension) == part.file;
    });
  };
  const auto index = base::partFile(scene, "images/index", ".lgi");
  if (std::all_of(scene.parts.begin(), scene.parts.end(),
                  [&](const base::ScenePart& part) { return methodOf(part) == std::end(kMethodFiles); }))
    return base::Error{base::ErrorCode::kInvalidInput,
                       place + ": is not a published scene; put there what `lumigrid publish` wrote"};

  Faults faults;
  for (const base::ScenePart& part : scene.parts) {
    if (!progress(0.0)) return faults;
    if (!repository::isObjectName(part.file))
      faults.push_back(place + ": scene.json lists a part '" + part.file + "', which cannot be");
    else if (const auto* method = methodOf(part); method != std::end(kMethodFiles))
      verifyFarFile(*source, part, scene, method->verify, progress, faults);
    else
      verifyPart(*source, part, faults);
  }
  repository::PackStoreOptions reads;
  reads.jobs = kReads;
  if (index)
    verifyPacks(repository::PackStore::open(source, *index, reads), source->place() + "/" + *index, progress, faults);
  verifyFarAnnotations(*source, faults);
  return faults;
}

// ---- The command

base::Result<CutReport> verifyCutsOfScene(const VerifyArguments& a, const VerifyProgress& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene, base::readScene(a.scene));
  LUMIGRID_ASSIGN_OR_RETURN(const auto patches, lod::patch::PatchFile::open(base::patchPath(a.scene, scene)));
  return verifyCuts(patches, a.cuts, a.seed, progress);
}

int run(const VerifyArguments& a) {
  stopOnSignals();
  ProgressLine line(a.quiet);
  const VerifyProgress progress = [&](double done) {
    line.show("verify", done);
    return !stopRequested();
  };
  bool is_published = repository::isRemotePlace(a.scene);
  if (a.cuts > 0 && is_published)
    return fail({base::ErrorCode::kInvalidInput, "--cuts needs the directory of a scene, not a place on a network"});
  auto faults = is_published ? verifyFar(a.scene, progress) : verifyHere(a.scene, progress, is_published);
  std::optional<CutReport> cuts;
  if (faults && a.cuts > 0 && !stopRequested()) {
    auto report = verifyCutsOfScene(a, progress);
    if (report) {
      faults->insert(faults->end(), report->faults.begin(), report->faults.end());
      cuts = std::move(*report);
    } else if (report.error().code != base::ErrorCode::kCancelled) {
      faults->push_back(report.error().message);
    }
  }
  line.finish();
  if (!faults) return fail(faults.error());
  if (stopRequested()) return fail({base::ErrorCode::kCancelled, "stopped before everything was read"});
  if (a.json) {
    nlohmann::json report{{"scene", a.scene}, {"faults", *faults}};
    if (cuts) report["cuts"] = cutsAsJson(*cuts);
    std::printf("%s\n", report.dump(2).c_str());
  } else {
    if (cuts) std::printf("%s", cutsAsText(*cuts).c_str());
    for (const std::string& fault : *faults) std::printf("%s\n", fault.c_str());
    if (faults->empty())
      std::printf("%s: all is well\n", a.scene.c_str());
    else if (is_published)
      std::printf("%s: %zu faults; `lumigrid publish` of the built scene with --rewrite mends them\n", a.scene.c_str(),
                  faults->size());
    else
      std::printf(
          "%s: %zu faults; `lumigrid build -o %s` renders missing and broken images again and removes what does not "
          "belong here, other parts need --force\n",
          a.scene.c_str(), faults->size(), a.scene.c_str());
  }
  return faults->empty() ? kDone : kFailed;
}

}  // namespace

RunCommand addVerify(CLI::App& command) {
  auto a = std::make_shared<VerifyArguments>();
  command
      .add_option("SCENE", a->scene,
                  "scene directory, or where a published scene lies: https://host/scene or s3://bucket/scene, which is "
                  "read by ranges, several at a time, without a cache")
      ->required();
  command.add_flag("--json", a->json, "faults as JSON");
  command.add_flag("--quiet", a->quiet, "no progress");
  command
      .add_option(
          "--cuts", a->cuts,
          "also rebuild this many random cuts of the patch hierarchy as half-edge meshes, and compare open edges, "
          "non-manifold vertices and orientation with the source's; needs some 200 bytes of memory a triangle")
      ->check(CLI::Range(0U, 1'000'000U))
      ->default_str("");
  command.add_option("--seed", a->seed, "the same seed gives the same cuts");
  return [a] { return run(*a); };
}

}  // namespace server::cli
