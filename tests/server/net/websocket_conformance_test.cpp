// The server against RFC 6455, byte by byte: handshakes, frames and closes, right ones and wrong ones, as the Autobahn
// suite has them, whose numbers stand beside the groups. After each the server serves another client.
#include <gtest/gtest.h>

#include "tests/server/net/loopback.h"
#include "tests/server/net/raw_websocket.h"
#include "tests/server/net/served_scene.h"

namespace server {
namespace {

base::Bytes hello() {
  return protocol::encode(protocol::ClientMessage(protocol::Hello{protocol::kVersion, "raw 1"}));
}

class Conformance : public testing::Test {
 protected:
  static void SetUpTestSuite() {
    scene = std::make_unique<SceneDirectory>(0);
    running = std::make_unique<RunningServer>(scene->path);
  }
  static void TearDownTestSuite() {
    running.reset();
    scene.reset();
  }
  void TearDown() override {
    const auto other = LoopbackClient::connect(running->port());
    ASSERT_TRUE(other) << "the server shakes no more hands";
    ASSERT_TRUE(other->send(protocol::Hello{protocol::kVersion, "another 1"}));
    const auto message = other->receive();
    EXPECT_TRUE(message && std::holds_alternative<protocol::Welcome>(*message)) << "the server serves nobody else";
  }
  /// A client that is through with its handshake.
  static std::unique_ptr<RawWebSocket> connected() {
    auto socket = std::make_unique<RawWebSocket>(running->port());
    EXPECT_TRUE(socket->connected() && socket->shakeHands());
    return socket;
  }
  /// Expects that the frames are answered by a close frame with one of the codes, and the end of the connection.
  static void expectClosed(const std::vector<base::Bytes>& frames, std::initializer_list<int> codes,
                           const std::string& about) {
    const auto socket = connected();
    for (const base::Bytes& frame : frames) (void)socket->write(frame);
    const auto closing = socket->readUntil(Op::kClose);
    EXPECT_EQ(socket->fault(), "") << about;
    if (!closing) {
      ADD_FAILURE() << about << ": no close frame";
      return;
    }
    const int code = closing->closeCode();
    EXPECT_TRUE(std::find(codes.begin(), codes.end(), code) != codes.end()) << about << ": closed with " << code;
    // Where the server began to close, it may wait for the client's answer (section 7.1.1).
    (void)socket->write(RawFrame{.op = Op::kClose, .payload = closing->payload});
    EXPECT_TRUE(socket->isClosed()) << about << ": the connection stays";
  }
  static void expectWelcome(RawWebSocket& socket, const std::string& about) {
    const auto frame = socket.readUntil(Op::kBinary);
    EXPECT_EQ(socket.fault(), "") << about;
    ASSERT_TRUE(frame) << about;
    const auto message = protocol::decodeServerMessage(frame->payload);
    EXPECT_TRUE(message && std::holds_alternative<protocol::Welcome>(*message)) << about;
  }

