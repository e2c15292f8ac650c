#pragma once
// A place by its name: "DIR" or "file:///DIR", "http(s)://host/folder", "s3://bucket/prefix".
#include <memory>
#include <string>

#include "base/error.h"
#include "repository/objects/objects.h"

namespace repository {

/// Whether the place is behind a network: its objects are better cached.
bool isRemotePlace(const std::string& place);

/// Errors: kNotFound (no such directory), kInvalidInput (no place that we know; credentials that cannot be read). What
/// lies behind a network is not asked yet.
base::Result<std::unique_ptr<ObjectSource>> openObjectSource(const std::string& place);

/// A directory is made; a bucket must be there (one request finds out). Errors also: kUnsupported (a web server takes
/// no objects), kNotFound (no such bucket), kIo (wrong credentials).
base::Result<std::unique_ptr<ObjectSink>> openObjectSink(const std::string& place);

}  // namespace repository
