// Reads the records of groups.
#include "lod/patch/group_records.h"

#include <algorithm>
#include <array>
#include <cstring>
#include <utility>

#include "base/crc32c.h"
#include "lod/patch/codec/normals.h"
#include "lod/patch/codec/residual_reader.h"
#include "lod/patch/codec/residuals.h"
#include "lod/patch/record_fields.h"
#include "lod/patch/records.h"

namespace lod::patch {
namespace {

using namespace records;

/// A plane has a bit at least for each number, so that a chunk of so many bytes has no more patches.
constexpr std::uint64_t kMaxPatchesPerByte = 8;
/// A reader of planes may look so far behind their end.
constexpr std::size_t kPadding = 64;

base::Error badRecords(const std::string& problem) {
  return {base::ErrorCode::kInvalidInput, problem + "; publish the scene again"};
}

// Reads the planes of a chunk one after the other.
class PlaneReader {
 public:
  PlaneReader(base::ByteView bytes, std::size_t at) : padded_(bytes.begin(), bytes.end()), at_(at) {
    padded_.resize(bytes.size() + kPadding);
  }
  /// The next plane's residuals, in whole groups; nothing where the bytes are none.
  std::optional<std::vector<std::uint32_t>> next(std::size_t count) {
    const std::size_t groups = codec::groupsOf(count);
    std::vector<std::uint32_t> numbers(groups * codec::kGroup);
    widths_.resize(std::max(widths_.size(), groups + codec::kGroup));
    if (!codec::readResiduals(whole(), at_, groups, {widths_.data(), nullptr}, numbers.data())) return std::nullopt;
    return numbers;
  }
  std::size_t remaining() const { return whole().size() - at_; }

