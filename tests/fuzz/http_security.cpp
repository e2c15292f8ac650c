// Heads of HTTP requests, with any bytes in them, before servers that are open, private, or behind proxies. Whoever is
// let in to a private scene has shown one of its tokens or links, and no answer tells one to who has not. Beast reads
// heads in the server; here a few lines do, which take all heads that Beast takes and more, so that this program
// compiles without it.
#include <algorithm>
#include <array>
#include <memory>
#include <optional>
#include <string>

#include "base/check.h"
#include "base/file.h"
#include "server/auth/access_rules.h"
#include "server/net/scene_names.h"
#include "server/net/security.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/scratch_directory.h"

namespace fuzz {
namespace {

constexpr std::int64_t kNow = 1'800'000'000;
const std::string kKey = "key-that-signs-links-of-the-fuzzed-server";
const std::string kOfAll = "token-of-all-the-scenes", kOfTower = "token-of-the-tower", kExpired = "token-of-yesterday";
const std::string kScenesHost = "scenes.example", kPagesOrigin = "https://page.example";

// ---- Heads

/// The fields of a head that decide, those that may stand there several times joined as the server joins them.
struct Head {
  std::string method, target, host, origin, authorization, cookie, fetch_site, fetch_mode, forwarded_for,
      forwarded_proto, upgrade, connection;
  bool is_upgrade = false;

  server::RequestHead view(bool is_secure) const {
    return {method, target, host, origin, authorization, cookie, fetch_site, fetch_mode, is_upgrade, is_secure};
  }
};

std::string lowerCase(std::string text) {
  for (char& c : text)
    if (c >= 'A' && c <= 'Z') c = static_cast<char>(c - 'A' + 'a');
  return text;
}

bool isControl(char c) {
  return static_cast<unsigned char>(c) < 0x20 || c == 0x7F;
}

std::string_view takeUntil(std::string_view& rest, char separator) {
  const std::size_t end = std::min(rest.find(separator), rest.size());
  const std::string_view piece = rest.substr(0, end);
  rest.remove_prefix(std::min(end + 1, rest.size()));
  return piece;
}

std::string_view takeLine(std::string_view& rest) {
  std::string_view line = takeUntil(rest, '\n');
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

std::string_view withoutSpaces(std::string_view text) {
  while (!text.empty() && (text.front() == ' ' || text.front() == '\t')) text.remove_prefix(1);
  while (!text.empty() && (text.back() == ' ' || text.back() == '\t')) text.remove_suffix(1);
  return text;
}

/// A field that the server reads once has its first value.
void takeField(Head& head, const std::string& name, std::string_view value) {
  const std::array<std::pair<const char*, std::string*>, 7> once{{{"host", &head.host},
                                                                  {"origin", &head.origin},
                                                                  {"authorization", &head.authorization},
                                                                  {"sec-fetch-site", &head.fetch_site},
                                                                  {"sec-fetch-mode", &head.fetch_mode},
                                                                  {"upgrade", &head.upgrade},
                                                                  {"connection", &head.connection}}};
  for (const auto& [known, field] : once)
    if (name == known && field->empty()) *field = value;
  const auto join = [&](std::string& all, char separator) {
    if (!all.empty()) all += separator;
    all += value;
  };
  if (name == "cookie") join(head.cookie, ';');
  if (name == "x-forwarded-for") join(head.forwarded_for, ',');
  if (name == "x-forwarded-proto") join(head.forwarded_proto, ',');
}

/// Nothing for bytes that no HTTP server takes for the head of a request.
std::optional<Head> parseHead(std::string_view text) {
  std::string_view line = takeLine(text);
  Head head;
  head.method = takeUntil(line, ' ');
  head.target = takeUntil(line, ' ');
  if (head.method.empty() || head.target.empty() || !line.starts_with("HTTP/1.")) return std::nullopt;
  if (std::any_of(head.method.begin(), head.method.end(), isControl)) return std::nullopt;
  if (std::any_of(head.target.begin(), head.target.end(), isControl)) return std::nullopt;
  while (!text.empty() && !(line = takeLine(text)).empty()) {
    const std::string name = lowerCase(std::string(takeUntil(line, ':')));
    const std::string_view value = withoutSpaces(line);
    if (std::any_of(value.begin(), value.end(), [](char c) { return c != '\t' && isControl(c); })) return std::nullopt;
    takeField(head, name, value);
  }
  head.is_upgrade = head.method == "GET" && lowerCase(head.upgrade).find("websocket") != std::string::npos &&
                    lowerCase(head.connection).find("upgrade") != std::string::npos;
  return head;
}

// ---- Servers

struct TestServer {
  server::Security security;
  bool has_tokens = false, has_keys = false, is_at_root = false;
  bool has_names = false;  ///< it answers by some names only
  bool has_pages = false;  ///< it answers kPagesOrigin
};

/// Two scenes at "/tower/" and "/bridge/", but for a server whose tower is at "/".
class TestServers {
 public:
  TestServers() {
    write("key", kKey + "\n");
    write("tokens", R"([{"token": ")" + kOfAll + R"(", "scenes": "all"}, {"token": ")" + kOfTower +
                        R"(", "scenes": ["tower"]}, {"token": ")" + kExpired + R"(", "scenes": "all", "expires": )" +
                        std::to_string(kNow) + "}]");
    const std::string tokens = directory_ / "tokens", key = directory_ / "key";
    add({.is_public = true, .is_open = true}, "0.0.0.0");
    add({.is_public = true, .is_open = true, .origins = {kPagesOrigin}}, "0.0.0.0");
    add({}, "127.0.0.1");
    add({.token_file = tokens, .is_public = true, .hosts = {kScenesHost}}, "0.0.0.0");
    add({.signing_keys = key, .is_public = true, .origins = {kPagesOrigin}}, "::");
    add({.token_file = tokens, .signing_keys = key, .trusted_proxies = {"127.0.0.1", "10.0.0.0/8", "2001:db8::/32"}},
        "unix:/run/lumigrid.sock");
    add({.token_file = tokens, .signing_keys = key, .hosts = {kScenesHost}}, "127.0.0.1");
    all_.back().is_at_root = true;
    all_.back().security.scene_names = {"tower"};
    auto keys = server::SigningKeys::read(key);
    LUMIGRID_CHECK(bool(keys));
    of_tower = keys->sign("tower", kNow + 3600);
    of_bridge = keys->sign("bridge", kNow + 60);
    expired = keys->sign("tower", kNow);
  }
  const std::vector<TestServer>& all() const { return all_; }

