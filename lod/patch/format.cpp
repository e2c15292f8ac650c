#include "lod/patch/format.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "base/crc32c.h"
#include "base/fields.h"
#include "lod/patch/codec.h"
#include "lod/patch/records.h"

namespace lod::patch {
namespace {

constexpr std::array<char, 8> kMagic{'L', 'G', 'P', 'A', 'T', 'C', 'H', '\n'};
constexpr std::uint32_t kVersion = 3, kOldestVersion = 2, kHasColors = 1;
constexpr std::uint64_t kBlockAlignment = 16;
constexpr std::size_t kHeaderCrcOffset = 92;

std::uint64_t alignedUp(std::uint64_t offset) {
  return (offset + kBlockAlignment - 1) / kBlockAlignment * kBlockAlignment;
}

// Header ------------------------------------------------------------------------------------------

// The fields between the lengths of the header and its checksum.
auto headerFields(auto& h, auto& flags) {
  return std::tie(h.file_bytes, h.blocks_offset, h.lattice.origin, h.lattice.step, h.source_triangles, flags, h.groups,
                  h.patches, h.parents, h.tables_crc);
}

base::Bytes headerBytes(const TableCounts& header) {
  const std::uint32_t flags = header.has_colors ? kHasColors : 0;
  base::ByteWriter out;
  out.write(kMagic);
  out.u32(kVersion);
  out.u32(kFileHeaderBytes);
  base::writeFields(out, headerFields(header, flags));
  out.u32(base::crc32c(out.view()));
  return out.takeBytes();
}

std::uint64_t tablesEnd(const TableCounts& header) {
  return kFileHeaderBytes + std::uint64_t{kGroupRowBytes} * header.groups +
         std::uint64_t{kPatchRowBytes} * header.patches + std::uint64_t{4} * header.parents;
}

base::Result<void> checkHeader(const TableCounts& header) {
  const glm::dvec3& origin = header.lattice.origin;
  const double step = header.lattice.step;
  if (!std::isfinite(origin.x) || !std::isfinite(origin.y) || !std::isfinite(origin.z) || !std::isfinite(step) ||
      step <= 0.0)
    return damaged("header: the lattice's origin or step is not a number of use");
  if (header.groups == 0 || header.patches == 0) return damaged("header: no groups or no patches");
  if (header.blocks_offset != alignedUp(tablesEnd(header)))
    return damaged("header: the blocks don't begin behind the tables");
  if (header.file_bytes < header.blocks_offset) return damaged("header: the file would end within its tables");
  return {};
}

// Tables ------------------------------------------------------------------------------------------

base::Bytes tableBytes(const Hierarchy& hierarchy) {
  base::ByteWriter out;
  for (const Group& group : hierarchy.groups) writeRow(out, group);
  for (const Patch& patch : hierarchy.patches) writeRow(out, patch);
  for (const std::uint32_t parent : hierarchy.parents) out.u32(parent);
  return out.takeBytes();
}

// Checks that blocks follow one another in the groups' order and patches within a block in theirs, without gap or
// overlap.
base::Result<void> checkBlocks(const Hierarchy& h, const TableCounts& header) {
  std::uint64_t offset = header.blocks_offset;
  for (std::size_t g = 0; g < h.groups.size(); ++g) {
    const Group& group = h.groups[g];
    if (group.block_offset != alignedUp(offset)) return groupError(g, "its block is not where the one before ends");
    std::uint64_t within = 0;
    for (std::uint32_t p = group.first_patch; p < group.first_patch + group.patch_count; ++p) {
      if (h.patches[p].block_offset != within) return patchError(p, "its bytes are not where the patch before ends");
      within += h.patches[p].block_bytes;
    }
    if (within != group.block_bytes) return groupError(g, "its block has not the length of its patches");
    offset = group.block_offset + group.block_bytes;
  }
  if (offset != header.file_bytes) return damaged("header: the file is not as long as its blocks");
  return {};
}

base::Result<Hierarchy> readTablesBehind(const TableCounts& header, base::ByteView front) {
  if (front.size() < header.blocks_offset)
    return damaged("cut short within the tables: " + std::to_string(front.size()) + " of " +
                   std::to_string(header.blocks_offset) + " bytes");
  const base::ByteView tables = front.subspan(kFileHeaderBytes, header.blocks_offset - kFileHeaderBytes);
  if (base::crc32c(tables) != header.tables_crc) return damaged("tables: checksum does not match");

  // The counts are bounded by the bytes that are here: the reader can't run dry.
  Hierarchy hierarchy;
  hierarchy.lattice = header.lattice;
  hierarchy.has_colors = header.has_colors;
  hierarchy.source_triangles = header.source_triangles;
  base::ByteReader in(tables);
  hierarchy.groups.resize(header.groups);
  for (Group& group : hierarchy.groups) group = readRow<Group>(in);
  hierarchy.patches.resize(header.patches);
  for (Patch& patch : hierarchy.patches) patch = readRow<Patch>(in);
  hierarchy.parents.resize(header.parents);
  for (std::uint32_t& parent : hierarchy.parents) parent = in.u32();

  LUMIGRID_TRY(checkHierarchy(hierarchy));
  LUMIGRID_TRY(checkBlocks(hierarchy, header));
  return hierarchy;
}

}  // namespace

base::Result<TableCounts> readTableCounts(base::ByteView front) {
  // Magic and version come first, so that a newer file is named as such.
  base::ByteReader in(front);
  if (in.read<std::array<char, 8>>() != kMagic || !in.ok()) return damaged("not a patch.lgp");
  const std::uint32_t version = in.u32();
  if (in.ok() && (version < kOldestVersion || version > kVersion))
    return base::Error{base::ErrorCode::kVersion, "format version " + std::to_string(version) +
                                                      ", this program reads " + std::to_string(kOldestVersion) +
                                                      " to " + std::to_string(kVersion) +
                                                      "; use a newer program or build the scene again"};
  const std::uint32_t header_bytes = in.u32();
  if (!in.ok() || front.size() < kFileHeaderBytes) return damaged("header: cut short");
  if (header_bytes != kFileHeaderBytes)
    return damaged("header: says that it has " + std::to_string(header_bytes) + " bytes instead of 96");
  std::uint32_t crc = 0;
  std::memcpy(&crc, front.data() + kHeaderCrcOffset, sizeof(crc));
  if (crc != base::crc32c(front.first(kHeaderCrcOffset))) return damaged("header: checksum does not match");

  TableCounts header;
  std::uint32_t flags = 0;
  base::readFields(in, headerFields(header, flags));
  if ((flags & ~kHasColors) != 0) return damaged("header: unknown flags");
  header.has_colors = (flags & kHasColors) != 0;
  LUMIGRID_TRY(checkHeader(header));
  return header;
}

base::Result<Hierarchy> readTables(base::ByteView front) {
  LUMIGRID_ASSIGN_OR_RETURN(const auto header, readTableCounts(front));
  return readTablesBehind(header, front);
}

// Reading -----------------------------------------------------------------------------------------

base::Result<PatchFile> PatchFile::open(const std::string& path) {
  PatchFile file;
  file.path_ = path;
  LUMIGRID_ASSIGN_OR_RETURN(file.file_, base::PositionedFile::open(path));
  const std::uint64_t size = file.file_->size();
  LUMIGRID_ASSIGN_OR_RETURN(auto front, file.read(0, std::min<std::uint64_t>(kFileHeaderBytes, size)));
  const auto header = readTableCounts(front);
  if (!header) return base::within(path, header.error());
  if (header->file_bytes != size)
    return base::within(
        path, damaged("has " + std::to_string(size) + " bytes, its header says " + std::to_string(header->file_bytes)));
  LUMIGRID_ASSIGN_OR_RETURN(front, file.read(0, header->blocks_offset));
  auto hierarchy = readTablesBehind(*header, front);
  if (!hierarchy) return base::within(path, hierarchy.error());
  file.hierarchy_ = std::move(*hierarchy);
  return file;
}

base::Result<base::Bytes> PatchFile::read(std::uint64_t offset, std::uint64_t bytes) const {
  base::Bytes read(bytes);
  LUMIGRID_TRY(file_->readAt(offset, read));
  return read;
}

base::Result<base::Bytes> PatchFile::block(std::uint32_t group) const {
  if (group >= hierarchy_.groups.size())
    return base::Error{base::ErrorCode::kNotFound, path_ + ": no group " + std::to_string(group) + " among " +
                                                       std::to_string(hierarchy_.groups.size())};
  const Group& row = hierarchy_.groups[group];
  return read(row.block_offset, row.block_bytes);
}

base::Result<base::Bytes> PatchFile::checkedBlock(std::uint32_t group) const {
  LUMIGRID_ASSIGN_OR_RETURN(auto bytes, block(group));
  const Group& row = hierarchy_.groups[group];
  for (std::uint32_t p = row.first_patch; p < row.first_patch + row.patch_count; ++p) {
    const Patch& patch = hierarchy_.patches[p];
    const auto counts = checkedCounts(base::ByteView(bytes).subspan(patch.block_offset, patch.block_bytes));
    if (!counts) return base::within(path_ + ": patch " + std::to_string(p), counts.error());
    if (counts->triangles != patch.triangles || counts->vertices != patch.vertices)
      return base::within(path_, patchError(p, "its counts are not its record's"));
  }
  return bytes;
}

base::Result<PatchGeometry> PatchFile::geometry(std::uint32_t patch) const {
  if (patch >= hierarchy_.patches.size())
    return base::Error{base::ErrorCode::kNotFound, path_ + ": no patch " + std::to_string(patch) + " among " +
                                                       std::to_string(hierarchy_.patches.size())};
  const Patch& row = hierarchy_.patches[patch];
  LUMIGRID_ASSIGN_OR_RETURN(const auto bytes,
                            read(hierarchy_.groups[row.consumer].block_offset + row.block_offset, row.block_bytes));
  return decode(patch, bytes);
}

base::Result<PatchGeometry> PatchFile::decode(std::uint32_t patch, base::ByteView bytes) const {
  auto geometry = decodeRow(hierarchy_.patches[patch], bytes);
  const std::string place = path_ + ": patch " + std::to_string(patch);
  if (!geometry) return base::within(place, geometry.error());
  if (geometry->colors.empty() == hierarchy_.has_colors)
    return base::within(place, damaged("colours where the scene has none, or none where it has"));
  return geometry;
}

// Verifying ---------------------------------------------------------------------------------------

namespace {

bool liesIn(const base::Sphere& sphere, const glm::vec3& p) {
  return contains(sphere, {p, 0.0F});
}

// Whether all facet normals lie in the cone. Triangles without area do not count.
bool coneHolds(const base::NormalCone& cone, const std::vector<glm::vec3>& positions,
               const std::vector<std::uint16_t>& indices) {
  if (cone.cos_angle <= -1.0F) return true;
  for (std::size_t t = 0; t + 2 < indices.size(); t += 3) {
    const glm::dvec3 a(positions[indices[t]]);
    const glm::dvec3 normal =
        glm::cross(glm::dvec3(positions[indices[t + 1]]) - a, glm::dvec3(positions[indices[t + 2]]) - a);
    const double length = glm::length(normal);
    // The cosine may be 1e-3 off, since float normals of thin triangles are that imprecise.
    if (length > 0.0 && glm::dot(normal, glm::dvec3(cone.axis)) < (cone.cos_angle - 1e-3) * length) return false;
  }
  return true;
}

void verifyGeometry(const Hierarchy& hierarchy, std::uint32_t index, const PatchGeometry& geometry,
                    std::vector<std::string>& faults) {
  const Patch& patch = hierarchy.patches[index];
  const base::Sphere& consumer = hierarchy.groups[patch.consumer].bounds;
  std::vector<glm::vec3> positions;
  positions.reserve(geometry.positions.size());
  for (const glm::ivec3& q : geometry.positions) positions.push_back(hierarchy.lattice.position(q));

  const auto all = [&](auto&& holds) { return std::all_of(positions.begin(), positions.end(), holds); };
  const auto report = [&](bool well, const char* problem) {
    if (!well) faults.push_back("patch " + std::to_string(index) + ": " + problem);
  };
  report(all([&](const glm::vec3& p) { return patch.box.contains(p); }), "its box does not hold its positions");
  report(all([&](const glm::vec3& p) { return liesIn(patch.bounds, p); }), "its sphere does not hold its positions");
  report(all([&](const glm::vec3& p) { return liesIn(consumer, p); }),
         "the sphere of the group that consumes it does not hold its positions");
  report(coneHolds(patch.cone, positions, geometry.indices), "its normal cone does not hold its facets' normals");
}

}  // namespace

std::vector<std::string> PatchFile::verify() const {
  std::vector<std::string> faults;
  for (std::uint32_t g = 0; g < hierarchy_.groups.size(); ++g) verifyBlock(g, faults);
  return faults;
}

// Reads a block with the bytes up to the next one, which must be zero.
void PatchFile::verifyBlock(std::uint32_t group, std::vector<std::string>& faults) const {
  const Group& row = hierarchy_.groups[group];
  const bool is_last = group + 1 == hierarchy_.groups.size();
  const std::uint64_t end = is_last ? fileBytes() : hierarchy_.groups[group + 1].block_offset;
  const auto bytes = read(row.block_offset, end - row.block_offset);
  if (!bytes) return faults.push_back(bytes.error().message);
  for (std::uint32_t p = row.first_patch; p < row.first_patch + row.patch_count; ++p) {
    const Patch& patch = hierarchy_.patches[p];
    const auto decoded = decode(p, base::ByteView(*bytes).subspan(patch.block_offset, patch.block_bytes));
    if (decoded)
      verifyGeometry(hierarchy_, p, *decoded, faults);
    else
      faults.push_back(decoded.error().message);
  }
  for (std::size_t at = row.block_bytes; at < bytes->size(); ++at)
    if ((*bytes)[at] != 0)
      faults.push_back(path_ + ": bytes between blocks at " + std::to_string(row.block_offset + at));
}

// Writing -----------------------------------------------------------------------------------------

namespace {

base::Result<void> writeZeros(base::AtomicFile& file, std::uint64_t end) {
  const base::Bytes zeros(std::size_t{1} << 16, 0);
  while (file.size() < end)
    LUMIGRID_TRY(file.write(base::ByteView(zeros).first(std::min<std::uint64_t>(zeros.size(), end - file.size()))));
  return {};
}

// Fills in the places of one group's patches; its block begins at `offset`.
base::Result<void> placeBlock(Hierarchy& hierarchy, std::uint32_t g, const std::vector<base::Bytes>& patches,
                              std::uint64_t offset) {
  Group& group = hierarchy.groups[g];
  if (patches.size() != group.patch_count)
    return groupError(g, std::to_string(patches.size()) + " encoded patches for " + std::to_string(group.patch_count));
  std::uint64_t within = 0;
  for (std::uint32_t i = 0; i < group.patch_count; ++i) {
    const std::uint32_t index = group.first_patch + i;
    Patch& row = hierarchy.patches[index];
    const auto counts = encodedCounts(patches[i]);
    if (!counts) return base::within("patch " + std::to_string(index), counts.error());
    if (counts->triangles != row.triangles || counts->vertices != row.vertices)
      return patchError(index, "its bytes hold " + std::to_string(counts->triangles) + " triangles and " +
                                   std::to_string(counts->vertices) + " vertices, its record says " +
                                   std::to_string(row.triangles) + " and " + std::to_string(row.vertices));
    row.block_offset = static_cast<std::uint32_t>(within);
    row.block_bytes = static_cast<std::uint32_t>(patches[i].size());
    within += patches[i].size();
    if (within > std::numeric_limits<std::uint32_t>::max()) return groupError(g, "its block is larger than 4 GB");
  }
  group.block_offset = offset;
  group.block_bytes = static_cast<std::uint32_t>(within);
  return {};
}

TableCounts headerOf(const Hierarchy& hierarchy) {
  TableCounts header;
  header.lattice = hierarchy.lattice;
  header.source_triangles = hierarchy.source_triangles;
  header.has_colors = hierarchy.has_colors;
  header.groups = static_cast<std::uint32_t>(hierarchy.groups.size());
  header.patches = static_cast<std::uint32_t>(hierarchy.patches.size());
  header.parents = static_cast<std::uint32_t>(hierarchy.parents.size());
  header.blocks_offset = alignedUp(tablesEnd(header));
  return header;
}

}  // namespace

base::Result<void> writePatchFile(
    const std::string& path, Hierarchy hierarchy,
    const std::function<base::Result<std::vector<base::Bytes>>(std::uint32_t group)>& blocks) {
  if (auto sound = checkHierarchy(hierarchy); !sound) return base::within(path, sound.error());
  TableCounts header = headerOf(hierarchy);
  header.file_bytes = header.blocks_offset;
  if (auto sound = checkHeader(header); !sound) return base::within(path, sound.error());
  LUMIGRID_ASSIGN_OR_RETURN(auto file, base::AtomicFile::create(path));

  // Zeros reserve the room of header and tables, whose lengths are known; then the blocks follow.
  LUMIGRID_TRY(writeZeros(file, header.blocks_offset));
  for (std::uint32_t g = 0; g < hierarchy.groups.size(); ++g) {
    LUMIGRID_ASSIGN_OR_RETURN(const auto patches, blocks(g));
    LUMIGRID_TRY(writeZeros(file, alignedUp(file.size())));
    if (auto placed = placeBlock(hierarchy, g, patches, file.size()); !placed)
      return base::within(path, placed.error());
    for (const base::Bytes& patch : patches) LUMIGRID_TRY(file.write(patch));
  }

  // Now that all places are known, the tables can be written.
  base::Bytes tables = tableBytes(hierarchy);
  tables.resize(header.blocks_offset - kFileHeaderBytes, 0);
  header.tables_crc = base::crc32c(tables);
  header.file_bytes = file.size();
  LUMIGRID_TRY(file.writeAt(kFileHeaderBytes, tables));
  LUMIGRID_TRY(file.writeAt(0, headerBytes(header)));
  return file.commit();
}

}  // namespace lod::patch
