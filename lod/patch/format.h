#pragma once
// patch.lgp: header, tables, then one block per group with the patches that the group consumes. docs/formats/patch.md
//
// Header and tables stand at the front and their length is in the first 32 bytes. Any block is one byte range. Clients
// of a static host read group_records.h in place of the tables.
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/file.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

/// A patch.lgp on disk. Opening reads header and tables and checks them (checksums, every index and link, monotone
/// errors and spheres); blocks are read by position when they are asked for, and not mapped: a file that is cut while
/// it is open gives an error (docs/decisions/reads-that-cannot-kill.md). Safe to read from several threads.
class PatchFile {
 public:
  /// Errors name the file and the row. kNotFound, kIo; kVersion for a newer format; kInvalidInput for a damaged or cut
  /// file.
  static base::Result<PatchFile> open(const std::string& path);
  const Hierarchy& hierarchy() const { return hierarchy_; }
  /// Reads the block of a group: its consumed patches' bytes, one after the other, as a client is sent them. They are
  /// not looked at. Errors: kNotFound, a number that is not a group's; those of PositionedFile::readAt.
  base::Result<base::Bytes> block(std::uint32_t group) const;
  /// The same, and checks every patch's checksum and that its counts are its record's. Errors name file and patch.
  base::Result<base::Bytes> checkedBlock(std::uint32_t group) const;
  /// Reads and decodes a patch; its counts are compared with its record. Errors as block(), and damage.
  base::Result<PatchGeometry> geometry(std::uint32_t patch) const;
  /// Reads everything and checks each patch's checksum, its geometry against its record (counts, box, sphere, cone of
  /// facet normals), and its positions against the sphere of the group that consumes it. Returns a line for each fault.
  std::vector<std::string> verify() const;
  std::uint64_t fileBytes() const { return file_ ? file_->size() : 0; }  ///< when it was opened
  const std::string& path() const { return path_; }

 private:
  base::Result<base::Bytes> read(std::uint64_t offset, std::uint64_t bytes) const;
  base::Result<PatchGeometry> decode(std::uint32_t patch, base::ByteView bytes) const;
  void verifyBlock(std::uint32_t group, std::vector<std::string>& faults) const;

  std::string path_;
  std::optional<base::PositionedFile> file_;  // nothing only where nothing was opened
  Hierarchy hierarchy_;
};

/// Whether a hierarchy keeps what hierarchy.h promises: ranges that partition all patches, links that agree in both
/// directions, parents with smaller numbers, monotone errors and spheres (to 1e-5 of the radius), finite numbers. The
/// error names the row. Block offsets and sizes are not looked at. Not for growing hierarchies.
base::Result<void> checkHierarchy(const Hierarchy& hierarchy);

/// The numbers of a header.
struct TableCounts {
  Lattice lattice;
  bool has_colors = false;
  std::uint64_t source_triangles = 0;
  std::uint64_t file_bytes = 0;
  std::uint64_t blocks_offset = 0;  ///< header and tables end there
  std::uint32_t groups = 0, patches = 0, parents = 0;
  std::uint32_t tables_crc = 0;
};
/// From the first 96 bytes of the file or more; checked as PatchFile::open does.
base::Result<TableCounts> readTableCounts(base::ByteView front);

/// Header and tables of patch.lgp, from its first bytes (all of the file or at least those before the blocks).
/// Checks everything that PatchFile::open does, but for the file's length.
base::Result<Hierarchy> readTables(base::ByteView front);

/// Writes patch.lgp; appears whole or not at all. `blocks(g)` yields the encoded patches of group g in order; called
/// once per group, ascending, and forgotten when written. The writer fills in offsets and sizes of groups and patches.
/// Errors: what checkHierarchy finds, what `blocks` returns, patches whose counts are not their records', kNoSpace,
/// kIo.
base::Result<void> writePatchFile(
    const std::string& path, Hierarchy hierarchy,
    const std::function<base::Result<std::vector<base::Bytes>>(std::uint32_t group)>& blocks);

/// Writes a group's record, its patches' records and its parents as bytes (protocol message Refinement;
/// docs/formats/patch.md, "One group as bytes"). `group` must be known in `hierarchy`.
void encodeGroup(const Hierarchy& hierarchy, std::uint32_t group, base::ByteWriter& out);

/// Reads what encodeGroup wrote into a growing hierarchy and returns the group's number; `in` stands behind it then.
/// Grows the tables as needed but never beyond `max_groups` and `max_patches` (the scene's totals: a group, parent or
/// producer number at or beyond max_groups, or a patch at or beyond max_patches, is refused), and sets known. The
/// growing hierarchy starts empty, with its lattice, has_colors and source_triangles set by the caller. Rows of groups
/// and patches not met yet are default ones (patch: 0 triangles). Groups may come in any order and twice; the first one
/// counts. On an error the hierarchy is unchanged.
base::Result<std::uint32_t> addGroup(base::ByteReader& in, Hierarchy& growing, std::uint32_t max_groups,
                                     std::uint32_t max_patches);

}  // namespace lod::patch
