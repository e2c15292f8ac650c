#pragma once
// TLS connections of one side share a context: a server's certificate and key, or the authorities that a client
// trusts. TLS 1.2 and 1.3 only (RFC 8996 retires the older ones).
#include <cstdint>
#include <memory>
#include <string>

#include "base/error.h"

struct ssl_ctx_st;  // OpenSSL's SSL_CTX

namespace base {

/// Connections keep the one that they began with, so that it may be replaced at any time.
using TlsContext = std::shared_ptr<ssl_ctx_st>;

struct ServerTls {
  TlsContext context;
  std::string warning;  ///< one line about a certificate that is not valid now, or soon no longer; empty: none
};
/// Reads a certificate, with those between it and its authority behind it, and its key, both in PEM. `now`: Unix
/// seconds. Errors name the file and what is wrong with it: missing, not PEM, the key of another certificate. A
/// certificate that has expired is a warning, as the clients decide.
Result<ServerTls> loadServerTls(const std::string& certificate_file, const std::string& key_file, std::int64_t now);

/// Trusts the authorities of this system, and those of `ca_file` (PEM) where it is not empty. Errors name the file.
Result<TlsContext> makeClientTls(const std::string& ca_file);

}  // namespace base
