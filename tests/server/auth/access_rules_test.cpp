#include "server/auth/access_rules.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "base/file.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

constexpr std::int64_t kNow = 1'800'000'000;
constexpr const char* kAll = "token-of-all-the-scenes";
constexpr const char* kTower = "token-of-the-tower-alone";
constexpr const char* kOld = "token-that-has-expired";

class AccessRulesTest : public testing::Test {
 protected:
  void SetUp() override {
    write("key", std::string(32, 'k'));
    write("tokens.json", R"([{"token": "token-of-all-the-scenes", "scenes": "all"},
      {"token": "token-of-the-tower-alone", "scenes": ["tower"], "expires": 1800000100},
      {"token": "token-that-has-expired", "scenes": ["tower"], "expires": 1800000000}])");
    rules_.emplace(*AccessRules::make({.token_file = path("tokens.json"), .signing_keys = path("key")}, "127.0.0.1"));
    keys_.emplace(*SigningKeys::read(path("key")));
  }
  std::string path(const std::string& name) const { return directory_ / name; }
  void write(const std::string& name, const std::string& text) const {
    ASSERT_TRUE(base::writeFileAtomically(path(name), base::viewOfText(text)));
    std::filesystem::permissions(path(name), std::filesystem::perms::owner_read);
  }
  int statusOf(std::string_view scene, const RequestHead& request) const {
    const SceneAccess access = rules_->accessTo(scene, request, kNow);
    return access.refusal ? access.refusal->status : 200;
  }
  std::string lineOf(std::string_view scene, const RequestHead& request) const {
    const SceneAccess access = rules_->accessTo(scene, request, kNow);
    return access.refusal ? access.refusal->line : "";
  }
  static RequestHead get(std::string_view target) {
    RequestHead request;
    request.method = "GET";
    request.target = target;
    request.host = "127.0.0.1:8080";
    return request;
  }
  static RequestHead withHeader(std::string_view authorization) {
    RequestHead request = get("/tower/");
    request.authorization = authorization;
    return request;
  }
  std::string linkTo(const std::string& scene, std::int64_t expires) const {
    return signedUrl("/" + scene + "/", keys_->sign(scene, expires));
  }

  const support::TemporaryDirectory directory_;
  std::optional<AccessRules> rules_;
  std::optional<SigningKeys> keys_;
};

TEST_F(AccessRulesTest, theHeaderOpensWhatItsTokenIsFor) {
  EXPECT_EQ(statusOf("tower", withHeader("Bearer token-of-all-the-scenes")), 200);
  EXPECT_EQ(statusOf("hall", withHeader("bearer  token-of-all-the-scenes")), 200);
  EXPECT_EQ(statusOf("tower", withHeader("Bearer token-of-the-tower-alone")), 200);
  EXPECT_EQ(statusOf("hall", withHeader("Bearer token-of-the-tower-alone")), 403);
  EXPECT_EQ(statusOf("tower", withHeader("Bearer token-that-has-expired")), 401);
  EXPECT_EQ(statusOf("tower", withHeader("Bearer token-of-nobody-at-all")), 401);
  EXPECT_EQ(statusOf("tower", withHeader("Basic token-of-all-the-scenes")), 401);
  EXPECT_EQ(statusOf("tower", withHeader("Bearer ")), 401);
  EXPECT_EQ(statusOf("tower", withHeader("Bearer")), 401);
  EXPECT_EQ(statusOf("tower", get("/tower/")), 401);
  EXPECT_EQ(rules_->accessTo("tower", withHeader("Bearer token-of-the-tower-alone"), kNow).until, 1800000100);
  EXPECT_EQ(rules_->accessTo("tower", withHeader("Bearer token-of-all-the-scenes"), kNow).until, kNoEnd);
}

