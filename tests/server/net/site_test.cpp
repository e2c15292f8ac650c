// Tests the page and the scene's files as a visitor receives them.
#include "server/net/site.h"

#include <gtest/gtest.h>

#include "tests/server/net/loopback.h"
#include "tests/server/net/page_folder.h"
#include "tests/server/net/served_scene.h"

namespace server {
namespace {

ServerOptions withPage(const PageFolder& page) {
  ServerOptions options = RunningServer::quiet();
  options.page_directory = page.path;
  return options;
}

TEST(Site, pageIsServedAtTheRootWithItsHeaders) {
  const SceneDirectory scene(0);
  const PageFolder page;
  RunningServer server(scene.path, withPage(page));
  for (const std::string target : {"/", "/index.html", "/?scene=https://elsewhere/tower"}) {
    const HttpAnswer home = httpRequest(server.port(), target);
    EXPECT_EQ(home.status, 200);
    EXPECT_EQ(home.body, "<!doctype html><title>page</title>");
    EXPECT_EQ(home.headers.at("content-type"), "text/html; charset=utf-8");
    EXPECT_EQ(home.headers.at("cache-control"), "no-cache");
    EXPECT_EQ(home.headers.at("x-content-type-options"), "nosniff");
    EXPECT_EQ(home.headers.at("referrer-policy"), "no-referrer");
    EXPECT_NE(home.headers.at("content-security-policy").find("'wasm-unsafe-eval'"), std::string::npos);
    EXPECT_EQ(home.headers.count("x-frame-options"), 0U);
  }
  // A WebSocket is still upgraded at the same address.
  EXPECT_TRUE(LoopbackClient::connect(server.port(), "/"));
}

TEST(Site, compressedFormsFollowAcceptEncoding) {
  const SceneDirectory scene(0);
  const PageFolder page;
  RunningServer server(scene.path, withPage(page));
  const HttpAnswer brotli = httpRequest(server.port(), "/", {{"Accept-Encoding", "gzip, deflate, br"}});
  EXPECT_EQ(brotli.body, "page as brotli");
  EXPECT_EQ(brotli.headers.at("content-encoding"), "br");
  EXPECT_EQ(brotli.headers.at("vary"), "Accept-Encoding");
  EXPECT_EQ(brotli.headers.at("content-type"), "text/html; charset=utf-8");
  const HttpAnswer gzip = httpRequest(server.port(), "/", {{"Accept-Encoding", "br;q=0, gzip"}});
  EXPECT_EQ(gzip.body, "page as gzip");
  EXPECT_EQ(gzip.headers.at("content-encoding"), "gzip");
  const HttpAnswer plain = httpRequest(server.port(), "/");
  EXPECT_EQ(plain.headers.count("content-encoding"), 0U);
  EXPECT_EQ(plain.headers.at("vary"), "Accept-Encoding");
  // The former has no brotli form, the latter no compressed form at all.
  EXPECT_EQ(httpRequest(server.port(), "/lumigrid-0123abcd.js", {{"Accept-Encoding", "br, gzip"}}).body,
            "program as gzip");
  const HttpAnswer style = httpRequest(server.port(), "/style.css", {{"Accept-Encoding", "br, gzip"}});
  EXPECT_EQ(style.body, "body{}");
  EXPECT_EQ(style.headers.count("vary"), 0U);
}

TEST(Site, onlyHashedNamesAreCachedForever) {
  const SceneDirectory scene(0);
  const PageFolder page;
  RunningServer server(scene.path, withPage(page));
  const HttpAnswer wasm = httpRequest(server.port(), "/lumigrid-0123abcd.wasm");
  EXPECT_EQ(wasm.headers.at("content-type"), "application/wasm");
  EXPECT_EQ(wasm.headers.at("cache-control"), "public, max-age=31536000, immutable");
  EXPECT_EQ(wasm.body, std::string("\0asm", 4));
  const HttpAnswer icon = httpRequest(server.port(), "/icons/32.png");
  EXPECT_EQ(icon.headers.at("content-type"), "image/png");
  EXPECT_EQ(icon.headers.at("cache-control"), "no-cache");
}

TEST(Site, knownBytesAreNotSentAgain) {
  const SceneDirectory scene(0);
  const PageFolder page;
  RunningServer server(scene.path, withPage(page));
  for (const std::string target : {"/", "/style.css", "/lumigrid-0123abcd.js", "/scene.json", "/annotations.json"}) {
    const HttpAnswer first = httpRequest(server.port(), target, {{"Accept-Encoding", "gzip"}});
    const std::string etag = first.headers.at("etag");
    EXPECT_EQ(etag.size(), 34U);
    const HttpAnswer again = httpRequest(server.port(), target, {{"Accept-Encoding", "gzip"}, {"If-None-Match", etag}});
    EXPECT_EQ(again.status, 304) << target;
    EXPECT_EQ(again.body, "");
    EXPECT_EQ(again.headers.at("etag"), etag);
    EXPECT_EQ(httpRequest(server.port(), target, {{"If-None-Match", "\"other\""}}).status, 200);
  }
  // Each form has a tag of its own.
  const std::string plain = httpRequest(server.port(), "/").headers.at("etag");
  EXPECT_EQ(httpRequest(server.port(), "/", {{"Accept-Encoding", "gzip"}, {"If-None-Match", plain}}).status, 200);
}

TEST(Site, howTheSceneIsShownFollowsTheFileWhileItIsServed) {
  const SceneDirectory directory(0);
  RunningServer server(directory.path);
  const auto welcomed = [&] {
    const auto client = LoopbackClient::connect(server.port());
    EXPECT_TRUE(client && client->send(protocol::Hello{protocol::kVersion, "loopback 1"}));
    const auto message = client->receive();
    return message ? std::get<protocol::Welcome>(*message) : protocol::Welcome();
  };
  const protocol::Welcome before = welcomed();
  const std::string etag = httpRequest(server.port(), "/scene.json").headers.at("etag");

  auto scene = base::readScene(directory.path);
  ASSERT_TRUE(scene) << scene.error().message;
  scene->up = {0.0, -1.0, 0.0};
  scene->units = "ft";
  scene->title = "A tower";
  scene->hull = {scene->origin + glm::dvec3(1.0, 2.0, -0.5)};
  scene->north = 90.0;
  scene->attribution = "<b>A. Nonymous</b>";
  scene->background = base::Rgb{1, 2, 3};
  scene->light.mode = base::LightMode::kUnlit;
  const std::string file = directory.path + "/scene.json";
  ASSERT_TRUE(base::writeSceneFile(*scene, file));
  const protocol::Welcome after = welcomed();
  EXPECT_EQ(after.up, glm::vec3(0.0F, -1.0F, 0.0F));
  EXPECT_EQ(after.units, "ft");
  EXPECT_EQ(after.scene_name, "A tower");
  EXPECT_EQ(after.hull, std::vector{glm::vec3(1.0F, 2.0F, -0.5F)});
  EXPECT_LT(glm::length(after.north - glm::vec3(1.0F, 0.0F, 0.0F)), 1e-6F);
  EXPECT_EQ(after.attribution, "<b>A. Nonymous</b>");
  EXPECT_EQ(after.background, (base::Rgb{1, 2, 3}));
  EXPECT_TRUE(!before.unlit && after.unlit);
  EXPECT_EQ(after.box_max, before.box_max);
  EXPECT_EQ(after.lattice_step, before.lattice_step);
  EXPECT_EQ(after.group_count, before.group_count);
  EXPECT_EQ(after.source_triangles, before.source_triangles);
  EXPECT_NE(httpRequest(server.port(), "/").body.find("&#60;b&#62;A. Nonymous"), std::string::npos);
  const HttpAnswer served = httpRequest(server.port(), "/scene.json", {{"If-None-Match", etag}});
  EXPECT_EQ(served.status, 200);
  EXPECT_EQ(served.body, base::formatScene(*scene));

  // Neither another build's document nor half a one is taken.
  auto other = *scene;
  other.title = "Another tower";
  other.box_max += 1.0;
  ASSERT_TRUE(base::writeSceneFile(other, file));
  EXPECT_EQ(welcomed().scene_name, "A tower");
  ASSERT_TRUE(base::writeFileAtomically(file, base::viewOfText(base::formatScene(*scene).substr(0, 100))));
  EXPECT_EQ(welcomed().scene_name, "A tower");
  EXPECT_EQ(httpRequest(server.port(), "/scene.json").body, served.body);
  // Nor does it matter that the file is away for a moment.
  std::filesystem::remove(file);
  EXPECT_EQ(welcomed().scene_name, "A tower");
  scene->title = "The tower";
  ASSERT_TRUE(base::writeSceneFile(*scene, file));
  EXPECT_EQ(welcomed().scene_name, "The tower");
}

TEST(Site, headAnswersWithTheHeadersOfGet) {
  const SceneDirectory scene(0);
  const PageFolder page;
  RunningServer server(scene.path, withPage(page));
  const HttpAnswer head = httpRequest(server.port(), "/", {{"Accept-Encoding", "br"}}, "HEAD");
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(head.body, "");
  EXPECT_EQ(head.headers.at("content-length"), "14");
  EXPECT_EQ(head.headers.at("content-encoding"), "br");
}

TEST(Site, nothingOutsideTheFolderIsReached) {
  const SceneDirectory scene(0);
  const PageFolder page;
  page.write(".secret", "hidden");
  std::filesystem::create_symlink("/etc/passwd", page.path + "/link.txt");
  std::filesystem::create_directory_symlink("/etc", page.path + "/linked");
  RunningServer server(scene.path, withPage(page));
  for (const std::string target :
       {"/../scene.json", "/icons/../index.html", "/%2e%2e/index.html", "//index.html", "/index.html/", "/icons",
        "/icons/", "/.secret", "/link.txt", "/linked/passwd", "/index.html.br", "/index.html%00", "index.html", "*"})
    EXPECT_NE(httpRequest(server.port(), target).status, 200) << target;
  // Files are read at start; a later file is not served.
  page.write("late.js", "late");
  EXPECT_EQ(httpRequest(server.port(), "/late.js").status, 404);
}

TEST(Site, plainPageSaysHowToGetThePageFiles) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  const HttpAnswer home = httpRequest(server.port(), "/");
  EXPECT_NE(home.body.find("lumigrid-view ws://"), std::string::npos);
  EXPECT_NE(home.body.find("--web"), std::string::npos);
}

TEST(Site, foldersWithoutAPageAreRefusedAtStart) {
  const SceneDirectory scene(0);
  const auto codeOf = [&](const std::string& directory) {
    ServerOptions options = RunningServer::quiet();
    options.port = 0;
    options.page_directory = directory;
    auto server = Server::open({scene.path}, options);
    EXPECT_FALSE(server);
    EXPECT_NE(server.error().message.find(directory), std::string::npos);
    return server.error().code;
  };
  EXPECT_EQ(codeOf(scene.path), base::ErrorCode::kNotFound);  // no index.html
  EXPECT_EQ(codeOf(scene.path + "/none"), base::ErrorCode::kIo);
  const PageFolder orphan;
  orphan.write("gone.css.br", "x");
  EXPECT_EQ(codeOf(orphan.path), base::ErrorCode::kInvalidInput);
  const PageFolder many;
  for (int i = 0; i < 300; ++i) many.write(std::to_string(i) + ".txt", "");
  EXPECT_EQ(codeOf(many.path), base::ErrorCode::kInvalidInput);
}

TEST(Site, pagesOfOtherHostsMayReadAnOpenScene) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path, RunningServer::open());
  const HttpAnswer asked =
      httpRequest(server.port(), "/patch.lgp",
                  {{"Origin", "https://other"}, {"Access-Control-Request-Headers", "range"}}, "OPTIONS");
  EXPECT_EQ(asked.status, 204);
  EXPECT_EQ(asked.headers.at("access-control-allow-origin"), "*");
  EXPECT_NE(asked.headers.at("access-control-allow-headers").find("Range"), std::string::npos);
  EXPECT_EQ(asked.headers.count("content-length"), 0U);
}

