#pragma once
// Lets clients that speak plain TCP talk to a TLS server of this machine: a port whose connections are passed on.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>
#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <vector>

#include "base/file.h"
#include "tests/support/ws_viewer.h"

namespace server {

class TlsTunnel {
 public:
  /// `authorities`: PEM files of the authorities that are trusted.
  TlsTunnel(std::uint16_t server, const std::vector<std::string>& authorities)
      : server_(server), context_(SSL_CTX_new(TLS_client_method()), &SSL_CTX_free) {
    for (const std::string& file : authorities)
      EXPECT_EQ(SSL_CTX_load_verify_locations(context_.get(), file.c_str(), nullptr), 1) << file;
    SSL_CTX_set_verify(context_.get(), SSL_VERIFY_PEER, nullptr);
    // A read that finds a session ticket alone returns. It must not wait for a message, for which the client may still
    // have to ask.
    SSL_CTX_clear_mode(context_.get(), SSL_MODE_AUTO_RETRY);
    listener_ = base::FileDescriptor(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    auto* const place = reinterpret_cast<sockaddr*>(&address);
    EXPECT_EQ(::bind(listener_.get(), place, size), 0);
    EXPECT_EQ(::listen(listener_.get(), 128), 0);
    EXPECT_EQ(::getsockname(listener_.get(), place, &size), 0);
    port_ = ntohs(address.sin_port);
    accepting_ = std::jthread([this](const std::stop_token& stop) { acceptAll(stop); });
  }
  ~TlsTunnel() {
    accepting_.request_stop();
    accepting_.join();
  }
  TlsTunnel(const TlsTunnel&) = delete;
  TlsTunnel& operator=(const TlsTunnel&) = delete;

  std::uint16_t port() const { return port_; }
  /// The serial number of the certificate that the last connection was shown; 0: none was made, or it was not trusted.
  long lastSerial() const { return last_serial_; }

 private:
  static constexpr int kPatienceMs = 50;  // how soon threads see that they are to stop
  using Session = std::unique_ptr<SSL, decltype(&SSL_free)>;

  static bool isReadable(int fd) {
    pollfd one{fd, POLLIN, 0};
    return ::poll(&one, 1, kPatienceMs) > 0;
  }
  void acceptAll(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      if (!isReadable(listener_.get())) continue;
      passed_.emplace_back([this, fd = ::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC)](
                               const std::stop_token& end) { pass(base::FileDescriptor(fd), end); });
    }
  }
  void pass(const base::FileDescriptor& plain, const std::stop_token& stop) {
    const base::FileDescriptor secret = support::connectTo(server_);
    const Session session(SSL_new(context_.get()), &SSL_free);
    SSL_set_fd(session.get(), secret.get());
    last_serial_ = 0;
    if (SSL_connect(session.get()) != 1) return;
    const std::unique_ptr<X509, decltype(&X509_free)> shown(SSL_get1_peer_certificate(session.get()), &X509_free);
    last_serial_ = ASN1_INTEGER_get(X509_get0_serialNumber(shown.get()));
    std::vector<char> piece(std::size_t{64} << 10);
    while (!stop.stop_requested()) {
      std::array<pollfd, 2> ends{pollfd{plain.get(), POLLIN, 0}, pollfd{secret.get(), POLLIN, 0}};
      if (SSL_pending(session.get()) == 0 && ::poll(ends.data(), ends.size(), kPatienceMs) <= 0) continue;
      if (ends[0].revents != 0) {
        const ssize_t got = ::recv(plain.get(), piece.data(), piece.size(), 0);
        if (got <= 0 || SSL_write(session.get(), piece.data(), static_cast<int>(got)) <= 0) return;
      }
      if (ends[1].revents != 0 || SSL_pending(session.get()) > 0) {
        const int got = SSL_read(session.get(), piece.data(), static_cast<int>(piece.size()));
        if (got <= 0 && SSL_get_error(session.get(), got) == SSL_ERROR_WANT_READ) continue;
        if (got <= 0 || ::send(plain.get(), piece.data(), static_cast<std::size_t>(got), MSG_NOSIGNAL) != got) return;
      }
    }
  }

  const std::uint16_t server_;
  const std::unique_ptr<SSL_CTX, decltype(&SSL_CTX_free)> context_;
  base::FileDescriptor listener_;
  std::uint16_t port_ = 0;
  std::atomic<long> last_serial_ = 0;
  std::vector<std::jthread> passed_;  // of acceptAll alone
  std::jthread accepting_;
};

}  // namespace server
