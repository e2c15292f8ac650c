#pragma once
// The parts of an HTTP request that decide who may have an answer, and the refusals. Knows no sockets.
#include <cstdint>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace server {

/// Absent fields are empty. Of fields that may stand there several times, all values are joined with commas, cookies
/// with semicolons.
struct RequestHead {
  std::string_view method, target, host, origin, authorization, cookie, fetch_site, fetch_mode;
  bool is_upgrade = false;  ///< asks for a WebSocket
  bool is_secure = false;   ///< came by TLS, to us or to a trusted proxy
};

using HeaderFields = std::vector<std::pair<std::string, std::string>>;

/// An answer that tells why there is none.
struct Refusal {
  int status = 403;
  std::string line;  ///< for the visitor, without a line end
  HeaderFields fields = {};
};

}  // namespace server