TEST(Site, changedAnnotationsAreServed) {
  const SceneDirectory scene(0);
  const auto write = [&](const std::string& text) {
    ASSERT_TRUE(base::writeFileAtomically(scene.path + "/annotations.json",
                                          {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}));
  };
  RunningServer server(scene.path);
  const HttpAnswer none = httpRequest(server.port(), "/annotations.json");
  EXPECT_EQ(none.status, 200);
  EXPECT_EQ(none.headers.at("content-type"), "application/json");
  EXPECT_EQ(none.body, "{\"version\": 1, \"annotations\": []}\n");

  const std::string notes = R"({"version": 1, "annotations": [{"position": [1, 2, 3], "title": "<b>"}]})";
  write(notes);
  EXPECT_EQ(httpRequest(server.port(), "/annotations.json").body, notes);
  write("{\"version\": 1, \"annotations\": [{\"title\": \"no place\"}]}");
  EXPECT_EQ(httpRequest(server.port(), "/annotations.json").body, none.body);
  write(notes);
  EXPECT_EQ(httpRequest(server.port(), "/annotations.json").body, notes);
  std::filesystem::remove(scene.path + "/annotations.json");
  EXPECT_EQ(httpRequest(server.port(), "/annotations.json").body, none.body);
  write(notes);
  EXPECT_EQ(httpRequest(server.port(), "/annotations.json").body, notes);
  // A file that cannot be read is served as it was.
  std::filesystem::remove(scene.path + "/annotations.json");
  std::filesystem::create_directory(scene.path + "/annotations.json");
  EXPECT_EQ(httpRequest(server.port(), "/annotations.json").body, notes);
}

