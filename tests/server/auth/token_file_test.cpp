#include "server/auth/token_file.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "base/file.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

class TokenFileTest : public testing::Test {
 protected:
  base::Result<TokenList> tokensOf(const std::string& text) const {
    EXPECT_TRUE(base::writeFileAtomically(path_, base::viewOfText(text)));
    return readTokenFile(path_);
  }
  const support::TemporaryDirectory directory_;
  const std::string path_ = directory_ / "tokens.json";
};

TEST_F(TokenFileTest, tokensOpenWhatTheyAreFor) {
  const std::string digest = base::hexOf(base::sha256(base::viewOfText("hashed-token-of-anna")));
  const auto tokens =
      tokensOf(R"([{"token": "plain-token-of-bert", "scenes": "all"}, {"sha256": ")" + digest +
               R"(", "scenes": ["tower", "hall"], "expires": "2027-01-31T12:00:00Z", "note": "Anna"}])");
  ASSERT_TRUE(bool(tokens)) << tokens.error().message;
  const Token* bert = tokens->find("plain-token-of-bert");
  const Token* anna = tokens->find("hashed-token-of-anna");
  ASSERT_NE(bert, nullptr);
  ASSERT_NE(anna, nullptr);
  EXPECT_TRUE(bert->opens("tower"));
  EXPECT_TRUE(bert->opens(""));
  EXPECT_FALSE(bert->expires);
  EXPECT_TRUE(anna->opens("hall"));
  EXPECT_FALSE(anna->opens("cellar"));
  EXPECT_EQ(anna->expires, 1801396800);
  for (const char* other : {"plain-token-of-berta", "Plain-token-of-bert", "", "bert"})
    EXPECT_EQ(tokens->find(other), nullptr) << other;
  EXPECT_EQ(tokens->find(digest), nullptr) << "the hash is no token";
  const auto expiry = [&](const std::string& text) {
    return tokensOf(R"([{"token": "plain-token-of-bert", "scenes": "all", "expires": )" + text + "}]")
        ->all()[0]
        .expires;
  };
  EXPECT_EQ(expiry("\"1970-01-02\""), 86400);
  EXPECT_EQ(expiry("12"), 12);
}

TEST_F(TokenFileTest, eachOfManyTokensIsFound) {
  const auto textOf = [](int i) { return "token-of-visitor-" + std::to_string(i); };
  std::string list;
  for (int i = 0; i < 1000; ++i)
    list +=
        (i == 0 ? "[" : ", ") + (R"({"token": ")" + textOf(i)) + R"(", "scenes": ["scene)" + std::to_string(i) + "\"]}";
  const auto tokens = tokensOf(list + "]");
  ASSERT_TRUE(bool(tokens)) << tokens.error().message;
  ASSERT_EQ(tokens->all().size(), 1000U);
  for (int i = 0; i < 1000; ++i) {
    ASSERT_NE(tokens->find(textOf(i)), nullptr) << i;
    EXPECT_EQ(tokens->find(textOf(i))->scenes, std::vector{"scene" + std::to_string(i)});
  }
  EXPECT_EQ(tokens->find(textOf(1000)), nullptr);
}

TEST_F(TokenFileTest, ofAnEntryThatComesTwiceTheLastCounts) {
  const auto tokens = tokensOf(R"([{"token": "plain-token-of-bert", "scenes": ["tower"]},
    {"token": "plain-token-of-anna", "scenes": "all"}, {"token": "plain-token-of-bert", "scenes": ["hall"]}])");
  ASSERT_TRUE(bool(tokens)) << tokens.error().message;
  EXPECT_EQ(tokens->find("plain-token-of-bert")->scenes, std::vector<std::string>{"hall"});
}

TEST_F(TokenFileTest, badFilesAreNamedWithTheirEntryAndNoSecret) {
  const std::string good = R"({"token": "plain-token-of-bert", "scenes": "all"})";
  for (const std::string& bad : {
           std::string(R"({"scenes": "all"})"),
           std::string(R"({"token": "short-secret", "scenes": "all"})"),
           std::string(R"({"token": "secret with spaces in it", "scenes": "all"})"),
           std::string(R"({"token": "a-secret-of-somebody"})"),
           std::string(R"({"token": "a-secret-of-somebody", "scenes": []})"),
           std::string(R"({"token": "a-secret-of-somebody", "scenes": "tower"})"),
           std::string(R"({"token": "a-secret-of-somebody", "scenes": [3]})"),
           std::string(R"({"token": "a-secret-of-somebody", "scenes": "all", "expires": "tomorrow"})"),
           std::string(R"({"token": "a-secret-of-somebody", "scenes": "all", "expiry": 12})"),
           std::string(R"({"sha256": "secret", "scenes": "all"})"),
           std::string(R"({"token": "a-secret-of-somebody", "sha256": "secret", "scenes": "all"})"),
           std::string(R"("a-secret-of-somebody")"),
       }) {
    const auto tokens = tokensOf("[" + good + ", " + bad + "]");
    ASSERT_FALSE(bool(tokens)) << bad;
    EXPECT_NE(tokens.error().message.find("tokens.json: token 2: "), std::string::npos) << tokens.error().message;
    EXPECT_EQ(tokens.error().message.find("secret"), std::string::npos) << tokens.error().message;
  }
  for (const char* bad : {"", "{}", "not json", "[}"}) EXPECT_FALSE(bool(tokensOf(bad))) << bad;
  EXPECT_TRUE(bool(tokensOf("[]")));
  EXPECT_FALSE(bool(readTokenFile(directory_ / "absent")));
}

TEST_F(TokenFileTest, aFileThatAllMayReadIsFound) {
  ASSERT_TRUE(bool(tokensOf("[]")));
  namespace fs = std::filesystem;
  fs::permissions(path_, fs::perms::owner_read | fs::perms::owner_write);
  EXPECT_FALSE(isReadableByAll(path_));
  fs::permissions(path_, fs::perms::others_read, fs::perm_options::add);
  EXPECT_TRUE(isReadableByAll(path_));
}

}  // namespace
}  // namespace server
