#include "server/net/server.h"

#include <gtest/gtest.h>
#include <sys/socket.h>

#include <cerrno>
#include <csignal>
#include <cstring>
#include <thread>

#include "base/file.h"
#include "server/net/hub.h"
#include "tests/server/net/loopback.h"
#include "tests/server/net/page_folder.h"
#include "tests/server/net/served_scene.h"
#include "tests/support/ws_viewer.h"

namespace server {
namespace {

/// Sends Hello and returns the Welcome.
protocol::Welcome greet(LoopbackClient& client) {
  EXPECT_TRUE(client.send(protocol::Hello{protocol::kVersion, "loopback 1"}));
  auto message = client.receive();
  EXPECT_TRUE(message && std::holds_alternative<protocol::Welcome>(*message));
  return message ? std::get<protocol::Welcome>(*message) : protocol::Welcome{};
}

struct ReceivedAnswers {
  int groups = 0, faces = 0;
  bool complete = false;
};

/// Everything up to Completion(sequence) or the end of the connection.
ReceivedAnswers receiveAll(LoopbackClient& client, std::uint32_t sequence) {
  ReceivedAnswers received;
  while (auto message = client.receive()) {
    if (std::holds_alternative<protocol::Refinement>(*message)) ++received.groups;
    if (std::holds_alternative<protocol::Face>(*message)) ++received.faces;
    if (const auto* complete = std::get_if<protocol::Completion>(&*message);
        complete && complete->sequence == sequence) {
      received.complete = true;
      break;
    }
  }
  return received;
}

// ---- WebSocket ----

TEST(Server, viewerIsWelcomedAndServedToCompletion) {
  const SceneDirectory scene;
  RunningServer server(scene.path);
  for (const std::string path : {"/", "/ws", "/ws?from=here"}) {
    auto client = LoopbackClient::connect(server.port(), path);
    ASSERT_TRUE(client) << path;
    const auto welcome = greet(*client);
    EXPECT_EQ(welcome.origin, glm::dvec3(500'000.0, 4'000'000.0, 100.0));
    EXPECT_EQ(welcome.grid.face_size, 64U);
    EXPECT_FALSE(welcome.can_render_frames);
    ASSERT_TRUE(client->send(viewOf(welcome, 1)));
    const ReceivedAnswers received = receiveAll(*client, 1);
    EXPECT_TRUE(received.complete);
    EXPECT_GE(received.groups, 1);
    EXPECT_GE(received.faces, 4);
    client->close();
  }
}

TEST(Server, sceneWithoutImagesIsServed) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  auto client = LoopbackClient::connect(server.port());
  ASSERT_TRUE(client);
  const auto welcome = greet(*client);
  EXPECT_EQ(welcome.grid.pointCount(), 0U);
  ASSERT_TRUE(client->send(viewOf(welcome, 1)));
  const ReceivedAnswers received = receiveAll(*client, 1);
  EXPECT_TRUE(received.complete);
  EXPECT_EQ(received.faces, 0);
}

TEST(Server, anotherVersionIsRefusedAndClosed) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  auto client = LoopbackClient::connect(server.port());
  ASSERT_TRUE(client);
  ASSERT_TRUE(client->send(protocol::Hello{7, "future"}));
  const auto message = client->receive();
  ASSERT_TRUE(message);
  EXPECT_NE(std::get<protocol::Refusal>(*message).reason.find("update the server"), std::string::npos);
  EXPECT_FALSE(client->receive());
  EXPECT_EQ(client->closeCode(), 1008);  // policy error
}

TEST(Server, garbageEndsItsConnectionAndNoOther) {
  const SceneDirectory scene;
  RunningServer server(scene.path);
  auto good = LoopbackClient::connect(server.port());
  ASSERT_TRUE(good);
  const auto welcome = greet(*good);

  auto bad = LoopbackClient::connect(server.port());
  ASSERT_TRUE(bad);
  ASSERT_TRUE(bad->sendBytes({0x42, 0x13, 0x37}));
  const auto refusal = bad->receive();
  ASSERT_TRUE(refusal && std::holds_alternative<protocol::Refusal>(*refusal));
  EXPECT_FALSE(bad->receive());
  EXPECT_EQ(bad->closeCode(), 1008);
  EXPECT_NE(bad->closeReason(), "");

  auto text = LoopbackClient::connect(server.port());
  ASSERT_TRUE(text);
  ASSERT_TRUE(text->sendBytes({'h', 'i'}, false));
  EXPECT_FALSE(text->receive());
  EXPECT_EQ(text->closeCode(), 1003);  // unknown data

  auto large = LoopbackClient::connect(server.port());
  ASSERT_TRUE(large);
  large->sendBytes(base::Bytes(protocol::kMaxClientMessage + 1, 1));
  EXPECT_FALSE(large->receive());

  rawExchange(server.port(), "\x16\x03\x01 this is not HTTP\r\n\r\n");

  ASSERT_TRUE(good->send(viewOf(welcome, 1)));
  EXPECT_TRUE(receiveAll(*good, 1).complete);
}

// The slow client's connection fills up: faces have 300 kB, the receive buffer is small, and nobody reads.
TEST(Server, slowReaderDelaysNobody) {
  const SceneDirectory scene(300'000);
  RunningServer server(scene.path);
  auto slow = LoopbackClient::connect(server.port(), "/", 4096);
  ASSERT_TRUE(slow);
  const auto welcome = greet(*slow);
  ASSERT_TRUE(slow->send(viewOf(welcome, 1)));

  auto quick = LoopbackClient::connect(server.port());
  ASSERT_TRUE(quick);
  ASSERT_TRUE(quick->send(protocol::Hello{}));
  ASSERT_TRUE(quick->send(viewOf(welcome, 1)));
  EXPECT_TRUE(receiveAll(*quick, 1).complete);

  // The slow client receives its messages when it reads at last.
  EXPECT_TRUE(receiveAll(*slow, 1).complete);
}

// Back-pressure keeps the queue short, so a newer view is soon heard of: of the old one's 30 faces only those come that
// were under way.
TEST(Server, newViewOvertakesTheOldOnesBytes) {
  const SceneDirectory scene(300'000);
  RunningServer server(scene.path);
  auto client = LoopbackClient::connect(server.port(), "/", 4096);
  ASSERT_TRUE(client);
  const auto welcome = greet(*client);
  ASSERT_TRUE(client->send(viewOf(welcome, 1)));
  protocol::View away = viewOf(welcome, 2);
  away.camera.direction = {0.0, 0.0, 1.0};
  ASSERT_TRUE(client->send(away));
  const ReceivedAnswers received = receiveAll(*client, 2);
  EXPECT_TRUE(received.complete);
  EXPECT_LE(received.faces, 4);
}

// ---- HTTP ----

TEST(Server, httpRoutesAnswer) {
  const SceneDirectory scene;
  RunningServer server(scene.path);
  EXPECT_EQ(httpRequest(server.port(), "/healthz").body, "ok");

  const HttpAnswer json = httpRequest(server.port(), "/scene.json");
  EXPECT_EQ(json.status, 200);
  EXPECT_EQ(json.headers.at("content-type"), "application/json");
  const auto file = base::readFile(scene.path + "/scene.json");
  EXPECT_EQ(json.body, std::string(file->begin(), file->end()));

  const HttpAnswer home = httpRequest(server.port(), "/");
  EXPECT_EQ(home.status, 200);
  EXPECT_NE(home.body.find("lumigrid-view ws://127.0.0.1:" + std::to_string(server.port()) + "/"), std::string::npos);
  EXPECT_NE(home.body.find("lumigrid_net_test"), std::string::npos);

  for (const std::string target : {"/nothing", "/patch.lgp/", "/images/data.mdb", "/../scene.json", "/%2e%2e/x"})
    EXPECT_EQ(httpRequest(server.port(), target).status, 404) << target;
  EXPECT_EQ(httpRequest(server.port(), "/scene.json", {}, "POST").status, 405);
  EXPECT_EQ(httpRequest(server.port(), "/scene.json", {}, "DELETE").status, 405);
}

TEST(Server, visitorsTextIsNotEchoedIntoThePage) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  const HttpAnswer home = httpRequest(server.port(), "/", {{"Host", "a<script>alert(1)</script>"}});
  EXPECT_EQ(home.status, 421);
  EXPECT_EQ(home.body.find("<script>"), std::string::npos);
}

TEST(Server, patchFileIsServedByRanges) {
  const SceneDirectory scene;
  RunningServer server(scene.path);
  const auto bytes = base::readFile(scene.path + "/patch.lgp");
  const std::string file(bytes->begin(), bytes->end());
  const std::string size = std::to_string(file.size());

  const HttpAnswer whole = httpRequest(server.port(), "/patch.lgp");
  EXPECT_EQ(whole.status, 200);
  EXPECT_EQ(whole.headers.at("accept-ranges"), "bytes");
  EXPECT_TRUE(whole.body == file);

  const HttpAnswer part = httpRequest(server.port(), "/patch.lgp", {{"Range", "bytes=100-299"}});
  EXPECT_EQ(part.status, 206);
  EXPECT_EQ(part.headers.at("content-range"), "bytes 100-299/" + size);
  EXPECT_TRUE(part.body == file.substr(100, 200));

  EXPECT_TRUE(httpRequest(server.port(), "/patch.lgp", {{"Range", "bytes=-7"}}).body == file.substr(file.size() - 7));
  const HttpAnswer beyond = httpRequest(server.port(), "/patch.lgp", {{"Range", "bytes=" + size + "-"}});
  EXPECT_EQ(beyond.status, 416);
  EXPECT_EQ(beyond.headers.at("content-range"), "bytes */" + size);
  EXPECT_EQ(beyond.body, "");

  const HttpAnswer head = httpRequest(server.port(), "/patch.lgp", {}, "HEAD");
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(head.headers.at("content-length"), size);
  EXPECT_EQ(head.body, "");
}

TEST(Server, moreConnectionsThanAllowedAreTurnedAway) {
  const SceneDirectory scene(0);
  ServerOptions options = RunningServer::quiet();
  options.max_connections = 1;
  RunningServer server(scene.path, options);
  auto first = LoopbackClient::connect(server.port());
  ASSERT_TRUE(first);
  greet(*first);
  const HttpAnswer refusal = httpRequest(server.port(), "/scene.json");
  EXPECT_EQ(refusal.status, 503);
  EXPECT_EQ(refusal.headers.at("retry-after"), "5");
  EXPECT_FALSE(LoopbackClient::connect(server.port()));
  // Whoever watches over the server is told that it is well.
  EXPECT_EQ(httpRequest(server.port(), "/healthz").status, 200);
  first->close();
  first.reset();
  // The server notices it with a delay.
  int status = 0;
  for (int attempt = 0; attempt < 500 && status != 200; ++attempt)
    status = httpRequest(server.port(), "/scene.json").status;
  EXPECT_EQ(status, 200);
}

TEST(Server, oneAddressCannotTakeAllConnections) {
  const SceneDirectory scene(0);
  ServerOptions options = RunningServer::quiet();
  options.connections_per_address = 2;
  RunningServer server(scene.path, options);
  auto first = LoopbackClient::connect(server.port());
  auto second = LoopbackClient::connect(server.port());
  ASSERT_TRUE(first && second);
  const std::string refusal = rawExchange(server.port(), "GET / HTTP/1.1\r\nHost: a\r\n\r\n");
  EXPECT_TRUE(refusal.starts_with("HTTP/1.1 429 Too Many Requests\r\n")) << refusal;
  EXPECT_TRUE(refusal.ends_with("close others\n")) << refusal;
}

TEST(Server, mutePeersOfOneAddressDoNotHideTheServersHealth) {
  const SceneDirectory scene(0);
  ServerOptions options = RunningServer::quiet();
  options.max_connections = 1;
  RunningServer server(scene.path, options);
  const auto viewer = LoopbackClient::connect(server.port());
  ASSERT_TRUE(viewer);
  std::vector<base::FileDescriptor> mute;
  for (std::uint32_t i = 0; i < kMaxTurnedAway + 4; ++i) mute.push_back(support::connectTo(server.port(), 66));
  EXPECT_EQ(httpRequest(server.port(), "/healthz").status, 200);
  // Beyond its share an address is told at once.
  char first = 0;
  EXPECT_EQ(::recv(mute.back().get(), &first, 1, 0), 1);
}

// Whatever is sent in place of a request, the answer says what was wrong with it.
TEST(Server, badRequestsAreAnswered) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  const auto answerTo = [&](const std::string& bytes) { return rawExchange(server.port(), bytes).substr(0, 13); };
  EXPECT_EQ(answerTo("\x16\x03\x01 this is not HTTP\r\n\r\n"), "HTTP/1.1 400 ");
  EXPECT_EQ(answerTo("GET /healthz HTTP/1.1\r\nHost: a\r\nA: " + std::string(9000, 'a') + "\r\n\r\n"), "HTTP/1.1 431 ");
  EXPECT_EQ(answerTo("POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 5\r\n\r\nhello"), "HTTP/1.1 413 ");
  EXPECT_EQ(answerTo("PUT / HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"), "HTTP/1.1 405 ");
}

// Bytes behind the part that was read do not have the connection reset before the answer is read.
TEST(Server, refusedRequestsAreReadToTheirEnd) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  const std::pair<std::string, std::string> requests[] = {
      {"GET /healthz HTTP/1.1\r\nHost: a\r\nA: " + std::string(100'000, 'a') + "\r\n\r\n", "HTTP/1.1 431 "},
      {"POST / HTTP/1.1\r\nHost: a\r\nContent-Length: 100000\r\n\r\n" + std::string(100'000, 'a'), "HTTP/1.1 413 "},
      {std::string(100'000, '\1'), "HTTP/1.1 400 "}};
  for (const auto& [request, answer] : requests) {
    const base::FileDescriptor socket = support::connectTo(server.port());
    ASSERT_EQ(::send(socket.get(), request.data(), request.size(), MSG_NOSIGNAL), static_cast<ssize_t>(request.size()));
    std::string said(4096, ' ');
    ssize_t size = 0, last = 0;
    while ((last = ::recv(socket.get(), &said[static_cast<std::size_t>(size)], 1, 0)) > 0) size += last;
    EXPECT_EQ(last, 0) << std::strerror(errno);
    EXPECT_TRUE(said.starts_with(answer)) << said;
    // A reset would follow at once, and other systems than this one would lose what was not read by then.
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    int failure = 0;
    socklen_t length = sizeof failure;
    EXPECT_EQ(::getsockopt(socket.get(), SOL_SOCKET, SO_ERROR, &failure, &length), 0);
    EXPECT_EQ(failure, 0) << "the connection was reset: " << std::strerror(failure);
  }
}

TEST(Server, aRequestThatDoesNotComeInTimeIsToldSo) {
  const SceneDirectory scene(0);
  ServerOptions options = RunningServer::quiet();
  options.head_seconds = 1.0;
  RunningServer server(scene.path, options);
  EXPECT_TRUE(rawExchange(server.port(), "GET /healthz HT").starts_with("HTTP/1.1 408 "));
  EXPECT_EQ(rawExchange(server.port(), ""), "");
}

TEST(Server, otherMethodsAreToldWhichThereAre) {
  const SceneDirectory first(0), second(0);
  RunningServer one(first.path), two({first.path, second.path});
  for (const RunningServer* server : {&one, &two}) {
    HttpAnswer refused = httpRequest(server->port(), "/", {}, "DELETE");
    EXPECT_EQ(refused.status, 405);
    EXPECT_EQ(refused.headers["allow"], "GET, HEAD, OPTIONS");
    EXPECT_EQ(httpRequest(server->port(), "/", {}, "OPTIONS").status, 204);
  }
}

// ---- Viewers that behave badly

TEST(Server, aViewerThatSaysNothingIsLetGo) {
  const SceneDirectory scene(0);
  ServerOptions options = RunningServer::quiet();
  options.hello_seconds = 0.2;
  RunningServer server(scene.path, options);
  auto mute = LoopbackClient::connect(server.port());
  ASSERT_TRUE(mute);
  EXPECT_FALSE(mute->receive());
  EXPECT_EQ(mute->closeCode(), 1008);
  EXPECT_EQ(mute->closeReason(), "no Hello came in time");
}

TEST(Server, aViewerThatIsSilentForLongIsLetGo) {
  const SceneDirectory scene(0);
  ServerOptions options = RunningServer::quiet();
  options.idle_seconds = 0.2;
  RunningServer server(scene.path, options);
  auto silent = LoopbackClient::connect(server.port());
  ASSERT_TRUE(silent);
  greet(*silent);
  EXPECT_FALSE(silent->receive());
  EXPECT_EQ(silent->closeCode(), 1001);
}

TEST(Server, aViewerThatTakesNothingIsDropped) {
  const SceneDirectory scene(2'000'000);
  ServerOptions options = RunningServer::quiet();
  options.stall_seconds = 0.3;
  RunningServer server(scene.path, options);
  auto stalled = LoopbackClient::connect(server.port(), "/", 4096);
  ASSERT_TRUE(stalled);
  const auto welcome = greet(*stalled);
  ASSERT_TRUE(stalled->send(viewOf(welcome, 1)));
  // It reads again once the server has given it up: what was under way comes, and then the end.
  std::this_thread::sleep_for(std::chrono::milliseconds(1500));
  EXPECT_FALSE(receiveAll(*stalled, 1).complete);
}

// The answer as a whole might take 48 seconds.
TEST(Server, aVisitorThatTakesNothingIsDropped) {
  const SceneDirectory scene(0);
  const PageFolder page;
  page.write("large.bin", std::string(std::size_t{48} << 20, 'x'));
  ServerOptions options = RunningServer::quiet();
  options.page_directory = page.path;
  options.stall_seconds = 0.3;
  options.min_bytes_per_second = 1 << 20;
  RunningServer server(scene.path, options);
  const base::FileDescriptor stalled = support::connectTo(server.port());
  const std::string request = "GET /large.bin HTTP/1.1\r\nHost: localhost\r\n\r\n";
  ASSERT_EQ(::send(stalled.get(), request.data(), request.size(), 0), static_cast<ssize_t>(request.size()));
  const auto isOpen = [&](int connections) {
    const std::string line = "lumigrid_connections_open{kind=\"http\"} " + std::to_string(connections) + "\n";
    return httpRequest(server.port(), "/metrics").body.find(line) != std::string::npos;
  };
  bool is_dropped = false;  // the connection that asks is left
  for (int attempt = 0; attempt < 200 && !is_dropped; ++attempt) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    is_dropped = isOpen(1);
  }
  EXPECT_TRUE(is_dropped);
}

TEST(Server, largeAnswersComeWholeAndTheConnectionIsKept) {
  const SceneDirectory scene(0);
  const PageFolder page;
  std::string large(3'500'000, 'x');
  for (std::size_t i = 0; i < large.size(); i += 7) large[i] = static_cast<char>('a' + i % 26);
  page.write("large.bin", large);
  ServerOptions options = RunningServer::quiet();
  options.page_directory = page.path;
  RunningServer server(scene.path, options);
  const std::string ask = "GET /large.bin HTTP/1.1\r\nHost: localhost\r\n";
  const std::string both = rawExchange(server.port(), ask + "\r\n" + ask + "Connection: close\r\n\r\n");
  const std::size_t first = both.find("\r\n\r\n") + 4, second = both.find("\r\n\r\n", first + large.size()) + 4;
  EXPECT_TRUE(both.substr(first, large.size()) == large);
  EXPECT_TRUE(both.substr(second) == large);
}

// Thousands of messages are read at the pace that is allowed, and another viewer is served meanwhile.
TEST(Server, aFloodOfViewsStarvesItself) {
  const SceneDirectory scene;
  ServerOptions options = RunningServer::quiet();
  options.messages_per_second = 50.0;
  RunningServer server(scene.path, options);
  auto flood = LoopbackClient::connect(server.port());
  ASSERT_TRUE(flood);
  const auto welcome = greet(*flood);
  protocol::View view = viewOf(welcome, 1);
  view.max_points = 64;
  for (; view.sequence < 2000; ++view.sequence) ASSERT_TRUE(flood->send(view));
  for (int i = 0; i < 3; ++i) {
    auto other = LoopbackClient::connect(server.port());
    ASSERT_TRUE(other);
    greet(*other);
    ASSERT_TRUE(other->send(viewOf(welcome, 1)));
    EXPECT_TRUE(receiveAll(*other, 1).complete);
  }
}

// ---- starting and stopping ----

TEST(Server, takenPortIsNamedWithAdvice) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  ServerOptions options = RunningServer::quiet();
  options.port = server.port();
  auto second = Server::open({scene.path}, options);
  ASSERT_FALSE(second);
  EXPECT_EQ(second.error().code, base::ErrorCode::kNetwork);
  EXPECT_EQ(second.error().message, "127.0.0.1:" + std::to_string(server.port()) +
                                        " is in use; choose another port with --port (0 picks a free one)");
}

TEST(Server, placesAreWrittenAsInAddressesOfTheWeb) {
  EXPECT_EQ(placeText("127.0.0.1", 80), "127.0.0.1:80");
  EXPECT_EQ(placeText("::1", 8080), "[::1]:8080");
}

TEST(Server, wrongAddressesAndFoldersAreErrors) {
  const SceneDirectory scene(0);
  ServerOptions options = RunningServer::quiet();
  options.address = "localhost.nowhere";
  EXPECT_EQ(Server::open({scene.path}, options).error().code, base::ErrorCode::kInvalidInput);
  EXPECT_FALSE(Server::open({scene.path + "/nothing"}, RunningServer::quiet()));
}

TEST(Server, stopClosesConnectionsAndReturns) {
  const SceneDirectory scene;
  RunningServer server(scene.path);
  auto client = LoopbackClient::connect(server.port());
  ASSERT_TRUE(client);
  greet(*client);
  auto silent = LoopbackClient::connect(server.port());  // never answers the close frame: cut after two seconds
  ASSERT_TRUE(silent);
  std::thread stopper([&] { server.stop(); });
  while (client->receive()) {
  }
  EXPECT_EQ(client->closeCode(), 1001);  // going away
  stopper.join();
  EXPECT_EQ(httpRequest(server.port(), "/healthz").status, 0);
}

TEST(Server, terminationSignalEndsRun) {
  const SceneDirectory scene(0);
  ServerOptions options = RunningServer::quiet();
  options.port = 0;
  auto server = Server::open({scene.path}, options);
  ASSERT_TRUE(server);
  std::thread thread([&] { EXPECT_TRUE((*server)->run(true)); });
  // Once the server answers, its signal handler is installed.
  while (httpRequest((*server)->port(), "/healthz").status != 200) {
  }
  std::raise(SIGTERM);
  thread.join();
}

}  // namespace
}  // namespace server
