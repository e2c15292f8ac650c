#include "lod/qsplat/builder/tree_writer.h"

#include <cstring>

namespace lod::qsplat::builder {

namespace {
// Sealed blocks are written together, so many bytes at a time. A choice: fewer would make more system calls.
constexpr std::size_t kMaxSealed = std::size_t{256} * kBlockBytes;
}  // namespace

base::Result<TreeWriter> TreeWriter::create(const std::string& path, bool colors, bool wide_pointers,
                                            const base::Sphere& root) {
  LUMIGRID_ASSIGN_OR_RETURN(auto file, base::AtomicFile::create(path));
  Header header;
  header.colors = colors;
  header.wide_pointers = wide_pointers;
  header.root = root;
  TreeWriter writer(std::move(file), header);
  const base::Bytes no_header(kBlockBytes, 0);  // written last
  LUMIGRID_TRY(writer.file_.write(no_header));
  return writer;
}

base::Result<void> TreeWriter::add(const GroupNodes& group) {
  const std::uint32_t bytes = layout_.bytes(group.count, group.has_pointer);
  if (header_.groups == 0) children_.place(bytes);
  LUMIGRID_TRY(place(bytes));

  std::uint8_t* const at = writeNodes(group, layout_, block_.data() + offset_ % kBlockBytes);
  header_.nodes += group.count;
  for (const Node& node : group.view()) header_.leaves += !group.has_pointer || node.isLeaf() ? 1 : 0;
  if (group.has_pointer) {
    const std::uint64_t half = children_.next(group) / 2;
    if (!header_.wide_pointers && half >> 32 != 0)
      return base::Error{base::ErrorCode::kUnsupported, "the tree takes more than 8 GiB: it needs wide pointers"};
    std::memcpy(at, &half, layout_.pointer_bytes);
    ++header_.pointers;
  }
  offset_ += bytes;
  ++header_.groups;
  return {};
}

// Begins the next block where the group does not fit the current one, and counts levels.
base::Result<void> TreeWriter::place(std::uint32_t bytes) {
  if (offset_ == level_end_) {
    level_end_ = children_.end();
    if (++header_.levels > kMaxLevels)
      return base::Error{base::ErrorCode::kUnsupported, "the tree has more than 128 levels"};
  }
  const std::uint64_t where = groupPlace(offset_, bytes);
  if (where != offset_ && offset_ % kBlockBytes != 0) LUMIGRID_TRY(seal());
  offset_ = where;
  return {};
}

base::Result<void> TreeWriter::seal() {
  sealBlock(block_.data(), static_cast<std::uint32_t>(block_number_++));
  sealed_.insert(sealed_.end(), block_.begin(), block_.end());
  block_.fill(0);
  return sealed_.size() < kMaxSealed ? base::Result<void>() : flush();
}

base::Result<void> TreeWriter::flush() {
  LUMIGRID_TRY(file_.write(sealed_));
  sealed_.clear();
  return {};
}

base::Result<Header> TreeWriter::finish() {
  LUMIGRID_TRY(seal());
  LUMIGRID_TRY(flush());
  header_.file_bytes = file_.size();
  LUMIGRID_TRY(file_.writeAt(0, headerBytes(header_)));
  LUMIGRID_TRY(file_.commit());
  return header_;
}

}  // namespace lod::qsplat::builder
