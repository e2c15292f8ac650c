// The viewer and a server that speaks TLS and has private scenes.
#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <functional>
#include <optional>

#include "base/file.h"
#include "client/native/connection.h"
#include "client/native/curl_fetcher.h"
#include "client/native/http_request.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"
#include "tests/support/certificates.h"
#include "tests/support/temporary_directory.h"

namespace client {
namespace {

using server::RunningServer;
using server::SceneDirectory;

constexpr const char* kToken = "token-of-the-only-scene";
constexpr const char* kNames = "IP:127.0.0.1,DNS:localhost";

class PrivateSceneTest : public testing::Test {
 protected:
  void SetUp() override {
    authority_.write(path("ca.pem"));
    issue(kNames);
    ASSERT_TRUE(bool(base::writeFileAtomically(
        path("tokens.json"), base::viewOfText(R"([{"token": "token-of-the-only-scene", "scenes": "all"}])"))));
    std::filesystem::permissions(path("tokens.json"), std::filesystem::perms::owner_read);
    options_.certificate_file = path("server.pem");
    options_.key_file = path("server.key");
    options_.access.token_file = path("tokens.json");
    access_ = {kToken, path("ca.pem")};
  }
  void start() { server_.emplace(scene_.path, options_); }
  std::string path(const std::string& name) const { return directory_ / name; }
  void issue(const std::string& names, long end = 90 * 86400) const {
    authority_.issue(names, -7200, end, path("server.pem"), path("server.key"));
  }
  ServerUrl url(const std::string& host = "127.0.0.1") const {
    return *parseServerUrl("wss://" + host + ":" + std::to_string(server_->port()) + "/");
  }
  std::string place() const { return "https://127.0.0.1:" + std::to_string(server_->port()); }
  static bool pumpUntil(Connection& connection, Session& session, const std::function<bool()>& condition) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(10);
    while (std::chrono::steady_clock::now() < end) {
      connection.pump(session);
      if (condition()) return true;
      connection.waitForArrival(0.01);
    }
    return false;
  }
  /// Connects to a server that lets nobody in; what the viewer is told.
  std::string problemOf(const HostAccess& access, const std::string& host = "127.0.0.1") {
    Session session({});
    Connection connection(url(host), {}, access);
    EXPECT_TRUE(pumpUntil(connection, session, [&] { return !session.problem().empty(); }));
    EXPECT_EQ(session.welcome(), nullptr);
    return session.problem();
  }
  HttpResponse get(const std::string& target, const HostAccess& access) const {
    HttpRequest request;
    request.url = place() + target;
    request.max_bytes = 1 << 20;
    return HttpClient(access).send(request);
  }

