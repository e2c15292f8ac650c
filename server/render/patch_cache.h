#pragma once
// Keeps a scene's patches on the GPU within a budget, leaves with the pages of their textures.
#include <cstdint>
#include <functional>
#include <list>
#include <span>
#include <unordered_map>
#include <vector>

#include "base/error.h"
#include "lod/draw/triangles.h"
#include "lod/patch/format.h"
#include "lod/texture/format.h"
#include "server/render/page_meshes.h"

namespace server {

/// A patch to draw.
struct DrawnPatch {
  std::uint32_t number = 0;
  int reduction = kNoPages;  ///< pageReduction() of its pages
  bool operator==(const DrawnPatch&) const = default;
};

/// A surface is drawn by one of several programs that make the same picture of it.
enum class SurfaceKind : std::uint8_t { kColors, kPages, kPagesWithAlpha };

/// Uploads patches when they are first drawn and evicts the least recently used ones.
class PatchCache {
 public:
  /// Puts the program for such a surface of this patch into use and returns it.
  using UseProgram = std::function<const base::gl::Program&(SurfaceKind, std::uint32_t patch)>;

  /// `file` and `textures` (null: there are none) must outlive the cache. `budget_bytes`: limit for uploaded patches,
  /// though one patch may always be there.
  PatchCache(const lod::patch::PatchFile& file, const lod::texture::TextureFile* textures, std::uint64_t budget_bytes);

  /// Draws these patches in this order; each is given once. Patches that don't fit the budget together are drawn in
  /// batches: upload, draw, evict. Neither the order nor the resolution of pages depends on what was cached, so neither
  /// does the picture.
  base::Result<void> draw(std::span<const DrawnPatch> patches, const UseProgram& use);

  /// Samples of a pixel along each side, from the next picture on.
  void setSamples(int samples) { pages_.setSamples(samples); }
  std::uint64_t gpuBytes() const { return meshes_.gpuBytes() + pages_.gpuBytes(); }
  std::uint64_t uploads() const { return uploads_; }  ///< patches uploaded so far

 private:
  struct Decoded;
  struct Resident {
    int reduction = kNoPages;
    bool has_rest = true;  ///< some triangles are on no page
    std::list<std::uint32_t>::iterator age;
    /// Pages that were halved less often serve as well.
    bool serves(int wanted) const { return (wanted == kNoPages) == (reduction == kNoPages) && reduction <= wanted; }
  };
  base::Result<void> makeResident(std::span<const DrawnPatch> batch);
  base::Result<void> uploadMissing(std::span<const DrawnPatch> missing);
  void remove(std::uint32_t patch);
  void drawOne(const DrawnPatch& patch, const UseProgram& use) const;
  base::Result<Decoded> decode(const DrawnPatch& patch) const;
  std::uint64_t bytesOf(const DrawnPatch& patch) const;

  const lod::patch::PatchFile& file_;
  const lod::texture::TextureFile* textures_;
  std::uint64_t budget_bytes_;
  lod::draw::PatchMeshes meshes_;
  PageMeshes pages_;
  std::list<std::uint32_t> by_age_;  ///< resident patches, oldest first
  std::unordered_map<std::uint32_t, Resident> resident_;
  std::uint64_t uploads_ = 0;
  std::uint64_t given_up_bytes_ = 0;  ///< of pages, since the GL finished last
};

}  // namespace server
