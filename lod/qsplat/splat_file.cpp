#include "lod/qsplat/splat_file.h"

namespace lod::qsplat {

base::Result<SplatFile> SplatFile::open(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(auto mapped, base::MappedFile::open(path));
  auto header = readHeader(mapped.bytes());
  if (!header) return base::within(path, header.error());
  if (header->storedBytes() != mapped.bytes().size())
    return base::within(path, damaged("has " + std::to_string(mapped.bytes().size()) + " bytes, its header says " +
                                      std::to_string(header->storedBytes())));
  SplatFile file;
  file.file_ = std::move(mapped);
  file.header_ = *header;
  return file;
}

}  // namespace lod::qsplat
