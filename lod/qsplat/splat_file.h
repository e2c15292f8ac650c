#pragma once
// A qsplat.lgq on disk. Blocks are read by position as they are used, and not mapped: a file that is cut while it is
// open has damaged blocks (docs/decisions/reads-that-cannot-kill.md).
#include <memory>
#include <string>
#include <vector>

#include "base/file.h"
#include "lod/file_bytes.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat {

class SplatFile {
 public:
  /// Checks the header and the file's length; blocks are checked by those who read them. Errors name the file:
  /// kNotFound, kIo, and those of readHeader.
  static base::Result<SplatFile> open(const std::string& path);
  const Header& header() const { return header_; }
  /// The whole file, whose length was as the header has it when it was opened. Null where nothing was opened.
  const std::shared_ptr<const FileBytes>& bytes() const { return bytes_; }
  /// Runs checkTree on the file.
  std::vector<std::string> verify() const { return checkTree(*bytes_); }

 private:
  std::shared_ptr<const FileBytes> bytes_;
  Header header_;
};

}  // namespace lod::qsplat
