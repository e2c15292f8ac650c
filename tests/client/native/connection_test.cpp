#include "client/native/connection.h"

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <functional>

#include "client/native/headless.h"
#include "tests/server/net/served_scene.h"

namespace client {
namespace {

using server::RunningServer;
using server::SceneDirectory;

std::string urlOf(std::uint16_t port) {
  return "ws://127.0.0.1:" + std::to_string(port) + "/";
}
ServerUrl parsed(std::uint16_t port) {
  return *parseServerUrl(urlOf(port));
}

/// Pumps until the condition holds; returns false after a long while.
bool pumpUntil(Connection& connection, Session& session, const std::function<bool()>& condition) {
  for (int i = 0; i < 3000; ++i) {
    connection.pump(session);
    if (condition()) return true;
    connection.waitForArrival(0.01);
  }
  return false;
}

base::ViewCamera viewOf(const Session& session, double height) {
  base::ViewCamera camera = server::viewOf(*session.welcome(), 1).camera;
  camera.position.z += height;
  return camera;
}

/// Accepts connections into its queue and never answers.
struct SilentListener {
  SilentListener() {
    fd = ::socket(AF_INET, SOCK_STREAM, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof(address);
    LUMIGRID_CHECK(::bind(fd, reinterpret_cast<sockaddr*>(&address), size) == 0);
    LUMIGRID_CHECK(::listen(fd, 8) == 0);
    LUMIGRID_CHECK(::getsockname(fd, reinterpret_cast<sockaddr*>(&address), &size) == 0);
    port = ntohs(address.sin_port);
  }
  ~SilentListener() { ::close(fd); }
  int fd = -1;
  std::uint16_t port = 0;
};

struct UrlRow {
  const char* text;
  const char* host;
  const char* port;
  const char* target;
};

TEST(ServerUrl, isReadInItsUsualSpellings) {
  const UrlRow rows[] = {{"ws://example.org:9000/a?b=c", "example.org", "9000", "/a?b=c"},
                         {"http://example.org:9000/", "example.org", "9000", "/"},
                         {"http://example.org", "example.org", "8080", "/"},
                         {"localhost:81", "localhost", "81", "/"},
                         {"localhost", "localhost", "8080", "/"},
                         {"ws://[::1]:8081/x", "::1", "8081", "/x"},
                         {"ws://[::1]", "::1", "8080", "/"},
                         {"wss://example.org", "example.org", "443", "/"},
                         {"https://example.org:8443/a", "example.org", "8443", "/a"}};
  for (const UrlRow& row : rows) {
    auto url = parseServerUrl(row.text);
    ASSERT_TRUE(bool(url)) << row.text;
    EXPECT_EQ(url->host, row.host) << row.text;
    EXPECT_EQ(url->port, row.port) << row.text;
    EXPECT_EQ(url->target, row.target) << row.text;
  }
  EXPECT_EQ(parseServerUrl("ws://[::1]:8081/")->authority(), "[::1]:8081");
}

TEST(ServerUrl, refusesMalformedAddressesInOneLine) {
  for (const char* bad : {"", "ws://", "ftp://a", "ws://a:0", "ws://a:65536", "ws://a:x", "ws://a:", "ws://[::1",
                          "ws://[::1]x", "ws://a b", "ws://a/ b", "ws://u@a", "ws://a\r\nHost: b"}) {
    auto url = parseServerUrl(bad);
    ASSERT_FALSE(bool(url)) << bad;
  }
}

TEST(Connection, aViewOverARealSocketIsCompleted) {
  const SceneDirectory scene;
  const RunningServer server(scene.path);
  Session session({});
  Connection connection(parsed(server.port()));
  ASSERT_TRUE(pumpUntil(connection, session, [&] { return session.phase() == SessionPhase::kReady; }));
  session.setView(viewOf(session, 0.0));
  ASSERT_TRUE(pumpUntil(connection, session, [&] { return session.complete(); })) << session.problem();
  EXPECT_TRUE(session.hasGroup(0));
  EXPECT_GT(session.stats().faces_received, 0U);
}

TEST(Connection, nobodyThereIsSaidInPlainWords) {
  std::uint16_t free_port = 0;
  { free_port = SilentListener().port; }
  Session session({});
  Connection connection(parsed(free_port));
  ASSERT_TRUE(pumpUntil(connection, session, [&] { return !session.problem().empty(); }));
  EXPECT_NE(session.problem().find("cannot reach 127.0.0.1:" + std::to_string(free_port)), std::string::npos)
      << session.problem();
  EXPECT_EQ(session.phase(), SessionPhase::kDisconnected);
}

TEST(Connection, aServerThatStopsAndComesBackIsFoundAgainAndToldWhatIsHere) {
  const SceneDirectory scene;
  Session session({});
  std::unique_ptr<Connection> connection;
  std::uint16_t port = 0;
  {
    const RunningServer first(scene.path);
    port = first.port();
    connection = std::make_unique<Connection>(parsed(port));
    ASSERT_TRUE(pumpUntil(*connection, session, [&] { return session.phase() == SessionPhase::kReady; }));
    session.setView(viewOf(session, 0.0));
    ASSERT_TRUE(pumpUntil(*connection, session, [&] { return session.complete(); }));
  }
  ASSERT_TRUE(pumpUntil(*connection, session, [&] { return session.phase() == SessionPhase::kDisconnected; }));
  EXPECT_FALSE(session.problem().empty());
  EXPECT_TRUE(session.hasGroup(0)) << "what came stays";
  const SessionStats before = session.stats();

  server::ServerOptions options = RunningServer::quiet();
  options.port = port;
  auto second = server::Server::open({scene.path}, options);
  ASSERT_TRUE(bool(second)) << second.error().message;
  std::thread runs([&] { (void)(*second)->run(false); });
  EXPECT_TRUE(pumpUntil(*connection, session, [&] { return session.complete(); })) << session.problem();
  EXPECT_EQ(session.stats().groups_received, before.groups_received) << "nothing that is here is sent again";
  (*second)->stop();
  runs.join();
}

TEST(Connection, anEmulatedLinkHandsOverNoMoreThanItsRateAllows) {
  const SceneDirectory scene(20'000);
  const RunningServer server(scene.path);
  Session session({});
  const LinkLimit link{200'000.0, 0.05};
  Connection connection(parsed(server.port()), link);
  const auto start = std::chrono::steady_clock::now();
  ASSERT_TRUE(pumpUntil(connection, session, [&] { return session.phase() == SessionPhase::kReady; }));
  session.setView(viewOf(session, 0.0));
  ASSERT_TRUE(pumpUntil(connection, session, [&] { return session.complete(); }));
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  // A slow machine makes it slower, never faster.
  EXPECT_LE(static_cast<double>(session.stats().bytes_received), link.bytes_per_second * seconds);
  EXPECT_GE(seconds, 2 * link.latency_seconds) << "Welcome, and the answer to the view";
}

TEST(Connection, aSessionThatFindsFaultEndsTheConnection) {
  const SceneDirectory scene;
  const RunningServer server(scene.path);
  Session session({});
  Connection connection(parsed(server.port()));
  ASSERT_TRUE(pumpUntil(connection, session, [&] { return session.phase() == SessionPhase::kReady; }));
  session.setView(viewOf(session, 0.0));
  connection.pump(session);

  // The session is made to believe that it got no Welcome, and takes the data that follow for a fault of the server.
  session.connected();
  (void)session.nextToSend();
  ASSERT_TRUE(pumpUntil(connection, session, [&] { return session.phase() == SessionPhase::kDisconnected; }));
  EXPECT_NE(session.problem().find("before its Welcome"), std::string::npos) << session.problem();
  EXPECT_TRUE(pumpUntil(connection, session, [&] { return session.phase() == SessionPhase::kReady; }))
      << "a new connection is tried after a while";
}

TEST(Headless, aServerThatNeverAnswersIsGivenUp) {
  const SilentListener silent;
  HeadlessOptions options;
  options.url = urlOf(silent.port);
  options.path.resize(1);
  options.connect_timeout = 0.2;
  auto run = runHeadless(options);
  ASSERT_FALSE(bool(run));
  EXPECT_EQ(run.error().code, base::ErrorCode::kNetwork) << run.error().message;
}

}  // namespace
}  // namespace client
