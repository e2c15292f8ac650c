#pragma once
// How a server is kept from those who shall not see it: its rules on who may, and TLS. Both are read from files, and
// again on SIGHUP.
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/error.h"
#include "base/tls/tls_context.h"
#include "server/auth/access_rules.h"
#include "server/net/site.h"

namespace server {

struct ServerOptions;

/// Not changed once it is made, so that a connection may keep what it began with.
struct Security {
  AccessRules rules;
  base::TlsContext tls;                  ///< null: plain TCP
  std::vector<std::string> scene_names;  ///< of all scenes, as tokens and links name them

  /// Reads the files that the options name. Errors are one line; what is odd but no error goes to the log.
  static base::Result<std::shared_ptr<const Security>> read(const ServerOptions& options,
                                                            std::vector<std::string> scene_names);

  /// The answer to a request that gets no other: one by another name or from another host's page, without a credential
  /// for the scene, or with one in its address, which is moved to the address without. `scene`: the one that is
  /// addressed, whether it exists or not; nothing for the list of all.
  std::optional<HttpReply> answerInstead(const RequestHead& request, std::optional<std::string_view> scene,
                                         std::int64_t now) const;
  /// The answer to who asks for figures on all scenes and may not see them all.
  std::optional<HttpReply> refuseFigures(const RequestHead& request, std::int64_t now) const;
  /// Whether the visitor may see the scene.
  bool opens(const std::string& scene, const RequestHead& request, std::int64_t now) const {
    return !rules.accessTo(scene, request, now).refusal;
  }
  /// The value of Cache-Control: no shared cache may keep what is private.
  std::string cacheControl(const char* of_reply) const;
};

/// The word of the metrics for a refusal of answerInstead(): "token", "origin" or "host"; null for another answer.
const char* refusalReason(const HttpReply& reply);

/// Unix seconds.
std::int64_t secondsNow();

}  // namespace server