  const support::TemporaryDirectory directory_;
  const support::Authority authority_{"test authority"};
  const SceneDirectory scene_;
  server::ServerOptions options_ = RunningServer::quiet();
  HostAccess access_;
  std::optional<RunningServer> server_;
};

TEST_F(PrivateSceneTest, aViewIsCompletedOverTls) {
  start();
  for (const char* host : {"127.0.0.1", "localhost"}) {
    Session session({});
    Connection connection(url(host), {}, access_);
    ASSERT_TRUE(pumpUntil(connection, session, [&] { return session.phase() == SessionPhase::kReady; }))
        << session.problem();
    session.setView(server::viewOf(*session.welcome(), 1).camera);
    ASSERT_TRUE(pumpUntil(connection, session, [&] { return session.complete(); })) << session.problem();
    EXPECT_GT(session.stats().faces_received, 0U);
  }
}

TEST_F(PrivateSceneTest, filesAreReadByRangesOverTls) {
  start();
  const auto file = base::readFile(scene_.path + "/patch.lgp");
  ASSERT_TRUE(bool(file));
  const HttpResponse whole = get("/patch.lgp", access_);
  EXPECT_EQ(whole.head.status, 200) << whole.problem;
  EXPECT_TRUE(whole.body == *file);
  CurlFetcher fetcher(place(), {}, access_);
  fetcher.submit(1, "patch.lgp", 100, 200);
  fetcher.wait(10.0);
  const std::vector<FetchAnswer> answers = fetcher.takeAnswers();
  ASSERT_EQ(answers.size(), 1U);
  EXPECT_EQ(answers[0].outcome, FetchOutcome::kBytes) << answers[0].detail;
  EXPECT_TRUE(answers[0].bytes == base::Bytes(file->begin() + 100, file->begin() + 300));
}

TEST_F(PrivateSceneTest, wrongTokensAreToldInTheServersWords) {
  start();
  EXPECT_NE(problemOf({"", access_.ca_file}).find("401: this is private"), std::string::npos);
  const std::string wrong = problemOf({"token-of-nobody-at-all", access_.ca_file});
  EXPECT_NE(wrong.find("401: this link or token is not valid here"), std::string::npos) << wrong;
  EXPECT_EQ(wrong.find("nobody"), std::string::npos);
  EXPECT_EQ(get("/scene.json", {"", access_.ca_file}).head.status, 401);
}

TEST_F(PrivateSceneTest, anUnknownAuthorityIsRefused) {
  start();
  EXPECT_NE(problemOf({kToken, ""}).find("certificate is refused: unable to get local issuer"), std::string::npos);
  EXPECT_NE(get("/scene.json", {kToken, ""}).problem.find("certificate"), std::string::npos);
}

TEST_F(PrivateSceneTest, aCertificateForAnotherNameIsRefused) {
  issue("DNS:elsewhere.example,IP:127.0.0.2");
  start();
  EXPECT_NE(problemOf(access_).find("IP address mismatch"), std::string::npos);
  EXPECT_NE(problemOf(access_, "localhost").find("ostname mismatch"), std::string::npos);
  EXPECT_FALSE(get("/scene.json", access_).problem.empty());
}

TEST_F(PrivateSceneTest, anExpiredCertificateIsRefused) {
  issue(kNames, -3600);
  start();
  EXPECT_NE(problemOf(access_).find("certificate has expired"), std::string::npos);
  EXPECT_NE(get("/scene.json", access_).problem.find("expired"), std::string::npos);
}

TEST_F(PrivateSceneTest, aBadFileOfAuthoritiesIsNamed) {
  start();
  EXPECT_NE(problemOf({kToken, path("tokens.json")}).find(path("tokens.json")), std::string::npos);
}

TEST_F(PrivateSceneTest, aNewCertificateIsForNewConnectionsAndABadOneForNone) {
  start();
  Session session({});
  Connection connection(url(), {}, access_);
  ASSERT_TRUE(pumpUntil(connection, session, [&] { return session.phase() == SessionPhase::kReady; }))
      << session.problem();

  const support::Authority other("another authority");
  other.write(path("other.pem"));
  other.issue(kNames, -7200, 90 * 86400, path("server.pem"), path("server.key"));
  const HostAccess with_other{kToken, path("other.pem")};
  EXPECT_EQ(get("/scene.json", access_).head.status, 200) << "nothing is read before it is asked for";
  server_->reload();
  ASSERT_EQ(get("/scene.json", with_other).head.status, 200);
  EXPECT_EQ(get("/scene.json", access_).head.status, 0);

  ASSERT_TRUE(bool(base::writeFileAtomically(path("server.key"), base::viewOfText("no key\n"))));
  server_->reload();
  EXPECT_EQ(get("/scene.json", with_other).head.status, 200);

  // The viewer goes on meanwhile.
  session.setView(server::viewOf(*session.welcome(), 1).camera);
  ASSERT_TRUE(pumpUntil(connection, session, [&] { return session.complete(); })) << session.problem();
  EXPECT_EQ(session.problem(), "");
}

TEST_F(PrivateSceneTest, plainHttpToATlsPortIsTold) {
  start();
  const std::string answer = server::rawExchange(server_->port(), "GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n");
  EXPECT_TRUE(answer.starts_with("HTTP/1.1 400 ")) << answer;
  EXPECT_TRUE(answer.ends_with("https://\n")) << answer;
  const std::size_t head_end = answer.find("\r\n\r\n");
  ASSERT_NE(head_end, std::string::npos);
  EXPECT_NE(answer.find("Content-Length: " + std::to_string(answer.size() - head_end - 4) + "\r\n"), std::string::npos);
  EXPECT_EQ(server::rawExchange(server_->port(), std::string("\0\1\2\3\4\5\6\7", 8)).find("HTTP"), std::string::npos);
  EXPECT_EQ(get("/scene.json", access_).head.status, 200) << "the server goes on";
}

TEST_F(PrivateSceneTest, theLinksCredentialOpensTheScene) {
  start();
  std::string link = "wss://127.0.0.1:" + std::to_string(server_->port()) + "/?token=" + kToken;
  const HostAccess access{takeCredential(link), access_.ca_file};
  Session session({});
  Connection connection(*parseServerUrl(link), {}, access);
  EXPECT_TRUE(pumpUntil(connection, session, [&] { return session.phase() == SessionPhase::kReady; }))
      << session.problem();
}

}  // namespace
}  // namespace client