// A range of a changed file would be mixed with ranges of the old one.
TEST(Site, rangeOfAChangedFileIsAnsweredWithTheWholeFile) {
  const SceneDirectory scene(0);
  auto document = base::readScene(scene.path);
  ASSERT_TRUE(document);
  const auto sha256 = base::sha256OfFile(scene.path + "/patch.lgp");
  ASSERT_TRUE(sha256);
  document->parts.push_back({"patch.lgp", std::filesystem::file_size(scene.path + "/patch.lgp"), *sha256});
  ASSERT_TRUE(base::writeSceneFile(*document, scene.path + "/scene.json"));
  RunningServer server(scene.path);
  const std::string etag = httpRequest(server.port(), "/patch.lgp", {}, "HEAD").headers.at("etag");
  EXPECT_EQ(httpRequest(server.port(), "/patch.lgp", {{"Range", "bytes=0-9"}, {"If-Range", etag}}).status, 206);
  EXPECT_EQ(httpRequest(server.port(), "/patch.lgp", {{"Range", "bytes=0-9"}, {"If-Range", "\"old\""}}).status, 200);
  EXPECT_EQ(httpRequest(server.port(), "/patch.lgp", {{"If-None-Match", etag}}).status, 304);
}

}  // namespace
}  // namespace server
