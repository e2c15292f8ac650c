// lumigrid publish writes a scene as objects that never change and, last, scene.json, which says which of them are the
// current version (docs/formats/packs.md).
#include "repository/packs/publish.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "base/file.h"
#include "base/hash/sha256.h"
#include "base/json/annotations_file.h"
#include "base/json/parse.h"
#include "base/stopwatch.h"
#include "lod/patch/group_records.h"
#include "lod/qsplat/splat_file.h"
#include "lod/texture/format.h"
#include "plan/opening_ranges.h"
#include "repository/objects/open_objects.h"
#include "repository/packs/pack_format.h"
#include "server/cli/commands.h"
#include "server/cli/console.h"
#include "server/cli/streamed/info.h"
#include "server/net/page_files.h"
#include "server/scene/open_scene.h"

namespace server::cli {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;
using nlohmann::json;

struct PublishArguments {
  std::string scene, destination;
  repository::PublishOptions images;
  std::string viewer = "auto";  // or "on", "off"
  std::string web;              // folder of the page's files; empty: where they are installed
  bool prune = false, with_textures = false, json = false, quiet = false;
};

struct PublishedPage {
  std::uint64_t files = 0;
  std::uint64_t bytes_written = 0;
  std::uint64_t pruned = 0;
};

struct PublishReport {
  std::optional<repository::PublishedImages> images;
  std::optional<PublishedPage> page;
  std::optional<std::size_t> annotations;
  std::uint64_t part_bytes = 0;     ///< patch.lgp and its like
  std::uint64_t bytes_written = 0;  ///< bytes of parts and images
  std::uint64_t pruned = 0;
  double seconds = 0.0;
};

constexpr const char* kBinary = "application/octet-stream";

// A directory in which `lumigrid build` made a scene is refused: objects of two kinds would lie side by side there.
Result<void> refuseBuiltScene(repository::ObjectSink& sink) {
  std::vector<std::string> built{"patch.lgp", base::kBuildingFile, "images/data.mdb"};
  for (const base::StreamedMethod& method : base::kStreamedMethods) built.push_back(method.file());
  for (const std::string& name : built) {
    LUMIGRID_ASSIGN_OR_RETURN(auto size, sink.size(name));
    if (size.has_value())
      return Error{ErrorCode::kExists,
                   sink.place() + ": holds a scene that `lumigrid build` made; publish to another place"};
  }
  return {};
}

// Opens a method's file as its readers do. Errors name it.
Result<void> checkReadable(const std::string& path) {
  const std::string extension = std::filesystem::path(path).extension().string();
  const auto failure = [](const auto& result) { return result ? Result<void>() : Result<void>(result.error()); };
  if (extension == base::kHlodMethod.extension) return failure(readHlodJson(path));
  if (extension == base::kUmbrellaMethod.extension) return failure(readUmbrellasJson(path));
  if (extension == base::kSplatMethod.extension) return failure(lod::qsplat::SplatFile::open(path));
  if (extension == ".lgt") return failure(lod::texture::TextureFile::open(path));
  return {};  // patches were opened with the scene
}

// Writes one file of the scene under a name that holds its content's hash.
Result<base::ScenePart> publishPart(const PublishArguments& a, const base::ScenePart& part,
                                    repository::ObjectSink& sink, PublishReport& report) {
  const std::string path = a.scene + "/" + part.file;
  if (!repository::isObjectName(part.file))
    return Error{ErrorCode::kInvalidInput, a.scene + ": scene.json lists a part '" + part.file + "', which cannot be"};
  LUMIGRID_ASSIGN_OR_RETURN(auto hash, base::sha256OfFile(path));
  if (hash != part.sha256)
    return Error{ErrorCode::kInvalidInput,
                 path + ": is not the file that scene.json lists (SHA-256 differs); build the scene again"};
  LUMIGRID_TRY(checkReadable(path));
  const base::ScenePart published{base::publishedName(part.file, hash), part.bytes, hash};
  report.part_bytes += part.bytes;
  LUMIGRID_ASSIGN_OR_RETURN(auto there, sink.size(published.file));
  if (!a.images.rewrite && there == part.bytes) return published;
  LUMIGRID_TRY(sink.putFile(published.file, path, kBinary));
  report.bytes_written += part.bytes;
  return published;
}

bool isImages(const base::ScenePart& part) {
  return part.sha256.empty() || repository::idOfIndexName(part.file);
}

// Viewers do not read them; a server that draws frames does.
bool isTextures(const base::ScenePart& part) {
  const std::string name = base::isPublishedName(part.file) ? part.file.substr(0, part.file.find('-')) : part.file;
  return name == "texture" || name == "texture.lgt";
}

// A published scene has them; they are made anew from the hierarchy.
bool isRecords(const base::ScenePart& part) {
  return part.file.ends_with(".lgr");
}

// Writes the records of the hierarchy's groups, and notes for both what viewers read first.
Result<base::ScenePart> publishRecords(const PublishArguments& a, const OpenScene& scene, base::ScenePart& patches,
                                       repository::ObjectSink& sink, PublishReport& report) {
  const base::Bytes bytes = lod::patch::encodeRecords(scene.patches.hierarchy(), patches.bytes);
  const std::string hash = base::hexOf(base::sha256(bytes));
  base::ScenePart records{base::publishedName("records.lgr", hash), bytes.size(), hash};
  LUMIGRID_ASSIGN_OR_RETURN(auto opening, plan::openingRanges(scene.patches.hierarchy(), bytes));
  patches.opening = std::move(opening.blocks);
  records.opening = {opening.records};
  report.part_bytes += records.bytes;
  LUMIGRID_ASSIGN_OR_RETURN(auto there, sink.size(records.file));
  if (!a.images.rewrite && there == records.bytes) return records;
  LUMIGRID_TRY(sink.put(records.file, bytes, kBinary));
  report.bytes_written += records.bytes;
  return records;
}

Result<base::ScenePart> publishImages(const PublishArguments& a, const OpenScene& scene, repository::ObjectSink& sink,
                                      PublishReport& report, ProgressLine& line) {
  const base::Stopwatch watch;
  auto images = repository::publishImages(*scene.images, sink, a.images, [&](const repository::PublishProgress& p) {
    line.show(
        "publishing images",
        static_cast<double>(p.keys_done) / static_cast<double>(std::max<std::uint64_t>(p.keys_total, 1)),
        formatBytes(p.bytes) + ", " +
            formatBytes(static_cast<std::uint64_t>(static_cast<double>(p.bytes) / std::max(watch.seconds(), 1e-3))) +
            "/s");
    return !stopRequested();
  });
  line.finish();
  if (!images) return images.error();
  report.bytes_written += images->bytes_written;
  base::ScenePart part{images->index, images->index_bytes, images->index_sha256};
  part.opening = {{0, images->index_front_bytes}};
  report.images = std::move(*images);
  return part;
}

// scene.json as others see it: the folders of the meshes on this machine are left out.
base::Scene publicScene(base::Scene scene) {
  for (base::SceneSource& source : scene.sources) source.path = std::filesystem::path(source.path).filename().string();
  scene.parts.clear();
  return scene;
}

// Whether only a publisher gives such a name; also that of a temporary file that a killed one left.
bool isPublishersName(const std::string& name) {
  const std::size_t part = name.rfind(".part");
  const std::string whole =
      part != std::string::npos && base::isUnfinished(name, name.substr(0, part)) ? name.substr(0, part) : name;
  if (repository::idOfPackName(whole) || repository::idOfIndexName(whole)) return true;
  const std::string extension = std::filesystem::path(whole).extension().string();
  return whole.find('/') == std::string::npos && extension.size() == 4 && extension.starts_with(".lg") &&
         base::isPublishedName(whole);
}

// Removes objects of earlier versions that this one does not have.
Result<void> removeOldObjects(const base::Scene& scene, repository::ObjectSink& sink, PublishReport& report) {
  std::set<std::string> current;
  for (const base::ScenePart& part : scene.parts) current.insert(part.file);
  if (report.images) current.insert(report.images->pack_names.begin(), report.images->pack_names.end());
  LUMIGRID_ASSIGN_OR_RETURN(auto names, sink.list(""));
  for (const std::string& name : names) {
    if (!isPublishersName(name) || current.contains(name)) continue;
    LUMIGRID_TRY(sink.remove(name));
    ++report.pruned;
  }
  return {};
}

// ---- The browser client beside the scene, so that the place opens in a browser with no server of ours

/// The object that lists the page's files at the place, each with its SHA-256: other files are somebody else's, and are
/// not replaced.
constexpr const char* kPageList = "lumigrid-page.json";
constexpr const char* kRoot = "index.html";
constexpr std::uint64_t kMaxListBytes = 1 << 20;  // a list of the page's 40 files has some 5 kB

struct Object {
  base::ByteView bytes;
  std::string type;
  std::string sha256;
};
/// By name. Compressed forms stand beside their files, for servers that can send them.
using Objects = std::map<std::string, Object>;
using Hashes = std::map<std::string, std::string>;  // name → SHA-256 in hexadecimal digits

std::string hashOf(base::ByteView bytes) {
  return base::hexOf(base::sha256(bytes));
}

Objects objectsOf(const PageFiles& pages, base::ByteView root) {
  Objects objects;
  for (const auto& [name, file] : pages) {
    if (name == kRoot) {
      objects[name] = {root, file.type, hashOf(root)};
      continue;
    }
    objects[name] = {file.plain.bytes, file.type, hashOf(file.plain.bytes)};
    if (!file.gzip.etag.empty()) objects[name + ".gz"] = {file.gzip.bytes, "application/gzip", hashOf(file.gzip.bytes)};
    if (!file.brotli.etag.empty())
      objects[name + ".br"] = {file.brotli.bytes, "application/octet-stream", hashOf(file.brotli.bytes)};
  }
  return objects;
}

Result<void> setMeta(std::string& html, const std::string& name, const std::string& content) {
  const std::string front = "<meta name=\"" + name + "\" content=\"";
  const std::size_t at = html.find(front + "\">");
  if (at == std::string::npos)
    return Error{ErrorCode::kInvalidInput,
                 "the page's index.html lacks " + front +
                     "\">; build the preset web again, or leave the page out with --viewer off"};
  html.insert(at + front.size(), content);
  return {};
}

/// The page's index.html, told to show the scene beside it.
Result<base::Bytes> rootBesideScene(const base::Bytes& html, const base::StreamedMethod* method) {
  std::string text(html.begin(), html.end());
  LUMIGRID_TRY(setMeta(text, "lumigrid-scene", "scene.json"));
  if (method != nullptr) LUMIGRID_TRY(setMeta(text, "lumigrid-method", method->name));
  return base::Bytes(text.begin(), text.end());
}

bool isCompressedForm(const std::string& name, const Objects& objects) {
  return (name.ends_with(".gz") || name.ends_with(".br")) && objects.contains(name.substr(0, name.size() - 3));
}

bool isScenes(const std::string& name) {
  return name == "scene.json" || name == "annotations.json" || name == kPageList || name.starts_with("images/") ||
         name.ends_with(".lgp") || name.ends_with(".lgr") ||
         std::any_of(std::begin(base::kStreamedMethods), std::end(base::kStreamedMethods),
                     [&](const base::StreamedMethod& method) { return name.ends_with(method.extension); });
}

/// The files that the last publisher wrote; none where there is no list.
Result<Hashes> readList(repository::ObjectSink& sink, const repository::ObjectSource& source) {
  LUMIGRID_ASSIGN_OR_RETURN(auto size, sink.size(kPageList));
  if (!size) return Hashes();
  const Error bad{ErrorCode::kInvalidInput, source.place() + "/" + kPageList +
                                                ": cannot be read; remove the page's files there and publish again"};
  if (*size > kMaxListBytes) return bad;
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, source.read(kPageList, 0, *size));
  const json list = base::parseJson(bytes);
  if (!list.is_object() || !list.contains("version") || list["version"] != 1 || !list.contains("files") ||
      !list["files"].is_object())
    return bad;
  Hashes hashes;
  for (const auto& [name, hash] : list["files"].items()) {
    if (!repository::isObjectName(name) || isScenes(name) || !hash.is_string()) return bad;
    hashes[name] = hash.get<std::string>();
  }
  return hashes;
}