 private:
  base::ByteView whole() const { return base::ByteView(padded_).first(padded_.size() - kPadding); }
  base::Bytes padded_, widths_;
  std::size_t at_;
};

template <std::size_t kPlanes>
std::optional<std::array<std::vector<std::uint32_t>, kPlanes>> readPlanes(PlaneReader& reader, std::size_t count) {
  std::array<std::vector<std::uint32_t>, kPlanes> planes;
  for (auto& plane : planes) {
    auto numbers = reader.next(count);
    if (!numbers) return std::nullopt;
    plane = std::move(*numbers);
  }
  return planes;
}

// The front of a chunk, before its planes.
struct ChunkHead {
  std::uint32_t first_patch = 0;
  std::uint64_t block_offset = 0;
  Units units;
  GroupNumbers group;
  PatchNumbers patch;
  std::size_t bytes = 0;
};

std::optional<ChunkHead> readHead(base::ByteView bytes, const Lattice& lattice) {
  base::ByteReader in(bytes);
  ChunkHead head;
  in.u32();  // the checksum
  head.first_patch = in.u32();
  head.block_offset = in.u64();
  const unsigned shift = in.u8();
  if (shift > kMaxUnitShift) return std::nullopt;
  head.units = {lattice.origin, std::ldexp(lattice.step, static_cast<int>(shift))};
  const auto number = [&in](std::uint32_t& value, std::uint32_t) { value = static_cast<std::uint32_t>(in.varint()); };
  visitNumbers(head.group, {}, number);
  number(head.patch.producer, 0);
  number(head.patch.typical_error, 0);
  number(head.patch.error, 0);
  number(head.patch.visible_error, 0);
  head.bytes = in.offset();
  return in.ok() ? std::optional(head) : std::nullopt;
}

// Residuals become numbers row by row, since they are predicted from the rows before.
std::optional<std::vector<GroupNumbers>> readGroups(PlaneReader& reader, std::size_t count, GroupNumbers before) {
  const auto planes = readPlanes<kGroupPlanes>(reader, count);
  if (!planes) return std::nullopt;
  std::vector<GroupNumbers> groups(count);
  for (std::size_t g = 0; g < count; ++g) {
    std::size_t plane = 0;
    visitNumbers(groups[g], before,
                 [&](std::uint32_t& number, std::uint32_t predicted) { number = predicted + (*planes)[plane++][g]; });
    before = groups[g];
  }
  return groups;
}

std::optional<std::vector<PatchNumbers>> readPatches(PlaneReader& reader, std::size_t count,
                                                     const std::vector<GroupNumbers>& groups, PatchNumbers before) {
  const auto planes = readPlanes<kPatchPlanes>(reader, count);
  if (!planes) return std::nullopt;
  std::vector<PatchNumbers> patches(count);
  std::size_t p = 0;
  for (const GroupNumbers& group : groups) {
    for (const std::size_t end = p + group.patches; p < end; ++p) {
      std::size_t plane = 0;
      visitNumbers(patches[p], before, group,
                   [&](std::uint32_t& number, std::uint32_t predicted) { number = predicted + (*planes)[plane++][p]; });
      before = patches[p];
    }
  }
  return patches;
}

base::Sphere sphereOf(const Units& units, const Triple& center, std::uint32_t radius) {
  base::Sphere sphere;
  for (std::size_t k = 0; k < 3; ++k) sphere.center[static_cast<int>(k)] = units.placeOf(center[k], k);
  sphere.radius = static_cast<float>(units.lengthOf(radius));
  return sphere;
}

Group groupOf(const GroupNumbers& n, const Units& units) {
  Group group;
  group.bounds = sphereOf(units, n.center, n.radius);
  group.error = errorOfCode(n.error);
  group.attribute_error = errorOfCode(n.attribute_error);
  group.typical_error = errorOfCode(n.typical_error);
  group.typical_color_error = errorOfCode(n.typical_color_error);
  group.visible_error = errorOfCode(n.visible_error);
  group.level = n.level;
  group.patch_count = n.patches;
  group.parent_count = n.parents;
  return group;
}

Patch patchOf(const PatchNumbers& n, const Units& units) {
  Patch patch;
  for (std::size_t k = 0; k < 3; ++k) {
    const int axis = static_cast<int>(k);
    patch.box.min[axis] = units.placeOf(n.corner[k], k);
    patch.box.max[axis] = units.placeOf(n.corner[k] + n.extent[k], k);
  }
  patch.bounds = sphereOf(units, n.center, n.radius);
  codec::NormalBlock axis;
  const auto low_byte = [](std::uint32_t code) { return static_cast<std::int32_t>(code << 24) >> 24; };
  const std::int32_t u = low_byte(n.axis_u), v = low_byte(n.axis_v);
  codec::decodeNormals(&u, &v, 1, axis);
  patch.cone = {{axis.x[0], axis.y[0], axis.z[0]}, cosineOfAngle(n.angle)};
  patch.level = static_cast<std::uint16_t>(n.level);
  patch.triangles = n.triangles;
  patch.vertices = n.vertices;
  patch.block_bytes = n.bytes;
  if (n.level == 0) {
    patch.color_detail = static_cast<std::uint16_t>(n.color_detail);
    return patch;
  }
  patch.producer = n.producer;
  patch.own_error = errorOfCode(n.error);
  patch.own_typical_error = errorOfCode(n.typical_error);
  patch.own_visible_error = errorOfCode(n.visible_error);
  return patch;
}

}  // namespace

base::Result<GroupRecords> GroupRecords::open(base::ByteView front) {
  base::ByteReader in(front);
  const base::ByteView magic = in.bytes(sizeof(kRecordsMagic) - 1);
  if (!in.ok() || base::textOf(magic) != kRecordsMagic) return badRecords("these are no records of groups");
  const std::uint32_t version = in.u32();
  if (version != kRecordsVersion)
    return base::Error{base::ErrorCode::kVersion, "records of version " + std::to_string(version) +
                                                      ", this viewer reads " + std::to_string(kRecordsVersion)};
  GroupRecords read;
  RecordCounts& counts = read.counts_;
  counts.front_bytes = in.u32();
  counts.object_bytes = in.u64();
  counts.patch_bytes = in.u64();
  for (int k = 0; k < 3; ++k) counts.lattice.origin[k] = in.f64();
  counts.lattice.step = in.f64();
  counts.source_triangles = in.u64();
  counts.has_colors = (in.u32() & kColorsFlag) != 0;
  counts.groups = in.u32();
  counts.patches = in.u32();
  const std::uint32_t per_chunk = in.u32();
  const std::uint32_t directory_crc = in.u32();
  const std::size_t covered = in.offset();
  const std::uint32_t header_crc = in.u32();
  if (!in.ok() || base::crc32c(front.first(covered)) != header_crc) return badRecords("the header is damaged");
  const bool numbers_are = std::isfinite(counts.lattice.origin.x) && std::isfinite(counts.lattice.origin.y) &&
                           std::isfinite(counts.lattice.origin.z) && std::isfinite(counts.lattice.step) &&
                           counts.lattice.step > 0.0 && counts.groups > 0 && counts.patches > 0 &&
                           per_chunk == kGroupsPerChunk;
  if (!numbers_are) return badRecords("the header holds what cannot be");
  if (counts.front_bytes < RecordCounts::kHeaderBytes || counts.front_bytes > front.size())
    return badRecords("the directory is not in the first bytes");

  const base::ByteView directory =
      front.subspan(RecordCounts::kHeaderBytes, counts.front_bytes - RecordCounts::kHeaderBytes);
  const std::uint32_t chunks = (counts.groups - 1) / kGroupsPerChunk + 1;
  if (base::crc32c(directory) != directory_crc || chunks > directory.size())
    return badRecords("the directory is damaged");
  base::ByteReader lengths(directory);
  std::uint64_t at = counts.front_bytes;
  read.offsets_.reserve(std::size_t{chunks} + 1);
  for (std::uint32_t chunk = 0; chunk < chunks; ++chunk) {
    read.offsets_.push_back(at);
    const std::uint64_t length = lengths.varint();
    if (length == 0 || length > counts.object_bytes - std::min(at, counts.object_bytes))
      return badRecords("the directory is damaged");
    at += length;
  }
  read.offsets_.push_back(at);
  if (!lengths.atEnd() || at != counts.object_bytes) return badRecords("the directory is damaged");
  for (std::uint32_t chunk = 0; chunk < chunks && read.offsets_[chunk + 1] <= front.size(); ++chunk)
    LUMIGRID_TRY(read.add(chunk, front.subspan(read.offsets_[chunk], read.chunkBytes(chunk))));
  return read;
}

base::Result<void> GroupRecords::add(std::uint32_t chunk, base::ByteView bytes) {
  if (has(chunk)) return {};
  const std::uint32_t first_group = chunk * kGroupsPerChunk;
  auto decoded = decodeChunk(bytes, first_group, std::min(kGroupsPerChunk, counts_.groups - first_group));
  if (bytes.size() != chunkBytes(chunk) || !decoded)
    return badRecords("chunk " + std::to_string(chunk) + " of the records is damaged");
  chunks_.emplace(chunk, std::move(*decoded));
  return {};
}

std::optional<GroupRecords::Chunk> GroupRecords::decodeChunk(base::ByteView bytes, std::uint32_t first_group,
                                                             std::uint32_t count) const {
  base::ByteReader in(bytes);
  const std::uint32_t crc = in.u32();
  if (!in.ok() || crc != base::crc32c(bytes.subspan(sizeof(crc)))) return std::nullopt;
  const auto head = readHead(bytes, counts_.lattice);
  if (!head) return std::nullopt;
  PlaneReader reader(bytes, head->bytes);
  const auto groups = readGroups(reader, count, head->group);
  if (!groups) return std::nullopt;
  std::uint64_t patch_count = 0, parent_count = 0;
  for (const GroupNumbers& group : *groups) patch_count += group.patches, parent_count += group.parents;
  const std::uint64_t most = kMaxPatchesPerByte * reader.remaining();
  if (patch_count > most || parent_count > most || head->first_patch + patch_count > counts_.patches)
    return std::nullopt;
  const auto parents = parent_count == 0 ? std::vector<std::uint32_t>() : reader.next(parent_count);
  const auto patches = readPatches(reader, patch_count, *groups, head->patch);
  if (!parents || !patches || reader.remaining() != 0) return std::nullopt;

  Chunk decoded;
  std::uint32_t parent = first_group, next_parent = 0, next_patch = 0;
  std::uint64_t block_offset = head->block_offset;
  for (std::uint32_t g = 0; g < count; ++g) {
    const std::uint32_t number = first_group + g;
    Group group = groupOf((*groups)[g], head->units);
    group.first_patch = head->first_patch + next_patch;
    std::vector<Patch> consumed;
    std::uint64_t block_bytes = 0;
    for (std::uint32_t i = 0; i < group.patch_count; ++i) {
      consumed.push_back(patchOf((*patches)[next_patch++], head->units));
      consumed.back().consumer = number;
      consumed.back().block_offset = static_cast<std::uint32_t>(block_bytes);
      block_bytes += consumed.back().block_bytes;
    }
    if (block_bytes > counts_.patch_bytes || block_offset > counts_.patch_bytes - block_bytes) return std::nullopt;
    group.block_offset = block_offset;
    group.block_bytes = static_cast<std::uint32_t>(block_bytes);
    block_offset = (block_offset + block_bytes + kBlockMultiple - 1) / kBlockMultiple * kBlockMultiple;
    if (groupFault(group, number) != nullptr) return std::nullopt;

    base::ByteWriter out;
    out.u32(number);
    writeRow(out, group);
    for (const Patch& patch : consumed) writeRow(out, patch);
    for (const Patch& patch : consumed)
      out.f32(patch.own_error), out.f32(patch.own_typical_error), out.f32(patch.own_visible_error);
    for (std::uint32_t i = 0; i < group.parent_count; ++i) out.u32(parent += (*parents)[next_parent++]);
    decoded.rows.push_back(group);
    decoded.records.push_back(out.takeBytes());
  }
  return decoded;
}

const Group* GroupRecords::row(std::uint32_t group) const {
  const auto chunk = chunks_.find(chunkOf(group));
  return chunk == chunks_.end() ? nullptr : &chunk->second.rows[group % kGroupsPerChunk];
}

base::ByteView GroupRecords::record(std::uint32_t group) const {
  const auto chunk = chunks_.find(chunkOf(group));
  if (chunk == chunks_.end()) return {};
  return chunk->second.records[group % kGroupsPerChunk];
}

std::uint32_t GroupRecords::leadingGroups() const {
  std::uint32_t chunk = 0;
  while (chunk < chunkCount() && has(chunk)) ++chunk;
  return std::min(chunk * kGroupsPerChunk, counts_.groups);
}

}  // namespace lod::patch
