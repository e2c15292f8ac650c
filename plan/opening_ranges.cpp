#include "plan/opening_ranges.h"

#include <algorithm>
#include <set>
#include <utility>

#include "plan/view_plan.h"

namespace plan {
namespace {

using base::FileRange;
using lod::patch::TablePages;

/// Bytes between two ranges that are read in vain rather than asked for apart: a request and the head of its answer
/// have some 700.
constexpr std::uint64_t kMaxGap = 1024;

/// So many bytes of blocks at most, so that over a thin link something is seen before all of the coarse model is here:
/// 0.4 s at 384 kbit/s.
constexpr std::uint64_t kOpeningBlockBytes = 20'000;

/// Tables up to this size are named whole: a client that has drawn something asks for small tables to their end before
/// it plans, which would take a round trip more.
constexpr std::uint64_t kWholeTableBytes = 16 * 1024;

/// Joins neighbours, which are in order of offsets.
std::vector<FileRange> joined(const std::vector<FileRange>& ranges) {
  std::vector<FileRange> out;
  for (const FileRange& range : ranges) {
    if (!out.empty() && range.offset <= out.back().offset + out.back().length + kMaxGap)
      out.back().length = range.offset + range.length - out.back().offset;
    else
      out.push_back(range);
  }
  return out;
}

}  // namespace

base::Result<std::vector<FileRange>> openingRanges(
    const std::function<base::Result<base::Bytes>(const FileRange&)>& read) {
  LUMIGRID_ASSIGN_OR_RETURN(const base::Bytes header, read({0, lod::patch::TableCounts::kHeaderBytes}));
  LUMIGRID_ASSIGN_OR_RETURN(const auto counts, lod::patch::readTableCounts(header));
  LUMIGRID_ASSIGN_OR_RETURN(const base::Bytes tables, read({0, counts.blocks_offset}));
  LUMIGRID_ASSIGN_OR_RETURN(const auto hierarchy, lod::patch::readTables(tables));
  const std::vector<std::uint32_t> coarse = coarseGroups(hierarchy, kOpeningBlockBytes);

  // A client finds the coarse groups among the first rows, one after the other, and needs the pages of their records.
  TablePages pages(counts);
  std::set<std::uint32_t> needed;
  const std::uint32_t last = *std::max_element(coarse.begin(), coarse.end());
  const auto last_page = static_cast<std::uint32_t>((counts.rowOffset(last + 1) - 1) / TablePages::kPageBytes);
  const bool is_small = counts.blocks_offset <= kWholeTableBytes;
  for (std::uint32_t page = 0; page < (is_small ? pages.pageCount() : last_page + 1); ++page) needed.insert(page);
  for (std::size_t before = 0; before != needed.size();) {
    before = needed.size();
    for (const std::uint32_t page : needed)
      pages.add(pages.pageOffset(page), base::ByteView(tables).subspan(pages.pageOffset(page), pages.pageLength(page)));
    for (const std::uint32_t group : coarse) {
      LUMIGRID_ASSIGN_OR_RETURN(const auto record, pages.record(group));
      needed.insert(record.missing.begin(), record.missing.end());
    }
  }

  std::vector<FileRange> of_tables, of_blocks;
  for (const std::uint32_t page : needed) of_tables.push_back({pages.pageOffset(page), pages.pageLength(page)});
  for (const std::uint32_t group : coarse)
    of_blocks.push_back({hierarchy.groups[group].block_offset, hierarchy.groups[group].block_bytes});
  std::sort(of_blocks.begin(), of_blocks.end(),
            [](const FileRange& a, const FileRange& b) { return a.offset < b.offset; });
  std::vector<FileRange> ranges = joined(of_tables);
  const std::vector<FileRange> blocks = joined(of_blocks);
  ranges.insert(ranges.end(), blocks.begin(), blocks.end());
  ranges.resize(std::min(ranges.size(), kMaxOpeningRanges));
  return ranges;
}

}  // namespace plan
