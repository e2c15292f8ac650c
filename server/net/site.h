#pragma once
// The HTTP answers of one scene that are known at once: the page, small texts, and where the bytes of the scene's files
// are to be read (docs/formats/http.md). It knows no sockets. /render and /pick, which are answered later, are not its
// business.
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "server/net/page_files.h"
#include "server/net/scene_documents.h"
#include "server/scene/open_scene.h"

namespace server {

/// The parts of a request that matter here; absent fields are empty.
struct HttpRequest {
  std::string_view method, target, host, range, if_range, if_none_match, accept_encoding;
  bool is_secure = false;  ///< came by TLS
  std::string_view path() const { return target.substr(0, target.find('?')); }
};

/// A body that lies on a disk or behind a network, away from the io thread, and is read range by range while it is
/// sent.
struct FileBody {
  const repository::ObjectSource* source = nullptr;
  std::string name;
  std::uint64_t offset = 0;
  std::uint64_t length = 0;  ///< 0: the reply has no such body
};

using HttpHeaders = std::vector<std::pair<std::string, std::string>>;

struct HttpReply {
  int status = 200;
  std::string type = "text/plain; charset=utf-8";
  const char* cache = "no-cache";
  std::string text = {};      ///< the body, unless `bytes`, `owned` or `file` has one
  base::ByteView bytes = {};  ///< bytes of the site, with which they live
  base::Bytes owned = {};
  FileBody file = {};        ///< part of a file of the scene; length 0: none
  bool has_length = true;    ///< false: a HEAD that does not say how long the body were
  HttpHeaders headers = {};  ///< besides type and cache

  base::ByteView body() const;
};

HttpReply textReply(int status, std::string text, HttpHeaders headers = {});
/// Status 400 with the error's line.
HttpReply badRequest(const base::Error& error);
/// The answer of a scene without patches to requests that need them.
HttpReply withoutPatchesReply();
/// Tells browsers what a page of another host may request (CORS); they may keep the answer for a day.
HttpReply preflightReply();
/// Status 405, with the methods that there are.
HttpReply methodNotAllowedReply();
/// In Retry-After, unless it is known better when to ask again.
inline constexpr int kRetrySeconds = 5;
/// Status 503, which tells the visitor to ask again after `seconds`.
HttpReply tryLater(int seconds, std::string text);

/// The Host header as the visitor typed it, or our own place (address:port) when it is malformed.
std::string shownHost(std::string_view host, const std::string& place);

/// The same with "ws://" or "wss://" before it.
std::string socketPlace(const HttpRequest& request, const std::string& place);

class Site {
 public:
  /// `scene` outlives this. `pages`: empty for none. Reads the documents of a local scene.
  Site(OpenScene& scene, PageFiles pages);

  /// `place`: address:port, shown where the Host header is malformed.
  HttpReply answer(const HttpRequest& request, const std::string& place) const;
  /// Whether a path has a file: of the scene or of the page.
  bool hasFile(std::string_view path) const;
  /// The documents that answers are made from.
  const DocumentStamps& stamps() const { return stamps_; }
  /// Makes answers from what readChanges() found from here on. A scene.json of another build is left alone: it
  /// describes files that are not open here.
  void takeUp(ChangedDocuments changed);
  /// `take_up` is called by takeUp() with a light that differs from the one before.
  void onLightChanged(std::function<void(const base::Light&)> take_up) { take_up_light_ = std::move(take_up); }

 private:
  void takeUpAppearance(const base::Scene& changed);
  HttpReply homeReply(const HttpRequest& request, const std::string& place) const;
  HttpReply plainHomeReply(const HttpRequest& request, const std::string& place) const;
  HttpReply sceneReply(const HttpRequest& request) const;
  HttpReply annotationsReply(const HttpRequest& request) const;
  /// A file of the scene that is answered by byte ranges.
  struct SceneFile {
    std::string plain;                                 ///< "/patch.lgp"
    std::string path;                                  ///< the same, or with the name that scene.json has for it
    std::string etag;                                  ///< empty where scene.json has no SHA-256
    const repository::ObjectSource* source = nullptr;  ///< reads it; outlives the site
    std::uint64_t size = 0;
  };
  void addSceneFile(const std::string& stem, const std::string& extension, const repository::ObjectSource& source,
                    std::uint64_t bytes);
  const SceneFile* findSceneFile(std::string_view path) const;
  static HttpReply sceneFileReply(const HttpRequest& request, const SceneFile& file);

  OpenScene& scene_;
  DocumentStamps stamps_;
  const PageFiles pages_;
  AnnotationsDocument annotations_;
  std::string scene_etag_;
  std::function<void(const base::Light&)> take_up_light_;
  std::vector<SceneFile> files_;
};

}  // namespace server