  server::LinkGrant of_tower, of_bridge, expired;

 private:
  void write(const char* name, const std::string& text) const {
    LUMIGRID_CHECK(bool(base::writeFileAtomically(directory_ / name, base::viewOfText(text))));
  }
  void add(const server::AccessOptions& options, const std::string& address) {
    auto rules = server::AccessRules::make(options, address);
    LUMIGRID_CHECK(bool(rules));
    all_.push_back({{std::move(*rules), nullptr, {"tower", "bridge"}},
                    !options.token_file.empty(),
                    !options.signing_keys.empty(),
                    false,
                    !options.hosts.empty() || (server::isLocalAddress(address) && !options.is_open),
                    !options.origins.empty()});
  }

  support::ScratchDirectory directory_;
  std::vector<TestServer> all_;
};

const TestServers& servers() {
  static const TestServers made;
  return made;
}

// ---- Checks

/// Whether the head shows a secret in one of the places where one counts.
bool shows(const Head& head, const std::string& secret) {
  for (const std::string* place : {&head.authorization, &head.target, &head.cookie})
    if (place->find(secret) != std::string::npos) return true;
  return false;
}

/// The rules are compared with this: since nobody can make a link, the only good ones are those known here.
bool showsKeyTo(const std::string& scene, const Head& head, const TestServer& server) {
  if (server.has_tokens && (shows(head, kOfAll) || (scene == "tower" && shows(head, kOfTower)))) return true;
  if (!server.has_keys) return false;
  return (scene == "tower" && shows(head, servers().of_tower.signature)) ||
         (scene == "bridge" && shows(head, servers().of_bridge.signature));
}

bool showsKeyToOneOf(const std::vector<std::string>& scenes, const Head& head, const TestServer& server) {
  return std::any_of(scenes.begin(), scenes.end(),
                     [&](const std::string& scene) { return showsKeyTo(scene, head, server); });
}

/// A host and port without the ports that both schemes have anyway.
std::string_view withoutUsualPorts(std::string_view host) {
  while (host.ends_with(":443") || host.ends_with(":80")) host = host.substr(0, host.rfind(':'));
  return host;
}

bool isPageAllowed(const Head& head, const TestServer& server) {
  if (head.origin.empty() || server.security.rules.origins().isForAnyOrigin()) return true;
  const std::string origin = lowerCase(head.origin), host = lowerCase(head.host);
  const std::size_t begin = origin.find("//");
  if (begin == std::string::npos) return false;
  return (server.has_pages && withoutUsualPorts(origin) == kPagesOrigin) ||
         (!host.empty() && withoutUsualPorts(std::string_view(origin).substr(begin + 2)) == withoutUsualPorts(host));
}

bool isNameAllowed(const Head& head, const TestServer& server) {
  const std::string host = lowerCase(head.host);
  if (host.empty() || host.starts_with('[') || !server.has_names) return true;
  std::string_view name = std::string_view(host).substr(0, host.find(':'));
  if (name.ends_with('.')) name.remove_suffix(1);
  if (name == "localhost" || name.ends_with(".localhost") || name == kScenesHost) return true;
  return name.starts_with("127.") && name.find_first_not_of("0123456789.") == name.npos;
}

void checkFields(const server::HeaderFields& fields) {
  for (const auto& [name, value] : fields) {
    LUMIGRID_CHECK(!name.empty());
    LUMIGRID_CHECK(std::none_of(value.begin(), value.end(), isControl));
  }
}

/// A credential in the address an answer leads to would go on into the browser's history and to other hosts.
bool namesCredential(std::string_view location) {
  takeUntil(location, '?');
  while (!location.empty()) {
    const std::string_view part = takeUntil(location, '&');
    const std::string_view name = part.substr(0, part.find('='));
    if (name == "token" || name == "expires" || name == "signature") return true;
  }
  return false;
}

void checkRedirect(const server::HttpReply& reply, const Head& head, const TestServer& server,
                   const std::vector<std::string>& scenes) {
  LUMIGRID_CHECK(server.security.rules.isPrivate() && showsKeyToOneOf(scenes, head, server));
  LUMIGRID_CHECK(std::string_view(reply.cache) == "no-store");
  LUMIGRID_CHECK(!reply.headers.empty() && reply.headers.front().first == "Location");
  const std::string& location = reply.headers.front().second;
  LUMIGRID_CHECK(location.starts_with("./"));
  const bool into_folder = location.find('/', 2) < location.find('?');
  LUMIGRID_CHECK(into_folder || !namesCredential(location));
  if (reply.headers.size() == 1) return;
  LUMIGRID_CHECK(!into_folder && reply.headers.size() == 2 && reply.headers[1].first == "Set-Cookie");
  const std::string& cookie = reply.headers[1].second;
  LUMIGRID_CHECK(cookie.find("; HttpOnly; SameSite=Lax") != std::string::npos);
  LUMIGRID_CHECK(std::count(cookie.begin(), cookie.end(), '=') <= 3);
}

void checkReply(const server::HttpReply& reply, const Head& head, const TestServer& server,
                const std::vector<std::string>& scenes) {
  checkFields(reply.headers);
  std::string said(base::textOf(reply.body()));
  for (const auto& [name, value] : reply.headers) said += "\n" + value;
  LUMIGRID_CHECK(said.find(kKey) == std::string::npos || head.target.find(kKey) != std::string::npos);
  for (const std::string& secret : {kOfAll, kOfTower, servers().of_tower.signature, servers().of_bridge.signature})
    LUMIGRID_CHECK(said.find(secret) == std::string::npos ||
                   (reply.status == 303 && head.target.find(secret) != std::string::npos));
  if (reply.status == 303) return checkRedirect(reply, head, server, scenes);
  const bool refuses = reply.status == 401 || reply.status == 403 || reply.status == 421;
  LUMIGRID_CHECK(refuses == (server::refusalReason(reply) != nullptr));
  LUMIGRID_CHECK(refuses || (reply.status == 204 && head.method == "OPTIONS"));
}

void checkLetIn(const Head& head, const TestServer& server, const std::vector<std::string>& scenes) {
  LUMIGRID_CHECK(isPageAllowed(head, server) && isNameAllowed(head, server));
  LUMIGRID_CHECK(!server.security.rules.isPrivate() || showsKeyToOneOf(scenes, head, server));
}

/// Decides as Hub::answerInstead() does.
void checkDecision(const Head& head, const TestServer& server, bool is_secure) {
  const server::Security& security = server.security;
  const server::RequestHead request = head.view(is_secure);
  const server::NamedTarget named = server::splitTarget(head.target);
  std::optional<std::string_view> scene;
  if (server.is_at_root)
    scene = "tower";
  else if (!named.name.empty())
    scene = named.name;
  const std::vector<std::string> scenes = scene ? std::vector<std::string>{std::string(*scene)} : security.scene_names;
  if (const auto reply = security.answerInstead(request, scene, kNow))
    checkReply(*reply, head, server, scenes);
  else
    checkLetIn(head, server, scenes);
  for (const std::string& name : security.scene_names)
    LUMIGRID_CHECK(!security.opens(name, request, kNow) || !security.rules.isPrivate() ||
                   showsKeyTo(name, head, server));
  if (const auto refused = security.refuseFigures(request, kNow))
    checkReply(*refused, head, server, security.scene_names);
  else
    for (const std::string& name : security.scene_names) checkLetIn(head, server, {name});
  checkFields(security.rules.origins().fields(request));
}

/// The client is who the last proxy that is trusted tells, whatever others have written before that.
void checkClient(const Head& head, const server::TrustedProxies& proxies) {
  const server::IpAddress proxy = *server::parseIpAddress("10.1.2.3"), other = *server::parseIpAddress("203.0.113.9");
  LUMIGRID_CHECK(proxies.clientAddress(other, head.forwarded_for) == other);
  LUMIGRID_CHECK(!proxies.cameByTls(other, head.forwarded_proto));
  if (!proxies.contains(proxy)) return;
  const server::IpAddress client = proxies.clientAddress(proxy, head.forwarded_for);
  LUMIGRID_CHECK(server::parseIpAddress(client.text()) == client);
  LUMIGRID_CHECK(!server::limitKey(client.text()).empty());
  if (!proxies.contains(client))
    LUMIGRID_CHECK(proxies.clientAddress(proxy, "198.51.100.7," + head.forwarded_for) == client);
  LUMIGRID_CHECK(proxies.clientAddress(proxy, head.forwarded_for + ",203.0.113.9") == other);
}

base::Bytes request(const std::string& text) {
  return {text.begin(), text.end()};
}

}  // namespace

