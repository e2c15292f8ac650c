#pragma once
// Objects in a bucket of any S3-compatible store (Amazon S3 API reference, REST).
#include <memory>
#include <string>

#include "base/error.h"
#include "repository/objects/objects.h"
#include "repository/objects/s3_config.h"

namespace repository {

/// `place`: "s3://bucket" or "s3://bucket/prefix". Nothing is asked yet.
base::Result<std::unique_ptr<ObjectSource>> openS3Source(const std::string& place, const S3Config& config);

/// Asks once whether the bucket is there. Errors: kInvalidInput (no credentials), kNotFound (no such bucket), kIo
/// (wrong credentials), kNetwork.
base::Result<std::unique_ptr<ObjectSink>> openS3Sink(const std::string& place, const S3Config& config);

}  // namespace repository
