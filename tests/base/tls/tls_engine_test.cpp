#include "base/tls/tls_engine.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <unistd.h>

#include <ctime>
#include <optional>

#include "tests/support/certificates.h"
#include "tests/support/temporary_directory.h"

namespace base {
namespace {

using Step = TlsEngine::Step;

// A client and a server at the two ends of a socket; both run on this thread, one step after the other.
class TlsEngineTest : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_EQ(::socketpair(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK, 0, ends_), 0);
    authority_.write(path("ca.pem"));
  }
  void TearDown() override {
    for (const int end : ends_)
      if (end >= 0) ::close(end);
  }
  std::string path(const std::string& name) const { return directory_ / name; }
  void connect(const std::string& host, const std::string& names, long end = 3600, bool trusted = true) {
    authority_.issue(names, -7200, end, path("server.pem"), path("server.key"));
    const auto server = loadServerTls(path("server.pem"), path("server.key"), std::time(nullptr));
    const auto client = makeClientTls(trusted ? path("ca.pem") : "");
    ASSERT_TRUE(server && client);
    server_.emplace(TlsEngine::forServer(server->context, ends_[0]));
    client_.emplace(TlsEngine::forClient(*client, ends_[1], host));
  }
  /// The client's last step.
  Step shakeHands() {
    Step client = Step::kWantsToWrite;
    for (int i = 0; i < 10 && client != Step::kDone && client != Step::kFailed; ++i) {
      client = client_->handshake().step;
      server_step_ = server_->handshake().step;
    }
    return client;
  }
  std::string problemWith(const std::string& host, const std::string& names, long end = 3600, bool trusted = true) {
    connect(host, names, end, trusted);
    EXPECT_EQ(shakeHands(), Step::kFailed);
    return client_->problem();
  }

  const support::TemporaryDirectory directory_;
  const support::Authority authority_{"test authority"};
  int ends_[2] = {-1, -1};
  std::optional<TlsEngine> server_, client_;
  Step server_step_ = Step::kFailed;
};

TEST_F(TlsEngineTest, bytesPassBothWaysAndTheEndIsTold) {
  connect("localhost", "DNS:localhost");
  ASSERT_EQ(shakeHands(), Step::kDone) << client_->problem();
  ASSERT_EQ(server_step_, Step::kDone);
  Bytes buffer(100);
  EXPECT_EQ(server_->read(buffer).step, Step::kWantsToRead);
  ASSERT_EQ(client_->write(viewOfText("question")).bytes, 8U);
  TlsEngine::Outcome read = server_->read(std::span(buffer).first(5));
  EXPECT_EQ(textOf(ByteView(buffer).first(read.bytes)), "quest");
  EXPECT_FALSE(server_->isPeerGone());
  read = server_->read(buffer);
  EXPECT_EQ(textOf(ByteView(buffer).first(read.bytes)), "ion");
  EXPECT_FALSE(server_->isPeerGone()) << "silence is no end";
  ASSERT_EQ(server_->write(viewOfText("answer")).bytes, 6U);
  read = client_->read(buffer);
  EXPECT_EQ(textOf(ByteView(buffer).first(read.bytes)), "answer");
  client_->sendClose();
  EXPECT_TRUE(server_->isPeerGone());
  EXPECT_EQ(server_->read(buffer).step, Step::kClosed);
}

TEST_F(TlsEngineTest, aFullSocketIsWaitedFor) {
  connect("localhost", "DNS:localhost");
  ASSERT_EQ(shakeHands(), Step::kDone) << client_->problem();
  const Bytes block(16384, 'x');
  std::size_t written = 0, received = 0;
  TlsEngine::Outcome outcome;
  while ((outcome = server_->write(block)).step == Step::kDone) written += outcome.bytes;
  EXPECT_EQ(outcome.step, Step::kWantsToWrite);
  ASSERT_GT(written, 0U);
  Bytes buffer(16384);
  const auto drain = [&] {
    while ((outcome = client_->read(buffer)).step == Step::kDone) received += outcome.bytes;
  };
  drain();
  outcome = server_->write(block);
  ASSERT_EQ(outcome.step, Step::kDone) << server_->problem();
  written += outcome.bytes;
  drain();
  EXPECT_EQ(received, written);
}

TEST_F(TlsEngineTest, addressesOfNumbersAreComparedAsSuch) {
  connect("127.0.0.1", "IP:127.0.0.1");
  EXPECT_EQ(shakeHands(), Step::kDone) << client_->problem();
}

TEST_F(TlsEngineTest, aCertificateForAnotherHostIsRefused) {
  EXPECT_NE(problemWith("localhost", "DNS:elsewhere.example").find("ostname mismatch"), std::string::npos);
}
TEST_F(TlsEngineTest, aCertificateForAnotherAddressIsRefused) {
  EXPECT_NE(problemWith("127.0.0.1", "IP:127.0.0.2,DNS:localhost").find("IP address mismatch"), std::string::npos);
}
TEST_F(TlsEngineTest, anExpiredCertificateIsRefused) {
  EXPECT_NE(problemWith("localhost", "DNS:localhost", -3600).find("has expired"), std::string::npos);
}
TEST_F(TlsEngineTest, anUnknownAuthorityIsRefused) {
  EXPECT_NE(problemWith("localhost", "DNS:localhost", 3600, false).find("unable to get local issuer"),
            std::string::npos);
}

TEST_F(TlsEngineTest, plainHttpIsRecognized) {
  connect("localhost", "DNS:localhost");
  const std::string request = "GET / HTTP/1.1\r\nHost: localhost\r\n\r\n";
  ASSERT_EQ(::write(ends_[1], request.data(), request.size()), static_cast<ssize_t>(request.size()));
  EXPECT_EQ(server_->handshake().step, Step::kFailed);
  EXPECT_TRUE(server_->metPlainHttp());
}

TEST_F(TlsEngineTest, otherBytesAreAFailureAndAnEndOneToo) {
  connect("localhost", "DNS:localhost");
  ASSERT_EQ(::write(ends_[1], "\0\1\2\3\4\5\6\7", 8), 8);
  EXPECT_EQ(server_->handshake().step, Step::kFailed);
  EXPECT_FALSE(server_->metPlainHttp());
  EXPECT_NE(server_->problem(), "");
  ::close(std::exchange(ends_[1], -1));
  server_->sendClose();  // raises no signal
}

}  // namespace
}  // namespace base
