// The files that viewers stream by ranges, served from this machine and from elsewhere, and scenes that have nothing
// else. A server does not read their contents, so any bytes do.
#include <gtest/gtest.h>
#include <openssl/evp.h>

#include <algorithm>
#include <filesystem>

#include "base/hash/sha256.h"
#include "server/net/site.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/page_folder.h"
#include "tests/server/net/served_scene.h"
#include "tests/support/nginx.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

namespace fs = std::filesystem;

void write(const std::string& path, const std::string& text) {
  ASSERT_TRUE(base::writeFileAtomically(path, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()}));
}

/// A published scene of one streamed file.
class StreamedScene {
 public:
  StreamedScene(const std::string& directory, std::size_t bytes, const base::StreamedMethod& method) {
    fs::create_directories(directory);
    file.resize(bytes);
    for (std::size_t i = 0; i < bytes; ++i) file[i] = static_cast<char>(i * i % 251);
    const std::string hash =
        base::hexOf(base::sha256({reinterpret_cast<const std::uint8_t*>(file.data()), file.size()}));
    name = base::publishedName(method.file(), hash);
    path = directory + "/" + name;
    write(path, file);
    base::Scene scene;
    scene.box_max = glm::dvec3(1.0);
    scene.parts = {{name, bytes, hash}};
    EXPECT_TRUE(base::writeSceneFile(scene, directory + "/scene.json"));
  }
  std::string name, path, file;
};

class StreamedFiles : public ::testing::TestWithParam<base::StreamedMethod> {
 protected:
  /// As the server names it, whatever the scene calls it.
  const std::string target = "/" + GetParam().file();
};
INSTANTIATE_TEST_SUITE_P(Of, StreamedFiles, ::testing::ValuesIn(base::kStreamedMethods),
                         [](const auto& method) { return std::string(method.param.name); });

TEST_P(StreamedFiles, fileIsServedAndPatchesAreRefused) {
  const support::TemporaryDirectory directory;
  const StreamedScene scene(directory / "cloud", 5000, GetParam());
  const PageFolder page;
  ServerOptions options = RunningServer::quiet();
  options.page_directory = page.path;
  const RunningServer server(directory / "cloud", options);

  EXPECT_EQ(httpRequest(server.port(), target).body, scene.file);
  EXPECT_EQ(httpRequest(server.port(), "/" + scene.name, {{"Range", "bytes=1000-1009"}}).body,
            scene.file.substr(1000, 10));
  for (const std::string other :
       {"/patch.lgp", "/render?position=0,0,9&direction=0,0,-1", "/pick?ox=0&oy=0&oz=9&dx=0&dy=0&dz=-1"}) {
    const HttpAnswer answer = httpRequest(server.port(), other);
    EXPECT_EQ(answer.status, 501) << other;
    EXPECT_NE(answer.body.find("no patches"), std::string::npos) << answer.body;
    EXPECT_NE(answer.body.find("--methods patch"), std::string::npos) << answer.body;
    EXPECT_EQ(answer.body.find('\n'), answer.body.size() - 1) << answer.body;
  }
}

