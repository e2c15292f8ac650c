#include "lod/patch/table_pages.h"

#include <algorithm>

#include "base/crc32c.h"
#include "lod/patch/records.h"

namespace lod::patch {
namespace {

// Checks the ranges that a row names against the totals.
base::Result<void> checkRow(const TableCounts& counts, std::uint32_t index, const Group& group) {
  LUMIGRID_TRY(checkGroupRow(group, index, counts.patches, counts.parents));
  if (group.block_offset < counts.blocks_offset || group.block_offset > counts.file_bytes ||
      group.block_bytes > counts.file_bytes - group.block_offset)
    return groupError(index, "its block is not in the file");
  return {};
}

}  // namespace

std::uint32_t TablePages::pageCount() const {
  return static_cast<std::uint32_t>((counts_.blocks_offset + kPageBytes - 1) / kPageBytes);
}

std::uint32_t TablePages::pageLength(std::uint32_t page) const {
  return static_cast<std::uint32_t>(std::min<std::uint64_t>(kPageBytes, counts_.blocks_offset - pageOffset(page)));
}

void TablePages::add(std::uint64_t offset, base::ByteView bytes) {
  const std::uint64_t end = offset + bytes.size();
  for (auto page = static_cast<std::uint32_t>((offset + kPageBytes - 1) / kPageBytes);
       page < pageCount() && pageOffset(page) + pageLength(page) <= end; ++page) {
    const base::ByteView part = bytes.subspan(pageOffset(page) - offset, pageLength(page));
    pages_.try_emplace(page, part.begin(), part.end());
  }
}

std::uint64_t TableCounts::rowOffset(std::uint32_t group) const {
  return kFileHeaderBytes + std::uint64_t{kGroupRowBytes} * group;
}
std::uint64_t TableCounts::patchOffset(std::uint32_t patch) const {
  return rowOffset(groups) + std::uint64_t{kPatchRowBytes} * patch;
}
std::uint64_t TableCounts::parentOffset(std::uint32_t parent) const {
  return patchOffset(patches) + std::uint64_t{4} * parent;
}

// Nothing if pages are missing, which are added to `missing`.
std::optional<base::Bytes> TablePages::read(std::uint64_t offset, std::uint64_t length,
                                            std::vector<std::uint32_t>* missing) const {
  if (length == 0) return base::Bytes();
  const auto first = static_cast<std::uint32_t>(offset / kPageBytes);
  const auto last = static_cast<std::uint32_t>((offset + length - 1) / kPageBytes);
  bool here = true;
  for (std::uint32_t page = first; page <= last; ++page) {
    if (has(page)) continue;
    here = false;
    if (missing == nullptr) return std::nullopt;
    missing->push_back(page);
  }
  if (!here) return std::nullopt;

  base::Bytes out;
  out.reserve(length);
  for (std::uint32_t page = first; page <= last; ++page) {
    const base::Bytes& bytes = pages_.at(page);
    const std::uint64_t begin = std::max(offset, pageOffset(page)) - pageOffset(page);
    const std::uint64_t end = std::min<std::uint64_t>(offset + length - pageOffset(page), bytes.size());
    out.insert(out.end(), bytes.begin() + static_cast<std::ptrdiff_t>(begin),
               bytes.begin() + static_cast<std::ptrdiff_t>(end));
  }
  return out;
}

base::Result<std::optional<Group>> TablePages::row(std::uint32_t group) const {
  const auto bytes = read(counts_.rowOffset(group), kGroupRowBytes);
  if (!bytes) return std::optional<Group>();
  base::ByteReader in(*bytes);
  const Group row = readRow<Group>(in);
  LUMIGRID_TRY(checkRow(counts_, group, row));
  return std::optional(row);
}

std::uint32_t TablePages::leadingRows() const {
  std::uint32_t page = 0;
  while (has(page)) ++page;
  const std::uint64_t end = pageOffset(page);
  if (end < kFileHeaderBytes) return 0;
  return static_cast<std::uint32_t>(std::min<std::uint64_t>(counts_.groups, (end - kFileHeaderBytes) / kGroupRowBytes));
}

base::Result<TablePages::Record> TablePages::record(std::uint32_t group) const {
  Record record;
  const auto row_bytes = read(counts_.rowOffset(group), kGroupRowBytes, &record.missing);
  if (!row_bytes) return record;
  LUMIGRID_ASSIGN_OR_RETURN(const auto row, this->row(group));
  const Group& g = *row;

  // The rows of its patches and its parents, then those of the groups that produced the patches.
  const auto patch_bytes =
      read(counts_.patchOffset(g.first_patch), std::uint64_t{kPatchRowBytes} * g.patch_count, &record.missing);
  const auto parent_bytes =
      read(counts_.parentOffset(g.first_parent), std::uint64_t{4} * g.parent_count, &record.missing);
  base::ByteWriter errors;
  if (patch_bytes) {
    base::ByteReader in(*patch_bytes);
    for (std::uint32_t i = 0; i < g.patch_count; ++i) {
      const Patch patch = readRow<Patch>(in);
      if (patch.producer == kNoGroup) {
        for (int error = 0; error < 3; ++error) errors.f32(0.0F);
        continue;
      }
      if (patch.producer >= counts_.groups) return patchError(g.first_patch + i, "its producer is not there");
      if (!read(counts_.rowOffset(patch.producer), kGroupRowBytes, &record.missing)) continue;
      LUMIGRID_ASSIGN_OR_RETURN(const auto producer, this->row(patch.producer));
      errors.f32(producer->error);
      errors.f32(producer->typical_error);
      errors.f32(producer->visible_error);
    }
  }
  std::sort(record.missing.begin(), record.missing.end());
  record.missing.erase(std::unique(record.missing.begin(), record.missing.end()), record.missing.end());
  if (!record.missing.empty()) return record;

  base::ByteWriter out;
  out.u32(group);
  out.bytes(*row_bytes);
  out.bytes(*patch_bytes);
  out.bytes(errors.view());
  out.bytes(*parent_bytes);
  record.bytes = out.takeBytes();
  return record;
}

base::Result<void> TablePages::checkWhole() const {
  const auto bytes = read(kFileHeaderBytes, counts_.blocks_offset - kFileHeaderBytes);
  if (!bytes) return damaged("not all of the tables is here");
  if (base::crc32c(*bytes) != counts_.tables_crc) return damaged("tables: checksum does not match");
  return {};
}

}  // namespace lod::patch
