#include "server/cli/verify_parts.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "lod/patch/format.h"
#include "lod/qsplat/splat_file.h"
#include "repository/sampling/parameters.h"
#include "repository/verify.h"

namespace server::cli {
namespace {

// The points that a store samples; nothing, and a fault, when it does not record them.
std::optional<repository::SampledPoints> samplesOf(const repository::Store& store, const std::string& path,
                                                   Faults& faults) {
  const auto meta = valueOrFault(store.readMeta(), faults);
  if (meta && !*meta) faults.push_back(path + ": does not say which grid it belongs to");
  if (!meta || !*meta) return std::nullopt;
  return valueOrFault(repository::sampledPointsFromMeta(**meta, path), faults);
}

}  // namespace

void verifySplats(const std::string& path, const base::Scene& scene, Faults& faults) {
  const auto splats = valueOrFault(lod::qsplat::SplatFile::open(path), faults);
  if (!splats) return;
  for (const std::string& fault : splats->verify()) faults.push_back(path + ": " + fault);
  const lod::qsplat::Header& header = splats->header();
  if (header.colors != scene.has_colors) faults.push_back(path + ": colours do not agree with scene.json");
  const base::Aabb box = scene.localBox();
  const float slack = header.root.radius + 1e-6F * box.diagonal();
  if (!base::Aabb{box.min - slack, box.max + slack}.contains(header.root.center))
    faults.push_back(path + ": its root lies outside the scene's box");
}

void verifyPatches(const std::string& path, const base::Scene& scene, Faults& faults) {
  const auto patches = valueOrFault(lod::patch::PatchFile::open(path), faults);
  if (!patches) return;
  for (const std::string& fault : patches->verify()) faults.push_back(fault);
  const lod::patch::Hierarchy& h = patches->hierarchy();
  if (h.has_colors != scene.has_colors) faults.push_back(path + ": colours do not agree with scene.json");
  base::Aabb box = scene.localBox();
  const float slack = static_cast<float>(h.lattice.positionError()) + 1e-6F * box.diagonal();
  box.min -= slack;
  box.max += slack;
  for (std::size_t i = 0; i < h.patches.size(); ++i)
    if (h.patches[i].level == 0 && !(box.contains(h.patches[i].box.min) && box.contains(h.patches[i].box.max)))
      faults.push_back(path + ": leaf patch " + std::to_string(i) + " lies outside the scene's box");
}

void verifyPacks(const repository::PackStore& packs, const std::string& path, const VerifyProgress& progress,
                 Faults& faults) {
  const auto points = samplesOf(packs, path, faults);
  if (!points) return;
  const double all = static_cast<double>(std::max<std::uint64_t>(1, packs.root().keys));
  for (std::string& fault : repository::verify(packs, points->grid, points->treeOrNull(), 0, [&](std::uint64_t values) {
         return !progress || progress(std::min(1.0, static_cast<double>(values) / all));
       }))
    faults.push_back(std::move(fault));
}

}  // namespace server::cli
