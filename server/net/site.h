#pragma once
// What one server answers over plain HTTP at once, from memory: the page, the scene's files, small texts
// (docs/formats/http.md). It does not know the socket; who answers later (/render, /pick) is told apart by `find`.
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "server/net/annotations.h"
#include "server/net/open_scene.h"
#include "server/net/page_files.h"

namespace server {

/// What is looked at of a request; fields that are absent are empty.
struct HttpRequest {
  std::string_view method, target, host, range, if_range, if_none_match, accept_encoding;
  std::string_view path() const { return target.substr(0, target.find('?')); }
};

/// A body that lies behind a network and is read piece by piece while it is sent.
struct FarBody {
  const repository::ObjectSource* source = nullptr;
  std::string name;
  std::uint64_t offset = 0;
  std::uint64_t length = 0;  ///< 0: there is none
};

struct HttpReply {
  int status = 200;
  std::string type = "text/plain; charset=utf-8";
  const char* cache = "no-cache";
  std::string text;      ///< the body, unless one of the next two has bytes
  base::ByteView bytes;  ///< that live with the site
  base::Bytes owned;
  FarBody far;                                               ///< of some length: then this is the body
  bool has_length = true;                                    ///< false: a HEAD that does not say how long the body were
  std::vector<std::pair<std::string, std::string>> headers;  ///< besides type and cache

  base::ByteView body() const;
};

HttpReply textReply(int status, std::string text);
/// 400 and the error's line.
HttpReply badRequest(const base::Error& error);
/// What a scene of splats alone answers to who asks for more.
HttpReply splatsOnlyReply();
/// 503: the visitor may ask again in so many seconds.
HttpReply tryLater(int seconds, std::string text);

/// The Host header as the visitor typed it, or our own place (address:port) when it is none that could be shown.
std::string shownHost(std::string_view host, const std::string& place);

class Site {
 public:
  /// `scene` outlives this. `pages`: empty for none.
  Site(const OpenScene& scene, PageFiles pages);

  /// `place`: address:port, shown where the Host header is none that can be.
  HttpReply answer(const HttpRequest& request, const std::string& place);

 private:
  HttpReply home(const HttpRequest& request, const std::string& place) const;
  HttpReply plainHome(const HttpRequest& request, const std::string& place) const;
  HttpReply annotations(const HttpRequest& request);
  /// A file of the scene that is answered by byte ranges.
  struct Part {
    std::string plain;                                 ///< "/patch.lgp"
    std::string path;                                  ///< the same, or with the name that scene.json has for it
    std::string etag;                                  ///< empty where scene.json has no SHA-256
    base::ByteView bytes;                              ///< here, or else
    const repository::ObjectSource* source = nullptr;  ///< read from there
    std::uint64_t size = 0;
  };
  Part partNamed(const std::string& stem, const std::string& extension) const;
  void addParts();
  const Part* findPart(std::string_view path) const;
  static HttpReply part(const HttpRequest& request, const Part& part);

  const OpenScene& scene_;
  const PageFiles pages_;
  Annotations annotations_;
  std::string scene_etag_;
  std::vector<Part> parts_;
};

}  // namespace server
