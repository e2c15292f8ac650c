// Requests of visitors: lines are a method, a target and the header fields that a site reads, with any bytes in them.
// Whatever is asked, the answer is one of HTTP's, keeps within the file, and has no header that a visitor could split.
#include <filesystem>

#include "base/byte_range.h"
#include "base/check.h"
#include "server/net/http_text.h"
#include "server/scene/open_scene.h"
#include "server/net/page_files.h"
#include "server/net/site.h"
#include "tests/fuzz/fuzz.h"
#include "tests/server/net/served_scene.h"

namespace fuzz {
namespace {

/// A site with a page of two files beside its scene.
struct TestSite {
  TestSite() {
    auto opened = server::openScene(directory.path);
    LUMIGRID_CHECK(bool(opened));
    scene = std::move(*opened);
    page = directory.path + "/page";
    std::filesystem::create_directories(page);
    for (const char* name : {"index.html", "index.html.gz", "lumigrid-0123abcd.js"})
      LUMIGRID_CHECK(bool(base::writeFileAtomically(page + "/" + name, base::viewOfText("<title>page</title>"))));
    auto files = server::readPageFiles(page);
    LUMIGRID_CHECK(bool(files));
    site = std::make_unique<server::Site>(*scene, std::move(*files));
  }

  server::SceneDirectory directory{0};
  std::string page;
  std::unique_ptr<server::OpenScene> scene;
  std::unique_ptr<server::Site> site;
};

server::Site& site() {
  static TestSite made;
  return *made.site;
}

std::string_view nextField(std::string_view& text) {
  const std::size_t end = text.find('\n');
  const std::string_view field = text.substr(0, end);
  text.remove_prefix(end == text.npos ? text.size() : end + 1);
  return field;
}

void checkReply(const server::HttpReply& reply, const server::HttpRequest& request) {
  LUMIGRID_CHECK(reply.status >= 200 && reply.status < 600);
  for (const auto& [name, value] : reply.headers) LUMIGRID_CHECK(value.find_first_of("\r\n") == value.npos);
  LUMIGRID_CHECK(reply.type.find_first_of("\r\n") == std::string::npos);
  if (reply.status == 304 || reply.status == 416) LUMIGRID_CHECK(reply.body().empty());
  if (reply.status == 206) LUMIGRID_CHECK(!request.range.empty());
}

void checkRange(std::string_view header) {
  for (const std::uint64_t size : {std::uint64_t{0}, std::uint64_t{1}, std::uint64_t{1000}, ~std::uint64_t{0}}) {
    const base::RangeRequest range = base::parseRange(header, size);
    if (range.kind == base::RangeRequest::Kind::kUnsatisfiable) continue;
    LUMIGRID_CHECK(range.first <= size && range.length <= size - range.first);
    (void)base::formatContentRange(range, size);
  }
}

base::Bytes request(const std::string& text) {
  return {text.begin(), text.end()};
}

}  // namespace

std::vector<base::Bytes> seeds() {
  return {request("GET\n/?scene=https://elsewhere/tower\nlocalhost:8080\n\n\n\ngzip, br;q=0.5"),
          request("GET\n/patch.lgp\nlocalhost\nbytes=10-99\n\"abc\"\n\n"),
          request("GET\n/patch.lgp\n[::1]:80\nbytes=-500,1-2\n\nW/\"x\", *\n"),
          request("HEAD\n/scene.json\nhost\n\n\n\"0123456789abcdef0123456789abcdef\"\n"),
          request("GET\n/lumigrid-0123abcd.js?v=%2e%2e/%00\na.b\n\n\n\n*;q=0"),
          request("GET\n/../../etc/passwd\n<script>\n\n\n\n"),
          request("GET\n/annotations.json\n\nbytes=0-\n\n\n"),
          request("OPTIONS\n*\n\n\n\n\n"),
          request("POST\n/healthz\n\n\n\n\n")};
}

void fuzzOne(base::ByteView bytes) {
  std::string_view rest = base::textOf(bytes);
  server::HttpRequest request;
  for (std::string_view* field : {&request.method, &request.target, &request.host, &request.range, &request.if_range,
                                  &request.if_none_match, &request.accept_encoding})
    *field = nextField(rest);
  checkReply(site().answer(request, "127.0.0.1:80"), request);
  checkRange(request.range);
  const std::string host = server::shownHost(request.host, "127.0.0.1:80");
  LUMIGRID_CHECK(host.find_first_of("<>\"\r\n ") == std::string::npos);
}

}  // namespace fuzz
