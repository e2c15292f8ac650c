#pragma once
// The textures of leaf patches: for each leaf and each of the source's pictures that it shows, the part of the picture
// is cut out, at the picture's own resolution. As many pictures as memory holds are cut up at a time, each of them read
// once, and what was made of a picture is kept in a log, in their order, so that a build that was stopped goes on
// behind the last.
#include <cstdint>
#include <functional>
#include <span>
#include <string>
#include <vector>

#include "lod/ingest/picture_units.h"
#include "lod/ingest/record_log.h"
#include "lod/ingest/texture_places.h"
#include "lod/patch/builder/work_store.h"
#include "lod/texture/format.h"

namespace lod::patch::builder {

struct LeafTextureSource {
  const std::vector<mesh::SourcePicture>& pictures;
  const ingest::TexturePlaces& places;
  const ingest::PictureUnits& units;
  const WorkStore& store;  ///< where the leaves are
  const Lattice& lattice;
};

class LeafTextures {
 public:
  struct Resources {
    unsigned threads = 1;
    std::uint64_t memory = 0;  ///< bytes for pictures; one of them is worked on even where it takes more
  };

  /// Makes the pages of all leaves, which do not depend on the resources. The log lies in `directory`; with `resume` it
  /// is continued. `report(share)` returns false to cancel. Errors: those of the pictures, kCancelled, kNoSpace, kIo.
  static base::Result<LeafTextures> make(const LeafTextureSource& source, std::span<const WorkPatch> leaves,
                                         const std::string& directory, bool resume, Resources resources,
                                         const std::function<bool(double)>& report);
  /// Patch::color_detail of a leaf.
  std::uint16_t colorDetail(std::size_t leaf) const { return detail_[leaf]; }
  /// Writes texture.lgt. `patch_of[leaf]`: the number of the leaf in patch.lgp, which has `patches`. `on_bytes`: as
  /// texture::writeTextureFile has it.
  base::Result<texture::TextureSummary> write(const std::string& path, std::span<const std::uint32_t> patch_of,
                                              std::uint32_t patches,
                                              const std::function<void(base::Bytes)>& on_bytes) const;

 private:
  /// A page in the log.
  struct Kept {
    std::uint32_t leaf = 0;
    texture::PageRecord record;  ///< its offset is that in the log, and it has no patch
  };
  class Maker;

  ingest::RecordLog log_;
  std::vector<Kept> pages_;
  std::vector<std::uint16_t> detail_;
  texture::TextureSummary summary_;
};

}  // namespace lod::patch::builder
