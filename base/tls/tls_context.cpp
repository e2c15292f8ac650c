#include "base/tls/tls_context.h"

#include <openssl/err.h>
#include <openssl/pem.h>
#include <openssl/ssl.h>
#include <openssl/x509.h>

#include <ctime>

#include "base/check.h"
#include "base/file.h"

namespace base {
namespace {

constexpr std::int64_t kSecondsADay = 86400;
constexpr std::int64_t kDaysToWarn = 14;  // programs that renew certificates do so a month before the end

Error wrong(const std::string& path, const std::string& problem) {
  ERR_clear_error();
  return {ErrorCode::kInvalidInput, path + ": " + problem};
}

/// The passphrase of a key; without this OpenSSL asks for it at the terminal.
int refusePassphrase(char* /*buffer*/, int /*size*/, int /*writing*/, void* /*user*/) {
  return 0;
}

TlsContext makeContext(const SSL_METHOD* method) {
  TlsContext context(SSL_CTX_new(method), SSL_CTX_free);
  LUMIGRID_CHECK(context != nullptr);  // fails only without memory
  SSL_CTX* c = context.get();
  SSL_CTX_set_min_proto_version(c, TLS1_2_VERSION);
  // Forward secrecy and authenticated encryption; TLS 1.3 has nothing else.
  SSL_CTX_set_cipher_list(c, "ECDHE+AESGCM:ECDHE+CHACHA20");
  // A peer may ask for no second handshake, which costs us more than it. One that closes without saying so loses
  // nothing: HTTP and WebSocket tell how long their messages are.
  SSL_CTX_set_options(c, SSL_OP_NO_RENEGOTIATION | SSL_OP_NO_COMPRESSION | SSL_OP_IGNORE_UNEXPECTED_EOF);
  // Buffers of idle connections go back (2 × 17 KB each).
  SSL_CTX_set_mode(c, SSL_MODE_RELEASE_BUFFERS | SSL_MODE_ENABLE_PARTIAL_WRITE | SSL_MODE_ACCEPT_MOVING_WRITE_BUFFER);
  SSL_CTX_set_read_ahead(c, 0);
  SSL_CTX_set_default_passwd_cb(c, refusePassphrase);
  return context;
}

std::string dateOf(const ASN1_TIME* time) {
  std::tm parts{};
  if (ASN1_TIME_to_tm(time, &parts) != 1) return "a time that cannot be read";
  char text[32];
  return {text, std::strftime(text, sizeof text, "%Y-%m-%d %H:%M UTC", &parts)};
}

std::string warningOf(const X509* certificate, const std::string& path, std::int64_t now) {
  const auto compare = [](const ASN1_TIME* time, std::int64_t seconds) {
    std::time_t moment = seconds;
    return X509_cmp_time(time, &moment);  // below 0: `time` lies before
  };
  const ASN1_TIME* end = X509_get0_notAfter(certificate);
  if (compare(end, now) < 0)
    return path + ": the certificate has expired (" + dateOf(end) + "); clients will refuse it";
  if (compare(end, now + kDaysToWarn * kSecondsADay) < 0)
    return path + ": the certificate expires soon (" + dateOf(end) + ")";
  const ASN1_TIME* begin = X509_get0_notBefore(certificate);
  if (compare(begin, now) > 0) return path + ": the certificate is valid only from " + dateOf(begin) + " on";
  return "";
}

}  // namespace

Result<ServerTls> loadServerTls(const std::string& certificate_file, const std::string& key_file, std::int64_t now) {
  // Read for the error: it tells an absent file from one that may not be read.
  if (auto bytes = readFile(certificate_file); !bytes) return within("the certificate", bytes.error());
  if (auto bytes = readFile(key_file); !bytes) return within("the certificate's key", bytes.error());

  ServerTls tls{makeContext(TLS_server_method()), ""};
  SSL_CTX* context = tls.context.get();
  SSL_CTX_set_session_cache_mode(context, SSL_SESS_CACHE_OFF);  // tickets do it, and they are the client's to keep
  SSL_CTX_set_num_tickets(context, 1);
  if (SSL_CTX_use_certificate_chain_file(context, certificate_file.c_str()) != 1)
    return wrong(certificate_file, "is no certificate in PEM (a text that begins with -----BEGIN CERTIFICATE-----)");
  if (SSL_CTX_use_PrivateKey_file(context, key_file.c_str(), SSL_FILETYPE_PEM) != 1) {
    // OpenSSL compares the key with the certificate already here.
    const unsigned long code = ERR_peek_last_error();
    if (ERR_GET_LIB(code) == ERR_LIB_X509) return wrong(key_file, "is not the key of " + certificate_file);
    return wrong(key_file, "is no private key in PEM without a passphrase (-----BEGIN PRIVATE KEY-----)");
  }
  if (SSL_CTX_check_private_key(context) != 1) return wrong(key_file, "is not the key of " + certificate_file);
  ERR_clear_error();
  tls.warning = warningOf(SSL_CTX_get0_certificate(context), certificate_file, now);
  return tls;
}

Result<TlsContext> makeClientTls(const std::string& ca_file) {
  TlsContext context = makeContext(TLS_client_method());
  SSL_CTX_set_verify(context.get(), SSL_VERIFY_PEER, nullptr);
  SSL_CTX_set_default_verify_paths(context.get());  // a system without any is found out by the first connection
  if (!ca_file.empty()) {
    if (auto bytes = readFile(ca_file); !bytes) return bytes.error();
    if (SSL_CTX_load_verify_file(context.get(), ca_file.c_str()) != 1)
      return wrong(ca_file, "has no certificate in PEM (a text that begins with -----BEGIN CERTIFICATE-----)");
  }
  ERR_clear_error();
  return context;
}

}  // namespace base
