#pragma once
// Downloads a whole remote object into a local file, for readers that map it into memory.
#include <cstdint>
#include <functional>
#include <string>

#include "base/error.h"
#include "repository/objects/objects.h"

namespace repository {

struct MirrorOptions {
  std::uint64_t range_bytes = std::uint64_t{8} << 20;  ///< bytes of one read
  /// Called after each range, if set. Returning false stops with kCancelled; the next call goes on from there.
  std::function<bool(std::uint64_t done, std::uint64_t total)> progress;
};

/// Downloads `name` to directory/name, unless that file has this SHA-256 (64 lower-case hex digits) already, and
/// returns the path. The file appears when it is whole and checked. A stopped or killed call leaves its part beside it,
/// from which the next call goes on. When several processes ask for the same object, one downloads it and the others
/// wait. Errors: those of the source, kNoSpace, kIo, and kInvalidInput when the bytes have another SHA-256.
base::Result<std::string> mirrorObject(const ObjectSource& source, const std::string& name,
                                       const std::string& directory, const std::string& sha256,
                                       const MirrorOptions& options = {});

}  // namespace repository
