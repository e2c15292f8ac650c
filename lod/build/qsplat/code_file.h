#pragma once
// From a qsplat.lgq in the plain form to the same one in the coded form (docs/formats/qsplat.md). Private to
// lod/build/qsplat, but for tests.
#include <functional>

#include "base/error.h"
#include "lod/qsplat/format.h"

namespace lod::build::qsplat {

struct CodeOptions {
  unsigned threads = 0;                       ///< 0: all cores. The output does not depend on it.
  std::function<bool(double done)> progress;  ///< may be empty; false cancels
};

/// `plain`: a file that checkTree finds nothing in. `write` gets the coded one, front to back, piece by piece. Memory:
/// two bytes for each block, a byte for each inner node of a level or two, and some blocks. Errors: kCancelled; what
/// `write` returns.
base::Result<lod::qsplat::Header> codeFile(base::ByteView plain, const CodeOptions& options,
                                           const std::function<base::Result<void>(base::ByteView)>& write);

}  // namespace lod::build::qsplat
