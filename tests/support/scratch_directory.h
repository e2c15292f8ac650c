#pragma once
// A new directory for temporary files that is removed with all that is in it. Benchmarks use it too: no gtest here.
#include <stdlib.h>

#include <filesystem>
#include <string>

namespace support {

class ScratchDirectory {
 public:
  /// `name` is part of the directory's name, whose rest is unique.
  explicit ScratchDirectory(const std::string& name = "lumigrid") {
    path_ = (std::filesystem::temp_directory_path() / (name + "_XXXXXX")).string();
    if (::mkdtemp(path_.data()) == nullptr) path_.clear();
  }
  ~ScratchDirectory() {
    std::error_code ignored;
    if (!path_.empty()) std::filesystem::remove_all(path_, ignored);
  }
  ScratchDirectory(const ScratchDirectory&) = delete;
  ScratchDirectory& operator=(const ScratchDirectory&) = delete;
  std::string operator/(const std::string& name) const { return path_ + "/" + name; }
  const std::string& path() const { return path_; }  ///< empty: it could not be made

 private:
  std::string path_;
};

}  // namespace support
