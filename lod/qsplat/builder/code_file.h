#pragma once
// From a qsplat.lgq in the plain form to the same one in the coded form (docs/formats/qsplat.md). Private to
// lod/build/qsplat, but for tests.
#include <cstdint>
#include <functional>
#include <span>

#include "base/error.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat::builder {

struct CodeOptions {
  unsigned threads = 0;                       ///< 0: all cores. The output does not depend on it.
  std::function<bool(double done)> progress;  ///< may be empty; false cancels
};

/// Fills `out` from `offset` of the plain file on.
using ReadPlain = std::function<base::Result<void>(std::uint64_t offset, std::span<std::uint8_t> out)>;
/// Takes the coded file's next bytes.
using WriteCoded = std::function<base::Result<void>(base::ByteView)>;

/// The plain file is one that checkTree finds nothing in; it is read three times, front to back. Memory: two bytes for
/// each block, two for each inner node of a level or two, and some blocks. Errors: kCancelled; kUnsupported for a file
/// whose places take more than six bytes; what `read` and `write` return.
base::Result<lod::qsplat::Header> codeFile(const ReadPlain& read, const CodeOptions& options, const WriteCoded& write);

}  // namespace lod::qsplat::builder
