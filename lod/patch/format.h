#pragma once
// patch.lgp: header, tables, then one block per group with the patches that the group consumes. docs/formats/patch.md
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/bytes.h"
#include "base/error.h"
#include "base/file.h"
#include "lod/patch/hierarchy.h"

namespace lod::patch {

/// A patch.lgp on disk, memory-mapped. Opening checks header and tables (checksums, every index and link, monotone errors and
/// spheres); blocks are checked as they are read. Safe to read from several threads.
class PatchFile {
 public:
  static base::Result<PatchFile> open(const std::string& path);
  const Hierarchy& hierarchy() const { return hierarchy_; }
  /// The block of a group: its consumed patches' bytes, one after the other (what a client is sent).
  base::Result<base::ByteView> block(std::uint32_t group) const;
  base::Result<PatchGeometry> geometry(std::uint32_t patch) const;
  /// Reads everything: each block's checksum, each patch's geometry against its record (counts, box, sphere, cone). One line a fault.
  std::vector<std::string> verify() const;
  std::uint64_t fileBytes() const { return file_.bytes().size(); }

 private:
  std::string path_;
  base::MappedFile file_;
  Hierarchy hierarchy_;
};

/// Writes patch.lgp; appears whole or not at all. `blocks(g)` yields the encoded patches of group g in order; called once per
/// group, ascending. The writer fills in offsets and sizes of groups and patches.
base::Result<void> writePatchFile(const std::string& path, Hierarchy hierarchy,
                                  const std::function<base::Result<std::vector<base::Bytes>>(std::uint32_t group)>& blocks);

/// A group's record, its patches' records and its parents as bytes (protocol message Refine), and back into a growing hierarchy:
/// addGroup grows the tables as needed, checks every bound (indices below `max_groups`, `max_patches`), and sets known.
void encodeGroup(const Hierarchy& hierarchy, std::uint32_t group, base::ByteWriter& out);
base::Result<std::uint32_t> addGroup(base::ByteReader& in, Hierarchy& growing);

}  // namespace lod::patch
