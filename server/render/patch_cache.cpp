#include "server/render/patch_cache.h"

#include <algorithm>
#include <optional>

#include "base/parallel.h"

namespace server {
namespace {

// Patches decoded at a time: enough for all cores, and at most some 10 MB of geometry that waits for its upload.
constexpr std::size_t kDecodeTogether = 64;
// Patches a thread: with fewer, starting it costs more than it saves.
constexpr std::size_t kDecodePerThread = 4;

}  // namespace

PatchCache::PatchCache(const lod::patch::PatchFile& file, std::uint64_t budget_bytes)
    : file_(file), budget_bytes_(budget_bytes), meshes_(file.hierarchy().lattice) {}

std::uint64_t PatchCache::bytesOf(std::uint32_t patch) const {
  const lod::patch::Patch& record = file_.hierarchy().patches[patch];
  return lod::draw::PatchMeshes::bytesFor(record.vertices, record.triangles);
}

base::Result<void> PatchCache::draw(std::span<const std::uint32_t> patches) {
  while (!patches.empty()) {
    // The batch has as many patches as fit the budget together, at least one.
    std::size_t count = 1;
    std::uint64_t bytes = bytesOf(patches[0]);
    while (count < patches.size() && bytes + bytesOf(patches[count]) <= budget_bytes_)
      bytes += bytesOf(patches[count++]);
    const auto batch = patches.first(count);
    LUMIGRID_TRY(makeResident(batch));
    meshes_.draw(batch);
    patches = patches.subspan(count);
  }
  return {};
}

base::Result<void> PatchCache::makeResident(std::span<const std::uint32_t> batch) {
  // Resident patches of the batch become the youngest, so that all others are older.
  std::vector<std::uint32_t> missing;
  std::uint64_t missing_bytes = 0;
  for (const std::uint32_t patch : batch) {
    const auto found = place_.find(patch);
    if (found != place_.end()) {
      by_age_.splice(by_age_.end(), by_age_, found->second);
    } else {
      missing.push_back(patch);
      missing_bytes += bytesOf(patch);
    }
  }

  // Evict the oldest patches, but none of the batch.
  std::size_t evictable = by_age_.size() - (batch.size() - missing.size());
  for (; evictable > 0 && meshes_.gpuBytes() + missing_bytes > budget_bytes_; --evictable) {
    meshes_.remove(by_age_.front());
    place_.erase(by_age_.front());
    by_age_.pop_front();
  }
  for (std::size_t i = 0; i < missing.size(); i += kDecodeTogether)
    LUMIGRID_TRY(uploadMissing(std::span(missing).subspan(i, std::min(kDecodeTogether, missing.size() - i))));
  return {};
}

base::Result<void> PatchCache::uploadMissing(std::span<const std::uint32_t> missing) {
  // Decode on all cores; upload here, where the context is.
  std::vector<std::optional<base::Result<lod::patch::PatchGeometry>>> decoded(missing.size());
  const auto threads =
      std::min<std::size_t>(base::coreCount(), (missing.size() + kDecodePerThread - 1) / kDecodePerThread);
  base::parallelFor(missing.size(), static_cast<unsigned>(threads),
                    [&](std::size_t i) { decoded[i].emplace(file_.geometry(missing[i])); });
  for (std::size_t i = 0; i < missing.size(); ++i) {
    if (!*decoded[i]) return decoded[i]->error();
    meshes_.upload(missing[i], **decoded[i]);
    place_[missing[i]] = by_age_.insert(by_age_.end(), missing[i]);
    ++uploads_;
  }
  return {};
}

}  // namespace server
