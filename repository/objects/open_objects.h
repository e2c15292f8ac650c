#pragma once
// Opens a place by its name: "DIR" or "file:///DIR", "http(s)://host/folder", "s3://bucket/prefix".
#include <memory>
#include <string>

#include "base/error.h"
#include "repository/objects/objects.h"

namespace repository {

/// Whether the place lies behind a network, so that its objects are worth caching.
bool isRemotePlace(const std::string& place);

/// Opens a place for reading; no request is sent yet. Errors: kNotFound (no such directory), kInvalidInput (an unknown
/// kind of place, or credentials that cannot be read).
base::Result<std::unique_ptr<ObjectSource>> openObjectSource(const std::string& place);

/// Opens a place for writing. A directory is created; a bucket must exist, which one request finds out. Errors besides
/// those of openObjectSource: kUnsupported (a web server accepts no objects), kNotFound (no such bucket), kIo (wrong
/// credentials).
base::Result<std::unique_ptr<ObjectSink>> openObjectSink(const std::string& place);

}  // namespace repository
