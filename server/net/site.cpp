#include "server/net/site.h"

#include <algorithm>

#include "base/byte_range.h"
#include "server/net/http_text.h"

namespace server {
namespace {

constexpr const char* kForever = "public, max-age=31536000, immutable";
constexpr std::size_t kIdDigits = 32;  // of a part's SHA-256: as many as its published name has

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

/// 304 without a body when the visitor has these bytes already.
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
  HttpReply reply;
  reply.type = file.type;
  reply.cache = file.immutable ? kForever : "no-cache";
  reply.headers.emplace_back("ETag", form.etag);
  reply.headers.emplace_back("Content-Security-Policy", kPagePolicy);
  reply.headers.emplace_back("Referrer-Policy", "no-referrer");
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

HttpReply document(const HttpRequest& request, base::ByteView bytes, const std::string& etag) {
  HttpReply reply;
  reply.type = "application/json";
  reply.headers.emplace_back("ETag", etag);
  if (isKnown(request, etag))
    reply.status = 304;
  else
    reply.bytes = bytes;
  return reply;
}

/// What a page of another host may ask; answers to such questions are kept for a day.
HttpReply preflight() {
  HttpReply reply;
  reply.status = 204;
  reply.headers.emplace_back("Access-Control-Allow-Methods", "GET, HEAD");
  reply.headers.emplace_back("Access-Control-Allow-Headers", "Range, If-Range, If-None-Match");
  reply.headers.emplace_back("Access-Control-Max-Age", "86400");
  return reply;
}

}  // namespace

std::string shownHost(std::string_view host, const std::string& place) {
  const bool plain = !host.empty() && host.size() < 256 &&
                     host.find_first_not_of("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789.-:[]") ==
                         std::string_view::npos;
  return plain ? std::string(host) : place;
}

base::ByteView HttpReply::body() const {
  if (!bytes.empty()) return bytes;
  if (!owned.empty()) return owned;
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

HttpReply textReply(int status, std::string text) {
  HttpReply reply;
  reply.status = status;
  reply.text = std::move(text);
  return reply;
}

HttpReply badRequest(const base::Error& error) {
  return textReply(400, error.message + "\n");
}

HttpReply splatsOnlyReply() {
  return textReply(501,
                   "this scene has splats alone, and this needs patches; build them too (lumigrid build --methods "
                   "patch,qsplat), which needs a mesh\n");
}

HttpReply tryLater(int seconds, std::string text) {
  HttpReply reply = textReply(503, std::move(text));
  reply.headers.emplace_back("Retry-After", std::to_string(seconds));
  return reply;
}

Site::Site(const OpenScene& scene, PageFiles pages)
    : scene_(scene),
      pages_(std::move(pages)),
      annotations_(scene.directory, scene.annotations_json),
      scene_etag_(entityTag(scene.scene_json)) {
  addParts();
}

void Site::addParts() {
  const auto here = [this](Part part, base::ByteView bytes) {
    part.bytes = bytes;
    part.size = bytes.size();
    parts_.push_back(std::move(part));
  };
  if (scene_.data.patches != nullptr) here(partNamed("patch", ".lgp"), scene_.patch_bytes.bytes());
  Part splats = partNamed("qsplat", ".lgq");
  splats.source = scene_.far_splats.get();
  if (splats.source != nullptr)
    parts_.push_back(std::move(splats));
  else if (!scene_.splat_bytes.bytes().empty())
    here(std::move(splats), scene_.splat_bytes.bytes());
}

/// Size as scene.json says.
Site::Part Site::partNamed(const std::string& stem, const std::string& extension) const {
  const std::string name = base::partFile(scene_.scene, stem, extension).value_or(stem + extension);
  Part part{"/" + stem + extension, "/" + name, "", {}, nullptr, 0};
  for (const base::ScenePart& listed : scene_.scene.parts) {
    if (listed.file != name) continue;
    part.size = listed.bytes;
    if (listed.sha256.size() > kIdDigits) part.etag = '"' + listed.sha256.substr(0, kIdDigits) + '"';
  }
  return part;
}

const Site::Part* Site::findPart(std::string_view path) const {
  for (const Part& part : parts_)
    if (path == part.plain || path == part.path) return &part;
  return nullptr;
}

HttpReply Site::answer(const HttpRequest& request, const std::string& place) {
  if (request.method == "OPTIONS") return preflight();
  if (request.method != "GET" && request.method != "HEAD") {
    HttpReply reply = textReply(405, "only GET and HEAD\n");
    reply.headers.emplace_back("Allow", "GET, HEAD, OPTIONS");
    return reply;
  }
  const std::string_view path = request.path();
  if (path == "/healthz") return textReply(200, "ok");
  if (path == "/") return home(request, place);
  if (path == "/scene.json") return document(request, scene_.scene_json, scene_etag_);
  if (path == "/annotations.json") return annotations(request);
  if (const Part* found = findPart(path)) return part(request, *found);
  if (path == "/patch.lgp") return splatsOnlyReply();
  // Never a look at the disk: a name is in the list, or it is not here.
  if (path.starts_with('/'))
    if (const auto page = pages_.find(path.substr(1)); page != pages_.end()) return pageReply(request, page->second);
  return textReply(404,
                   "not here; there are /, /scene.json, /patch.lgp, /qsplat.lgq (if built), /annotations.json, "
                   "/render, /pick, /healthz and "
                   "the WebSocket at /\n");
}

/// Of splats alone the page is told at once which of its two programs it needs.
HttpReply Site::home(const HttpRequest& request, const std::string& place) const {
  const auto page = pages_.find("index.html");
  if (page == pages_.end()) return plainHome(request, place);
  const std::string_view query = request.target.substr(request.path().size());
  const bool says_what = query.find("method=") != query.npos || query.find("scene=") != query.npos;
  if (scene_.data.patches != nullptr || says_what) return pageReply(request, page->second);
  HttpReply reply = textReply(302, "see ?method=qsplat\n");
  reply.headers.emplace_back("Location", query.size() > 1 ? std::string(query) + "&method=qsplat" : "?method=qsplat");
  return reply;
}

HttpReply Site::plainHome(const HttpRequest& request, const std::string& place) const {
  const std::string name = escapeHtml(scene_.data.welcome.scene_name);
  const std::string size = scene_.data.patches != nullptr
                               ? std::to_string(scene_.data.welcome.source_triangles) + " triangles"
                               : std::string("Splats");
  HttpReply reply = textReply(
      200, "<!doctype html>\n<html lang=\"en\"><meta charset=\"utf-8\"><title>" + name + " - Lumigrid</title>\n<h1>" +
               name + "</h1>\n<p>" + size + ". Look at it with</p>\n<pre>lumigrid-view ws://" +
               shownHost(request.host, place) +
               "/</pre>\n<p>To look at it here, in the browser, the server needs the page's files: build the preset "
               "<code>web</code> and start <code>lumigrid serve</code> with <code>--web DIR</code> "
               "(docs/hosting.md).</p>\n</html>\n");
  reply.type = "text/html; charset=utf-8";
  return reply;
}

HttpReply Site::annotations(const HttpRequest& request) {
  const Annotations::Document& now = annotations_.current();
  HttpReply reply = document(request, {}, now.etag);
  if (reply.status == 200) reply.text = now.text;  // a copy: the file may change while it is sent
  return reply;
}

HttpReply Site::part(const HttpRequest& request, const Part& part) {
  HttpReply reply;
  reply.type = "application/octet-stream";
  if (base::isPublishedName(std::string(request.path()))) reply.cache = kForever;
  reply.headers.emplace_back("Accept-Ranges", "bytes");
  if (!part.etag.empty()) reply.headers.emplace_back("ETag", part.etag);
  if (isKnown(request, part.etag)) {
    reply.status = 304;
    return reply;
  }
  // A range of other bytes than the visitor knows would be of no use: then all of them.
  const bool same = request.if_range.empty() || (!part.etag.empty() && request.if_range == part.etag);
  const base::RangeRequest range = base::parseRange(same ? request.range : std::string_view(), part.size);
  if (range.kind != base::RangeRequest::Kind::kWhole)
    reply.headers.emplace_back("Content-Range", base::formatContentRange(range, part.size));
  if (range.kind == base::RangeRequest::Kind::kUnsatisfiable)
    reply.status = 416;
  else if (part.source != nullptr)
    reply.far = {part.source, part.path.substr(1), range.first, range.length};
  else
    reply.bytes = part.bytes.subspan(range.first, range.length);
  if (range.kind == base::RangeRequest::Kind::kPart) reply.status = 206;
  return reply;
}

}  // namespace server
