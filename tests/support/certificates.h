#pragma once
// An authority of a test's own, and certificates that it signs, as files.
#include <gtest/gtest.h>
#include <openssl/evp.h>
#include <openssl/pem.h>
#include <openssl/x509v3.h>

#include <cstdio>
#include <memory>
#include <string>

namespace support {

class Authority {
 public:
  explicit Authority(const std::string& name) : key_(makeKey()), certificate_(X509_new(), &X509_free) {
    fill(certificate_.get(), key_.get(), name, "", -3600, 3600);
    addExtension(certificate_.get(), NID_basic_constraints, "critical,CA:TRUE");
    EXPECT_GT(X509_sign(certificate_.get(), key_.get(), EVP_sha256()), 0);
  }
  /// Writes the authority's own certificate, which clients are told to trust.
  void write(const std::string& path) const { writeCertificate(certificate_.get(), path); }

  /// Writes a certificate and its key. `names`: as OpenSSL's subjectAltName has them, "IP:127.0.0.1,DNS:localhost". It
  /// is valid from `begin` to `end`, seconds from now.
  void issue(const std::string& names, long begin, long end, const std::string& certificate_file,
             const std::string& key_file) const {
    const Key key = makeKey();
    const Certificate certificate(X509_new(), &X509_free);
    fill(certificate.get(), key.get(), "server", names, begin, end);
    X509_set_issuer_name(certificate.get(), X509_get_subject_name(certificate_.get()));
    EXPECT_GT(X509_sign(certificate.get(), key_.get(), EVP_sha256()), 0);
    writeCertificate(certificate.get(), certificate_file);
    const File file(std::fopen(key_file.c_str(), "wb"), &std::fclose);
    ASSERT_NE(file, nullptr);
    EXPECT_EQ(PEM_write_PrivateKey(file.get(), key.get(), nullptr, nullptr, 0, nullptr, nullptr), 1);
  }

 private:
  using Key = std::unique_ptr<EVP_PKEY, decltype(&EVP_PKEY_free)>;
  using Certificate = std::unique_ptr<X509, decltype(&X509_free)>;
  using File = std::unique_ptr<std::FILE, int (*)(std::FILE*)>;

  static Key makeKey() { return {EVP_PKEY_Q_keygen(nullptr, nullptr, "EC", "P-256"), &EVP_PKEY_free}; }
  static void addExtension(X509* certificate, int kind, const std::string& value) {
    const std::unique_ptr<X509_EXTENSION, decltype(&X509_EXTENSION_free)> extension(
        X509V3_EXT_conf_nid(nullptr, nullptr, kind, value.c_str()), &X509_EXTENSION_free);
    EXPECT_EQ(X509_add_ext(certificate, extension.get(), -1), 1) << value;
  }
  /// Its issuer is itself.
  static void fill(X509* certificate, EVP_PKEY* key, const std::string& name, const std::string& names, long begin,
                   long end) {
    static int serial = 0;
    X509_set_version(certificate, 2);
    ASN1_INTEGER_set(X509_get_serialNumber(certificate), ++serial);
    X509_gmtime_adj(X509_getm_notBefore(certificate), begin);
    X509_gmtime_adj(X509_getm_notAfter(certificate), end);
    X509_set_pubkey(certificate, key);
    X509_NAME_add_entry_by_txt(X509_get_subject_name(certificate), "CN", MBSTRING_ASC,
                               reinterpret_cast<const unsigned char*>(name.data()), -1, -1, 0);
    X509_set_issuer_name(certificate, X509_get_subject_name(certificate));
    if (!names.empty()) addExtension(certificate, NID_subject_alt_name, names);
  }
  static void writeCertificate(X509* certificate, const std::string& path) {
    const File file(std::fopen(path.c_str(), "wb"), &std::fclose);
    ASSERT_NE(file, nullptr);
    EXPECT_EQ(PEM_write_X509(file.get(), certificate), 1);
  }

  const Key key_;
  const Certificate certificate_;
};

}  // namespace support
