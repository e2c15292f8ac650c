#pragma once
// A file of a local scene as it is downloaded.
#include <cstdint>
#include <memory>
#include <string>

#include "base/file.h"
#include "repository/objects/objects.h"

namespace server {

/// One file, kept open: a build that replaces it leaves those who download it alone. It is read by position and not
/// mapped, so a file that is cut or whose disk fails gives an error.
class OpenFile final : public repository::ObjectSource {
 public:
  /// Errors: as base::readFile.
  static base::Result<std::unique_ptr<OpenFile>> open(const std::string& path);
  /// `name` is for callers that have several objects; this has one. Errors are kIo and name the file.
  base::Result<base::Bytes> read(const std::string& name, std::uint64_t offset, std::uint64_t length) const override;
  base::Result<std::uint64_t> size(const std::string& /*name*/) const override { return size(); }
  const std::string& place() const override { return file_.path(); }
  std::uint64_t size() const { return file_.size(); }  ///< when it was opened
  base::Result<base::Bytes> readAll() const { return read("", 0, size()); }

 private:
  explicit OpenFile(base::PositionedFile file) : file_(std::move(file)) {}
  base::PositionedFile file_;
};

}  // namespace server
