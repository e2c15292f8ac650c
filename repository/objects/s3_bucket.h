#pragma once
// Sends signed requests to one place in a bucket and turns the store's error codes into messages.
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "repository/objects/s3_config.h"
#include "repository/objects/web_source.h"

namespace repository {

struct BucketRequest {
  std::string method;
  std::string name;                            ///< object below the place; "": the bucket itself
  std::map<std::string, std::string> query;    ///< not encoded
  std::map<std::string, std::string> headers;  ///< besides those of the signature; names in lower case
  base::ByteView body;
  std::uint64_t max_body_bytes = 0;  ///< as in HttpRequest
};

/// Safe from any thread.
class S3Bucket final : public ObjectServer {
 public:
  /// `place` is "s3://bucket" or "s3://bucket/prefix". Errors: kInvalidInput.
  static base::Result<S3Bucket> open(const std::string& place, const S3Config& config);

  /// Returns the store's answer, whatever its status. Errors as HttpClient::send; they name the object.
  base::Result<HttpResponse> send(const BucketRequest& call) const;
  base::Result<HttpResponse> request(const std::string& method, const std::string& name,
                                     const std::vector<std::string>& headers,
                                     std::uint64_t max_body_bytes) const override;
  /// The error for an answer that is no success. The answer to a HEAD has no body, so a GET asks for the reason.
  base::Error refusal(const std::string& name, const HttpResponse& response) const override;

  /// The bucket's address without a slash at its end: "https://host" or "https://host/bucket".
  std::string address() const { return address_ + root_; }
  bool isSigned() const { return !config_.credentials.access_key.empty(); }
  const S3Config& config() const { return config_; }
  const std::string& place() const { return place_; }
  /// "prefix/", or "".
  const std::string& prefix() const { return prefix_; }
  std::string describe(const std::string& name) const override { return name.empty() ? place_ : place_ + "/" + name; }

 private:
  S3Bucket(std::string place, std::string bucket, std::string prefix, const S3Config& config);
  base::Error explain(const std::string& name, int status, std::string_view xml) const;

  std::string place_, bucket_, prefix_;
  S3Config config_;
  std::string address_;  // "https://host"
  std::string host_;     // the header Host
  std::string root_;     // the path of the bucket: "" or "/bucket"
  std::shared_ptr<HttpClient> client_;
};

}  // namespace repository
