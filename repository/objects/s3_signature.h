#pragma once
// AWS Signature Version 4 ("Authenticating Requests (AWS Signature Version 4)", Amazon S3 API reference). The owner of
// the secret key signs method, path, query, headers and body, and the secret itself is never sent.
#include <map>
#include <string>
#include <string_view>

namespace repository {

struct S3Credentials {
  std::string access_key;
  std::string secret_key;
  std::string session_token;  ///< "" unless the credentials are temporary
};

struct S3Request {
  std::string method;                          ///< GET, …
  std::string path = "/";                      ///< percent-encoded once, as it is sent
  std::map<std::string, std::string> query;    ///< not encoded
  std::map<std::string, std::string> headers;  ///< to be signed; names in lower case; "host" is among them
  std::string payload_sha256;                  ///< digest of the body, hex
};

/// Encodes and sorts the query as it is both signed and sent: "a=1&b=%2F".
std::string canonicalQuery(const std::map<std::string, std::string>& query);

/// The value of the header Authorization. `time` equals the header x-amz-date, such as "20150830T123600Z".
std::string authorization(const S3Request& request, const S3Credentials& credentials, const std::string& region,
                          const std::string& service, const std::string& time);

}  // namespace repository