TEST_F(AccessRulesTest, eachRefusalSaysWhyAndChallenges) {
  const std::string none = lineOf("tower", get("/tower/"));
  const std::string expired = lineOf("tower", withHeader(std::string("Bearer ") + kOld));
  const std::string other = lineOf("hall", withHeader(std::string("Bearer ") + kTower));
  const std::string unknown = lineOf("tower", withHeader("Bearer token-of-nobody-at-all"));
  EXPECT_NE(none.find("private"), std::string::npos);
  EXPECT_NE(expired.find("expired"), std::string::npos);
  EXPECT_NE(other.find("other scenes"), std::string::npos);
  EXPECT_NE(unknown.find("not valid"), std::string::npos);
  for (const RequestHead& request : {get("/tower/"), withHeader("Bearer token-of-nobody-at-all")}) {
    const SceneAccess access = rules_->accessTo("tower", request, kNow);
    ASSERT_TRUE(access.refusal.has_value());
    ASSERT_EQ(access.refusal->fields.size(), 1U);
    EXPECT_EQ(access.refusal->fields[0].first, "WWW-Authenticate");
    EXPECT_TRUE(access.refusal->fields[0].second.starts_with("Bearer realm=\"lumigrid\""));
    EXPECT_EQ(access.refusal->fields[0].second.find("nobody"), std::string::npos);
    EXPECT_EQ(access.refusal->line.find("nobody"), std::string::npos);
  }
}

TEST_F(AccessRulesTest, aSignedLinkOpensItsSceneUntilItsTime) {
  const std::string link = linkTo("tower", kNow + 60);
  EXPECT_EQ(statusOf("tower", get(link)), 200);
  EXPECT_EQ(rules_->accessTo("tower", get(link), kNow).until, kNow + 60);
  EXPECT_EQ(statusOf("hall", get(link)), 401) << "replayed for another scene";
  EXPECT_EQ(statusOf("tower", get(linkTo("tower", kNow))), 401);
  EXPECT_NE(lineOf("tower", get(linkTo("tower", kNow))).find("expired"), std::string::npos);

  std::string changed = link;
  changed.back() = changed.back() == '0' ? '1' : '0';
  EXPECT_EQ(statusOf("tower", get(changed)), 401);
  std::string prolonged = link;
  prolonged.replace(prolonged.find("expires=") + 8, 10, std::to_string(kNow + 3600));
  EXPECT_EQ(statusOf("tower", get(prolonged)), 401);
  EXPECT_NE(lineOf("tower", get(prolonged)).find("not valid"), std::string::npos);
  EXPECT_EQ(statusOf("tower", get(link.substr(0, link.find("&signature")))), 401);
  // The same proof as a header, as the native client sends it.
  EXPECT_EQ(statusOf("tower", withHeader("Bearer " + keys_->sign("tower", kNow + 60).text())), 200);
}

TEST_F(AccessRulesTest, followingALinkLeavesACookieAndACleanAddress) {
  const std::vector<std::string> tower{"tower"};
  const auto by_token = rules_->cleanAddress(tower, get("/tower/?method=qsplat&token=token-of-all-the-scenes&x"), kNow);
  ASSERT_TRUE(by_token.has_value());
  EXPECT_EQ(by_token->location, "./?method=qsplat&x");
  EXPECT_TRUE(by_token->cookie.starts_with("lumigrid-")) << by_token->cookie;
  EXPECT_NE(by_token->cookie.find("=token-of-all-the-scenes; HttpOnly; SameSite=Lax"), std::string::npos);
  EXPECT_EQ(by_token->cookie.find("Max-Age"), std::string::npos);
  EXPECT_EQ(by_token->cookie.find("Secure"), std::string::npos);

  RequestHead request = get("/tower/");
  request.cookie = by_token->cookie;  // its attributes look like further cookies
  EXPECT_EQ(statusOf("tower", request), 200);

  const std::string link = linkTo("tower", kNow + 60);
  RequestHead secure = get(link);
  secure.is_secure = true;
  const auto by_link = rules_->cleanAddress(tower, secure, kNow);
  ASSERT_TRUE(by_link.has_value());
  EXPECT_EQ(by_link->location, "./");
  EXPECT_NE(by_link->cookie.find("; Max-Age=60"), std::string::npos) << by_link->cookie;
  EXPECT_NE(by_link->cookie.find("; Secure"), std::string::npos);
  request.cookie = by_link->cookie;
  EXPECT_EQ(statusOf("tower", request), 200);
  EXPECT_EQ(statusOf("hall", request), 401) << "the cookie is for its scene alone";
  EXPECT_EQ(rules_->accessTo("tower", request, kNow + 60).refusal->status, 401) << "a kept cookie ends with the link";
}

