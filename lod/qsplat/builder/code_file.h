#pragma once
// Rewrites a qsplat.lgq from the plain form to the coded form (docs/formats/qsplat.md).
#include <cstdint>
#include <functional>
#include <span>

#include "base/error.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat::builder {

/// Reads the plain file's bytes from `offset` on into all of `out`.
using ReadPlain = std::function<base::Result<void>(std::uint64_t offset, std::span<std::uint8_t> out)>;
/// Appends bytes to the coded file.
using WriteCoded = std::function<base::Result<void>(base::ByteView)>;

/// The plain file must be one that checkTree finds no fault in. It is read three times, front to back. Memory holds two
/// bytes for each block, two for each inner node of one or two levels, and some blocks. `threads`: 0 for all cores; the
/// output does not depend on it. `progress` may be empty; false cancels. Errors: kCancelled; kUnsupported for a file
/// whose offsets take more than six bytes; those of `read` and `write`.
base::Result<Header> codeFile(const ReadPlain& read, const WriteCoded& write, unsigned threads,
                              const std::function<bool(double done)>& progress = {});

}  // namespace lod::qsplat::builder
