#pragma once
// Reads and writes objects in a bucket of any S3-compatible store (Amazon S3 API reference, REST).
#include <memory>
#include <string>

#include "base/error.h"
#include "repository/objects/objects.h"
#include "repository/objects/s3_config.h"

namespace repository {

/// `place` is "s3://bucket" or "s3://bucket/prefix". No request is sent yet.
base::Result<std::unique_ptr<ObjectSource>> openS3Source(const std::string& place, const S3Config& config);

/// Sends one request to find out whether the bucket exists. Errors: kInvalidInput (no credentials), kNotFound (no such
/// bucket), kIo (wrong credentials), kNetwork.
base::Result<std::unique_ptr<ObjectSink>> openS3Sink(const std::string& place, const S3Config& config);

}  // namespace repository
