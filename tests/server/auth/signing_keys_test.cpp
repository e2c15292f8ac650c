#include "server/auth/signing_keys.h"

#include <gtest/gtest.h>

#include "base/file.h"
#include "base/hash/sha256.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

constexpr const char* kKey = "0123456789abcdef0123456789abcdef";

class SigningKeysTest : public testing::Test {
 protected:
  base::Result<SigningKeys> keysOf(const std::string& text) const {
    const std::string path = directory_ / "key";
    EXPECT_TRUE(base::writeFileAtomically(path, base::viewOfText(text)));
    return SigningKeys::read(path);
  }
  const support::TemporaryDirectory directory_;
};

TEST_F(SigningKeysTest, aGrantIsForOneSceneAndOneTime) {
  const auto keys = keysOf(std::string(kKey) + "\n");
  ASSERT_TRUE(bool(keys)) << keys.error().message;
  const LinkGrant grant = keys->sign("tower", 1'900'000'000);
  EXPECT_EQ(grant.signature,
            base::hexOf(base::hmacSha256(base::viewOfText(kKey), "lumigrid link 1\ntower\n1900000000")));
  EXPECT_TRUE(keys->hasSigned("tower", grant));
  EXPECT_FALSE(keys->hasSigned("towers", grant));
  EXPECT_FALSE(keys->hasSigned("", grant));
  LinkGrant longer = grant;
  ++longer.expires;
  EXPECT_FALSE(keys->hasSigned("tower", longer));
  for (std::size_t at : {std::size_t{0}, std::size_t{63}}) {
    LinkGrant changed = grant;
    changed.signature[at] = changed.signature[at] == '0' ? '1' : '0';
    EXPECT_FALSE(keys->hasSigned("tower", changed)) << at;
  }
}

TEST_F(SigningKeysTest, aReplacedKeyIsStillAcceptedWhileItIsListed) {
  const std::string new_key(32, 'n');
  const LinkGrant old_grant = keysOf(kKey)->sign("tower", 1);
  const auto both = keysOf("# new\n" + new_key + "\r\n\n# old\n" + kKey);
  ASSERT_TRUE(bool(both));
  EXPECT_TRUE(both->hasSigned("tower", old_grant));
  EXPECT_EQ(both->sign("tower", 1).signature, keysOf(new_key)->sign("tower", 1).signature);
  EXPECT_FALSE(keysOf(new_key)->hasSigned("tower", old_grant));
}

TEST_F(SigningKeysTest, badFilesAreNamedWithoutTheirContent) {
  for (const char* bad : {"", "# nothing\n", "short-secret\n", "0123456789abcdef0123456789 secretz"}) {
    const auto keys = keysOf(bad);
    ASSERT_FALSE(bool(keys)) << bad;
    EXPECT_NE(keys.error().message.find("key: "), std::string::npos) << keys.error().message;
    EXPECT_EQ(keys.error().message.find("secret"), std::string::npos) << keys.error().message;
  }
  EXPECT_FALSE(bool(SigningKeys::read(directory_ / "absent")));
}

TEST_F(SigningKeysTest, grantsAreReadAsTheyAreWritten) {
  const LinkGrant grant = keysOf(kKey)->sign("tower", 1'900'000'000);
  const auto read = parseLinkGrant(grant.text());
  ASSERT_TRUE(read.has_value());
  EXPECT_EQ(read->expires, grant.expires);
  EXPECT_EQ(read->signature, grant.signature);
  const std::string digits(64, 'a');
  for (const std::string& bad : {std::string(), "." + digits, "1." + digits + "a", "1." + std::string(64, 'A'),
                                 "-1." + digits, "1e3." + digits, "1" + digits, "1.." + digits.substr(1)})
    EXPECT_FALSE(parseLinkGrant(bad)) << bad;
}

TEST_F(SigningKeysTest, anAddressKeepsItsQueryAndItsFragment) {
  const LinkGrant grant{7, "ab"};
  EXPECT_EQ(signedUrl("https://host/tower/", grant), "https://host/tower/?expires=7&signature=ab");
  EXPECT_EQ(signedUrl("https://host/tower/?method=qsplat#m=q", grant),
            "https://host/tower/?method=qsplat&expires=7&signature=ab#m=q");
}

}  // namespace
}  // namespace server
