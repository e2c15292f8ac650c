#pragma once
// Which web pages may ask a server, and by which names it may be asked. A browser sends what any page tells it to; so
// without these rules a page on the web could read a server that only its visitor's machine or network can reach, by
// its address or by a name of the page's own that leads there (DNS rebinding).
#include <optional>
#include <string>
#include <vector>

#include "base/error.h"
#include "server/auth/request_head.h"

namespace server {

struct OriginOptions {
  std::string address = {};               ///< the one that the server listens at
  bool is_open = false;                   ///< anybody may see all scenes
  std::vector<std::string> origins = {};  ///< "https://example.org", which may ask besides the server's own pages
  std::vector<std::string> hosts = {};    ///< names by which the server may be asked
};

/// Pages of an open server without `origins` may come from anywhere; else from the server itself (Origin names the
/// host that is asked) and from `origins`. A server that listens at a loopback address and is not open answers by
/// loopback names, the address itself and `hosts` only, all others by any name, or by `hosts` where there are some.
class OriginRules {
 public:
  /// Errors name an origin or a host that is none.
  static base::Result<OriginRules> make(const OriginOptions& options);

  /// Nothing for a request that may be answered. A request without Host comes from no browser, and may; a Host that can
  /// be no name is answered by no server.
  std::optional<Refusal> check(const RequestHead& request) const;
  /// Fields that let browsers hand the answer to the pages that may read it (CORS), and to no others.
  HeaderFields fields(const RequestHead& request) const;
  bool isForAnyOrigin() const { return any_origin_; }

 private:
  bool isHostAllowed(const RequestHead& request) const;
  bool isOriginAllowed(const RequestHead& request) const;
  bool isOwnOrigin(const RequestHead& request) const;
  bool isListed(const RequestHead& request) const;

  bool any_origin_ = false;
  bool any_host_ = false;
  bool loopback_names_ = false;
  std::vector<std::string> origins_;  // normalized
  std::vector<std::string> hosts_;    // lower case, without ports
};

/// Whether a server that listens at this address can be reached from its own machine alone: a loopback address, or a
/// Unix socket ("unix:/path").
bool isLocalAddress(const std::string& address);

}  // namespace server
