#include "repository/lmdb_check.h"

#include <algorithm>
#include <bit>
#include <optional>
#include <vector>

#include "base/bytes.h"
#include "base/file.h"

// This is the layout of an LMDB 0.9 file on a 64-bit little-endian machine, after its source (mdb.c: MDB_meta,
// MDB_page, MDB_node, MDB_db).
//
// clang-format off
//   page   u64 number, u16 pad, u16 flags, u16 lower, u16 upper, then u16 offsets of nodes up to `lower`;
//          the nodes lie from `upper` on
//   node   u16 low, u16 high, u16 flags, u16 key bytes, key, data
//          in a leaf low and high give the bytes of the data; in a branch low, high and flags give a page number
//   table  u32 pad, u16 flags, u16 depth, u64 branch pages, u64 leaf pages, u64 overflow pages, u64 entries, u64 root
//   meta   page header, u32 magic, u32 version, u64 address, u64 map size, table of free pages, main table,
//          u64 last page, u64 transaction
// clang-format on
//
// The pad of the free table is the page size. The main table holds the named tables as nodes of 48 bytes. A value too
// large for a node lies in overflow pages of its own: a page header, then the value.

namespace repository {
namespace {

constexpr std::uint32_t kMagic = 0xBEEFC0DE;
constexpr std::uint32_t kVersion = 1;
constexpr std::uint16_t kBranch = 0x01, kLeaf = 0x02, kOverflow = 0x04, kKindMask = 0x7F;  // page flags
constexpr std::uint16_t kBigData = 0x01, kSubTable = 0x02;                                 // node flags
constexpr std::uint16_t kIntegerKeys = 0x08;                                               // table flags
constexpr std::uint64_t kNoPage = ~std::uint64_t{0};
constexpr std::uint64_t kPageHeader = 16, kNodeHeader = 8, kTableBytes = 48;
constexpr std::uint64_t kMaxBytes = std::uint64_t{1} << 46;  // half of the address space of an x86-64 process
constexpr int kMaxDepth = 32;                                // CURSOR_STACK in mdb.c

struct Table {
  std::uint32_t pad = 0;
  std::uint16_t flags = 0;
  std::uint16_t depth = 0;
  std::uint64_t root = kNoPage;
};

struct Meta {
  Table free_pages;
  Table main;
  std::uint64_t last_page = 0;
  std::uint64_t txn_id = 0;
};

Table readTable(base::ByteReader& in) {
  Table table;
  table.pad = in.u32();
  table.flags = in.u16();
  table.depth = in.u16();
  in.bytes(32);
  table.root = in.u64();
  return table;
}

std::optional<Meta> readMeta(base::ByteView file, std::uint64_t offset) {
  if (offset > file.size()) return std::nullopt;
  base::ByteReader in(file.subspan(offset));
  in.bytes(kPageHeader);
  const std::uint32_t magic = in.u32();
  const std::uint32_t version = in.u32();
  in.bytes(16);
  Meta meta;
  meta.free_pages = readTable(in);
  meta.main = readTable(in);
  meta.last_page = in.u64();
  meta.txn_id = in.u64();
  if (!in.ok() || magic != kMagic || (version & 0xFFFF) != kVersion) return std::nullopt;

  const std::uint32_t page_bytes = meta.free_pages.pad;
  const bool usable = std::has_single_bit(page_bytes) && page_bytes >= 512 && page_bytes <= 65536;
  if (!usable || meta.last_page < 1 || meta.last_page >= kMaxBytes / page_bytes) return std::nullopt;
  return meta;
}

base::Error damagedError(const std::string& directory, const std::string& problem) {
  return {base::ErrorCode::kInvalidInput,
          directory + "/data.mdb is damaged (" + problem + "); delete the directory and build the images again"};
}

// Walks the trees, marks the pages that it reaches and keeps the first fault.
class TreeWalker {
 public:
  TreeWalker(base::ByteView file, const Meta& meta, CheckDepth depth)
      : file_(file),
        depth_(depth),
        page_bytes_(meta.free_pages.pad),
        last_page_(meta.last_page),
        pages_(std::min<std::uint64_t>(meta.last_page + 1, file.size() / page_bytes_)),
        reached_(pages_) {
    if (pages_ >= 2) reached_[0] = reached_[1] = true;  // the meta pages
  }

