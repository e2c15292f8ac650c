#pragma once
// Writes a plain qsplat.lgq from its groups in breadth-first order (docs/formats/qsplat.md). Memory holds some blocks.
#include <string>

#include "base/file.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat::builder {

class TreeWriter {
 public:
  /// The file appears at `path` when it is complete. Errors: kNoSpace, kIo.
  static base::Result<TreeWriter> create(const std::string& path, bool colors, bool wide_pointers,
                                         const base::Sphere& root);
  /// Adds the next group. The first holds the root alone, with the sphere code kWholeParent. Errors: kNoSpace, kIo,
  /// kUnsupported (an offset needs wide pointers, or the tree has more than 128 levels).
  base::Result<void> add(const GroupNodes& group);
  /// Called after the last group. Errors: kNoSpace, kIo.
  base::Result<Header> finish();

 private:
  TreeWriter(base::AtomicFile file, const Header& header)
      : file_(std::move(file)), header_(header), layout_(header), children_(layout_, kBlockBytes) {}
  base::Result<void> place(std::uint32_t bytes);
  base::Result<void> seal();
  base::Result<void> flush();

  base::AtomicFile file_;
  Header header_;
  GroupLayout layout_;
  ChildLayout children_;
  std::array<std::uint8_t, kBlockBytes> block_{};
  base::Bytes sealed_;  // complete blocks that are not written yet
  std::uint64_t block_number_ = 1;
  std::uint64_t offset_ = kBlockBytes;     // where the groups added end
  std::uint64_t level_end_ = kBlockBytes;  // where the current level ends
};

}  // namespace lod::qsplat::builder
