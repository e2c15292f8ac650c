#pragma once
// Writes a plain qsplat.lgq from its groups in breadth-first order (docs/formats/qsplat.md). Memory holds some blocks.
#include <string>

#include "base/file.h"
#include "lod/qsplat/format.h"

namespace lod::qsplat::builder {

class TreeWriter {
 public:
  struct Options {
    bool colors = false;
    bool wide_pointers = false;
    base::Sphere root;
  };
  /// The file appears at `path` when it is complete. Errors: kNoSpace, kIo.
  static base::Result<TreeWriter> create(const std::string& path, const Options& options);
  /// Adds the next group. The first holds the root alone, with the sphere code kWholeParent. Errors: kNoSpace, kIo,
  /// kUnsupported (an offset needs wide pointers, or the tree has more than 128 levels).
  base::Result<void> add(const GroupNodes& group);
  /// Called after the last group. Errors: kNoSpace, kIo.
  base::Result<Header> finish();

 private:
  explicit TreeWriter(base::AtomicFile file, const Options& options)
      : file_(std::move(file)), layout_(options.colors, options.wide_pointers), children_(layout_, kBlockBytes) {
    header_.colors = options.colors;
    header_.wide_pointers = options.wide_pointers;
    header_.root = options.root;
  }
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