  void walkTrees(const Meta& meta) {
    walkTable(meta.main, true, 0);
    in_free_table_ = true;
    if ((meta.free_pages.flags & kIntegerKeys) == 0) fail("free list of another kind", 0);
    walkTable({0, 0, meta.free_pages.depth, meta.free_pages.root}, false, 0);
  }
  const std::string& fault() const { return fault_; }

 private:
  struct Page {
    base::ByteView bytes;
    std::uint16_t lower = 0;
    std::uint16_t upper = 0;
    std::uint64_t nodes() const { return (lower - kPageHeader) / 2; }
  };

  void fail(const std::string& problem, std::uint64_t page) {
    if (fault_.empty()) fault_ = problem + " at page " + std::to_string(page);
  }

  // Marks pages as reached; false when one lies outside of the file or was reached before.
  bool markReached(std::uint64_t first, std::uint64_t count) {
    if (first >= pages_ || count > pages_ - first) return fail("a link out of the file", first), false;
    for (std::uint64_t page = first; page < first + count; ++page) {
      if (reached_[page]) return fail("a page in use twice", page), false;
      reached_[page] = true;
    }
    return true;
  }

  void walkTable(const Table& table, bool holds_tables, std::uint64_t from) {
    if (table.root == kNoPage) return;
    if (table.flags != 0 || table.depth < 1 || table.depth > kMaxDepth) return fail("a table of another kind", from);
    walkPage(table.root, table.depth, holds_tables);
  }

  void walkPage(std::uint64_t number, int depth, bool holds_tables) {
    if (!fault_.empty() || !markReached(number, 1)) return;
    const auto page = readPage(number, depth == 1 ? kLeaf : kBranch);
    if (!page) return;
    const std::uint64_t min_nodes = depth > 1 && !in_free_table_ ? 2 : 1;
    if (page->nodes() < min_nodes) return fail("a page without nodes", number);
    for (std::uint64_t i = 0; i < page->nodes() && fault_.empty(); ++i) walkNode(*page, number, i, depth, holds_tables);
  }

  std::optional<Page> readPage(std::uint64_t number, std::uint16_t kind) {
    Page page;
    page.bytes = file_.subspan(number * page_bytes_, page_bytes_);
    base::ByteReader in(page.bytes);
    const std::uint64_t own_number = in.u64();
    in.u16();
    const std::uint16_t flags = in.u16();
    page.lower = in.u16();
    page.upper = in.u16();
    if (own_number != number || (flags & kKindMask) != kind)
      return fail("a page of the wrong kind", number), std::nullopt;
    if (page.lower < kPageHeader || page.lower % 2 != 0 || page.lower > page.upper || page.upper > page_bytes_) {
      return fail("a page whose parts overlap", number), std::nullopt;
    }
    return page;
  }

  void walkNode(const Page& page, std::uint64_t number, std::uint64_t i, int depth, bool holds_tables) {
    base::ByteReader offsets(page.bytes.subspan(kPageHeader + 2 * i));
    const std::uint64_t at = offsets.u16();
    if (at < page.upper || at % 2 != 0 || at + kNodeHeader > page_bytes_) return fail("a node out of its page", number);
    base::ByteReader in(page.bytes.subspan(at));
    const std::uint64_t low = in.u16();
    const std::uint64_t high = in.u16();
    const std::uint16_t flags = in.u16();
    const std::uint16_t key_bytes = in.u16();
    in.bytes(key_bytes);
    if (!in.ok()) return fail("a key out of its page", number);
    if (depth > 1) return walkPage(low | high << 16 | std::uint64_t{flags} << 32, depth - 1, holds_tables);
    walkData(in, low | high << 16, flags, number, holds_tables);
  }

