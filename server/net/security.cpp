#include "server/net/security.h"

#include <algorithm>
#include <chrono>
#include <utility>

#include "server/net/scene_names.h"
#include "server/net/server.h"
#include "spdlog/spdlog.h"

namespace server {
namespace {

/// The answer to a link to a scene's folder that lacks the slash at its end. A cookie made here would be for the folder
/// above, and so be sent to all scenes of the host. So it leads to the folder, where the link becomes a cookie.
std::optional<HttpReply> moveIntoFolder(std::string_view target, std::string_view scene) {
  const NamedTarget named = splitTarget(target);
  if (named.name != scene || !named.rest.empty()) return std::nullopt;
  const std::string folder = "./" + std::string(scene) + "/";
  const std::size_t query = std::min(target.find('?'), target.size());
  return textReply(303, "see " + folder + "\n", {{"Location", folder + std::string(target.substr(query))}});
}

HttpReply replyOf(const Refusal& refusal) {
  return textReply(refusal.status, refusal.line + "\n", refusal.fields);
}

}  // namespace

base::Result<std::shared_ptr<const Security>> Security::read(const ServerOptions& options,
                                                             std::vector<std::string> scene_names) {
  if (options.certificate_file.empty() != options.key_file.empty())
    return base::Error{base::ErrorCode::kInvalidInput,
                       "--certificate and --key belong together; add the one that is missing"};
  LUMIGRID_ASSIGN_OR_RETURN(auto rules, AccessRules::make(options.access, options.address));
  base::TlsContext tls;
  if (!options.certificate_file.empty()) {
    LUMIGRID_ASSIGN_OR_RETURN(auto loaded,
                              base::loadServerTls(options.certificate_file, options.key_file, secondsNow()));
    if (!loaded.warning.empty()) spdlog::warn("{}", loaded.warning);
    tls = std::move(loaded.context);
  }
  for (const std::string& line : rules.warnings(scene_names, secondsNow())) spdlog::warn("{}", line);
  return std::make_shared<const Security>(Security{std::move(rules), std::move(tls), std::move(scene_names)});
}

std::optional<HttpReply> Security::answerInstead(const RequestHead& request, std::optional<std::string_view> scene,
                                                 std::int64_t now) const {
  if (const auto refusal = rules.origins().check(request)) return replyOf(*refusal);
  if (!rules.isPrivate()) return std::nullopt;
  if (request.method == "OPTIONS") return preflightReply();  // for all names alike, so that it tells of none
  const std::vector<std::string> wanted = scene ? std::vector<std::string>{std::string(*scene)} : scene_names;
  if (const auto cleaned = rules.cleanAddress(wanted, request, now)) {
    auto reply = scene ? moveIntoFolder(request.target, *scene) : std::nullopt;
    if (!reply) {
      reply = textReply(303, "see " + cleaned->location + "\n", {{"Location", cleaned->location}});
      if (!cleaned->cookie.empty()) reply->headers.emplace_back("Set-Cookie", cleaned->cookie);
    }
    reply->cache = "no-store";
    return reply;
  }
  std::optional<HttpReply> refused;
  const AccessRules::Credentials credentials = rules.credentialsOf(request);
  for (const std::string& name : wanted) {
    const SceneAccess access = rules.accessTo(name, credentials, now);
    if (!access.refusal) return std::nullopt;
    refused = replyOf(*access.refusal);
    refused->cache = "no-store";
  }
  return refused;
}

std::optional<HttpReply> Security::refuseFigures(const RequestHead& request, std::int64_t now) const {
  if (const auto refusal = rules.origins().check(request)) return replyOf(*refusal);
  const AccessRules::Credentials credentials = rules.credentialsOf(request);
  for (const std::string& name : scene_names)
    if (const SceneAccess access = rules.accessTo(name, credentials, now); access.refusal)
      return replyOf(*access.refusal);
  return std::nullopt;
}

std::string Security::cacheControl(const char* of_reply) const {
  constexpr std::string_view kPublic = "public, ";
  std::string_view value = of_reply;
  if (!rules.isPrivate()) return of_reply;
  if (value.starts_with(kPublic)) value.remove_prefix(kPublic.size());
  return "private, " + std::string(value);
}

const char* refusalReason(const HttpReply& reply) {
  if (reply.status == 421) return "host";
  if (reply.status != 401 && reply.status != 403) return nullptr;
  for (const auto& [name, value] : reply.headers)
    if (name == "WWW-Authenticate") return "token";
  return "origin";
}

std::int64_t secondsNow() {
  return std::chrono::duration_cast<std::chrono::seconds>(std::chrono::system_clock::now().time_since_epoch()).count();
}

}  // namespace server