/// The names that must be written. A file that is there already must be as a publisher left it, or as it would be
/// written.
Result<std::set<std::string>> namesToWrite(const Objects& objects, const Hashes& before, repository::ObjectSink& sink,
                                           const repository::ObjectSource& source) {
  std::set<std::string> names;
  for (const auto& [name, object] : objects) {
    if (isScenes(name))
      return Error{ErrorCode::kInvalidInput, "a file of the page has the name '" + name + "' of one of a scene's"};
    LUMIGRID_ASSIGN_OR_RETURN(auto size, sink.size(name));
    if (!size) {
      names.insert(name);
      continue;
    }
    LUMIGRID_ASSIGN_OR_RETURN(auto there, source.read(name, 0, *size));
    const std::string hash = hashOf(there);
    if (hash == object.sha256) continue;
    const auto ours = before.find(name);
    if (ours == before.end() || ours->second != hash)
      return Error{ErrorCode::kExists, source.place() + "/" + name +
                                           ": was not written by `lumigrid publish`; move it away, or leave the page "
                                           "out with --viewer off"};
    names.insert(name);
  }
  return names;
}

/// Returns whether the file was removed: one that somebody has changed since is theirs, and stays.
Result<bool> removeIfOurs(const std::string& name, const std::string& hash, repository::ObjectSink& sink,
                          const repository::ObjectSource& source) {
  LUMIGRID_ASSIGN_OR_RETURN(auto size, sink.size(name));
  if (!size) return false;
  LUMIGRID_ASSIGN_OR_RETURN(auto there, source.read(name, 0, *size));
  if (hashOf(there) != hash) return false;
  LUMIGRID_TRY(sink.remove(name));
  return true;
}

