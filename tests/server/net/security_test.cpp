// Private scenes over real sockets: who is let in, who is not, and what is said.
#include "server/net/security.h"

#include <gtest/gtest.h>
#include <spdlog/sinks/ostream_sink.h>
#include <spdlog/spdlog.h>

#include <filesystem>
#include <map>
#include <sstream>

#include "base/file.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"
#include "tests/support/certificates.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/ws_viewer.h"

namespace server {
namespace {

constexpr const char* kAll = "token-of-all-the-scenes";
constexpr const char* kFirst = "token-of-the-first-scene";
constexpr const char* kWrong = "token-of-nobody-at-all";

using Fields = std::map<std::string, std::string>;

Fields bearer(const std::string& token) {
  return {{"Authorization", "Bearer " + token}};
}

Fields upgrade(Fields fields = {}) {
  fields.insert({{"Connection", "Upgrade"},
                 {"Upgrade", "websocket"},
                 {"Sec-WebSocket-Version", "13"},
                 {"Sec-WebSocket-Key", "dGhlIHNhbXBsZSBub25jZQ=="}});
  return fields;
}

// Two private scenes, and the log of their server.
class SecurityTest : public testing::Test {
 protected:
  void SetUp() override {
    write("key", std::string(32, 'k'));
    writeTokens(kAll);
    options_.access.token_file = path("tokens.json");
    options_.access.signing_keys = path("key");
    previous_ = spdlog::default_logger();
    spdlog::set_default_logger(
        std::make_shared<spdlog::logger>("test", std::make_shared<spdlog::sinks::ostream_sink_mt>(log_)));
  }
  void TearDown() override {
    server_.reset();
    spdlog::set_default_logger(previous_);
  }
  std::string path(const std::string& name) const { return directory_ / name; }
  void write(const std::string& name, const std::string& text) const {
    ASSERT_TRUE(bool(base::writeFileAtomically(path(name), base::viewOfText(text))));
    std::filesystem::permissions(path(name), std::filesystem::perms::owner_read);
  }
  void writeTokens(const std::string& of_all) const {
    write("tokens.json", R"([{"token": ")" + of_all + R"(", "scenes": "all"},
      {"token": "token-of-the-first-scene", "scenes": [")" +
                             first_ + "\"]}]");
  }
  void start() { server_.emplace(std::vector<std::string>{first_scene_.path, second_scene_.path}, options_); }
  HttpAnswer get(const std::string& target, const Fields& fields = {}, const std::string& method = "GET") const {
    return httpRequest(server_->port(), target, fields, method);
  }
  std::string linkTo(const std::string& name, std::int64_t seconds) const {
    return signedUrl("/" + name + "/", SigningKeys::read(path("key"))->sign(name, secondsNow() + seconds));
  }
  static std::string cookieOf(const HttpAnswer& answer) {
    const auto cookie = answer.headers.find("set-cookie");
    return cookie == answer.headers.end() ? "" : cookie->second.substr(0, cookie->second.find(';'));
  }

  const support::TemporaryDirectory directory_;
  const SceneDirectory first_scene_{0}, second_scene_{0};
  const std::string first_ = std::filesystem::path(first_scene_.path).filename();
  const std::string second_ = std::filesystem::path(second_scene_.path).filename();
  ServerOptions options_ = RunningServer::quiet();
  std::ostringstream log_;
  std::shared_ptr<spdlog::logger> previous_;
  std::optional<RunningServer> server_;
};

TEST_F(SecurityTest, tokensOpenTheirScenesAndNoOthers) {
  start();
  const std::string first = "/" + first_ + "/scene.json", second = "/" + second_ + "/scene.json";
  EXPECT_EQ(get(first, bearer(kAll)).status, 200);
  EXPECT_EQ(get(second, bearer(kAll)).status, 200);
  EXPECT_EQ(get(first, bearer(kFirst)).status, 200);
  EXPECT_EQ(get(second, bearer(kFirst)).status, 403);
  const HttpAnswer none = get(first);
  EXPECT_EQ(none.status, 401);
  EXPECT_TRUE(none.headers.at("www-authenticate").starts_with("Bearer "));
  EXPECT_NE(none.body.find("private"), std::string::npos);
  EXPECT_EQ(none.headers.at("referrer-policy"), "no-referrer");
  EXPECT_EQ(get(first, bearer(kWrong)).status, 401);
  EXPECT_EQ(get(first, {}, "HEAD").status, 401);
  EXPECT_EQ(get(first, {}, "POST").status, 401);
  EXPECT_EQ(get("/healthz").body, "ok");
  EXPECT_EQ(get("/readyz").status, 200);
  EXPECT_EQ(get("/metrics").status, 401);
  EXPECT_EQ(get("/metrics", bearer(kFirst)).status, 403) << "they tell of the other scene, too";
  const std::string figures = get("/metrics", bearer(kAll)).body;
  for (const char* line : {"lumigrid_refused_total{reason=\"token\"} ", "lumigrid_http_answers_total{status=\"401\"} "})
    EXPECT_NE(figures.find(line), std::string::npos) << figures;
  for (const char* file : {"/patch.lgp", "/annotations.json", "/", "/pick?ox=1", "/render?x=1", "/nothing"})
    EXPECT_EQ(get("/" + first_ + file).status, 401) << file;
}

TEST_F(SecurityTest, whatIsNotThereIsRefusedLikeWhatMayNotBeSeen) {
  start();
  const HttpAnswer absent = get("/nobody/"), there = get("/" + second_ + "/");
  EXPECT_EQ(absent.status, there.status);
  EXPECT_EQ(absent.body, there.body);
  EXPECT_EQ(get("/nobody/", {}, "OPTIONS").status, get("/" + second_ + "/", {}, "OPTIONS").status);
  EXPECT_EQ(get("/nobody/", bearer(kFirst)).status, 403);
  EXPECT_EQ(get("/nobody/", bearer(kAll)).status, 404);
  EXPECT_EQ(get("/" + second_ + "/nothing", bearer(kAll)).status, 404);
}

TEST_F(SecurityTest, theListHasOnlyWhatTheVisitorMaySee) {
  start();
  EXPECT_EQ(get("/").status, 401);
  const HttpAnswer of_all = get("/", bearer(kAll)), of_first = get("/", bearer(kFirst));
  EXPECT_NE(of_all.body.find(second_ + "/"), std::string::npos);
  EXPECT_NE(of_first.body.find(first_ + "/"), std::string::npos);
  EXPECT_EQ(of_first.body.find(second_ + "/"), std::string::npos);
}

TEST_F(SecurityTest, noSharedCacheKeepsPrivateScenes) {
  start();
  for (const char* file : {"/scene.json", "/patch.lgp"})
    EXPECT_TRUE(get("/" + first_ + file, bearer(kAll)).headers.at("cache-control").starts_with("private, ")) << file;
  const HttpAnswer answer = get("/" + first_ + "/scene.json", bearer(kAll));
  EXPECT_EQ(answer.headers.count("access-control-allow-origin"), 0U);
  EXPECT_EQ(answer.headers.at("cross-origin-resource-policy"), "same-origin");
}

TEST_F(SecurityTest, aLinkBecomesACookieAndLeavesTheAddress) {
  start();
  const HttpAnswer moved = get("/" + first_ + "/?method=patches&token=" + std::string(kFirst));
  EXPECT_EQ(moved.status, 303);
  EXPECT_EQ(moved.headers.at("location"), "./?method=patches");
  EXPECT_EQ(moved.headers.at("referrer-policy"), "no-referrer");
  EXPECT_TRUE(moved.headers.at("cache-control").ends_with("no-store"));
  EXPECT_EQ(moved.body.find(kFirst), std::string::npos);
  const Fields cookie{{"Cookie", "theme=dark; " + cookieOf(moved)}};
  EXPECT_EQ(get("/" + first_ + "/scene.json", cookie).status, 200);
  EXPECT_EQ(get("/" + second_ + "/scene.json", cookie).status, 403);

  const std::string link = linkTo(first_, 60);
  const HttpAnswer by_link = get(link);
  EXPECT_EQ(by_link.status, 303);
  EXPECT_NE(by_link.headers.at("set-cookie").find("Max-Age="), std::string::npos);
  const Fields link_cookie{{"Cookie", cookieOf(by_link)}};
  EXPECT_EQ(get("/" + first_ + "/scene.json", link_cookie).status, 200);
  EXPECT_EQ(get("/" + second_ + "/scene.json", link_cookie).status, 401);
  EXPECT_EQ(get("/" + second_ + link.substr(link.find("/?"))).status, 401) << "replayed for another scene";
  EXPECT_EQ(get(linkTo(first_, -1)).status, 401);
  EXPECT_NE(get(linkTo(first_, -1)).body.find("expired"), std::string::npos);
  EXPECT_EQ(get("/" + first_ + "/?token=" + kWrong).status, 401);
}

// A cookie made at "/NAME" would be for "/", all scenes of the host.
TEST_F(SecurityTest, aLinkWithoutItsLastSlashBecomesACookieInTheFolder) {
  start();
  const std::string query = "?method=patches&token=" + std::string(kFirst);
  const HttpAnswer moved = get("/" + first_ + query);
  EXPECT_EQ(moved.status, 303);
  EXPECT_EQ(moved.headers.at("location"), "./" + first_ + "/" + query);
  EXPECT_EQ(moved.headers.count("set-cookie"), 0U);
  EXPECT_TRUE(moved.headers.at("cache-control").ends_with("no-store"));
  EXPECT_EQ(moved.body.find(kFirst), std::string::npos);
  const HttpAnswer there = get("/" + first_ + "/" + query);
  EXPECT_EQ(there.headers.at("location"), "./?method=patches");
  EXPECT_FALSE(cookieOf(there).empty());
  // Scenes that are there and others are not told apart, and what opens nothing is refused at once.
  EXPECT_EQ(get("/nobody?token=" + std::string(kAll)).headers.at("location"), "./nobody/?token=" + std::string(kAll));
  EXPECT_EQ(get("/" + second_ + query).status, 403);
  EXPECT_EQ(get("/" + first_ + "?token=" + kWrong).status, 401);
}

TEST_F(SecurityTest, webSocketsAreOpenedLikeTheRest) {
  start();
  const std::string place = "/" + first_ + "/ws";
  const std::string own = "http://127.0.0.1:" + std::to_string(server_->port());
  EXPECT_EQ(get(place, upgrade()).status, 401);
  EXPECT_EQ(get(place, upgrade(bearer(kWrong))).status, 401);
  EXPECT_EQ(get("/" + second_ + "/ws", upgrade(bearer(kFirst))).status, 403);
  EXPECT_EQ(get(place, upgrade(bearer(kFirst))).status, 101);
  EXPECT_EQ(get(place + "?token=" + kFirst, upgrade()).status, 101);
  Fields cookie{{"Cookie", cookieOf(get(linkTo(first_, 60)))}};
  EXPECT_EQ(get(place, upgrade(cookie)).status, 101);
  cookie["Origin"] = own;
  EXPECT_EQ(get(place, upgrade(cookie)).status, 101);
  cookie["Origin"] = "https://evil.example";
  EXPECT_EQ(get(place, upgrade(cookie)).status, 403) << "another host's page rides on the visitor's cookie";
}

TEST_F(SecurityTest, aViewerIsLetGoWhenItsLinkEnds) {
  start();
  const auto client = LoopbackClient::connect(server_->port(), linkTo(first_, 2));
  ASSERT_NE(client, nullptr);
  while (client->receive()) {
  }
  EXPECT_EQ(client->closeCode(), 1008);
  EXPECT_NE(client->closeReason().find("expired"), std::string::npos);
  EXPECT_EQ(LoopbackClient::connect(server_->port(), linkTo(first_, -1)), nullptr);
}

TEST_F(SecurityTest, aLocalServerIsNotReadByPagesOfTheWeb) {
  options_.access = {};
  start();
  const std::string target = "/" + first_ + "/scene.json", port = std::to_string(server_->port());
  EXPECT_EQ(get(target).status, 200);
  const HttpAnswer foreign = get(target, {{"Origin", "https://evil.example"}});
  EXPECT_EQ(foreign.status, 403);
  EXPECT_EQ(foreign.headers.count("access-control-allow-origin"), 0U);
  EXPECT_EQ(get(target, {{"Origin", "null"}}).status, 403);
  EXPECT_EQ(get("/" + first_ + "/ws", upgrade({{"Origin", "https://evil.example"}})).status, 403);
  EXPECT_EQ(get("/" + first_ + "/ws", upgrade({{"Origin", "http://127.0.0.1:" + port}})).status, 101);
  EXPECT_EQ(get(target, {{"Origin", "https://evil.example"}}, "OPTIONS").status, 403);
  EXPECT_EQ(get(target, {{"Sec-Fetch-Site", "cross-site"}, {"Sec-Fetch-Mode", "no-cors"}}).status, 403);
  const HttpAnswer rebound = get(target, {{"Host", "evil.example:" + port}, {"Origin", "http://evil.example:" + port}});
  EXPECT_EQ(rebound.status, 421);
  EXPECT_NE(rebound.body.find("--host"), std::string::npos);
  EXPECT_EQ(get(target, {{"Host", "localhost:" + port}, {"Origin", "http://localhost:" + port}}).status, 200);
  EXPECT_EQ(get("/metrics", {{"Host", "evil.example"}}).status, 421);
  EXPECT_EQ(get("/metrics", {{"Origin", "https://evil.example"}}).status, 403);
  EXPECT_EQ(get("/metrics").status, 200);
}

TEST_F(SecurityTest, allowedOriginsAndHostsAreLetIn) {
  options_.access.origins = {"https://page.example"};
  options_.access.hosts = {"scenes.example"};
  start();
  const std::string target = "/" + first_ + "/scene.json";
  Fields fields = bearer(kAll);
  fields["Host"] = "scenes.example";
  fields["Origin"] = "https://page.example";
  const HttpAnswer allowed = get(target, fields);
  EXPECT_EQ(allowed.status, 200);
  EXPECT_EQ(allowed.headers.at("access-control-allow-origin"), "https://page.example");
  const HttpAnswer asked = get(target, {{"Origin", "https://page.example"}}, "OPTIONS");
  EXPECT_EQ(asked.status, 204);
  EXPECT_NE(asked.headers.at("access-control-allow-headers").find("Authorization"), std::string::npos);
  fields["Origin"] = "https://scenes.example";
  EXPECT_EQ(get(target, fields).status, 200);
  fields["Origin"] = "https://other.example";
  EXPECT_EQ(get(target, fields).status, 403);
}

TEST_F(SecurityTest, aTrustedProxyTellsWhoAsksAndHow) {
  options_.access.trusted_proxies = {"127.0.0.1"};
  start();
  const std::string link = "/" + first_ + "/?token=" + kFirst;
  EXPECT_NE(get(link, {{"X-Forwarded-Proto", "https"}}).headers.at("set-cookie").find("; Secure"), std::string::npos);
  EXPECT_EQ(get(link, {{"X-Forwarded-Proto", "http"}}).headers.at("set-cookie").find("; Secure"), std::string::npos);
  Fields fields = upgrade(bearer(kFirst));
  fields["X-Forwarded-For"] = "198.51.100.7, 203.0.113.9";
  EXPECT_EQ(get("/" + first_ + "/ws", fields).status, 101);
  server_->stop();
  EXPECT_NE(log_.str().find("peer=203.0.113.9:"), std::string::npos) << log_.str();
}

TEST_F(SecurityTest, connectionsOfAProxyAreCountedForItsClients) {
  options_.access.trusted_proxies = {"127.0.0.1"};
  const std::string target = "/" + first_ + "/scene.json";
  Fields fields = bearer(kAll);
  fields["X-Forwarded-For"] = "203.0.113.9";
  options_.connections_per_address = 1;
  start();
  const auto viewer = LoopbackClient::connect(server_->port(), linkTo(first_, 60));
  ASSERT_NE(viewer, nullptr) << "the proxy itself has no limit";
  EXPECT_EQ(get(target, fields).status, 200);
  EXPECT_EQ(get(target, bearer(kAll)).status, 200);
  server_.reset();
  options_.connections_per_address = 0;
  start();
  EXPECT_EQ(get(target, fields).status, 429);
}

TEST_F(SecurityTest, filesAreReadAgainUnlessTheyAreWrong) {
  start();
  const std::string target = "/" + first_ + "/scene.json";
  const std::string newer = "token-that-came-later-on";
  writeTokens(newer);
  EXPECT_EQ(get(target, bearer(newer)).status, 401);
  server_->reload();
  EXPECT_EQ(get(target, bearer(newer)).status, 200);
  EXPECT_EQ(get(target, bearer(kAll)).status, 401);
  write("tokens.json", "no json");
  server_->reload();
  EXPECT_EQ(get(target, bearer(newer)).status, 200);
  server_->stop();
  EXPECT_NE(log_.str().find("stay as they were: " + path("tokens.json")), std::string::npos) << log_.str();
}

TEST_F(SecurityTest, aPublicAddressNeedsItsOptions) {
  options_.address = "0.0.0.0";
  options_.port = 0;
  const auto refused = Server::open({first_scene_.path}, options_);
  ASSERT_FALSE(bool(refused));
  EXPECT_NE(refused.error().message.find("--public"), std::string::npos);
  options_.access.is_public = true;
  const auto opened = Server::open({first_scene_.path}, options_);
  EXPECT_TRUE(bool(opened));
}

TEST_F(SecurityTest, aCertificateNeedsItsKey) {
  options_.certificate_file = path("certificate.pem");
  const auto refused = Server::open({first_scene_.path}, options_);
  ASSERT_FALSE(bool(refused));
  EXPECT_NE(refused.error().message.find("--key"), std::string::npos);
}

// Places of those who are turned away are few.
TEST_F(SecurityTest, whoIsTurnedAwayHasLessTimeForTheHandshake) {
  const support::Authority authority("authority");
  authority.issue("IP:127.0.0.1", -60, 3600, path("certificate.pem"), path("key.pem"));
  options_.certificate_file = path("certificate.pem");
  options_.key_file = path("key.pem");
  options_.max_connections = 1;
  start();
  const base::FileDescriptor admitted = support::connectTo(server_->port());
  const base::FileDescriptor turned_away = support::connectTo(server_->port());
  char none = 0;
  EXPECT_EQ(::recv(turned_away.get(), &none, 1, 0), 0) << "the server closes it";
  EXPECT_EQ(::recv(admitted.get(), &none, 1, MSG_DONTWAIT), -1) << "closed as early, though it came first";
}

TEST_F(SecurityTest, nothingSecretIsInTheLog) {
  spdlog::set_level(spdlog::level::trace);
  start();
  const std::string link = linkTo(first_, 60);
  const std::string signature = link.substr(link.find("signature=") + 10);
  const std::string place = "/" + first_;
  const Fields cookie{{"Cookie", cookieOf(get(link))}};
  const auto viewer = LoopbackClient::connect(server_->port(), link);
  ASSERT_NE(viewer, nullptr);
  ASSERT_TRUE(viewer->sendBytes({1, 2, 3}));
  while (viewer->receive()) {
  }
  for (const std::string& target :
       {place + "/?token=" + kAll, place + "/?token=" + kWrong, link, place + "/render?" + kAll,
        place + "/pick?token=" + kAll, place + "/ws?token=" + kFirst, linkTo(second_, -1)})
    for (const Fields& fields : {Fields(), cookie, bearer(kAll), bearer(kWrong), upgrade(bearer(kFirst)),
                                 upgrade({{"Origin", "https://evil.example"}})}) {
      const HttpAnswer answer = get(target, fields);
      EXPECT_NE(answer.status, 0) << target;
      for (const char* secret : {kAll, kFirst, kWrong, signature.c_str()})
        EXPECT_EQ(answer.body.find(secret), std::string::npos) << target;
    }
  server_->reload();
  server_->stop();
  spdlog::set_level(spdlog::level::info);
  const std::string log = log_.str();
  EXPECT_NE(log.find("disconnect"), std::string::npos) << "the log is empty";
  for (const std::string& secret : {std::string(kAll), std::string(kFirst), std::string(kWrong), signature,
                                    std::string(32, 'k'), std::string("token="), std::string("signature=")})
    EXPECT_EQ(log.find(secret), std::string::npos) << secret << " in\n" << log;
}

}  // namespace
}  // namespace server
