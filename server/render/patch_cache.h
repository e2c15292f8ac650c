#pragma once
// Keeps a scene's patches on the GPU within a budget.
#include <cstdint>
#include <list>
#include <span>
#include <unordered_map>
#include <vector>

#include "base/error.h"
#include "lod/draw/triangles.h"
#include "lod/patch/format.h"

namespace server {

/// Uploads patches when they are first drawn and evicts the least recently used ones.
class PatchCache {
 public:
  /// `file` must outlive the cache. `budget_bytes`: limit for uploaded patches, though one patch may always be there.
  PatchCache(const lod::patch::PatchFile& file, std::uint64_t budget_bytes);

  /// Draws these patches in this order with the program in use; each is given once. Patches that don't fit the budget
  /// together are drawn in batches: upload, draw, evict. The order never depends on what was cached, so neither does
  /// the picture.
  base::Result<void> draw(std::span<const std::uint32_t> patches);

  std::uint64_t gpuBytes() const { return meshes_.gpuBytes(); }
  std::uint64_t uploads() const { return uploads_; }  ///< patches uploaded so far

 private:
  base::Result<void> makeResident(std::span<const std::uint32_t> batch);
  base::Result<void> uploadMissing(std::span<const std::uint32_t> missing);
  std::uint64_t bytesOf(std::uint32_t patch) const;

  const lod::patch::PatchFile& file_;
  std::uint64_t budget_bytes_;
  lod::draw::PatchMeshes meshes_;
  std::list<std::uint32_t> by_age_;  ///< resident patches, oldest first
  std::unordered_map<std::uint32_t, std::list<std::uint32_t>::iterator> place_;
  std::uint64_t uploads_ = 0;
};

}  // namespace server