Result<void> putList(const Hashes& hashes, repository::ObjectSink& sink) {
  const std::string text = json{{"version", 1}, {"files", hashes}}.dump(1) + "\n";
  return sink.put(kPageList, base::viewOfText(text), "application/json");
}

/// Writes the files that are not there already, index.html after all that it names, then the list. `place` is the
/// sink's, to read from.
///
/// index.html is told in its <meta name="lumigrid-scene"> where the scene is, and in <meta name="lumigrid-method"> the
/// method of one without patches (null: it has them), so its compressed forms are left out; kInvalidInput where it has
/// no such elements. A file that an earlier call did not write is never replaced: kExists, naming it, before anything
/// is written. `prune` removes files of earlier pages that this one does not have. Otherwise they stay for pages that
/// are open somewhere, but for compressed forms of files that this page has: they would be sent in these files' place.
Result<PublishedPage> publishPage(const PageFiles& pages, const std::string& place, repository::ObjectSink& sink,
                                  const base::StreamedMethod* method, bool prune) {
  LUMIGRID_ASSIGN_OR_RETURN(auto source, repository::openObjectSource(place));
  LUMIGRID_ASSIGN_OR_RETURN(const auto root, rootBesideScene(pages.at(kRoot).plain.bytes, method));
  const Objects objects = objectsOf(pages, root);
  LUMIGRID_ASSIGN_OR_RETURN(const auto before, readList(sink, *source));
  LUMIGRID_ASSIGN_OR_RETURN(auto names, namesToWrite(objects, before, sink, *source));

  PublishedPage done{objects.size(), 0, 0};
  const auto write = [&](const std::string& name) -> Result<void> {
    const Object& object = objects.at(name);
    done.bytes_written += object.bytes.size();
    return sink.put(name, object.bytes, object.type);
  };
  for (const std::string& name : names)
    if (name != kRoot) LUMIGRID_TRY(write(name));
  if (names.contains(kRoot)) LUMIGRID_TRY(write(kRoot));

  Hashes after;
  for (const auto& [name, object] : objects) after[name] = object.sha256;
  for (const auto& [name, hash] : before) {
    if (after.contains(name)) continue;
    if (!prune && !isCompressedForm(name, objects)) {
      after[name] = hash;
      continue;
    }
    LUMIGRID_ASSIGN_OR_RETURN(auto removed, removeIfOurs(name, hash, sink, *source));
    if (removed) ++done.pruned;
  }
  if (after != before) LUMIGRID_TRY(putList(after, sink));
  return done;
}

