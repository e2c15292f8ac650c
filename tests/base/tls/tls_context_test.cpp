#include "base/tls/tls_context.h"

#include <ctime>

#include "base/file.h"
#include "tests/support/certificates.h"
#include "tests/support/temporary_directory.h"

namespace base {
namespace {

class ServerTlsTest : public testing::Test {
 protected:
  std::string path(const std::string& name) const { return directory_ / name; }
  Result<ServerTls> load(const std::string& certificate, const std::string& key) const {
    return loadServerTls(path(certificate), path(key), std::time(nullptr));
  }
  std::string problem(const std::string& certificate, const std::string& key) const {
    const auto loaded = load(certificate, key);
    return loaded ? std::string() : loaded.error().message;
  }
  void issue(const std::string& name, long begin = -3600, long end = 90 * 86400) const {
    authority_.issue("DNS:localhost", begin, end, path(name + ".pem"), path(name + ".key"));
  }

  const support::TemporaryDirectory directory_;
  const support::Authority authority_{"test authority"};
};

TEST_F(ServerTlsTest, aCertificateIsLoadedWithItsKey) {
  issue("good");
  const auto loaded = load("good.pem", "good.key");
  ASSERT_TRUE(bool(loaded)) << loaded.error().message;
  EXPECT_NE(loaded->context, nullptr);
  EXPECT_EQ(loaded->warning, "");
}

TEST_F(ServerTlsTest, badFilesAreNamedWithWhatIsWrong) {
  issue("good");
  issue("other");
  ASSERT_TRUE(bool(writeFileAtomically(path("text"), viewOfText("no certificate\n"))));
  const auto expect = [&](const std::string& certificate, const std::string& key, const std::string& named,
                          const std::string& what) {
    const std::string message = problem(certificate, key);
    EXPECT_NE(message.find(path(named)), std::string::npos) << message;
    EXPECT_NE(message.find(what), std::string::npos) << message;
    EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  };
  expect("absent.pem", "good.key", "absent.pem", "certificate");
  expect("good.pem", "absent.key", "absent.key", "key");
  expect("text", "good.key", "text", "is no certificate in PEM");
  expect("good.pem", "text", "text", "is no private key in PEM");
  expect("good.pem", "good.pem", "good.pem", "is no private key in PEM");
  expect("good.pem", "other.key", "other.key", "is not the key of " + path("good.pem"));
}

TEST_F(ServerTlsTest, certificatesOutOfTheirTimeAreWarnedOf) {
  const auto warning = [&](long begin, long end) {
    issue("dated", begin, end);
    const auto loaded = load("dated.pem", "dated.key");
    return loaded ? loaded->warning : loaded.error().message;
  };
  EXPECT_NE(warning(-7200, -3600).find("has expired"), std::string::npos);
  EXPECT_NE(warning(-7200, 86400).find("expires soon"), std::string::npos);
  EXPECT_NE(warning(3600, 90 * 86400).find("valid only from"), std::string::npos);
}

TEST_F(ServerTlsTest, aClientNamesABadFileOfAuthorities) {
  EXPECT_TRUE(bool(makeClientTls("")));
  authority_.write(path("ca.pem"));
  EXPECT_TRUE(bool(makeClientTls(path("ca.pem"))));
  ASSERT_TRUE(bool(writeFileAtomically(path("text"), viewOfText("no certificate\n"))));
  for (const char* bad : {"text", "absent"}) {
    const auto made = makeClientTls(path(bad));
    ASSERT_FALSE(bool(made));
    EXPECT_NE(made.error().message.find(path(bad)), std::string::npos) << made.error().message;
  }
}

}  // namespace
}  // namespace base
