#pragma once
// A whole far object as a local file: for what is memory-mapped.
#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "repository/objects/objects.h"

namespace repository {

struct MirrorOptions {
  std::uint64_t range_bytes = std::uint64_t{8} << 20;  ///< read at once
  /// Told after each range; false stops (kCancelled), and the next call goes on from there. Null: nobody.
  std::function<bool(std::uint64_t done, std::uint64_t total)> progress;
};

/// Downloads `name` to directory/name, unless that file has this SHA-256 (64 lower-case hex digits) already, and
/// returns the path. The file appears when it is whole and checked. What a stopped or killed call had is kept beside it
/// and gone on with; of several processes one downloads and the others wait. Errors: those of the source, kNoSpace,
/// kIo, kInvalidInput when what came has another SHA-256.
base::Result<std::string> mirrorObject(const ObjectSource& source, const std::string& name,
                                       const std::string& directory, const std::string& sha256,
                                       const MirrorOptions& options = {});

}  // namespace repository