// The page's files where they are asked for, or not refused and there.
Result<std::optional<PageFiles>> pageFiles(const PublishArguments& a) {
  if (a.viewer == "off") return std::optional<PageFiles>();
  const std::string directory = a.web.empty() ? installedPageFiles() : a.web;
  if (directory.empty()) {
    if (a.viewer == "auto") return std::optional<PageFiles>();
    return Error{ErrorCode::kNotFound,
                 "there are no page files beside this program; --web names the folder that the preset web builds"};
  }
  LUMIGRID_ASSIGN_OR_RETURN(auto pages, readPageFiles(directory));
  return std::optional(std::move(pages));
}

// A place keeps a page of somebody's own, unless --viewer on asks for ours, which is an error then.
Result<void> publishPageTo(const PublishArguments& a, const PageFiles& pages, const base::StreamedMethod* method,
                           repository::ObjectSink& sink, PublishReport& report) {
  auto page = publishPage(pages, a.destination, sink, method, a.prune);
  if (!page && page.error().code == ErrorCode::kExists && a.viewer == "auto") {
    std::fprintf(stderr, "lumigrid: the page is left out: %s\n", page.error().message.c_str());
    return {};
  }
  if (!page) return page.error();
  report.bytes_written += page->bytes_written;
  report.pruned += page->pruned;
  report.page = *page;
  return {};
}

