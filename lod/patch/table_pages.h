#pragma once
// Reads the tables of a patch.lgp page by page, as they come by byte ranges. A client of a static host so draws the
// coarse model when a few pages are here, and never reads rows that no view needs. A hierarchy of 10^8 triangles has 9
// MB of tables.
//
// Rows have fixed lengths, so each can be found without those before it; children are named by number. Walking down
// from group 0 needs a page or two for each step. docs/formats/patch.md, "Reading by ranges", has the byte map.
#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

/// The numbers of a header.
struct TableCounts {
  static constexpr std::uint64_t kHeaderBytes = 96;

  Lattice lattice;
  bool has_colors = false;
  std::uint64_t source_triangles = 0;
  std::uint64_t file_bytes = 0;
  std::uint64_t blocks_offset = 0;  ///< header and tables end there
  std::uint32_t groups = 0, patches = 0, parents = 0;
  std::uint32_t tables_crc = 0;

  /// Where the rows lie in the file; the tables end at parentOffset(parents).
  std::uint64_t rowOffset(std::uint32_t group) const;
  std::uint64_t patchOffset(std::uint32_t patch) const;
  std::uint64_t parentOffset(std::uint32_t parent) const;
};
/// From the first 96 bytes of the file or more; checked as PatchFile::open does.
base::Result<TableCounts> readTableCounts(base::ByteView front);

/// Hostile bytes are an error, never more memory than theirs. Rows are checked one by one; that they agree with each
/// other is checked as far as addGroup() does.
class TablePages {
 public:
  static constexpr std::uint32_t kPageBytes = 1024;

  explicit TablePages(const TableCounts& counts) : counts_(counts) {}
  const TableCounts& counts() const { return counts_; }

  /// Adds the whole pages among the bytes, which lie at `offset` in the file. The last page ends with the tables.
  void add(std::uint64_t offset, base::ByteView bytes);
  bool has(std::uint32_t page) const { return pages_.count(page) != 0; }
  std::uint32_t pageCount() const;
  std::uint32_t pagesHere() const { return static_cast<std::uint32_t>(pages_.size()); }
  std::uint64_t pageOffset(std::uint32_t page) const { return std::uint64_t{page} * kPageBytes; }
  std::uint32_t pageLength(std::uint32_t page) const;

  /// A group's row, checked by itself; nothing while its page is not here. `group` is below counts().groups.
  base::Result<std::optional<Group>> row(std::uint32_t group) const;
  /// The number of groups from group 0 on whose rows are all here.
  std::uint32_t leadingRows() const;

  struct Record {
    base::Bytes bytes;                   ///< as encodeGroup writes it; empty: pages are missing
    std::vector<std::uint32_t> missing;  ///< these; those of rows that they will name may follow
  };
  /// One group as bytes, for addGroup(): its row, its patches' rows, its parents, and the errors that are stated in the
  /// rows of the groups that produced its patches.
  base::Result<Record> record(std::uint32_t group) const;

  /// When all pages are here: whether their checksum is the header's.
  base::Result<void> checkWhole() const;

 private:
  std::optional<base::Bytes> read(std::uint64_t offset, std::uint64_t length,
                                  std::vector<std::uint32_t>* missing = nullptr) const;

  TableCounts counts_;
  std::unordered_map<std::uint32_t, base::Bytes> pages_;
};

}  // namespace lod::patch
