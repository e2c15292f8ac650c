#pragma once
// A qsplat.lgq on disk, memory-mapped (Rusinkiewicz and Levoy 2000, section 3.2: the system pages in what is looked
// at).
#include <string>
#include <vector>

#include "base/file.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat {

class SplatFile {
 public:
  /// Checks the header and the file's length; blocks are for who reads them to check. Errors name the file: kNotFound,
  /// kIo, and those of readHeader.
  static base::Result<SplatFile> open(const std::string& path);
  const Header& header() const { return header_; }
  /// All of the file; as long as the header says.
  base::ByteView bytes() const { return file_.bytes(); }
  /// checkTree of it.
  std::vector<std::string> verify() const { return checkTree(file_.bytes()); }

 private:
  base::MappedFile file_;
  Header header_;
};

}  // namespace lod::qsplat
