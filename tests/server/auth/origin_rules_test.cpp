#include "server/auth/origin_rules.h"

#include <gtest/gtest.h>

namespace server {
namespace {

OriginRules rulesOf(const OriginOptions& options) {
  auto rules = OriginRules::make(options);
  EXPECT_TRUE(bool(rules)) << rules.error().message;
  return *rules;
}

int statusOf(const OriginRules& rules, const RequestHead& request) {
  const auto refusal = rules.check(request);
  return refusal ? refusal->status : 200;
}

std::string field(const HeaderFields& fields, const std::string& name) {
  for (const auto& [key, value] : fields)
    if (key == name) return value;
  return "";
}

RequestHead requestOf(std::string_view host, std::string_view origin = {}) {
  RequestHead request;
  request.method = "GET";
  request.target = "/";
  request.host = host;
  request.origin = origin;
  return request;
}

TEST(OriginRules, aLocalServerAnswersByItsOwnNamesAlone) {
  const OriginRules rules = rulesOf({.address = "127.0.0.1"});
  for (const char* host : {"127.0.0.1:8080", "localhost", "LOCALHOST:9000", "localhost.:8080", "[::1]:8080",
                           "127.0.0.2", "scene.localhost", ""})
    EXPECT_EQ(statusOf(rules, requestOf(host)), 200) << host;
  // A page's own name that leads here, and tries to look like one of ours.
  for (const char* host : {"evil.example:8080", "localhost.evil.example", "127.0.0.1.evil.example", "evil-localhost",
                           "[::2]:8080", "[evil.example]", "0.0.0.0:8080", "127.0.0.1 evil"})
    EXPECT_EQ(statusOf(rules, requestOf(host)), 421) << host;
}

TEST(OriginRules, aMalformedHostIsNoNameOfAnyServer) {
  for (const OriginOptions& options : {OriginOptions{.address = "127.0.0.1"}, OriginOptions{.address = "0.0.0.0"},
                                       OriginOptions{.address = "0.0.0.0", .is_open = true},
                                       OriginOptions{.address = "0.0.0.0", .hosts = {"scenes.example"}}}) {
    const OriginRules rules = rulesOf(options);
    for (const char* host :
         {"a,b.localhost", "localhost/x", "a b", "a@localhost", "a%2eb", "m\xC3\xBCller.localhost"}) {
      EXPECT_EQ(statusOf(rules, requestOf(host)), 421) << host;
      EXPECT_EQ(statusOf(rules, requestOf(host, "null")), 421) << host;
    }
  }
}

TEST(OriginRules, aTextThatIsNoOriginIsNobodysOwnPage) {
  for (const char* address : {"127.0.0.1", "0.0.0.0"}) {
    const OriginRules rules = rulesOf({.address = address});
    for (const char* host : {"127.0.0.1:8080", "a,b.localhost", "localhost"})
      for (const char* origin : {"null", "file://", "chrome-extension://x", "http://", "https://a b"})
        EXPECT_NE(statusOf(rules, requestOf(host, origin)), 200) << host << " " << origin;
    EXPECT_EQ(statusOf(rules, requestOf("127.0.0.1:8080", "null")), 403);
  }
}

TEST(OriginRules, noOtherHostsPageReadsALocalServer) {
  const OriginRules rules = rulesOf({.address = "::1"});
  EXPECT_EQ(statusOf(rules, requestOf("127.0.0.1:8080", "http://127.0.0.1:8080")), 200);
  EXPECT_EQ(statusOf(rules, requestOf("127.0.0.1:80", "http://127.0.0.1")), 200);
  for (const char* origin : {"https://evil.example", "http://127.0.0.1:3000", "http://localhost:8080", "null",
                             "http://127.0.0.1:8080.evil.example", "http://evil.example/127.0.0.1:8080"})
    EXPECT_EQ(statusOf(rules, requestOf("127.0.0.1:8080", origin)), 403) << origin;

  // An <img> or <script> of another page sends no Origin.
  RequestHead embedded = requestOf("127.0.0.1:8080");
  embedded.fetch_mode = "no-cors";
  for (const char* site : {"cross-site", "same-site"}) {
    embedded.fetch_site = site;
    EXPECT_EQ(statusOf(rules, embedded), 403) << site;
  }
  for (const char* site : {"same-origin", "none"}) {
    embedded.fetch_site = site;
    EXPECT_EQ(statusOf(rules, embedded), 200) << site;
  }
  RequestHead link = requestOf("127.0.0.1:8080");
  link.fetch_site = "cross-site";
  link.fetch_mode = "navigate";
  EXPECT_EQ(statusOf(rules, link), 200) << "a followed link";
  const HeaderFields fields = rules.fields(requestOf("127.0.0.1:8080", "http://127.0.0.1:8080"));
  EXPECT_EQ(field(fields, "Access-Control-Allow-Origin"), "");
  EXPECT_EQ(field(fields, "Cross-Origin-Resource-Policy"), "same-origin");
}

TEST(OriginRules, anOpenServerIsReadByAnyPage) {
  for (const char* address : {"127.0.0.1", "0.0.0.0"}) {
    const OriginRules rules = rulesOf({.address = address, .is_open = true});
    RequestHead request = requestOf("any.example", "https://page.example");
    request.fetch_site = "cross-site";
    EXPECT_EQ(statusOf(rules, request), 200);
    EXPECT_EQ(field(rules.fields(request), "Access-Control-Allow-Origin"), "*");
    EXPECT_EQ(field(rules.fields(request), "Cross-Origin-Resource-Policy"), "cross-origin");
  }
}

TEST(OriginRules, listedOriginsMayAskAndAreTold) {
  const OriginRules rules =
      rulesOf({.address = "0.0.0.0", .origins = {"https://Page.example/", "http://other.example:80"}});
  for (const char* origin : {"https://page.example", "https://page.example:443", "http://other.example"}) {
    const RequestHead request = requestOf("scenes.example", origin);
    EXPECT_EQ(statusOf(rules, request), 200) << origin;
    EXPECT_EQ(field(rules.fields(request), "Access-Control-Allow-Origin"), origin);
    EXPECT_EQ(field(rules.fields(request), "Vary"), "Origin");
  }
  for (const char* origin : {"http://page.example", "https://page.example:8443", "https://sub.page.example"}) {
    const RequestHead request = requestOf("scenes.example", origin);
    EXPECT_EQ(statusOf(rules, request), 403) << origin;
    EXPECT_EQ(field(rules.fields(request), "Access-Control-Allow-Origin"), "");
  }
  const OriginRules limited = rulesOf({.address = "0.0.0.0", .is_open = true, .origins = {"https://page.example"}});
  EXPECT_EQ(statusOf(limited, requestOf("scenes.example", "https://evil.example")), 403);
}

TEST(OriginRules, overTlsAPlainPageOfTheSameNameIsAnothers) {
  const OriginRules rules = rulesOf({.address = "0.0.0.0"});
  RequestHead request = requestOf("scenes.example", "http://scenes.example");
  EXPECT_EQ(statusOf(rules, request), 200);
  request.is_secure = true;
  EXPECT_EQ(statusOf(rules, request), 403);
  request.origin = "https://scenes.example";
  EXPECT_EQ(statusOf(rules, request), 200);
  request.is_secure = false;
  EXPECT_EQ(statusOf(rules, request), 200) << "TLS may end at a proxy that we do not know of";
}

TEST(OriginRules, namedHostsLimitAPublicServerAndWidenALocalOne) {
  const OriginRules anywhere = rulesOf({.address = "0.0.0.0", .hosts = {"Scenes.example", "2001:db8::1"}});
  EXPECT_EQ(statusOf(anywhere, requestOf("scenes.EXAMPLE:8080")), 200);
  EXPECT_EQ(statusOf(anywhere, requestOf("[2001:db8::1]:8080")), 200);
  EXPECT_EQ(statusOf(anywhere, requestOf("127.0.0.1:8080")), 421);
  const OriginRules behind_proxy = rulesOf({.address = "127.0.0.1", .hosts = {"scenes.example"}});
  EXPECT_EQ(statusOf(behind_proxy, requestOf("scenes.example")), 200);
  EXPECT_EQ(statusOf(behind_proxy, requestOf("127.0.0.1:8080")), 200);
  EXPECT_EQ(statusOf(behind_proxy, requestOf("evil.example")), 421);
}

TEST(OriginRules, whatIsNoOriginOrHostIsNamed) {
  for (const char* bad : {"", "*", "page.example", "ftp://page.example", "https://", "https://page.example/folder"}) {
    const auto rules = OriginRules::make({.address = "0.0.0.0", .origins = {bad}});
    ASSERT_FALSE(bool(rules)) << bad;
    EXPECT_NE(rules.error().message.find(std::string("--allow-origin: '") + bad), std::string::npos);
  }
  for (const char* bad : {"", "https://x", "a b", ":80", "a,b.example", "*.example"}) {
    const auto rules = OriginRules::make({.address = "0.0.0.0", .hosts = {bad}});
    ASSERT_FALSE(bool(rules)) << bad;
    EXPECT_NE(rules.error().message.find("--host"), std::string::npos);
  }
}

TEST(LocalAddress, isALoopbackOneOrAUnixSocket) {
  for (const char* local : {"127.0.0.1", "::1", "127.1.2.3", "unix:/run/lumigrid.sock"})
    EXPECT_TRUE(isLocalAddress(local)) << local;
  for (const char* other : {"0.0.0.0", "::", "192.168.1.2", "fe80::1"}) EXPECT_FALSE(isLocalAddress(other)) << other;
}

}  // namespace
}  // namespace server
