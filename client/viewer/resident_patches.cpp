#include "client/viewer/resident_patches.h"

#include <algorithm>
#include <limits>
#include <utility>

#include "lod/patch/codec.h"

namespace client {
namespace {

std::uint64_t gpuBytes(const lod::patch::Patch& patch) {
  return lod::draw::PatchMeshes::bytesFor(patch.vertices, patch.triangles);
}

std::uint64_t gpuBytes(const lod::patch::Hierarchy& hierarchy, std::uint32_t group) {
  const lod::patch::Group& record = hierarchy.groups[group];
  std::uint64_t bytes = 0;
  for (std::uint32_t i = 0; i < record.patch_count; ++i) bytes += gpuBytes(hierarchy.patches[record.first_patch + i]);
  return bytes;
}

/// Decodes the patch's geometry from its group's block.
base::Result<lod::patch::PatchGeometry> decode(const lod::patch::Patch& patch, base::ByteView block) {
  const auto broken = [](const std::string& problem) { return base::Error{base::ErrorCode::kInvalidInput, problem}; };
  if (patch.block_offset > block.size() || patch.block_bytes > block.size() - patch.block_offset)
    return broken("lies outside its block");
  LUMIGRID_ASSIGN_OR_RETURN(auto geometry,
                            lod::patch::decodePatch(block.subspan(patch.block_offset, patch.block_bytes)));
  if (geometry.positions.size() != patch.vertices || geometry.indices.size() != std::size_t{3} * patch.triangles)
    return broken("is not of the size that its record says");
  return geometry;
}

}  // namespace

void ResidentPatches::drop(std::uint32_t group, const lod::patch::Hierarchy& hierarchy,
                           lod::draw::PatchMeshes& meshes) {
  ready_.erase(group);
  const lod::patch::Group& record = hierarchy.groups[group];
  for (std::uint32_t i = 0; i < record.patch_count; ++i) meshes.remove(record.first_patch + i);
}

void ResidentPatches::forget() {
  ready_.clear();
  wanted_ = {};
  drawn_ = {};
  occluders_.clear();
  unfinished_ = false;
}

void ResidentPatches::update(const lod::patch::CutRequest& view, bool with_occluders, Session& session,
                             lod::draw::PatchMeshes& meshes, const Spend& spend, const Fault& fault) {
  ++updates_;
  const lod::patch::Hierarchy& hierarchy = session.hierarchy();
  lod::patch::CutRequest request = view;
  request.cost = [](const lod::patch::Patch& patch) { return gpuBytes(patch) + patch.block_bytes; };

  // Select the wanted cut, and upload its groups.
  const auto have = [&](std::uint32_t group) { return session.hasGroup(group) && broken_.count(group) == 0; };
  wanted_ = lod::patch::selectCut(hierarchy, request, have);
  for (const std::uint32_t group : wanted_.expanded)
    if (const auto found = ready_.find(group); found != ready_.end()) found->second = updates_;
  uploadWanted(view.max_cost, session, meshes, spend, fault);

  // Select the drawn cut, which most often is the wanted one.
  const auto ready = [this](std::uint32_t group) { return isReady(group); };
  if (std::all_of(wanted_.expanded.begin(), wanted_.expanded.end(), ready))
    drawn_ = wanted_;
  else
    drawn_ = lod::patch::selectCut(hierarchy, request, ready);

  // A surface outside the view may hide another one from a sampling point, so the occluders are the same expanded
  // groups without culling.
  occluders_.clear();
  if (!with_occluders || drawn_.expanded.empty()) return;
  const std::unordered_set<std::uint32_t> expanded(drawn_.expanded.begin(), drawn_.expanded.end());
  request.cull = false;
  request.max_triangles = std::numeric_limits<std::uint64_t>::max();
  request.max_cost = std::numeric_limits<std::uint64_t>::max();
  occluders_ = lod::patch::selectCut(hierarchy, request, [&expanded](std::uint32_t group) {
                 return expanded.count(group) != 0;
               }).patches;
}

void ResidentPatches::uploadWanted(std::uint64_t max_bytes, Session& session, lod::draw::PatchMeshes& meshes,
                                   const Spend& spend, const Fault& fault) {
  unfinished_ = false;
  const lod::patch::Hierarchy& hierarchy = session.hierarchy();
  for (const std::uint32_t group : wanted_.expanded) {
    if (isReady(group)) continue;
    const std::uint64_t bytes = gpuBytes(hierarchy, group);
    if (!spend(bytes)) {
      unfinished_ = true;
      return;
    }
    // The wanted groups fit by themselves, unless even the root alone exceeds the budget.
    if (!makeRoom(bytes, max_bytes, hierarchy, meshes) && group != 0) return;
    if (upload(group, session, meshes, fault))
      ready_[group] = updates_;
    else
      broken_.insert(group);
  }
}

/// Drops groups that this view does not want: the longest unwanted first, among equals the finest.
bool ResidentPatches::makeRoom(std::uint64_t bytes, std::uint64_t limit, const lod::patch::Hierarchy& hierarchy,
                               lod::draw::PatchMeshes& meshes) {
  const auto fits = [&] { return meshes.gpuBytes() + bytes <= limit; };
  if (fits()) return true;
  std::vector<std::pair<std::uint64_t, std::uint32_t>> unwanted;
  for (const auto& [group, last_wanted] : ready_)
    if (last_wanted != updates_) unwanted.emplace_back(last_wanted, ~group);
  std::sort(unwanted.begin(), unwanted.end());
  for (const auto& [last_wanted, complement] : unwanted) {
    if (fits()) break;
    drop(~complement, hierarchy, meshes);
  }
  return fits();
}

/// Decodes and uploads all patches that the group consumes. Returns false and keeps none of them when one is broken.
bool ResidentPatches::upload(std::uint32_t group, Session& session, lod::draw::PatchMeshes& meshes,
                             const Fault& fault) {
  const lod::patch::Hierarchy& hierarchy = session.hierarchy();
  const lod::patch::Group& record = hierarchy.groups[group];
  const base::ByteView block(*session.block(group));
  for (std::uint32_t i = 0; i < record.patch_count; ++i) {
    const std::uint32_t number = record.first_patch + i;
    auto geometry = decode(hierarchy.patches[number], block);
    if (!geometry) {
      fault("patch " + std::to_string(number) + " of group " + std::to_string(group) + ": " + geometry.error().message);
      drop(group, hierarchy, meshes);
      return false;
    }
    meshes.upload(number, *geometry);
  }
  return true;
}

}  // namespace client