std::vector<base::Bytes> seeds() {
  const auto link = [](const std::string& path, const server::LinkGrant& grant) {
    return request("GET " + server::signedUrl(path, grant) + " HTTP/1.1\r\nHost: scenes.example\r\n\r\n");
  };
  const TestServers& made = servers();
  const std::string websocket = "Connection: Upgrade\r\nUpgrade: websocket\r\nSec-WebSocket-Version: 13\r\n";
  return {
      request("GET /tower/scene.json HTTP/1.1\r\nHost: localhost:8080\r\nAuthorization: Bearer " + kOfAll +
              "\r\nOrigin: http://localhost:8080\r\n\r\n"),
      request("GET /tower/?token=" + kOfTower + "&view=1 HTTP/1.1\r\nHost: [::1]:80\r\n\r\n"),
      request("GET /bridge?token=" + kOfAll + " HTTP/1.1\r\nX-Forwarded-Proto: https\r\n\r\n"),
      request("GET /bridge/ws HTTP/1.1\r\nHost: scenes.example\r\n" + websocket +
              "Cookie: a=b; lumigrid-0123abcd=" + made.of_bridge.text() + "\r\nOrigin: https://page.example\r\n\r\n"),
      link("/tower/", made.of_tower),
      link("/bridge/render?width=3", made.of_bridge),
      link("/tower/", made.expired),
      request("HEAD /tower/ HTTP/1.1\r\nAuthorization: Bearer " + kExpired + "\r\nCookie: lumigrid-1=" + kOfTower +
              "\r\nCookie: lumigrid-2=" + made.expired.text() + "\r\nSec-Fetch-Site: cross-site\r\n" +
              "Sec-Fetch-Mode: navigate\r\n\r\n"),
      request("GET /tower/ HTTP/1.1\r\nHost: scenes.example\r\nOrigin: https://scenes.example.org\r\nAuthorization: "
              "Bearer " +
              kOfAll + "\r\n\r\n"),
      request("GET /bridge/ HTTP/1.1\r\nHost: Scenes.Example.:443\r\nOrigin: https://page.example:443\r\nCookie: "
              "lumigrid-3=" +
              made.of_bridge.text() + "\r\n\r\n"),
      request("OPTIONS * HTTP/1.1\r\nHost: 127.0.0.1\r\nOrigin: null\r\n\r\n"),
      request("GET / HTTP/1.0\r\nX-Forwarded-For: 198.51.100.7, 10.0.0.1:4711\r\nX-Forwarded-For: "
              "[2001:db8::1]:80\r\nX-Forwarded-Proto: http,https\r\n\r\n")};
}

void fuzzOne(base::ByteView bytes) {
  const auto head = parseHead(base::textOf(bytes));
  if (!head) return;
  for (const TestServer& server : servers().all()) {
    const server::TrustedProxies& proxies = server.security.rules.proxies();
    checkClient(*head, proxies);
    const server::IpAddress peer = *server::parseIpAddress("10.1.2.3");
    checkDecision(*head, server, proxies.cameByTls(peer, head->forwarded_proto));
  }
}

}  // namespace fuzz
