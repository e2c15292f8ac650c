#include "base/tls/tls_engine.h"

#include <arpa/inet.h>
#include <openssl/bio.h>
#include <openssl/err.h>
#include <openssl/ssl.h>
#include <openssl/x509v3.h>
#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "base/check.h"

namespace base {
namespace {

// ---- A socket for OpenSSL. Its own one would raise SIGPIPE where the peer is gone.

int socketOf(BIO* bio) {
  return static_cast<int>(reinterpret_cast<std::intptr_t>(BIO_get_data(bio)));
}

bool wouldBlock() {
  return errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR;
}

int writeSocket(BIO* bio, const char* data, int size) {
  BIO_clear_retry_flags(bio);
  const ssize_t sent = ::send(socketOf(bio), data, static_cast<std::size_t>(size), MSG_NOSIGNAL);
  if (sent < 0 && wouldBlock()) BIO_set_retry_write(bio);
  return static_cast<int>(sent);
}

int readSocket(BIO* bio, char* data, int size) {
  BIO_clear_retry_flags(bio);
  const ssize_t received = ::recv(socketOf(bio), data, static_cast<std::size_t>(size), 0);
  if (received < 0 && wouldBlock()) BIO_set_retry_read(bio);
  if (received == 0) BIO_set_flags(bio, BIO_FLAGS_IN_EOF);
  return static_cast<int>(received);
}

long controlSocket(BIO* bio, int command, long /*number*/, void* /*pointer*/) {
  if (command == BIO_CTRL_EOF) return BIO_test_flags(bio, BIO_FLAGS_IN_EOF) != 0 ? 1 : 0;
  return command == BIO_CTRL_FLUSH || command == BIO_CTRL_DUP ? 1 : 0;
}

int createSocket(BIO* bio) {
  BIO_set_init(bio, 1);
  return 1;
}

const BIO_METHOD* socketMethod() {
  static const BIO_METHOD* method = [] {
    BIO_METHOD* made = BIO_meth_new(BIO_get_new_index() | BIO_TYPE_SOURCE_SINK, "socket without SIGPIPE");
    LUMIGRID_CHECK(made != nullptr);
    BIO_meth_set_write(made, writeSocket);
    BIO_meth_set_read(made, readSocket);
    BIO_meth_set_ctrl(made, controlSocket);
    BIO_meth_set_create(made, createSocket);
    return made;
  }();
  return method;
}

bool isIpAddress(const std::string& host) {
  unsigned char bytes[16];
  return ::inet_pton(AF_INET, host.c_str(), bytes) == 1 || ::inet_pton(AF_INET6, host.c_str(), bytes) == 1;
}

int lengthOf(std::size_t size) {
  constexpr std::size_t kMaxRecord = 16384;  // RFC 8446, section 5.1
  return static_cast<int>(std::min(size, kMaxRecord));
}

}  // namespace

void TlsEngine::FreeSsl::operator()(ssl_st* ssl) const {
  SSL_free(ssl);
}

TlsEngine::TlsEngine(const TlsContext& context, int socket) : ssl_(SSL_new(context.get())) {
  BIO* bio = BIO_new(socketMethod());
  LUMIGRID_CHECK(ssl_ != nullptr && bio != nullptr);  // fail only without memory
  BIO_set_data(bio, reinterpret_cast<void*>(static_cast<std::intptr_t>(socket)));
  SSL_set_bio(ssl_.get(), bio, bio);
}

TlsEngine TlsEngine::forServer(const TlsContext& context, int socket) {
  TlsEngine engine(context, socket);
  SSL_set_accept_state(engine.ssl_.get());
  return engine;
}

TlsEngine TlsEngine::forClient(const TlsContext& context, int socket, const std::string& host) {
  TlsEngine engine(context, socket);
  SSL* ssl = engine.ssl_.get();
  SSL_set_connect_state(ssl);
  if (isIpAddress(host)) {
    LUMIGRID_CHECK(X509_VERIFY_PARAM_set1_ip_asc(SSL_get0_param(ssl), host.c_str()) == 1);
  } else {
    SSL_set_hostflags(ssl, X509_CHECK_FLAG_NO_PARTIAL_WILDCARDS);
    LUMIGRID_CHECK(SSL_set1_host(ssl, host.c_str()) == 1);
    // The name goes to servers of several hosts (SNI). OpenSSL's macro for this casts in the old style.
    std::string name = host;
    SSL_ctrl(ssl, SSL_CTRL_SET_TLSEXT_HOSTNAME, TLSEXT_NAMETYPE_host_name, name.data());
  }
  return engine;
}

TlsEngine::Outcome TlsEngine::handshake() {
  ERR_clear_error();  // of others on this thread
  return outcomeOf(SSL_do_handshake(ssl_.get()));
}

TlsEngine::Outcome TlsEngine::read(std::span<std::uint8_t> out) {
  ERR_clear_error();
  return outcomeOf(SSL_read(ssl_.get(), out.data(), lengthOf(out.size())));
}

TlsEngine::Outcome TlsEngine::write(ByteView bytes) {
  ERR_clear_error();
  return outcomeOf(SSL_write(ssl_.get(), bytes.data(), lengthOf(bytes.size())));
}

void TlsEngine::sendClose() {
  if (broken_ || SSL_in_init(ssl_.get()) != 0) return;
  SSL_shutdown(ssl_.get());
  ERR_clear_error();
}

bool TlsEngine::isPeerGone() {
  ERR_clear_error();
  std::uint8_t byte = 0;
  const Outcome outcome = outcomeOf(SSL_peek(ssl_.get(), &byte, 1));
  return outcome.step == Step::kClosed || outcome.step == Step::kFailed;
}

TlsEngine::Outcome TlsEngine::outcomeOf(int returned) {
  const int saved_errno = errno;
  const int error = SSL_get_error(ssl_.get(), returned);
  switch (error) {
    case SSL_ERROR_NONE:
      return {Step::kDone, static_cast<std::size_t>(std::max(returned, 0))};
    case SSL_ERROR_WANT_READ:
      return {Step::kWantsToRead};
    case SSL_ERROR_WANT_WRITE:
      return {Step::kWantsToWrite};
    case SSL_ERROR_ZERO_RETURN:
      return {Step::kClosed};
    case SSL_ERROR_SYSCALL:
      broken_ = true;
      system_error_ = saved_errno != 0 ? saved_errno : ECONNRESET;
      problem_ = std::strerror(system_error_);
      ERR_clear_error();
      return {Step::kFailed};
    default:
      broken_ = true;
      explainFailure();
      return {Step::kFailed};
  }
}

void TlsEngine::explainFailure() {
  const unsigned long code = ERR_peek_error();
  const long verified = SSL_get_verify_result(ssl_.get());
  met_plain_http_ = ERR_GET_LIB(code) == ERR_LIB_SSL && ERR_GET_REASON(code) == SSL_R_HTTP_REQUEST;
  const char* reason = ERR_reason_error_string(code);
  if (verified != X509_V_OK && ERR_GET_REASON(code) == SSL_R_CERTIFICATE_VERIFY_FAILED)
    problem_ = std::string("its certificate is refused: ") + X509_verify_cert_error_string(verified);
  else
    problem_ = reason != nullptr ? reason : "TLS failed";
  ERR_clear_error();
}

}  // namespace base
