// Reads plain files from nginx, a common web server.
#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <random>

#include "base/file.h"
#include "base/hash/sha256.h"
#include "repository/objects/cached_source.h"
#include "repository/objects/mirror.h"
#include "repository/objects/web_source.h"
#include "tests/support/nginx.h"
#include "tests/support/temporary_directory.h"

namespace repository {
namespace {

using base::Bytes;
using base::ErrorCode;
using support::Nginx;
using support::TemporaryDirectory;

Bytes sample(std::size_t size) {
  Bytes bytes(size);
  std::minstd_rand random(7);
  for (std::uint8_t& byte : bytes) byte = static_cast<std::uint8_t>(random() >> 8);
  return bytes;
}

// Writes a key and a self-signed certificate for 127.0.0.1 as key.pem and certificate.pem.
void writeCertificate(const std::string& directory) {
  const std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)> key(EVP_PKEY_Q_keygen(nullptr, nullptr, "EC", "P-256"),
                                                                &EVP_PKEY_free);
  const std::unique_ptr<X509, decltype(&X509_free)> certificate(X509_new(), &X509_free);
  X509* const x = certificate.get();
  X509_set_version(x, 2);
  ASN1_INTEGER_set(X509_get_serialNumber(x), 1);
  X509_gmtime_adj(X509_getm_notBefore(x), -3600);
  X509_gmtime_adj(X509_getm_notAfter(x), 3600);
  X509_set_pubkey(x, key.get());
  const std::string name = "test";
  X509_NAME_add_entry_by_txt(X509_get_subject_name(x), "CN", MBSTRING_ASC,
                             reinterpret_cast<const unsigned char*>(name.data()), -1, -1, 0);
  X509_set_issuer_name(x, X509_get_subject_name(x));
  for (const auto& [kind, value] :
       {std::pair(NID_subject_alt_name, "IP:127.0.0.1"), std::pair(NID_basic_constraints, "critical,CA:TRUE")}) {
    const std::unique_ptr<X509_EXTENSION, decltype(&X509_EXTENSION_free)> extension(
        X509V3_EXT_conf_nid(nullptr, nullptr, kind, value), &X509_EXTENSION_free);
    X509_add_ext(x, extension.get(), -1);
  }
  ASSERT_GT(X509_sign(x, key.get(), EVP_sha256()), 0);
  const auto write = [&](const std::string& file, const auto& put) {
    const std::unique_ptr<std::FILE, decltype(&std::fclose)> out(std::fopen((directory + file).c_str(), "wb"),
                                                                 &std::fclose);
    ASSERT_EQ(put(out.get()), 1);
  };
  write("/key.pem",
        [&](std::FILE* out) { return PEM_write_PrivateKey(out, key.get(), nullptr, nullptr, 0, nullptr, nullptr); });
  write("/certificate.pem", [&](std::FILE* out) { return PEM_write_X509(out, x); });
}

// The text $DIR stands for a directory.
constexpr const char* kServers = R"(
  gzip on; gzip_types *; gzip_min_length 1;
  server {
    listen 127.0.0.1:$PORT0;
    root $DIR/www;
    location /secret/ { deny all; }
    location /norange/ { alias $DIR/www/scene/; max_ranges 0; }
    location /busy/ { return 503; }
    location /moved/ { return 301 http://127.0.0.1:$PORT0/scene/a.bin; }
  }
  server {
    listen 127.0.0.1:$PORT1 ssl;
    ssl_certificate $DIR/certificate.pem;
    ssl_certificate_key $DIR/key.pem;
    root $DIR/www;
    location /down/ { return 302 http://127.0.0.1:$PORT0/scene/a.bin; }
  }
)";

class NginxTest : public ::testing::Test {
 protected:
  void SetUp() override {
    LUMIGRID_SKIP_WITHOUT_NGINX();
    std::filesystem::create_directories(directory_ / "www/scene");
    ASSERT_TRUE(base::writeFileAtomically(directory_ / "www/scene/a.bin", bytes_));
    writeCertificate(directory_.path());
    std::string servers = kServers;
    support::replaceAll(servers, "$DIR", directory_.path());
    nginx_ = std::make_unique<Nginx>(Nginx::Configuration{servers, 2});
    ASSERT_TRUE(nginx_->running());
  }
  std::unique_ptr<ObjectSource> open(const std::string& folder, const HttpOptions& options = quick()) {
    return std::move(*openHttpSource(nginx_->url() + folder, options));
  }
  std::unique_ptr<ObjectSource> openSecure(const std::string& folder, const HttpOptions& options) {
    return std::move(*openHttpSource("https://127.0.0.1:" + std::to_string(nginx_->port(1)) + folder, options));
  }
  static HttpOptions quick() {
    HttpOptions options;
    options.retries = 1;
    options.first_pause = std::chrono::milliseconds(1);
    return options;
  }
  HttpOptions trusting() {
    HttpOptions options = quick();
    options.ca_file = directory_ / "certificate.pem";
    return options;
  }
  void expectReads(const ObjectSource& source) {
    std::minstd_rand random(1);
    for (int i = 0; i < 100; ++i) {
      const std::uint64_t offset = random() % bytes_.size();
      const std::uint64_t length = 1 + random() % std::min<std::uint64_t>(bytes_.size() - offset, 50000);
      const auto read = source.read("a.bin", offset, length);
      ASSERT_TRUE(read) << read.error().message;
      const auto begin = bytes_.begin() + static_cast<std::ptrdiff_t>(offset);
      EXPECT_TRUE(std::equal(read->begin(), read->end(), begin, begin + static_cast<std::ptrdiff_t>(length)));
    }
  }

  const TemporaryDirectory directory_;
  const Bytes bytes_ = sample(1000000);
  std::unique_ptr<Nginx> nginx_;
};

TEST_F(NginxTest, servesRangesToSeveralThreads) {
  const auto source = open("/scene");
  EXPECT_EQ(*source->size("a.bin"), bytes_.size());
  std::vector<std::thread> threads;
  for (int t = 0; t < 8; ++t) threads.emplace_back([&] { expectReads(*source); });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(source->read("a.bin", bytes_.size() - 1, 2).error().code, ErrorCode::kInvalidInput);
  EXPECT_EQ(source->read("a.bin", bytes_.size(), 1).error().code, ErrorCode::kInvalidInput);
}

TEST_F(NginxTest, refusalsNameTheReason) {
  EXPECT_EQ(open("/scene")->read("none", 0, 1).error().code, ErrorCode::kNotFound);
  EXPECT_EQ(open("/secret")->read("a.bin", 0, 1).error().code, ErrorCode::kIo);
  EXPECT_EQ(open("/busy")->read("a.bin", 0, 1).error().code, ErrorCode::kNetwork);
  EXPECT_EQ(open("/norange")->read("a.bin", 5, 10).error().code, ErrorCode::kUnsupported);
  EXPECT_TRUE(open("/norange")->read("a.bin", 0, bytes_.size()));
  EXPECT_TRUE(open("/moved")->read("a.bin", 5, 10));
  const auto source = open("/scene");
  EXPECT_TRUE(source->read("a.bin", 0, 1));
  nginx_->stop();
  EXPECT_EQ(source->read("a.bin", 0, 1).error().code, ErrorCode::kNetwork);
}

TEST_F(NginxTest, aFileThatIsReplacedIsNotMixed) {
  const auto source = open("/scene");
  EXPECT_TRUE(source->read("a.bin", 0, 1));
  ASSERT_TRUE(base::writeFileAtomically(directory_ / "www/scene/a.bin", Bytes(10, 1)));
  const auto read = source->read("a.bin", 1, 1);
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("changed while it was read"), std::string::npos) << read.error().message;
  EXPECT_EQ(*source->size("a.bin"), 10U);
  EXPECT_TRUE(source->read("a.bin", 1, 1));
}

TEST_F(NginxTest, certificatesAreVerified) {
  const auto untrusted = openSecure("/scene", quick())->read("a.bin", 0, 1);
  ASSERT_FALSE(untrusted);
  EXPECT_NE(untrusted.error().message.find("certificate is not trusted"), std::string::npos)
      << untrusted.error().message;
  expectReads(*openSecure("/scene", trusting()));
  HttpOptions missing = quick();
  missing.ca_file = directory_ / "none.pem";
  EXPECT_EQ(openSecure("/scene", missing)->read("a.bin", 0, 1).error().code, ErrorCode::kInvalidInput);
}

TEST_F(NginxTest, redirectsFromHttpsToHttpAreRefused) {
  const auto read = openSecure("/down", trusting())->read("a.bin", 0, 1);
  ASSERT_FALSE(read);
  EXPECT_NE(read.error().message.find("redirected from https"), std::string::npos) << read.error().message;
}

TEST_F(NginxTest, cacheAndMirrorReadThroughIt) {
  std::shared_ptr<const ObjectSource> source = open("/scene");
  RangeCacheOptions options;
  options.bytes = std::uint64_t{16} << 20;
  const auto cached = CachedSource::open(source, directory_ / "cache", options);
  ASSERT_TRUE(cached) << cached.error().message;
  expectReads(**cached);
  ASSERT_TRUE(mirrorObject(*source, "a.bin", directory_ / "mirror", base::hexOf(base::sha256(bytes_)), {100000, {}}));
  EXPECT_EQ(*base::readFile(directory_ / "mirror/a.bin"), bytes_);
  nginx_->stop();
  EXPECT_TRUE((*cached)->read("a.bin", 0, 100000));
}

}  // namespace
}  // namespace repository
