#include "client/native/host_access.h"

#include <gtest/gtest.h>

#include "base/file.h"
#include "tests/support/temporary_directory.h"

namespace client {
namespace {

TEST(Credential, isTakenOutOfALink) {
  struct Row {
    std::string link, credential, address;
  };
  for (const Row& row : {
           Row{"wss://host/tower/?token=abc", "abc", "wss://host/tower/"},
           Row{"https://host/tower/?a=b&token=abc&c#m=q", "abc", "https://host/tower/?a=b&c#m=q"},
           Row{"wss://host/?expires=17&signature=0af", "17.0af", "wss://host/"},
           Row{"wss://host/?signature=0af&method=x&expires=17", "17.0af", "wss://host/?method=x"},
           Row{"wss://host/?expires=17", "", "wss://host/?expires=17"},
           Row{"wss://host/", "", "wss://host/"},
           Row{"wss://host/#token=abc", "", "wss://host/#token=abc"},
       }) {
    std::string url = row.link;
    EXPECT_EQ(takeCredential(url), row.credential) << row.link;
    EXPECT_EQ(url, row.address) << row.link;
  }
}

TEST(TokenFile, holdsOneTokenAndNothingElse) {
  const support::TemporaryDirectory directory;
  const std::string path = directory / "token";
  const auto tokenOf = [&](const std::string& text) {
    EXPECT_TRUE(bool(base::writeFileAtomically(path, base::viewOfText(text))));
    return readTokenFile(path);
  };
  ASSERT_TRUE(bool(tokenOf(" abc-1._~\r\n")));
  EXPECT_EQ(*tokenOf(" abc-1._~\r\n"), "abc-1._~");
  for (const char* bad : {"", "\n", "two secrets", "secret\nsecret", "secret\x01"}) {
    const auto token = tokenOf(bad);
    ASSERT_FALSE(bool(token)) << bad;
    EXPECT_NE(token.error().message.find(path), std::string::npos);
    EXPECT_EQ(token.error().message.find("secret"), std::string::npos);
  }
}

TEST(Token, isExposedOnlyOnTheWayToAnotherMachine) {
  for (const char* safe :
       {"wss://example.org/", "https://example.org/", "ws://localhost:8080/", "127.0.0.1:8080", "http://[::1]:8080/",
        "localhost", "ws://LOCALHOST./tower/", "tower.localhost:8080", "ws://127.9.8.7", "ws://[0:0:0:0:0:0:0:1]/"})
    EXPECT_FALSE(wouldExposeToken(safe)) << safe;
  for (const char* open :
       {"ws://example.org/", "http://192.168.1.1/tower/", "example.org:8080", "ws://localhost.example.org/",
        "ws://localhost-tower:8080/", "ws://127.example.org/", "ws://127.0.0.1.example.org:8080/", "ws://notlocalhost/",
        "ws://[::1:2]/", "ws://[::2]/", "ws://128.0.0.1/", "ws://localhost@example.org/", "ws://[", "", "ws://"})
    EXPECT_TRUE(wouldExposeToken(open)) << open;
}

}  // namespace
}  // namespace client