  static std::unique_ptr<SceneDirectory> scene;
  static std::unique_ptr<RunningServer> running;
};
std::unique_ptr<SceneDirectory> Conformance::scene;
std::unique_ptr<RunningServer> Conformance::running;

int statusOf(const std::string& head) {
  return head.size() < 12 ? 0 : std::atoi(head.substr(9, 3).c_str());
}

// ---- Handshake (sections 4.2.1 and 4.2.2) ----

TEST_F(Conformance, handshakeAnswersTheKey) {
  RawWebSocket socket(running->port());
  ASSERT_TRUE(socket.write(RawWebSocket::request("GET / HTTP/1.1", "13")));
  const std::string head = socket.readHead();
  EXPECT_EQ(statusOf(head), 101);
  // The answer to this key is section 1.3's.
  EXPECT_NE(head.find("s3pPLMBiTxaQ9kYGzzhZRbK+xOo="), std::string::npos) << head;
}

TEST_F(Conformance, handshakeReadsNamesInAnyCase) {
  RawWebSocket socket(running->port());
  ASSERT_TRUE(
      socket.write("GET / HTTP/1.1\r\nhOST: 127.0.0.1\r\nUPGRADE: WebSocket\r\nconnection: keep-alive, upgrade\r\n"
                   "sec-websocket-version: 13\r\nsec-websocket-key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"));
  EXPECT_EQ(statusOf(socket.readHead()), 101);
}

TEST_F(Conformance, handshakesThatAreIncompleteAreRefused) {
  struct Case {
    std::string about, request;
    std::vector<int> statuses;
  };
  const std::vector<Case> cases{
      {"another version (4.4)", RawWebSocket::request("GET / HTTP/1.1", "12"), {426}},
      {"no number for a version", RawWebSocket::request("GET / HTTP/1.1", "abc"), {400, 426}},
      {"no version", RawWebSocket::request("GET / HTTP/1.1", ""), {400, 426}},
      {"no key", RawWebSocket::request("GET / HTTP/1.1", "13", ""), {400}},
      {"a key that is no base64 of 16 bytes", RawWebSocket::request("GET / HTTP/1.1", "13", "short"), {400}},
      {"a key of a thousand bytes", RawWebSocket::request("GET / HTTP/1.1", "13", std::string(1000, 'A')), {400, 431}},
      // Not a handshake at all, so that the page or a refusal is the answer.
      {"POST", RawWebSocket::request("POST / HTTP/1.1", "13"), {200, 400, 405, 411}},
      {"HTTP/1.0", RawWebSocket::request("GET / HTTP/1.0", "13"), {200, 400, 505}},
  };
  for (const Case& one : cases) {
    RawWebSocket socket(running->port());
    ASSERT_TRUE(socket.write(one.request));
    const std::string head = socket.readHead();
    const int status = statusOf(head);
    EXPECT_TRUE(std::find(one.statuses.begin(), one.statuses.end(), status) != one.statuses.end())
        << one.about << ": " << status;
    EXPECT_TRUE(status != 426 || head.find("Sec-WebSocket-Version: 13") != std::string::npos) << one.about;
  }
}

// ---- Fragments (section 5.4; Autobahn 5) ----

TEST_F(Conformance, messagesMayComeInFragments) {
  const base::Bytes whole = hello();
  const auto socket = connected();
  for (std::size_t i = 0; i < whole.size(); ++i)
    ASSERT_TRUE(socket->write(
        RawFrame{.op = i == 0 ? Op::kBinary : Op::kContinuation, .payload = {whole[i]}, .fin = i + 1 == whole.size()}));
  expectWelcome(*socket, "a fragment a byte");
}

TEST_F(Conformance, fragmentsMayBeEmpty) {
  const auto socket = connected();
  ASSERT_TRUE(socket->write(RawFrame{.payload = {}, .fin = false}));
  ASSERT_TRUE(socket->write(RawFrame{.op = Op::kContinuation, .payload = hello(), .fin = false}));
  ASSERT_TRUE(socket->write(RawFrame{.op = Op::kContinuation, .payload = {}}));
  expectWelcome(*socket, "empty first and last");
}

TEST_F(Conformance, framesMayComeByteByByte) {
  const auto socket = connected();
  for (const std::uint8_t byte : encode(RawFrame{.payload = hello()})) ASSERT_TRUE(socket->write(base::Bytes{byte}));
  expectWelcome(*socket, "a byte at a time");
}

TEST_F(Conformance, pingsBetweenFragmentsAreAnswered) {
  base::Bytes whole = hello();
  const auto half = whole.begin() + 5;
  const auto socket = connected();
  ASSERT_TRUE(socket->write(RawFrame{.payload = {whole.begin(), half}, .fin = false}));
  ASSERT_TRUE(socket->write(RawFrame{.op = Op::kPing, .payload = bytesOf("still there?")}));
  const auto pong = socket->readFrame();
  ASSERT_TRUE(pong && pong->op == Op::kPong);
  EXPECT_EQ(pong->payload, bytesOf("still there?"));
  ASSERT_TRUE(socket->write(RawFrame{.op = Op::kContinuation, .payload = {half, whole.end()}}));
  expectWelcome(*socket, "after the ping");
}

TEST_F(Conformance, fragmentsInTheWrongOrderCloseTheConnection) {
  const base::Bytes some = encode(RawFrame{.payload = bytesOf("abc"), .fin = false});
  expectClosed({encode(RawFrame{.op = Op::kContinuation, .payload = hello()})}, {1002}, "continuation of nothing");
  expectClosed({encode(RawFrame{.op = Op::kContinuation, .payload = hello(), .fin = false})}, {1002},
               "unfinished continuation of nothing");
  expectClosed({some, encode(RawFrame{.payload = hello()})}, {1002}, "a message within another");
  expectClosed({some, encode(RawFrame{.op = Op::kText, .payload = hello()})}, {1002}, "a text within another");
}

// ---- Control frames (section 5.5; Autobahn 2) ----

TEST_F(Conformance, pongsCarryThePingsPayload) {
  const auto socket = connected();
  for (const std::size_t size : {0, 1, 125}) {
    const base::Bytes payload(size, 0xFE);
    ASSERT_TRUE(socket->write(RawFrame{.op = Op::kPing, .payload = payload}));
    const auto pong = socket->readUntil(Op::kPong);
    ASSERT_TRUE(pong) << size;
    EXPECT_EQ(pong->payload, payload);
    EXPECT_TRUE(pong->fin);
  }
}

TEST_F(Conformance, ofManyPingsTheLastIsAnswered) {
  const auto socket = connected();
  for (int i = 0; i <= 1000; ++i)
    ASSERT_TRUE(socket->write(RawFrame{.op = Op::kPing, .payload = bytesOf(std::to_string(i))}));
  // A server may answer the newest ping alone (section 5.5.3).
  for (auto pong = socket->readUntil(Op::kPong); true; pong = socket->readUntil(Op::kPong)) {
    ASSERT_TRUE(pong);
    if (pong->payload == bytesOf("1000")) break;
  }
}

TEST_F(Conformance, pongsThatNobodyAskedForAreIgnored) {
  const auto socket = connected();
  ASSERT_TRUE(socket->write(RawFrame{.op = Op::kPong, .payload = bytesOf("here I am")}));
  ASSERT_TRUE(socket->write(RawFrame{.payload = hello()}));
  expectWelcome(*socket, "after a pong");
}

TEST_F(Conformance, controlFramesAreShortAndWhole) {
  for (const Op op : {Op::kPing, Op::kPong, Op::kClose}) {
    const std::string about = "opcode " + std::to_string(static_cast<int>(op));
    const base::Bytes long_payload(126, op == Op::kClose ? 3 : 1);
    expectClosed({encode(RawFrame{.op = op, .payload = long_payload})}, {1002}, about + " of 126 bytes");
    expectClosed({encode(RawFrame{.op = op, .payload = closePayload(1000), .fin = false})}, {1002},
                 about + " in fragments");
  }
}

// ---- Reserved bits and opcodes (section 5.2; Autobahn 3 and 4) ----

TEST_F(Conformance, reservedBitsCloseTheConnection) {
  for (const std::uint8_t bits : {1, 2, 4, 7}) {
    expectClosed({encode(RawFrame{.payload = hello(), .reserved = bits})}, {1002}, "reserved " + std::to_string(bits));
    expectClosed({encode(RawFrame{.op = Op::kPing, .reserved = bits})}, {1002}, "ping " + std::to_string(bits));
  }
}

TEST_F(Conformance, unknownOpcodesCloseTheConnection) {
  for (const int op : {3, 4, 5, 6, 7, 11, 12, 13, 14, 15})
    expectClosed({encode(RawFrame{.op = static_cast<Op>(op), .payload = bytesOf("a")})}, {1002},
                 "opcode " + std::to_string(op));
}

// ---- Masks and lengths (sections 5.1 to 5.3) ----

TEST_F(Conformance, framesWithoutAMaskCloseTheConnection) {
  expectClosed({encode(RawFrame{.payload = hello(), .masked = false})}, {1002}, "a message");
  expectClosed({encode(RawFrame{.op = Op::kPing, .masked = false})}, {1002}, "a ping");
}

TEST_F(Conformance, lengthsAreWrittenInTheirShortestForm) {
  expectClosed({encode(RawFrame{.payload = hello(), .length_bytes = 2})}, {1002}, "16 bits for a short one");
  expectClosed({encode(RawFrame{.payload = hello(), .length_bytes = 8})}, {1002}, "64 bits for a short one");
  expectClosed({encode(RawFrame{.payload = {}, .length = std::uint64_t{1} << 63U})}, {1002, 1009}, "the highest bit");
}

TEST_F(Conformance, messagesOverTheLimitCloseTheConnection) {
  const std::uint64_t over = protocol::kMaxClientMessage + 1;
  expectClosed({encode(RawFrame{.payload = {}, .length = over})}, {1009}, "its header alone");
  expectClosed({encode(RawFrame{.payload = {}, .length = std::uint64_t{1} << 40U})}, {1009}, "a terabyte");
  const base::Bytes half(over / 2 + 1, 0x5A);
  expectClosed({encode(RawFrame{.payload = half, .fin = false}),
                encode(RawFrame{.op = Op::kContinuation, .payload = half, .fin = false})},
               {1009}, "the sum of fragments");
}

// ---- Types of data (section 7.4.1) ----

TEST_F(Conformance, textIsNotAccepted) {
  expectClosed({encode(RawFrame{.op = Op::kText, .payload = bytesOf("hello")})}, {1003}, "text");
  expectClosed({encode(RawFrame{.op = Op::kText, .payload = {0xC0, 0x80}})}, {1003, 1007}, "text that is not UTF-8");
  expectClosed({encode(RawFrame{.op = Op::kText, .payload = bytesOf("hel"), .fin = false}),
                encode(RawFrame{.op = Op::kContinuation, .payload = bytesOf("lo")})},
               {1003}, "text in fragments");
}

// ---- Closing (sections 5.5.1 and 7.4; Autobahn 7) ----

TEST_F(Conformance, closesAreAnsweredWithTheirCode) {
  for (const int code : {1000, 1001, 1002, 1003, 1007, 1008, 1009, 1010, 1011, 3000, 3999, 4000, 4999})
    expectClosed({encode(RawFrame{.op = Op::kClose, .payload = closePayload(static_cast<std::uint16_t>(code), "bye")})},
                 {code}, "code " + std::to_string(code));
  expectClosed({encode(RawFrame{.op = Op::kClose})}, {1000, 1005}, "no code");
  expectClosed({encode(RawFrame{.op = Op::kClose, .payload = closePayload(1000, std::string(123, 'x'))})}, {1000},
               "the longest reason");
}

TEST_F(Conformance, codesThatMayNotBeSentAreErrors) {
  const auto closeOf = [](int code) {
    return encode(RawFrame{.op = Op::kClose, .payload = closePayload(static_cast<std::uint16_t>(code))});
  };
  for (const int code : {0, 1, 999, 1004, 1005, 1006, 1015, 1016, 1100, 2000, 2999})
    expectClosed({closeOf(code)}, {1002}, "code " + std::to_string(code));
  // The RFC says nothing of codes from 5000 on (Autobahn 7.13).
  for (const int code : {5000, 65535}) expectClosed({closeOf(code)}, {1002, code}, "code " + std::to_string(code));
}

TEST_F(Conformance, payloadsThatAreNoCloseAreErrors) {
  expectClosed({encode(RawFrame{.op = Op::kClose, .payload = {3}})}, {1002}, "one byte");
  for (const std::string reason : {"\xC0\x80", "\xFF", "\xED\xA0\x80", "\xF4\x90\x80\x80", "\xE2\x82"})
    expectClosed({encode(RawFrame{.op = Op::kClose, .payload = closePayload(1000, reason)})}, {1002, 1007},
                 "a reason that is not UTF-8");
}

TEST_F(Conformance, nothingIsReadAfterAClose) {
  const auto socket = connected();
  ASSERT_TRUE(socket->write(RawFrame{.op = Op::kClose, .payload = closePayload(1000)}));
  (void)socket->write(RawFrame{.payload = hello()});
  const auto first = socket->readFrame();
  ASSERT_TRUE(first && first->op == Op::kClose) << "a message after the close is answered";
  EXPECT_TRUE(socket->isClosed());
}

TEST_F(Conformance, aCloseWithinFragmentsIsAnswered) {
  expectClosed({encode(RawFrame{.payload = bytesOf("abc"), .fin = false}),
                encode(RawFrame{.op = Op::kClose, .payload = closePayload(1001)})},
               {1001}, "within fragments");
}

// ---- Clients that vanish ----

TEST_F(Conformance, clientsMayVanishAnywhere) {
  const base::Bytes frame = encode(RawFrame{.payload = hello()});
  for (std::size_t length = 0; length <= frame.size(); ++length) {
    const auto socket = connected();
    EXPECT_TRUE(socket->write(base::Bytes(frame.begin(), frame.begin() + static_cast<std::ptrdiff_t>(length))));
  }
  const std::string request = RawWebSocket::request("GET / HTTP/1.1", "13");
  for (std::size_t length = 0; length <= request.size(); length += 7) {
    RawWebSocket socket(running->port());
    EXPECT_TRUE(socket.write(request.substr(0, length)));
  }
}

TEST_F(Conformance, aCloseInTheMiddleOfAnAnswerEndsIt) {
  const auto socket = connected();
  ASSERT_TRUE(socket->write(RawFrame{.payload = hello()}));
  expectWelcome(*socket, "before the view");
  protocol::View view;
  view.sequence = 1;
  view.camera.position = {500'000.0, 4'000'000.0, 150.0};
  view.camera.direction = {0.0, 0.0, -1.0};
  view.camera.up = {0.0, 1.0, 0.0};
  view.camera.width = view.camera.height = 256;
  ASSERT_TRUE(socket->write(RawFrame{.payload = protocol::encode(protocol::ClientMessage(view))}));
  ASSERT_TRUE(socket->write(RawFrame{.op = Op::kClose, .payload = closePayload(1000)}));
  const auto closing = socket->readUntil(Op::kClose);
  ASSERT_TRUE(closing);
  EXPECT_EQ(closing->closeCode(), 1000);
  EXPECT_TRUE(socket->isClosed());
}

}  // namespace
}  // namespace server