TEST_F(AccessRulesTest, theCleanAddressLeadsNowhereElse) {
  const std::vector<std::string> tower{"tower"};
  const auto location = [&](const std::string& path) {
    const std::string target = path + "?token=" + kAll;
    const auto cleaned = rules_->cleanAddress(tower, get(target), kNow);
    return cleaned ? cleaned->location : "none";
  };
  EXPECT_EQ(location("/tower"), "./tower");
  EXPECT_EQ(location("/tower/scene.json"), "./scene.json");
  EXPECT_EQ(location("//evil.example"), "./evil.example");
  EXPECT_EQ(location("/javascript:alert(1)"), "./javascript:alert(1)");
  EXPECT_EQ(location("https://evil.example"), "./evil.example");
}

TEST_F(AccessRulesTest, onlyGoodCredentialsInAddressesAreCleaned) {
  const std::vector<std::string> tower{"tower"};
  EXPECT_FALSE(rules_->cleanAddress(tower, get("/tower/?token=token-of-nobody-at-all"), kNow));
  EXPECT_FALSE(rules_->cleanAddress(tower, get("/tower/?method=qsplat"), kNow));
  RequestHead socket = get("/tower/?token=token-of-all-the-scenes");
  socket.is_upgrade = true;
  EXPECT_FALSE(rules_->cleanAddress(tower, socket, kNow));
  EXPECT_EQ(statusOf("tower", socket), 200);
  // A wrong link of somebody who is in already does not stay in the address either.
  RequestHead inside = get("/tower/?token=token-of-nobody-at-all");
  inside.cookie = "other=1; lumigrid-00000000=token-of-the-tower-alone";
  const auto cleaned = rules_->cleanAddress(tower, inside, kNow);
  ASSERT_TRUE(cleaned.has_value());
  EXPECT_EQ(cleaned->cookie, "");
}

TEST_F(AccessRulesTest, oneGoodCredentialOfSeveralIsEnough) {
  RequestHead request = get("/tower/");
  request.authorization = "Bearer token-of-nobody-at-all";
  request.cookie = "lumigrid-1=token-that-has-expired; theme=dark; lumigrid-2=token-of-the-tower-alone";
  EXPECT_EQ(statusOf("tower", request), 200);
  EXPECT_EQ(statusOf("hall", request), 401);
  request.cookie = "theme=token-of-the-tower-alone; xlumigrid-2=token-of-the-tower-alone";
  EXPECT_EQ(statusOf("tower", request), 401) << "cookies of others";
}

// A host may have many servers, on other ports, whose cookies a browser sends along.
TEST_F(AccessRulesTest, manyCookiesOfOtherServersLockNobodyOut) {
  std::string many;
  for (int i = 0; i < 200; ++i) many += "lumigrid-" + std::to_string(i) + "=token-of-nobody-at-all; ";
  RequestHead request = get("/tower/");
  request.cookie = many;
  EXPECT_EQ(statusOf("tower", request), 401);
  const std::string with_token = many + "lumigrid-200=token-of-the-tower-alone";
  request.cookie = with_token;
  EXPECT_EQ(statusOf("tower", request), 200);
  EXPECT_EQ(statusOf("hall", request), 403);
  const std::string with_grant = many + "lumigrid-200=" + keys_->sign("hall", kNow + 60).text();
  request.cookie = with_grant;
  EXPECT_EQ(statusOf("hall", request), 200);
  EXPECT_EQ(statusOf("tower", request), 401);
}

