#pragma once
// Where a scene is published: the text that a user types, as something that takes objects.
#include <memory>
#include <string>

#include "base/error.h"
#include "repository/objects.h"

namespace repository {

/// A directory ("path" or "file:///path", made when it is not there), or a bucket ("s3://bucket/prefix").
/// Errors: those of the place; kUnsupported for a place that cannot be written.
base::Result<std::unique_ptr<ObjectSink>> openSink(const std::string& place);

}  // namespace repository
