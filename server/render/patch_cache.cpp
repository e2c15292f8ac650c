#include "server/render/patch_cache.h"

#include <algorithm>
#include <optional>

#include "base/parallel.h"

namespace server {
namespace {

// Patches decoded at a time: enough for all cores, and at most some megabytes that wait for their upload.
constexpr std::size_t kDecodeTogether = 64;
constexpr std::uint64_t kDecodeBytes = std::uint64_t{16} << 20;
// Software GL keeps pages that were given up until all that was drawn with them is done.
constexpr std::uint64_t kMostGivenUp = std::uint64_t{16} << 20;
// Patches a thread: with fewer, starting it costs more than it saves. Decoding a page takes longer than that.
constexpr std::size_t kDecodePerThread = 4;

}  // namespace

// A patch as it is uploaded: the geometry keeps the triangles that are on no page.
struct PatchCache::Decoded {
  lod::patch::PatchGeometry geometry;
  std::vector<std::uint16_t> rest;  // indices
  std::vector<ReducedPage> pages;
};

PatchCache::PatchCache(const lod::patch::PatchFile& file, const lod::texture::TextureFile* textures,
                       std::uint64_t budget_bytes)
    : file_(file),
      textures_(textures),
      budget_bytes_(budget_bytes),
      meshes_(file.hierarchy().lattice),
      pages_(file.hierarchy().lattice) {}

// About what the patch takes: with pages, the rest beside them may turn out to be less.
std::uint64_t PatchCache::bytesOf(const DrawnPatch& patch) const {
  const lod::patch::Patch& record = file_.hierarchy().patches[patch.number];
  std::uint64_t triangles = record.triangles, bytes = 0;
  if (patch.reduction != kNoPages)
    for (const lod::texture::PageRecord& page : textures_->pagesOf(patch.number)) {
      bytes += PageMeshes::bytesFor(page, patch.reduction);
      triangles -= std::min<std::uint64_t>(triangles, page.triangles);
    }
  return bytes + (triangles == 0 ? 0 : lod::draw::PatchMeshes::bytesFor(record.vertices, triangles));
}

base::Result<void> PatchCache::draw(std::span<const DrawnPatch> patches, const UseProgram& use) {
  while (!patches.empty()) {
    // The batch has as many patches as fit the budget together, at least one.
    std::size_t count = 1;
    std::uint64_t bytes = bytesOf(patches[0]);
    while (count < patches.size() && bytes + bytesOf(patches[count]) <= budget_bytes_)
      bytes += bytesOf(patches[count++]);
    const auto batch = patches.first(count);
    LUMIGRID_TRY(makeResident(batch));
    for (const DrawnPatch& patch : batch) drawOne(patch, use);
    patches = patches.subspan(count);
  }
  return {};
}

void PatchCache::drawOne(const DrawnPatch& patch, const UseProgram& use) const {
  const Resident& resident = resident_.at(patch.number);
  if (patch.reduction != kNoPages)
    pages_.draw(patch.number, patch.reduction - resident.reduction, [&](bool alpha) -> const base::gl::Program& {
      return use(alpha ? SurfaceKind::kPagesWithAlpha : SurfaceKind::kPages, patch.number);
    });
  if (!resident.has_rest) return;
  use(SurfaceKind::kColors, patch.number);
  meshes_.draw({&patch.number, 1});
}

void PatchCache::remove(std::uint32_t patch) {
  const auto found = resident_.find(patch);
  meshes_.remove(patch);
  pages_.remove(patch);
  by_age_.erase(found->second.age);
  resident_.erase(found);
}

base::Result<void> PatchCache::makeResident(std::span<const DrawnPatch> batch) {
  // Resident patches of the batch become the youngest, so that all others are older.
  std::vector<DrawnPatch> missing;
  std::uint64_t missing_bytes = 0;
  for (const DrawnPatch& patch : batch) {
    const auto found = resident_.find(patch.number);
    if (found != resident_.end() && found->second.serves(patch.reduction)) {
      by_age_.splice(by_age_.end(), by_age_, found->second.age);
      continue;
    }
    if (found != resident_.end()) remove(patch.number);
    missing.push_back(patch);
    missing_bytes += bytesOf(patch);
  }

  // Evict the oldest patches, but none of the batch.
  std::size_t evictable = by_age_.size() - (batch.size() - missing.size());
  const std::uint64_t pages_before = pages_.gpuBytes();
  for (; evictable > 0 && gpuBytes() + missing_bytes > budget_bytes_; --evictable) remove(by_age_.front());
  given_up_bytes_ += pages_before - pages_.gpuBytes();
  if (given_up_bytes_ > kMostGivenUp) {
    glFinish();
    given_up_bytes_ = 0;
  }

  for (std::size_t i = 0; i < missing.size();) {
    std::size_t count = 0;
    for (std::uint64_t bytes = 0; i + count < missing.size() && count < kDecodeTogether; ++count) {
      bytes += bytesOf(missing[i + count]);
      if (count > 0 && bytes > kDecodeBytes) break;
    }
    LUMIGRID_TRY(uploadMissing(std::span(missing).subspan(i, count)));
    i += count;
  }
  return {};
}

base::Result<PatchCache::Decoded> PatchCache::decode(const DrawnPatch& patch) const {
  Decoded decoded;
  LUMIGRID_ASSIGN_OR_RETURN(decoded.geometry, file_.geometry(patch.number));
  if (patch.reduction == kNoPages) {
    decoded.rest = decoded.geometry.indices;
    return decoded;
  }
  std::vector<bool> on_page(decoded.geometry.indices.size() / 3, false);
  for (const lod::texture::PageRecord& record : textures_->pagesOf(patch.number)) {
    LUMIGRID_ASSIGN_OR_RETURN(auto page, textures_->page(record));
    for (const lod::texture::PageTriangle& t : page.triangles) {
      if (t.triangle >= on_page.size())
        return base::Error{base::ErrorCode::kInvalidInput, textures_->path() + ": a page of patch " +
                                                               std::to_string(patch.number) +
                                                               " has triangles that the patch has not; build the "
                                                               "scene again"};
      on_page[t.triangle] = true;
    }
    decoded.pages.push_back(reduced(std::move(page), patch.reduction));
  }
  for (std::size_t t = 0; t < on_page.size(); ++t)
    if (!on_page[t])
      for (std::size_t k = 0; k < 3; ++k) decoded.rest.push_back(decoded.geometry.indices[3 * t + k]);
  return decoded;
}

base::Result<void> PatchCache::uploadMissing(std::span<const DrawnPatch> missing) {
  // Decode on all cores; upload here, where the context is.
  std::vector<std::optional<base::Result<Decoded>>> decoded(missing.size());
  const std::size_t each = textures_ == nullptr ? kDecodePerThread : 1;
  const auto threads = std::min<std::size_t>(base::coreCount(), (missing.size() + each - 1) / each);
  base::parallelFor(missing.size(), static_cast<unsigned>(threads),
                    [&](std::size_t i) { decoded[i].emplace(decode(missing[i])); });
  for (std::size_t i = 0; i < missing.size(); ++i) {
    if (!*decoded[i]) return decoded[i]->error();
    Decoded& one = **decoded[i];
    const std::uint32_t patch = missing[i].number;
    if (missing[i].reduction != kNoPages) pages_.upload(patch, one.geometry, one.pages);
    one.geometry.indices = std::move(one.rest);
    const bool has_rest = !one.geometry.indices.empty();
    if (has_rest) meshes_.upload(patch, one.geometry);
    resident_[patch] = {missing[i].reduction, has_rest, by_age_.insert(by_age_.end(), patch)};
    ++uploads_;
  }
  return {};
}

}  // namespace server
