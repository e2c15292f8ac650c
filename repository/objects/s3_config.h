#pragma once
// Where an S3 store is and who asks: from the variables and files that AWS's own tools read.
#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "base/error.h"
#include "repository/objects/http_client.h"
#include "repository/objects/s3_signature.h"

namespace repository {

struct S3Config {
  S3Credentials credentials;  ///< access_key "": requests are not signed, which public buckets allow
  std::string region = "us-east-1";
  std::string endpoint;  ///< "http(s)://host[:port]"; "": Amazon's of the region
  HttpOptions http;
  /// Larger files go up in parts of this size (5 MiB at least, or stores refuse them; more for files of over 10,000
  /// parts).
  std::uint64_t part_bytes = std::uint64_t{64} << 20;
};

/// The value of an environment variable; nothing when unset or empty.
using EnvironmentVariables = std::function<std::optional<std::string>(const std::string& name)>;

/// AWS_ACCESS_KEY_ID, AWS_SECRET_ACCESS_KEY, AWS_SESSION_TOKEN, or else the profile AWS_PROFILE (default: "default") of
/// ~/.aws/credentials (AWS_SHARED_CREDENTIALS_FILE) and ~/.aws/config (AWS_CONFIG_FILE); AWS_REGION,
/// AWS_DEFAULT_REGION; AWS_ENDPOINT_URL_S3, AWS_ENDPOINT_URL; AWS_CA_BUNDLE. Errors: kInvalidInput (half a pair of
/// keys, a profile that is not there, an endpoint that is no address), kIo.
base::Result<S3Config> readS3Config(const EnvironmentVariables& environment);
base::Result<S3Config> readS3Config();  ///< of this process

}  // namespace repository