// ---- The command

// Annotations keep their name: they may change without the scene.
Result<void> publishAnnotations(const PublishArguments& a, const std::optional<base::AnnotationsText>& annotations,
                                repository::ObjectSink& sink, PublishReport& report) {
  if (!annotations ||
      std::filesystem::path(a.scene).lexically_normal() == std::filesystem::path(a.destination).lexically_normal())
    return {};
  report.annotations = annotations->notes;
  return sink.put(base::kAnnotationsFile, base::viewOfText(annotations->text), "application/json");
}

// Opens the scene as a server does, which checks that its patches and images belong together.
Result<std::unique_ptr<OpenScene>> openWhole(const PublishArguments& a, const base::Scene& scene) {
  if (base::partFile(scene, "patch", ".lgp") || base::methodWithoutPatches(scene) != nullptr) return openScene(a.scene);
  return Error{ErrorCode::kInvalidInput, a.scene + ": scene.json lists no patch.lgp; build the scene again"};
}

Result<PublishReport> publish(const PublishArguments& a) {
  const base::Stopwatch watch;
  // Errors beside the scene are told before hours of copying.
  LUMIGRID_ASSIGN_OR_RETURN(auto pages, pageFiles(a));
  LUMIGRID_ASSIGN_OR_RETURN(auto annotations, base::readAnnotations(a.scene));
  LUMIGRID_ASSIGN_OR_RETURN(const auto built, base::readScene(a.scene));
  LUMIGRID_ASSIGN_OR_RETURN(auto open, openWhole(a, built));
  LUMIGRID_ASSIGN_OR_RETURN(auto sink, repository::openObjectSink(a.destination));
  LUMIGRID_TRY(refuseBuiltScene(*sink));

  PublishReport report;
  if (pages) LUMIGRID_TRY(publishPageTo(a, *pages, base::methodWithoutPatches(built), *sink, report));
  base::Scene scene = publicScene(built);
  for (const base::ScenePart& part : built.parts) {
    if (isImages(part) || isRecords(part) || (isTextures(part) && !a.with_textures)) continue;
    LUMIGRID_ASSIGN_OR_RETURN(auto published, publishPart(a, part, *sink, report));
    std::optional<base::ScenePart> records;
    if (part.file == base::partFile(built, "patch", ".lgp")) {
      LUMIGRID_ASSIGN_OR_RETURN(records, publishRecords(a, *open, published, *sink, report));
    }
    scene.parts.push_back(std::move(published));
    if (records) scene.parts.push_back(std::move(*records));
  }
  if (open->images) {
    ProgressLine line(a.quiet);
    LUMIGRID_ASSIGN_OR_RETURN(auto published, publishImages(a, *open, *sink, report, line));
    scene.parts.push_back(std::move(published));
  }

  LUMIGRID_TRY(publishAnnotations(a, annotations, *sink, report));
  // All objects that scene.json names are there, so it may be seen.
  LUMIGRID_TRY(sink->put("scene.json", base::viewOfText(base::formatScene(scene)), "application/json"));
  if (a.prune) LUMIGRID_TRY(removeOldObjects(scene, *sink, report));
  report.seconds = watch.seconds();
  return report;
}

