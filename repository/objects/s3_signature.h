#pragma once
// AWS Signature Version 4 ("Authenticating Requests (AWS Signature Version 4)", Amazon S3 API reference): who has the
// secret key signs method, path, query, headers and body, and the secret itself never travels.
#include <map>
#include <string>
#include <string_view>

namespace repository {

struct S3Credentials {
  std::string access_key;
  std::string secret_key;
  std::string session_token;  ///< of temporary credentials; else ""
};

struct S3Request {
  std::string method;                          ///< GET, …
  std::string path = "/";                      ///< percent-encoded once, as it travels
  std::map<std::string, std::string> query;    ///< not encoded
  std::map<std::string, std::string> headers;  ///< to be signed; names in lower case; "host" is among them
  std::string payload_sha256;                  ///< of the body, hex
};

/// "a=1&b=%2F": encoded and sorted as it is signed and as it travels.
std::string canonicalQuery(const std::map<std::string, std::string>& query);

/// The value of the header Authorization. `time`: "20150830T123600Z", the same as the header x-amz-date.
std::string authorization(const S3Request& request, const S3Credentials& credentials, const std::string& region,
                          const std::string& service, const std::string& time);

}  // namespace repository
