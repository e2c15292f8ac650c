#include "server/cli/verify_far.h"

#include <stdlib.h>
#include <cerrno>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <optional>
#include <utility>

#include "base/file.h"
#include "base/hash/sha256.h"
#include "base/json/annotations_file.h"
#include "repository/objects/mirror.h"
#include "repository/objects/open_objects.h"
#include "repository/packs/prefetch.h"
#include "server/net/open_scene.h"

namespace server::cli {
namespace {

namespace fs = std::filesystem;

constexpr unsigned kReads = 8;                                 // under way at a time: hides a distant store's latency
constexpr std::uint64_t kRangeBytes = std::uint64_t{4} << 20;  // eight of them are held at a time

using Source = std::shared_ptr<const repository::ObjectSource>;

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

using VerifyFile = void (*)(const std::string& path, const base::Scene& scene, Faults& faults);

// Checks a method's file through a local copy, since it is read through a memory map; length and SHA-256 are compared
// while it is copied.
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

void verifyFarImages(const Source& source, const std::string& index, const VerifyProgress& progress, Faults& faults) {
  repository::PackStoreOptions options;
  options.jobs = kReads;
  if (const auto packs = valueOrFault(repository::PackStore::open(source, index, options), faults))
    verifyPacks(**packs, source->place() + "/" + index, progress, faults);
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

}  // namespace

base::Result<Faults> verifyFar(const std::string& place, const VerifyProgress& progress) {
  LUMIGRID_ASSIGN_OR_RETURN(const Source source, repository::openObjectSource(place));
  LUMIGRID_ASSIGN_OR_RETURN(const auto json, readSceneJson(*source));
  LUMIGRID_ASSIGN_OR_RETURN(const auto scene,
                            base::parseScene(std::string(json.begin(), json.end()), source->place() + "/scene.json"));
  const auto patches = base::partFile(scene, "patch", ".lgp");
  const auto splats = base::partFile(scene, "qsplat", ".lgq");
  const auto index = base::partFile(scene, "images/index", ".lgi");
  if (!patches || !base::isPublishedName(*patches))
    return base::Error{base::ErrorCode::kInvalidInput,
                       place + ": is not a published scene; put there what `lumigrid publish` wrote"};

  Faults faults;
  for (const base::ScenePart& part : scene.parts) {
    if (!progress(0.0)) return faults;
    if (!repository::isObjectName(part.file))
      faults.push_back(place + ": scene.json lists a part '" + part.file + "', which cannot be");
    else if (part.file == *patches)
      verifyFarFile(*source, part, scene, verifyPatches, progress, faults);
    else if (part.file == splats)
      verifyFarFile(*source, part, scene, verifySplats, progress, faults);
    else
      verifyPart(*source, part, faults);
  }
  if (index) verifyFarImages(source, *index, progress, faults);
  verifyFarAnnotations(*source, faults);
  return faults;
}

}  // namespace server::cli
