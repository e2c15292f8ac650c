#include "server/cli/published_page.h"

#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>
#include <string_view>
#include <utility>

#include "base/hash/sha256.h"
#include "repository/objects/open_objects.h"

namespace server::cli {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;
using nlohmann::json;

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
  const base::Sha256Digest digest = base::sha256(bytes);
  return base::hexOf(digest);
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
Result<base::Bytes> rootBesideScene(const base::Bytes& html, bool splats_only) {
  std::string text(html.begin(), html.end());
  LUMIGRID_TRY(setMeta(text, "lumigrid-scene", "scene.json"));
  if (splats_only) LUMIGRID_TRY(setMeta(text, "lumigrid-method", "qsplat"));
  return base::Bytes(text.begin(), text.end());
}

bool isCompressedForm(const std::string& name, const Objects& objects) {
  return (name.ends_with(".gz") || name.ends_with(".br")) && objects.contains(name.substr(0, name.size() - 3));
}

bool isScenes(const std::string& name) {
  return name == "scene.json" || name == "annotations.json" || name == kPageList || name.starts_with("images/") ||
         name.ends_with(".lgp") || name.ends_with(".lgq");
}

/// The files that the last publisher wrote; none where there is no list.
Result<Hashes> readList(repository::ObjectSink& sink, const repository::ObjectSource& source) {
  LUMIGRID_ASSIGN_OR_RETURN(auto size, sink.size(kPageList));
  if (!size) return Hashes();
  const Error bad{ErrorCode::kInvalidInput, source.place() + "/" + kPageList +
                                                ": cannot be read; remove the page's files there and publish again"};
  if (*size > kMaxListBytes) return bad;
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, source.read(kPageList, 0, *size));
  const json list = json::parse(bytes.begin(), bytes.end(), nullptr, false);
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

}  // namespace

Result<PublishedPage> publishPage(const PageFiles& pages, const std::string& place, repository::ObjectSink& sink,
                                  bool splats_only, bool prune) {
  LUMIGRID_ASSIGN_OR_RETURN(auto source, repository::openObjectSource(place));
  LUMIGRID_ASSIGN_OR_RETURN(const auto root, rootBesideScene(pages.at(kRoot).plain.bytes, splats_only));
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

}  // namespace server::cli