TEST_F(AccessRulesTest, credentialsAreReadOnceForAllScenes) {
  RequestHead request = get("/?token=token-that-has-expired");
  request.authorization = "Bearer token-of-the-tower-alone";
  const std::string cookie = "lumigrid-1=" + keys_->sign("hall", kNow + 60).text();
  request.cookie = cookie;
  const AccessRules::Credentials credentials = rules_->credentialsOf(request);
  EXPECT_EQ(credentials.size(), 3U);
  EXPECT_EQ(rules_->accessTo("tower", credentials, kNow).until, 1800000100);
  EXPECT_EQ(rules_->accessTo("hall", credentials, kNow).until, kNow + 60);
  ASSERT_TRUE(rules_->accessTo("cellar", credentials, kNow).refusal.has_value());
}

TEST_F(AccessRulesTest, withoutTokensAndKeysEveryoneSeesTheScenes) {
  const auto rules = AccessRules::make({}, "127.0.0.1");
  ASSERT_TRUE(bool(rules));
  EXPECT_FALSE(rules->isPrivate());
  EXPECT_FALSE(rules->accessTo("tower", get("/tower/"), kNow).refusal);
  const std::vector<std::string> tower{"tower"};
  EXPECT_FALSE(rules->cleanAddress(tower, get("/tower/?token=token-of-all-the-scenes"), kNow));
}

TEST_F(AccessRulesTest, aPublicAddressNeedsAWordOnWhoMaySee) {
  const auto problem = [&](AccessOptions options, const char* address) {
    const auto rules = AccessRules::make(options, address);
    return rules ? std::string() : rules.error().message;
  };
  const std::string tokens = path("tokens.json");
  for (const char* address : {"0.0.0.0", "::", "192.168.1.7"}) {
    for (const AccessOptions& bad : {AccessOptions{}, AccessOptions{.is_public = true}, AccessOptions{.is_open = true},
                                     AccessOptions{.token_file = tokens}}) {
      const std::string message = problem(bad, address);
      for (const char* piece : {address, "--public", "--tokens", "--signing-key", "--open"})
        EXPECT_NE(message.find(piece), std::string::npos) << message;
      EXPECT_EQ(message.find('\n'), std::string::npos);
    }
    EXPECT_EQ(problem({.is_public = true, .is_open = true}, address), "");
    EXPECT_EQ(problem({.token_file = tokens, .is_public = true}, address), "");
    EXPECT_EQ(problem({.signing_keys = path("key"), .is_public = true}, address), "");
  }
  EXPECT_EQ(problem({}, "127.0.0.1"), "");
  EXPECT_EQ(problem({}, "::1"), "");
  EXPECT_NE(problem({.token_file = tokens, .is_open = true}, "127.0.0.1").find("--open"), std::string::npos);
  EXPECT_NE(problem({.token_file = path("absent")}, "127.0.0.1").find("absent"), std::string::npos);
}

TEST_F(AccessRulesTest, theLogIsWarnedOfFilesThatAreNoSecretAndTokensOfNoUse) {
  const std::vector<std::string> served{"tower"};
  const std::vector<std::string> lines = rules_->warnings(served, kNow);
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_NE(lines[0].find("token 3 has expired"), std::string::npos);
  std::filesystem::permissions(path("key"), std::filesystem::perms::others_read, std::filesystem::perm_options::add);
  EXPECT_EQ(rules_->warnings(served, kNow).size(), 2U);
  EXPECT_EQ(rules_->warnings({}, kNow).size(), 4U);
  for (const std::string& line : rules_->warnings({}, kNow)) EXPECT_EQ(line.find("token-"), std::string::npos) << line;
}

}  // namespace
}  // namespace server
