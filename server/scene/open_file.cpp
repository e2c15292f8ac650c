#include "server/scene/open_file.h"

#include <utility>

namespace server {

base::Result<std::unique_ptr<OpenFile>> OpenFile::open(const std::string& path) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, base::PositionedFile::open(path));
  return std::unique_ptr<OpenFile>(new OpenFile(std::move(file)));
}

base::Result<base::Bytes> OpenFile::read(const std::string& /*name*/, std::uint64_t offset,
                                         std::uint64_t length) const {
  if (offset > size() || length > size() - offset)
    return repository::tooShortError(file_.path(), size(), offset, length);
  base::Bytes bytes(length);
  if (const auto read = file_.readAt(offset, bytes); !read)
    return base::Error{base::ErrorCode::kIo, read.error().message};
  return bytes;
}

}  // namespace server
