#include "lod/qsplat/splat_file.h"

#include <utility>

#include "lod/disk_bytes.h"

namespace lod::qsplat {
base::Result<SplatFile> SplatFile::open(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(auto opened, base::PositionedFile::open(path));
  SplatFile file;
  file.bytes_ = std::make_shared<DiskBytes>(std::move(opened));
  auto header = readHeader(readFront(*file.bytes_));
  if (!header) return base::within(path, header.error());
  if (header->storedBytes() != file.bytes_->size())
    return base::within(path, damaged("has " + std::to_string(file.bytes_->size()) + " bytes, its header says " +
                                      std::to_string(header->storedBytes())));
  file.header_ = *header;
  return file;
}

}  // namespace lod::qsplat