void print(const PublishArguments& a, const PublishReport& r) {
  if (a.json) {
    json j{{"scene", a.scene},           {"destination", a.destination},
           {"part_bytes", r.part_bytes}, {"bytes_written", r.bytes_written},
           {"pruned", r.pruned},         {"seconds", r.seconds}};
    if (r.page) j["page_files"] = r.page->files;
    if (r.annotations) j["annotations"] = *r.annotations;
    if (r.images)
      j["images"] = {{"images", r.images->keys - r.images->empty},
                     {"empty", r.images->empty},
                     {"index", r.images->index},
                     {"index_bytes", r.images->index_bytes},
                     {"packs", r.images->pack_names.size()},
                     {"packs_written", r.images->packs_written},
                     {"pack_bytes", r.images->pack_bytes}};
    std::printf("%s\n", j.dump(2).c_str());
    return;
  }
  if (a.quiet) return;
  std::printf("%s: published at %s in %s; %s written\n", a.scene.c_str(), a.destination.c_str(),
              formatSeconds(r.seconds).c_str(), formatBytes(r.bytes_written).c_str());
  if (r.images)
    std::printf("  %s images and %s empty faces in %zu packs of %s together, %s of them new; index %s\n",
                formatCount(r.images->keys - r.images->empty).c_str(), formatCount(r.images->empty).c_str(),
                r.images->pack_names.size(), formatBytes(r.images->pack_bytes).c_str(),
                formatCount(r.images->packs_written).c_str(), formatBytes(r.images->index_bytes).c_str());
  if (r.annotations) std::printf("  %s annotations\n", formatCount(*r.annotations).c_str());
  if (r.page)
    std::printf("  the page that shows it in a browser: index.html and %s more files\n",
                formatCount(r.page->files - 1).c_str());
  if (a.prune) std::printf("  %s objects of earlier versions removed\n", formatCount(r.pruned).c_str());
}

}  // namespace

RunCommand addPublish(CLI::App& command) {
  auto a = std::make_shared<PublishArguments>();
  command.add_option("SCENE", a->scene, "scene directory, built or published")->required();
  command
      .add_option(
          "DEST", a->destination,
          "a directory, made when it is not there, or a bucket: s3://bucket/scene (docs/places.md). Any web server or "
          "CDN that serves these files serves the scene (docs/hosting.md). Objects of an earlier "
          "version stay readable, and unchanged ones are not written again; a run that was stopped goes on")
      ->required();
  command
      .add_option("--pack-size", a->images.pack_bytes,
                  "fill packs of images up to this, 1M to 64M; smaller ones make a change cheaper to publish, larger "
                  "ones make fewer objects")
      ->transform(CLI::AsSizeValue(false))
      ->check(CLI::Range(repository::kMinPackTarget, repository::kMaxPackTarget))
      ->default_str("16M");
  command
      .add_option("--jobs", a->images.jobs,
                  "packs written side by side, 1 to 64; each takes twice its size in memory. More help a distant store")
      ->check(CLI::Range(1U, 64U));
  command.add_flag("--rewrite", a->images.rewrite,
                   "write what is there already too: mends a place where `lumigrid verify` found damage");
  command
      .add_option("--viewer", a->viewer,
                  "on, off: whether to put the browser client's files beside the scene too, so that the place opens in "
                  "a browser; auto: where they are found, and nothing of somebody else's is in their place")
      ->check(CLI::IsMember({"auto", "on", "off"}));
  command.add_option("--web", a->web,
                     "folder with those files; default: ../share/lumigrid/web beside the folder of this program, where "
                     "installing puts them");
  command.add_flag("--prune", a->prune,
                   "when all is done remove what earlier versions had and this one has not; viewers and servers that "
                   "still read those lose them");
  command.add_flag("--with-textures", a->with_textures,
                   "publish the source's textures too, for servers that draw frames from the copy; viewers need none");
  command.add_flag("--json", a->json, "summary as JSON");
  command.add_flag("--quiet", a->quiet, "no progress and no summary");
  return [a]() -> int {
    stopOnSignals();
    ignoreBrokenPipes();
    auto report = publish(*a);
    if (!report) return fail(report.error());
    print(*a, *report);
    return kDone;
  };
}

}  // namespace server::cli