  void walkData(base::ByteReader& in, std::uint64_t bytes, std::uint16_t flags, std::uint64_t number,
                bool holds_tables) {
    base::ByteView data;
    if (flags == kBigData) {
      const std::uint64_t first = in.u64();
      if (!in.ok()) return fail("a value's link out of its page", number);
      const std::uint64_t pages = (kPageHeader + bytes + page_bytes_ - 1) / page_bytes_;
      if (!markReached(first, pages)) return;
      if (depth_ == CheckDepth::kValues && !isOverflow(first, pages))
        return fail("a value's page of the wrong kind", first);
      data = file_.subspan(first * page_bytes_ + kPageHeader, bytes);
    } else {
      data = in.bytes(bytes);
      if (!in.ok()) return fail("a value out of its page", number);
    }
    if (holds_tables != ((flags & kSubTable) != 0) || (flags & ~(kBigData | kSubTable)) != 0)
      return fail("a value of another kind", number);
    if (holds_tables) {
      if (data.size() != kTableBytes) return fail("a table record of the wrong size", number);
      base::ByteReader record(data);
      walkTable(readTable(record), false, number);
    }
    if (in_free_table_) walkFreeList(data, number);
  }

  bool isOverflow(std::uint64_t number, std::uint64_t pages) const {
    base::ByteReader in(file_.subspan(number * page_bytes_, kPageHeader));
    const std::uint64_t own_number = in.u64();
    in.u16();
    const std::uint16_t flags = in.u16();
    return own_number == number && (flags & kKindMask) == kOverflow && in.u32() == pages;
  }

  // A free list is a count and then that many numbers of free pages in descending order.
  void walkFreeList(base::ByteView data, std::uint64_t number) {
    base::ByteReader in(data);
    const std::uint64_t count = in.u64();
    if (!in.ok() || count > in.remaining() / 8) return fail("a free list out of its page", number);
    std::uint64_t before = kNoPage;
    for (std::uint64_t i = 0; i < count; ++i) {
      const std::uint64_t page = in.u64();
      if (page >= before || page < 2) return fail("a free list out of order", number);
      if (page > last_page_) return fail("a free page out of the file", number);  // a writer would write to it
      if (page < pages_ && reached_[page]) return fail("a page in use and free", page);
      if (page < pages_) reached_[page] = true;
      before = page;
    }
  }

  base::ByteView file_;
  CheckDepth depth_;
  std::uint64_t page_bytes_;
  std::uint64_t last_page_;
  std::uint64_t pages_;  // pages up to last_page_ that the file has
  std::vector<bool> reached_;
  bool in_free_table_ = false;
  std::string fault_;
};

}  // namespace

base::Result<void> checkLmdbHeader(const std::string& directory) {
  const auto file = base::MappedFile::open(directory + "/data.mdb");
  if (!file)
    return file.error().code == base::ErrorCode::kNotFound ? base::Result<void>() : base::Result<void>(file.error());
  if (file->bytes().empty()) return {};
  const auto first = readMeta(file->bytes(), 0);
  if (!first) return damagedError(directory, "its first meta page is none");
  const auto second = readMeta(file->bytes(), first->free_pages.pad);
  if (!second || second->free_pages.pad != first->free_pages.pad)
    return damagedError(directory, "its second meta page is none");
  return {};
}

base::Result<void> checkLmdbTrees(const std::string& directory, std::uint64_t txn_id, CheckDepth depth) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto file, base::MappedFile::open(directory + "/data.mdb"));
  const auto first = readMeta(file.bytes(), 0);
  const auto second = first ? readMeta(file.bytes(), first->free_pages.pad) : first;
  if (!first || !second) return damagedError(directory, "no meta page");
  const Meta& meta = first->txn_id == txn_id ? *first : *second;
  if (meta.txn_id != txn_id)
    return base::Error{base::ErrorCode::kBusy, directory + ": its writer is quicker than we can look; try again"};
  TreeWalker walker(file.bytes(), meta, depth);
  walker.walkTrees(meta);
  if (!walker.fault().empty()) return damagedError(directory, walker.fault());
  return {};
}

}  // namespace repository
