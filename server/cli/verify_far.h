#pragma once
// `lumigrid verify` for a published scene behind a network.
#include <string>

#include "base/error.h"
#include "server/cli/verify_parts.h"

namespace server::cli {

/// Reads everything of the scene at a place ("https://host/scene", "s3://bucket/scene") by ranges, several at a time,
/// and past every cache: each part's length and SHA-256 against scene.json; the hierarchy, through a file in the
/// directory for temporary files; each pack and value; annotations. Memory does not grow with the scene. Errors: those
/// of reading scene.json, and no published scene there.
base::Result<Faults> verifyFar(const std::string& place, const VerifyProgress& progress);

}  // namespace server::cli