// Files are read a megabyte at a time while they are sent, so a cut one is noticed there.
TEST_P(StreamedFiles, downloadsOfAFileThatIsCutEndEarlyOrAreRefused) {
  constexpr std::size_t kBytes = 3'500'000, kLeft = 2'500'000;
  const support::TemporaryDirectory directory;
  const StreamedScene scene(directory / "cloud", kBytes, GetParam());
  const StreamedScene other(directory / "other", kBytes, GetParam());
  const RunningServer server(std::vector<std::string>{directory / "cloud", directory / "other"});
  const HttpAnswer whole = httpRequest(server.port(), "/cloud" + target);
  EXPECT_TRUE(whole.body == scene.file);
  fs::resize_file(scene.path, kLeft);

  const std::string answer = rawExchange(server.port(), "GET /cloud" + target + " HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_NE(answer.find("Content-Length: " + std::to_string(kBytes)), std::string::npos);
  const std::string body = answer.substr(answer.find("\r\n\r\n") + 4);
  EXPECT_GT(body.size(), 1'000'000U);
  EXPECT_LE(body.size(), kLeft);
  EXPECT_TRUE(body == scene.file.substr(0, body.size()));

  const auto range = [&](const std::string& name, const std::string& bytes) {
    return httpRequest(server.port(), "/" + name + target, {{"Range", "bytes=" + bytes}});
  };
  const HttpAnswer gone = range("cloud", "3000000-3000009");
  EXPECT_EQ(gone.status, 503);
  EXPECT_EQ(gone.headers.count("retry-after"), 1U);
  EXPECT_NE(gone.body.find("cannot be read"), std::string::npos) << gone.body;
  const HttpAnswer there = range("cloud", "2000000-2000009");
  EXPECT_EQ(there.status, 206);
  EXPECT_EQ(there.body, scene.file.substr(2'000'000, 10));
  EXPECT_EQ(there.headers.at("etag"), whole.headers.at("etag"));
  EXPECT_TRUE(httpRequest(server.port(), "/other" + target).body == other.file);
  EXPECT_EQ(httpRequest(server.port(), "/healthz").status, 200);
}

// A build that replaces a file leaves those who download the old one alone.
TEST_P(StreamedFiles, aFileThatIsReplacedIsServedAsItWas) {
  const support::TemporaryDirectory directory;
  const StreamedScene scene(directory / "cloud", 5000, GetParam());
  const RunningServer server(directory / "cloud");
  write(scene.path, std::string(5000, 'x'));
  EXPECT_EQ(httpRequest(server.port(), target).body, scene.file);
  fs::remove(scene.path);
  EXPECT_EQ(httpRequest(server.port(), target).body, scene.file);
}

TEST_P(StreamedFiles, pageIsRedirectedToTheMethodsProgram) {
  const support::TemporaryDirectory directory;
  const StreamedScene scene(directory / "cloud", 5000, GetParam());
  const SceneDirectory patches(0);
  const PageFolder page;
  ServerOptions options = RunningServer::quiet();
  options.page_directory = page.path;
  const RunningServer server(std::vector<std::string>{directory / "cloud", patches.path}, options);

  const std::string choice = std::string("method=") + GetParam().name;
  const HttpAnswer moved = httpRequest(server.port(), "/cloud/");
  EXPECT_EQ(moved.status, 302);
  EXPECT_EQ(moved.headers.at("location"), "?" + choice);
  EXPECT_EQ(httpRequest(server.port(), "/cloud/?check").headers.at("location"), "?check&" + choice);
  EXPECT_EQ(httpRequest(server.port(), "/cloud/?method=qsplat").status, 200);
  EXPECT_EQ(httpRequest(server.port(), "/cloud/?scene=https://elsewhere/tower").status, 200);
  const std::string other = "/" + fs::path(patches.path).filename().string() + "/";
  EXPECT_EQ(httpRequest(server.port(), other).status, 200);
}

/// Expects that a viewer of patches is told to show the method.
void expectRefusal(const RunningServer& server, const base::StreamedMethod& method) {
  const auto client = LoopbackClient::connect(server.port());
  ASSERT_TRUE(client);
  ASSERT_TRUE(client->send(protocol::Hello{protocol::kVersion, "test"}));
  const auto message = client->receive();
  ASSERT_TRUE(message && std::holds_alternative<protocol::Refusal>(*message));
  const auto& refusal = std::get<protocol::Refusal>(*message);
  EXPECT_STREQ(protocol::methodOf(refusal.instead), method.name);
  EXPECT_NE(refusal.reason.find(std::string("--method ") + method.name), std::string::npos) << refusal.reason;
  EXPECT_FALSE(client->receive());
}

TEST_P(StreamedFiles, viewersOfOtherMethodsAreRefusedWithAdvice) {
  const support::TemporaryDirectory directory;
  const StreamedScene scene(directory / "cloud", 5000, GetParam());
  expectRefusal(RunningServer(directory / "cloud"), GetParam());
}

/// A server of the scene that nginx serves from path("site/cloud"), with a cache of its own.
class RemoteStreamedFile : public StreamedFiles {
 protected:
  static constexpr std::size_t kBytes = 3'500'000;  // some pieces
  void SetUp() override {
    LUMIGRID_SKIP_WITHOUT_NGINX();
    scene = std::make_unique<StreamedScene>(directory / "site/cloud", kBytes, GetParam());
    nginx = std::make_unique<support::Nginx>(directory / "site");
    ASSERT_TRUE(nginx->running());
    ServerOptions options = RunningServer::quiet();
    options.remote.cache_directory = directory / "cache";
    server = std::make_unique<RunningServer>(nginx->url() + "/cloud", options);
  }
  HttpAnswer request(const std::map<std::string, std::string>& headers = {}, const std::string& method = "GET") const {
    return httpRequest(server->port(), target, headers, method);
  }

  const support::TemporaryDirectory directory;
  std::unique_ptr<StreamedScene> scene;
  std::unique_ptr<support::Nginx> nginx;
  std::unique_ptr<RunningServer> server;
};

INSTANTIATE_TEST_SUITE_P(Of, RemoteStreamedFile, ::testing::ValuesIn(base::kStreamedMethods),
                         [](const auto& method) { return std::string(method.param.name); });

TEST_P(RemoteStreamedFile, wholeFileAndRangesArePassedOn) {
  const HttpAnswer whole = request();
  EXPECT_EQ(whole.status, 200);
  EXPECT_TRUE(whole.body == scene->file);
  EXPECT_EQ(whole.headers.at("accept-ranges"), "bytes");
  for (const auto& [first, last] : {std::pair<std::size_t, std::size_t>{0, 0}, {1000, 70'000}, {100'000, 2'600'000}}) {
    const HttpAnswer part = request({{"Range", "bytes=" + std::to_string(first) + "-" + std::to_string(last)}});
    EXPECT_EQ(part.status, 206);
    EXPECT_TRUE(part.body == scene->file.substr(first, last - first + 1)) << first;
    EXPECT_EQ(part.headers.at("content-range"),
              "bytes " + std::to_string(first) + "-" + std::to_string(last) + "/" + std::to_string(kBytes));
  }
  EXPECT_EQ(request({{"Range", "bytes=4000000-"}}).status, 416);
  const HttpAnswer head = request({}, "HEAD");
  EXPECT_EQ(head.headers.at("content-length"), std::to_string(kBytes));
  EXPECT_EQ(head.body, "");
}

TEST_P(RemoteStreamedFile, tagIsOfTheContent) {
  const std::string etag = request({{"Range", "bytes=0-9"}}).headers.at("etag");
  EXPECT_EQ(etag, "\"" + scene->name.substr(std::string(GetParam().name).size() + 1, 32) + "\"");
  EXPECT_EQ(request({{"If-None-Match", etag}}).status, 304);
  EXPECT_EQ(request({{"Range", "bytes=0-9"}, {"If-Range", etag}}).status, 206);
  EXPECT_EQ(request({{"Range", "bytes=0-9"}, {"If-Range", "\"other\""}}).status, 200);
}

TEST_P(RemoteStreamedFile, readBytesAreCached) {
  const HttpAnswer first = request({{"Range", "bytes=5000-9000"}});
  EXPECT_EQ(first.status, 206);
  nginx->stop();
  EXPECT_EQ(request({{"Range", "bytes=6000-9999"}}).body, scene->file.substr(6000, 4000));
  EXPECT_EQ(request({{"Range", "bytes=5000-9000"}}).body, first.body);
}

TEST_P(RemoteStreamedFile, unreachableOrMissingFileIsAnErrorInOneLine) {
  const auto expectLine = [](const HttpAnswer& answer, int status) {
    EXPECT_EQ(answer.status, status);
    EXPECT_NE(answer.body.find("where the scene lies"), std::string::npos) << answer.body;
    EXPECT_EQ(answer.body.find('\n'), answer.body.size() - 1) << answer.body;
  };
  fs::remove(scene->path);
  expectLine(request({{"Range", "bytes=0-9"}}), 502);
  write(scene->path, scene->file);
  EXPECT_EQ(request({{"Range", "bytes=0-9"}}).status, 206) << "it came back";
  nginx->stop();
  const HttpAnswer away = request({{"Range", "bytes=3000000-3000009"}});
  expectLine(away, 503);
  EXPECT_EQ(away.headers.count("retry-after"), 1U);
}

TEST_P(RemoteStreamedFile, patchesThatWereNotPublishedDoNotCount) {
  base::Scene listed = *base::readScene(directory / "site/cloud");
  listed.parts.push_back({"patch.lgp", 9, ""});
  ASSERT_TRUE(base::writeSceneFile(listed, directory / "site/cloud/scene.json"));
  ServerOptions options = RunningServer::quiet();
  options.remote.cache_directory = directory / "cache";
  expectRefusal(RunningServer(nginx->url() + "/cloud", options), GetParam());
}

// The server cannot invent the rest of the body, so it closes the connection, and the visitor sees a short body.
TEST_P(RemoteStreamedFile, interruptedBodyEndsTheConnection) {
  EXPECT_EQ(request({{"Range", "bytes=0-2000000"}}).body.size(), 2'000'001U);
  nginx->stop();
  const std::string answer = rawExchange(server->port(), "GET " + target + " HTTP/1.1\r\nHost: localhost\r\n\r\n");
  EXPECT_NE(answer.find("Content-Length: " + std::to_string(kBytes)), std::string::npos);
  EXPECT_GT(answer.size(), 1'000'000U);
  EXPECT_LT(answer.size(), kBytes);
}

std::string base64Of(base::ByteView bytes) {
  std::string text(4 * ((bytes.size() + 2) / 3) + 1, '\0');
  const int length =
      EVP_EncodeBlock(reinterpret_cast<unsigned char*>(text.data()), bytes.data(), static_cast<int>(bytes.size()));
  text.resize(static_cast<std::size_t>(length));
  return text;
}

TEST(PagePolicy, allowsTheInlineScriptOfThePage) {
  const auto bytes = base::readFile(LUMIGRID_SOURCE_DIR "/client/web/site/early.js");
  ASSERT_TRUE(bytes);
  const base::Sha256Digest digest = base::sha256(*bytes);
  EXPECT_NE(std::string(kPagePolicy).find("'sha256-" + base64Of(digest) + "'"), std::string::npos)
      << "kPagePolicy and docs/hosting.md must name sha256-" << base64Of(digest);
}

}  // namespace
}  // namespace server
