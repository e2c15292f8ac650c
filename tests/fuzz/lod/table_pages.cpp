// TablePages on any file, page by page as a client walks it, with the header's checksum made right so that mutations of
// the counts are met; and a hierarchy grown from what it gives.
#include <unistd.h>

#include <cstdlib>
#include <string>

#include "base/check.h"
#include "base/crc32c.h"
#include "base/file.h"
#include "lod/patch/format.h"
#include "lod/patch/table_pages.h"
#include "tests/fuzz/fuzz.h"
#include "tests/support/synthetic_hierarchy.h"

namespace {

constexpr std::uint32_t kMaxRecords = 64;

void walk(base::ByteView file) {
  using lod::patch::TablePages;
  const auto counts = lod::patch::readTableCounts(file);
  if (!counts) return;
  LUMIGRID_CHECK(counts->blocks_offset <= counts->file_bytes);
  TablePages tables(*counts);
  lod::patch::Hierarchy growing;
  growing.lattice = counts->lattice;
  for (std::uint32_t group = 0; group < std::min(counts->groups, kMaxRecords); ++group) {
    for (int round = 0; round < 4; ++round) {
      const auto record = tables.record(group);
      if (!record) break;
      if (record->missing.empty()) {
        base::ByteReader in(record->bytes);
        if (lod::patch::addGroup(in, growing, counts->groups, counts->patches)) {
          const lod::patch::Group& g = growing.groups[group];
          LUMIGRID_CHECK(g.block_offset >= counts->blocks_offset &&
                         g.block_offset + g.block_bytes <= counts->file_bytes);
        }
        break;
      }
      for (const std::uint32_t page : record->missing) {
        LUMIGRID_CHECK(page < tables.pageCount() && !tables.has(page));
        const std::uint64_t offset = tables.pageOffset(page);
        if (offset + tables.pageLength(page) > file.size()) return;
        tables.add(offset, file.subspan(offset, tables.pageLength(page)));
        LUMIGRID_CHECK(tables.has(page));
      }
    }
  }
  static_cast<void>(tables.leadingRows());
  if (tables.pagesHere() == tables.pageCount()) static_cast<void>(tables.checkWhole());
}

}  // namespace

namespace fuzz {

std::vector<base::Bytes> seeds() {
  const char* folder = std::getenv("TMPDIR");
  const std::string path =
      std::string(folder != nullptr ? folder : "/tmp") + "/fuzz_table_pages_" + std::to_string(::getpid());
  LUMIGRID_CHECK(static_cast<bool>(support::writeSynthetic(support::syntheticHierarchy(4), path)));
  std::vector<base::Bytes> all{*base::readFile(path),
                               *base::readFile(std::string(LUMIGRID_SOURCE_DIR) + "/tests/golden/patch_v3.lgp")};
  std::remove(path.c_str());
  return all;
}

void fuzzOne(base::ByteView bytes) {
  walk(bytes);
  if (bytes.size() < 96) return;
  base::Bytes sealed(bytes.begin(), bytes.end());
  const std::uint32_t crc = base::crc32c(base::ByteView(sealed).first(92));
  std::memcpy(sealed.data() + 92, &crc, sizeof(crc));
  walk(sealed);
}

}  // namespace fuzz
