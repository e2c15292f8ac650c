#include "plan/opening_ranges.h"

#include <algorithm>

#include "lod/patch/group_records.h"
#include "plan/view_plan.h"

namespace plan {
namespace {

using base::FileRange;
using lod::patch::GroupRecords;

/// Bytes between two ranges that are read in vain rather than asked for apart: a request and the head of its answer
/// have some 700.
constexpr std::uint64_t kMaxGap = 1024;

/// So many bytes of blocks at most, so that over a thin link something is seen before all of the coarse model is here:
/// 0.4 s at 384 kbit/s.
constexpr std::uint64_t kOpeningBlockBytes = 20'000;

/// Records are named up to the chunk that reaches this, so that a view can be planned for as soon as something is
/// drawn: sixteen groups mostly, all of a scene of 100 000 triangles. More came at the cost of the first picture
/// (docs/decisions/static-scenes.md).
constexpr std::uint64_t kOpeningRecordBytes = 2'000;

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

base::Result<OpeningRanges> openingRanges(const lod::patch::Hierarchy& hierarchy, base::ByteView records) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto read, GroupRecords::open(records));
  const std::vector<std::uint32_t> coarse = coarseGroups(hierarchy, kOpeningBlockBytes);

  // A client finds the coarse groups among the first records, one after the other.
  std::uint32_t chunk = GroupRecords::chunkOf(*std::max_element(coarse.begin(), coarse.end()));
  const auto end = [&] { return read.chunkOffset(chunk) + read.chunkBytes(chunk); };
  while (end() < kOpeningRecordBytes && chunk + 1 < read.chunkCount()) ++chunk;

  std::vector<FileRange> of_blocks;
  for (const std::uint32_t group : coarse)
    of_blocks.push_back({hierarchy.groups[group].block_offset, hierarchy.groups[group].block_bytes});
  std::sort(of_blocks.begin(), of_blocks.end(),
            [](const FileRange& a, const FileRange& b) { return a.offset < b.offset; });
  OpeningRanges ranges{{0, end()}, joined(of_blocks)};
  ranges.blocks.resize(std::min(ranges.blocks.size(), kMaxOpeningRanges));
  return ranges;
}

}  // namespace plan
