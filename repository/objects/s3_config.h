#pragma once
// The address of an S3 store and the credentials for it, from the variables and files that AWS's own tools read.
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "base/error.h"
#include "repository/objects/http_client.h"
#include "repository/objects/s3_signature.h"

namespace repository {

struct S3Config {
  S3Credentials credentials;  ///< with access_key "" requests are not signed, which public buckets allow
  std::string region = "us-east-1";
  std::string endpoint;  ///< "http(s)://host[:port]"; "": Amazon's of the region
  HttpOptions http;
  /// Larger files are uploaded in parts of this size. Stores refuse parts below 5 MiB, and more than 10,000 parts, so a
  /// very large file gets larger ones.
  std::uint64_t part_bytes = std::uint64_t{64} << 20;
};

/// Returns the value of an environment variable; nothing when it is unset or empty.
using EnvironmentVariables = std::function<std::optional<std::string>(const std::string& name)>;

/// Credentials come from AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY and AWS_SESSION_TOKEN, or else from the profile
/// AWS_PROFILE (default: "default") of ~/.aws/credentials (AWS_SHARED_CREDENTIALS_FILE) and ~/.aws/config
/// (AWS_CONFIG_FILE). The region comes from AWS_REGION or AWS_DEFAULT_REGION, the endpoint from AWS_ENDPOINT_URL_S3 or
/// AWS_ENDPOINT_URL, certificates from AWS_CA_BUNDLE. Errors: kInvalidInput (half a pair of keys, a profile that does
/// not exist, an endpoint that is no address), kIo.
base::Result<S3Config> readS3Config(const EnvironmentVariables& environment);
base::Result<S3Config> readS3Config();  ///< with this process's environment

}  // namespace repository
