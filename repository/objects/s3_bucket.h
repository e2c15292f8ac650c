#pragma once
// One place in a bucket: signed requests to it, and what the store's errors mean.
#include <map>
#include <string>
#include <string_view>

#include "base/bytes.h"
#include "base/error.h"
#include "repository/objects/http_client.h"
#include "repository/objects/s3_config.h"

namespace repository {

struct S3Exchange {
  std::string method;
  std::string name;                            ///< of an object below the place; "": the bucket itself
  std::map<std::string, std::string> query;    ///< not encoded
  std::map<std::string, std::string> headers;  ///< besides those of the signature; names in lower case
  base::ByteView body;
  std::uint64_t most_bytes = 0;  ///< as in HttpRequest
};

/// From any thread.
class S3Bucket {
 public:
  /// `place`: "s3://bucket" or "s3://bucket/prefix". Errors: kInvalidInput.
  static base::Result<S3Bucket> open(const std::string& place, const S3Config& config);

  /// Any answer of the store. Errors as HttpClient::send; they name the object.
  base::Result<HttpResponse> send(const S3Exchange& exchange) const;
  /// The error for an answer that is no success. An answer without a body (of HEAD) is asked for again by GET.
  base::Error refusal(const std::string& name, const HttpResponse& response) const;

  /// Of the bucket, without a slash at its end: "https://host" or "https://host/bucket".
  std::string address() const { return address_ + root_; }
  bool isSigned() const { return !config_.credentials.access_key.empty(); }
  const S3Config& config() const { return config_; }
  const std::string& place() const { return place_; }
  /// "prefix/", or "".
  const std::string& prefix() const { return prefix_; }
  std::string describe(const std::string& name) const { return name.empty() ? place_ : place_ + "/" + name; }

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
