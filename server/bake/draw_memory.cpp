#include "server/bake/draw_memory.h"

#include <algorithm>
#include <string>

#include "lod/draw/triangles.h"
#include "server/bake/draw_processes.h"

namespace server {
namespace {

constexpr std::uint64_t kMebi = std::uint64_t{1} << 20;

// These are measured peaks of the proportional set size (PSS: shared pages are counted once in all) with Mesa's
// llvmpipe 22.3, faces of 64 to 2048 pixels, budgets of 1 to 256 MiB; scenes of 20 thousand and of 3 million triangles:
//
//   this program while others draw                                62 to 80 MB
//   a process that draws the small scene, 64, 512, 1024, 2048     43, 70, 168, 411 MB
//   … 2048 in tiles, without and with textures                    222 to 249, 323 to 370 MB (RSS)
//   … the large one at tolerance 0, 256, 1024, budget 16          208, 382 MB; budget 256: 254, 375 MB
//
// So with the large scene some 200 MB are neither pictures nor patches that stay: llvmpipe keeps all that is drawn
// until the picture is done, also buffers that were given up in the meantime.
constexpr std::uint64_t kProgramBytes = 96 * kMebi;
constexpr std::uint64_t kContextBytes = 48 * kMebi;
constexpr std::uint64_t kDrawnBytesPerTriangle = 100;
constexpr std::uint64_t kMaxDrawnBytes = 256 * kMebi;
constexpr std::uint64_t kTargetBytesPerSample = 8;
// RGBA pictures of 4 bytes a pixel: the resolved one, four being read back, five under way, two waiting, and one being
// encoded, which takes half as much again; and the rest is rounding up.
constexpr std::uint64_t kPictureBytesPerPixel = 80;
// With textures: pages being decoded, and those given up whose drawing is under way.
constexpr std::uint64_t kPageBytes = 256 * kMebi;
constexpr std::uint64_t kEncoderBytesPerPixel = 24;  // each further thread has one picture in work, two waiting
// A stored face takes up to a byte for 8 pixels: twice what a full one takes at quality 85.
constexpr std::uint64_t kPixelsPerValueByte = 8;

constexpr std::uint64_t kGpuBudgetBytes = 2048 * kMebi;   // for the patches of all processes together …
constexpr std::uint64_t kCutBytes = 256 * kMebi;          // … and of one, where memory allows: a cut of a large scan
constexpr std::uint64_t kMinGpuBudgetBytes = 32 * kMebi;  // less uploads patches again for each face

std::uint64_t pixelsOf(const DrawDemand& demand) {
  return std::uint64_t{demand.face_size} * demand.face_size;
}

std::uint64_t tableBytes(const lod::patch::Hierarchy& hierarchy) {
  return hierarchy.patches.size() * sizeof(lod::patch::Patch) + hierarchy.groups.size() * sizeof(lod::patch::Group);
}

/// The memory of all patches uploaded at once: no cut needs more.
std::uint64_t geometryBytes(const lod::patch::Hierarchy& hierarchy) {
  // Pages are many times as large as patches, and how large depends on the view.
  if (hasTextures(hierarchy)) return kGpuBudgetBytes;
  std::uint64_t bytes = 0;
  for (const lod::patch::Patch& patch : hierarchy.patches)
    bytes += lod::draw::PatchMeshes::bytesFor(patch.vertices, patch.triangles);
  return bytes;
}

/// The memory that a context takes besides uploaded patches.
std::uint64_t contextBytes(const DrawDemand& demand) {
  const auto side = static_cast<std::uint64_t>(demand.render.supersampling);
  std::uint64_t samples = std::min(pixelsOf(demand) * side * side, demand.render.max_target_samples);
  if (demand.shadow_bytes == 0) samples = std::min(samples, demand.render.tile_samples);
  return (hasTextures(demand.hierarchy) ? kPageBytes : 0) + demand.shadow_bytes +
         std::min(kDrawnBytesPerTriangle * demand.hierarchy.source_triangles, kMaxDrawnBytes) +
         samples * kTargetBytesPerSample + pixelsOf(demand) * kPictureBytesPerPixel;
}

std::uint64_t programBytes(const DrawDemand& demand) {
  const std::uint64_t values = demand.window_faces + demand.batch_faces;  // waiting, and in the store's transaction
  return kProgramBytes + tableBytes(demand.hierarchy) + demand.own_bytes +
         values * pixelsOf(demand) / kPixelsPerValueByte;
}

/// The memory that drawing by `workers` takes besides uploaded patches.
std::uint64_t bytesBesidePatches(const DrawDemand& demand, unsigned workers) {
  const std::uint64_t bytes = programBytes(demand);
  if (demand.in_processes)
    return bytes + workers * (kContextBytes + tableBytes(demand.hierarchy) + contextBytes(demand));
  return bytes + contextBytes(demand) + (workers - 1) * pixelsOf(demand) * kEncoderBytesPerPixel;
}

std::uint64_t contextsOf(const DrawDemand& demand, unsigned workers) {
  return demand.in_processes ? workers : 1;
}

DrawLimits limitsOf(const DrawDemand& demand, unsigned workers, std::uint64_t gpu_budget_bytes) {
  return demand.in_processes ? DrawLimits{workers, 1, gpu_budget_bytes} : DrawLimits{0, workers, gpu_budget_bytes};
}

base::Error tooLittle(const DrawDemand& demand, std::uint64_t needed, std::uint64_t given) {
  const auto text = [](std::uint64_t bytes) { return std::to_string((bytes + kMebi - 1) / kMebi) + "M"; };
  return {base::ErrorCode::kNoSpace, "drawing images of " + std::to_string(demand.face_size) + " pixels takes up to " +
                                         text(needed) + " of memory, " + text(given) + " are given; give --memory " +
                                         text(needed) + " or more, or smaller images (--face)"};
}

}  // namespace

base::Result<DrawLimits> limitDrawing(const DrawDemand& demand, std::uint64_t memory_bytes) {
  const unsigned most = demand.in_processes ? drawProcessesFor(demand.threads) : std::max(1U, demand.threads);
  const auto wanted = [&](unsigned workers) {
    return demand.in_processes ? std::max(kCutBytes, kGpuBudgetBytes / workers) : kGpuBudgetBytes;
  };
  if (memory_bytes == 0) return limitsOf(demand, most, wanted(most));

  const std::uint64_t geometry = geometryBytes(demand.hierarchy);
  const std::uint64_t cut = std::min(kCutBytes, geometry);
  const auto takes = [&](unsigned workers, std::uint64_t gpu_budget_bytes) {
    return bytesBesidePatches(demand, workers) + contextsOf(demand, workers) * gpu_budget_bytes;
  };
  unsigned workers = most;
  while (workers > 1 && takes(workers, cut) > memory_bytes) --workers;
  const std::uint64_t least = takes(workers, std::min(kMinGpuBudgetBytes, geometry));
  if (least > memory_bytes) return tooLittle(demand, least, memory_bytes);
  const std::uint64_t share = (memory_bytes - bytesBesidePatches(demand, workers)) / contextsOf(demand, workers);
  return limitsOf(demand, workers, std::min(share, wanted(workers)));
}

base::Result<std::uint64_t> limitSampling(const DrawDemand& demand, std::uint64_t other_bytes,
                                          std::uint64_t memory_bytes) {
  if (memory_bytes == 0) return kGpuBudgetBytes;
  const std::uint64_t beside =
      kProgramBytes + tableBytes(demand.hierarchy) + demand.own_bytes + contextBytes(demand) + other_bytes;
  const std::uint64_t least = beside + std::min(kMinGpuBudgetBytes, geometryBytes(demand.hierarchy));
  if (least > memory_bytes) return tooLittle(demand, least, memory_bytes);
  return std::min(memory_bytes - beside, kGpuBudgetBytes);
}

}  // namespace server
