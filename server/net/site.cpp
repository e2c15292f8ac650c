#include "server/net/site.h"

#include <utility>

#include "base/byte_range.h"
#include "protocol/welcome.h"
#include "server/net/http_text.h"

namespace server {
namespace {

constexpr const char* kForever = "public, max-age=31536000, immutable";
// Digits of a SHA-256 in hex in a published name (docs/formats/packs.md).
constexpr std::size_t kIdDigits = 32;

std::string escapeHtml(std::string_view text) {
  std::string out;
  for (char c : text) {
    if (c == '<' || c == '>' || c == '&' || c == '"') {
      out += "&#" + std::to_string(static_cast<int>(c)) + ";";
    } else {
      out += c;
    }
  }
  return out;
}

/// Whether the visitor has these bytes already, so that 304 without a body is the answer.
bool isKnown(const HttpRequest& request, const std::string& etag) {
  return !etag.empty() && namesEntityTag(request.if_none_match, etag);
}

const PageForm& chooseForm(const PageFile& file, std::string_view accept_encoding) {
  if (!file.brotli.etag.empty() && acceptsCoding(accept_encoding, "br")) return file.brotli;
  if (!file.gzip.etag.empty() && acceptsCoding(accept_encoding, "gzip")) return file.gzip;
  return file.plain;
}

HttpReply pageReply(const HttpRequest& request, const PageFile& file) {
  const PageForm& form = chooseForm(file, request.accept_encoding);
  HttpReply reply{
      .type = file.type,
      .cache = file.immutable ? kForever : "no-cache",
      .headers = {{"ETag", form.etag}, {"Content-Security-Policy", kPagePolicy}, {"Referrer-Policy", "no-referrer"}}};
  if (!file.brotli.etag.empty() || !file.gzip.etag.empty()) reply.headers.emplace_back("Vary", "Accept-Encoding");
  if (isKnown(request, form.etag)) {
    reply.status = 304;
    return reply;
  }
  reply.bytes = form.bytes;
  if (&form == &file.brotli) reply.headers.emplace_back("Content-Encoding", "br");
  if (&form == &file.gzip) reply.headers.emplace_back("Content-Encoding", "gzip");
  return reply;
}

HttpReply jsonReply(const HttpRequest& request, base::ByteView bytes, const std::string& etag) {
  HttpReply reply{.type = "application/json", .headers = {{"ETag", etag}}};
  if (isKnown(request, etag))
    reply.status = 304;
  else
    reply.bytes = bytes;
  return reply;
}

}  // namespace

std::string shownHost(std::string_view host, const std::string& place) {
  const bool plain = !host.empty() && host.size() < 256 &&
                     host.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-:[]") ==
                         std::string_view::npos;
  return plain ? std::string(host) : place;
}

std::string socketPlace(const HttpRequest& request, const std::string& place) {
  return (request.is_secure ? "wss://" : "ws://") + shownHost(request.host, place);
}

base::ByteView HttpReply::body() const {
  if (!bytes.empty()) return bytes;
  if (!owned.empty()) return owned;
  return base::viewOfText(text);
}

HttpReply textReply(int status, std::string text, HttpHeaders headers) {
  return {.status = status, .text = std::move(text), .headers = std::move(headers)};
}

HttpReply badRequest(const base::Error& error) {
  return textReply(400, error.message + "\n");
}

HttpReply withoutPatchesReply() {
  return textReply(
      501,
      "this scene has no patches, which this needs; build them too (lumigrid build --methods patch), which "
      "needs a mesh\n");
}

HttpReply preflightReply() {
  return {.status = 204,
          .headers = {{"Access-Control-Allow-Methods", "GET, HEAD"},
                      {"Access-Control-Allow-Headers", "Authorization, Range, If-Range, If-None-Match"},
                      {"Access-Control-Max-Age", "86400"}}};
}

HttpReply methodNotAllowedReply() {
  return textReply(405, "only GET and HEAD\n", {{"Allow", "GET, HEAD, OPTIONS"}});
}

HttpReply tryLater(int seconds, std::string text) {
  return textReply(503, std::move(text), {{"Retry-After", std::to_string(seconds)}});
}

// ---- The site

Site::Site(OpenScene& scene, PageFiles pages)
    : scene_(scene),
      pages_(std::move(pages)),
      annotations_(annotationsOf(scene.annotations_json)),
      scene_etag_(entityTag(scene.scene_json)) {
  if (scene.patch_file != nullptr) addSceneFile("patch", ".lgp", *scene.patch_file, scene.patch_file->size());
  for (const StreamedFile& file : scene.streamed)
    addSceneFile(file.method.name, file.method.extension, *file.source, file.bytes);
  if (scene.directory.empty()) return;
  stamps_.scene = stampOf(scene.directory + "/scene.json", std::nullopt);
  takeUp(readChanges(scene.directory, stamps_));
}

void Site::takeUp(ChangedDocuments changed) {
  stamps_ = changed.stamps;
  if (changed.annotations) annotations_ = std::move(*changed.annotations);
  if (!changed.scene || !isSameBuild(changed.scene->scene, scene_.scene)) return;
  takeUpAppearance(changed.scene->scene);
  scene_.scene_json = std::move(changed.scene->bytes);
  scene_etag_ = std::move(changed.scene->etag);
}

void Site::takeUpAppearance(const base::Scene& changed) {
  // Other threads read the scene meanwhile, but not these members.
  base::Scene& scene = scene_.scene;
  scene.up = changed.up;
  scene.units = changed.units;
  scene.title = changed.title;
  scene.start_direction = changed.start_direction;
  scene.start_view = changed.start_view;
  scene.hull = changed.hull;
  scene.north = changed.north;
  scene.crs = changed.crs;
  scene.attribution = changed.attribution;
  scene.background = changed.background;
  scene.images_light = changed.images_light;
  const bool is_relit = changed.light != scene.light;
  scene.light = changed.light;

  // The rest of the Welcome tells of files that are open here.
  protocol::Welcome shown = protocol::welcomeOf(scene, scene_.name);
  const protocol::Welcome& open = scene_.data.welcome;
  shown.has_colors = open.has_colors;
  shown.lattice_origin = open.lattice_origin;
  shown.lattice_step = open.lattice_step;
  shown.group_count = open.group_count;
  shown.patch_count = open.patch_count;
  shown.source_triangles = open.source_triangles;
  shown.grid = open.grid;
  shown.can_render_frames = open.can_render_frames;
  scene_.data.welcome = std::move(shown);
  if (is_relit && take_up_light_) take_up_light_(scene.light);
}

/// Its names and tag are those that scene.json has.
void Site::addSceneFile(const std::string& stem, const std::string& extension, const repository::ObjectSource& source,
                        std::uint64_t bytes) {
  const std::string name = base::partFile(scene_.scene, stem, extension).value_or(stem + extension);
  SceneFile file{"/" + stem + extension, "/" + name, "", &source, bytes};
  for (const base::ScenePart& listed : scene_.scene.parts)
    if (listed.file == name && listed.sha256.size() > kIdDigits)
      file.etag = '"' + listed.sha256.substr(0, kIdDigits) + '"';
  files_.push_back(std::move(file));
}

const Site::SceneFile* Site::findSceneFile(std::string_view path) const {
  for (const SceneFile& file : files_)
    if (path == file.plain || path == file.path) return &file;
  return nullptr;
}

bool Site::hasFile(std::string_view path) const {
  if (path == "/scene.json" || path == "/annotations.json" || path == "/patch.lgp" || findSceneFile(path) != nullptr)
    return true;
  return path.starts_with('/') && pages_.find(path.substr(1)) != pages_.end();
}

HttpReply Site::answer(const HttpRequest& request, const std::string& place) const {
  if (request.method == "OPTIONS") return preflightReply();
  if (request.method != "GET" && request.method != "HEAD") return methodNotAllowedReply();
  const std::string_view path = request.path();
  if (path == "/healthz") return textReply(200, "ok");
  if (path == "/") return homeReply(request, place);
  if (path == "/scene.json") return sceneReply(request);
  if (path == "/annotations.json") return annotationsReply(request);
  if (const SceneFile* file = findSceneFile(path)) return sceneFileReply(request, *file);
  if (path == "/patch.lgp") return withoutPatchesReply();
  // The page's files are looked up in memory, never on the disk, so that no path can lead elsewhere.
  if (path.starts_with('/'))
    if (const auto page = pages_.find(path.substr(1)); page != pages_.end()) return pageReply(request, page->second);
  return textReply(404,
                   "not here; there are /, /scene.json, /patch.lgp, /qsplat.lgq, /pmr.lgm and /hlod.lgh (if built), "
                   "/annotations.json, /render, /pick, /healthz and the WebSocket at /\n");
}

/// For a scene without patches the page is redirected to ?method=qsplat, pmr or hlod, so that it loads that program at
/// once.
HttpReply Site::homeReply(const HttpRequest& request, const std::string& place) const {
  const auto page = pages_.find("index.html");
  if (page == pages_.end()) return plainHomeReply(request, place);
  const std::string_view query = request.target.substr(request.path().size());
  const bool has_choice = query.find("method=") != query.npos || query.find("scene=") != query.npos;
  if (scene_.streamed.empty() || scene_.data.patches != nullptr || has_choice) return pageReply(request, page->second);
  const std::string choice = std::string("method=") + scene_.streamed.front().method.name;
  return textReply(302, "see ?" + choice + "\n",
                   {{"Location", query.size() > 1 ? std::string(query) + "&" + choice : "?" + choice}});
}

HttpReply Site::plainHomeReply(const HttpRequest& request, const std::string& place) const {
  const std::string name = escapeHtml(scene_.data.welcome.scene_name);
  const std::string size = scene_.data.patches != nullptr
                               ? std::to_string(scene_.data.welcome.source_triangles) + " triangles"
                               : std::string("There are ") + protocol::contentOf(scene_.data.instead) + " only";
  const std::string& attribution = scene_.data.welcome.attribution;
  const std::string credit = attribution.empty() ? "" : "<p>" + escapeHtml(attribution) + "</p>\n";
  HttpReply reply = textReply(
      200, "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>" + name + " - Lumigrid</title>\n<h1>" +
               name + "</h1>\n" + credit + "<p>" + size + ". Look at it with</p>\n<pre>lumigrid-view " +
               socketPlace(request, place) +
               "/</pre>\n<p>To look at it here, in the browser, the server needs the page's files: build the preset "
               "<code>web</code> and start <code>lumigrid serve</code> with <code>--web DIR</code> "
               "(docs/hosting.md).</p>\n</html>\n");
  reply.type = "text/html; charset=utf-8";
  return reply;
}

HttpReply Site::sceneReply(const HttpRequest& request) const {
  HttpReply reply = jsonReply(request, {}, scene_etag_);
  // A copy, as the file may change while it is sent.
  if (reply.status == 200) reply.text.assign(scene_.scene_json.begin(), scene_.scene_json.end());
  return reply;
}

HttpReply Site::annotationsReply(const HttpRequest& request) const {
  HttpReply reply = jsonReply(request, {}, annotations_.etag);
  if (reply.status == 200) reply.text = annotations_.text;  // a copy, as the file may change while it is sent
  return reply;
}

HttpReply Site::sceneFileReply(const HttpRequest& request, const SceneFile& file) {
  HttpReply reply{.type = "application/octet-stream", .headers = {{"Accept-Ranges", "bytes"}}};
  if (base::isPublishedName(std::string(request.path()))) reply.cache = kForever;
  if (!file.etag.empty()) reply.headers.emplace_back("ETag", file.etag);
  if (isKnown(request, file.etag)) {
    reply.status = 304;
    return reply;
  }
  // A range of a changed file would be useless to the visitor, who gets the whole file then (RFC 9110, section 13.1.5).
  const bool same = request.if_range.empty() || (!file.etag.empty() && request.if_range == file.etag);
  const base::RangeRequest range = base::parseRange(same ? request.range : std::string_view(), file.size);
  if (range.kind != base::RangeRequest::Kind::kWhole)
    reply.headers.emplace_back("Content-Range", base::formatContentRange(range, file.size));
  if (range.kind == base::RangeRequest::Kind::kUnsatisfiable)
    reply.status = 416;
  else
    reply.file = {file.source, file.path.substr(1), range.first, range.length};
  if (range.kind == base::RangeRequest::Kind::kPart) reply.status = 206;
  return reply;
}

}  // namespace server
