#include "repository/objects/s3_signature.h"

#include <gtest/gtest.h>

#include "base/hash/sha256.h"

namespace repository {
namespace {

const std::string kNothing = base::hexOf(base::sha256({}));

std::string signatureOf(const S3Request& request, const std::string& service, const std::string& time) {
  // The secret keys of AWS's examples differ in one character: the test suite has '+' where the S3 manual has '/'.
  const S3Credentials credentials =
      service == "s3" ? S3Credentials{"AKIAIOSFODNN7EXAMPLE", "wJalrXUtnFEMI/K7MDENG/bPxRfiCYEXAMPLEKEY", ""}
                      : S3Credentials{"AKIDEXAMPLE", "wJalrXUtnFEMI/K7MDENG+bPxRfiCYEXAMPLEKEY", ""};
  const std::string header = authorization(request, credentials, "us-east-1", service, time);
  return header.substr(header.rfind('=') + 1);
}

// These are the cases of the Signature Version 4 test suite (aws-sig-v4-test-suite) that requests for objects meet.
TEST(S3Signature, equalsTheTestSuites) {
  struct Case {
    const char* name;
    S3Request request;
    const char* signature;
  };
  const std::string date = "20150830T123600Z";
  const std::map<std::string, std::string> headers{{"host", "example.amazonaws.com"}, {"x-amz-date", date}};
  const auto with = [&](const std::string& name, const std::string& value) {
    auto more = headers;
    more[name] = value;
    return more;
  };
  const std::vector<Case> cases{
      {"get-vanilla",
       {"GET", "/", {}, headers, kNothing},
       "5fa00fa31553b73ebf1942676e86291e8372ff2a2260956d9b8aae1d763fbf31"},
      {"get-vanilla-query-order-key-case",
       {"GET", "/", {{"Param2", "value2"}, {"Param1", "value1"}}, headers, kNothing},
       "b97d918cfa904a5beff61c982a1b6f458b799221646efd99d3219ec94cdf2500"},
      {"get-vanilla-query-unreserved",
       {"GET",
        "/",
        {{"-._~0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz",
          "-._~0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz"}},
        headers,
        kNothing},
       "9c3e54bfcdf0b19771a7f523ee5669cdf59bc7cc0884027167c21bb143a40197"},
      {"get-utf8",
       {"GET", "/%E1%88%B4", {}, headers, kNothing},
       "8318018e0b0f223aa2bbf98705b62bb787dc9c0e678f255a891fd03141be5d85"},
      {"post-vanilla",
       {"POST", "/", {}, headers, kNothing},
       "5da7c1a2acd57cee7505fc6676e4e544621c30862966e37dddb68e92efbe5d6b"},
      {"post-x-www-form-urlencoded",
       {"POST",
        "/",
        {},
        with("content-type", "application/x-www-form-urlencoded"),
        base::hexOf(base::sha256(base::viewOfText("Param1=value1")))},
       "ff11897932ad3f4e8b18135d722051e5ac45fc38421b1da7b9d196a0fe09473a"},
  };
  for (const Case& c : cases) EXPECT_EQ(signatureOf(c.request, "service", date), c.signature) << c.name;
}

TEST(S3Signature, headerValuesAreTrimmed) {
  // This is the suite's case get-header-value-trim.
  const S3Request request{"GET",
                          "/",
                          {},
                          {{"host", "example.amazonaws.com"},
                           {"my-header1", " value1"},
                           {"my-header2", " \"a   b   c\""},
                           {"x-amz-date", "20150830T123600Z"}},
                          kNothing};
  EXPECT_EQ(signatureOf(request, "service", "20150830T123600Z"),
            "acc3ed3afb60bb290fc8d2dd0098b9911fcaa05412b367055dee359757a9c736");
}

// The examples are those of "Signature Calculations for the Authorization Header: Transferring Payload in a Single
// Chunk" (Amazon S3 API reference).
TEST(S3Signature, equalsTheS3Manuals) {
  const std::string date = "20130524T000000Z";
  const std::string host = "examplebucket.s3.amazonaws.com";
  const S3Request get{
      "GET",
      "/test.txt",
      {},
      {{"host", host}, {"range", "bytes=0-9"}, {"x-amz-content-sha256", kNothing}, {"x-amz-date", date}},
      kNothing};
  EXPECT_EQ(signatureOf(get, "s3", date), "f0e8bdb87c964420e857bd35b5d6ed310bd44f0170aba48dd91039c6036bdb41");

  const std::string welcome = base::hexOf(base::sha256(base::viewOfText("Welcome to Amazon S3.")));
  const S3Request put{"PUT",
                      "/test%24file.text",
                      {},
                      {{"date", "Fri, 24 May 2013 00:00:00 GMT"},
                       {"host", host},
                       {"x-amz-content-sha256", welcome},
                       {"x-amz-date", date},
                       {"x-amz-storage-class", "REDUCED_REDUNDANCY"}},
                      welcome};
  EXPECT_EQ(signatureOf(put, "s3", date), "98ad721746da40c64f1a55b78f14c238d841ea1380cd77a1b5971af0ece108bd");

  const std::map<std::string, std::string> plain{
      {"host", host}, {"x-amz-content-sha256", kNothing}, {"x-amz-date", date}};
  EXPECT_EQ(signatureOf({"GET", "/", {{"lifecycle", ""}}, plain, kNothing}, "s3", date),
            "fea454ca298b7da1c68078a5d1bdbfbbe0d65c699e0f91ac7a200a0136783543");
  EXPECT_EQ(signatureOf({"GET", "/", {{"max-keys", "2"}, {"prefix", "J"}}, plain, kNothing}, "s3", date),
            "34b48302e7b5fa45bde8084f4b7868a86f0a534bc59db6670ed5711ef69dc6f7");
}

TEST(S3Signature, theHeaderNamesKeyScopeAndHeaders) {
  const S3Request request{"GET", "/", {}, {{"host", "h"}, {"x-amz-date", "20150830T123600Z"}}, kNothing};
  const std::string header = authorization(request, {"KEY", "secret", ""}, "eu-west-1", "s3", "20150830T123600Z");
  EXPECT_EQ(header.rfind("AWS4-HMAC-SHA256 Credential=KEY/20150830/eu-west-1/s3/aws4_request, "
                         "SignedHeaders=host;x-amz-date, Signature=",
                         0),
            0U)
      << header;
}

}  // namespace
}  // namespace repository
