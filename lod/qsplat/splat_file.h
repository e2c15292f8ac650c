#pragma once
// A qsplat.lgq on disk, memory-mapped, so that the system pages in the blocks that are used (Rusinkiewicz and Levoy
// 2000, section 3.2).
#include <string>
#include <vector>

#include "base/file.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat {

class SplatFile {
 public:
  /// Checks the header and the file's length; blocks are checked by those who read them. Errors name the file:
  /// kNotFound, kIo, and those of readHeader.
  static base::Result<SplatFile> open(const std::string& path);
  const Header& header() const { return header_; }
  /// Returns the whole file, whose length is as the header has it.
  base::ByteView bytes() const { return file_.bytes(); }
  /// Runs checkTree on the file.
  std::vector<std::string> verify() const { return checkTree(file_.bytes()); }

 private:
  base::MappedFile file_;
  Header header_;
};

}  // namespace lod::qsplat
