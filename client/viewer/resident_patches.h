#pragma once
// Keeps the groups of patches that are on the GPU: which are wanted for a view within a budget of bytes, which are
// dropped, and which cut the uploaded ones allow.
//
// There are two cuts. The *wanted* cut is refined over all groups whose blocks the session has, until the tolerance,
// the triangles or the bytes are reached. It depends only on the view and the cache, so at the limit of the budget it
// is simply coarser, and the same view always gives the same cut. Its groups are uploaded, most urgent first, and stay;
// the least recently wanted of the others make room. The *drawn* cut is the wanted one as far as it is uploaded.
#include <cstdint>
#include <functional>
#include <string>
#include <unordered_map>
#include <unordered_set>
#include <vector>

#include "client/source/session.h"
#include "lod/draw/triangles.h"
#include "lod/patch/traverse.h"

namespace client {

class ResidentPatches {
 public:
  /// Takes bytes from the frame's upload share; returns false when none are left.
  using Spend = std::function<bool(std::uint64_t bytes)>;
  using Fault = std::function<void(const std::string& problem)>;

  /// Notes that a block arrived, possibly again; an earlier one may have been broken.
  void arrived(std::uint32_t group) { broken_.erase(group); }
  void drop(std::uint32_t group, const lod::patch::Hierarchy& hierarchy, lod::draw::PatchMeshes& meshes);
  /// Forgets all uploads when the GL context is lost; the meshes are gone with it.
  void forget();

  /// Uploads groups that the view wants, and selects both cuts. `view.max_cost` limits the patches on the GPU together
  /// with the blocks of the groups in use, in bytes; `view.cost` is not used. `with_occluders`: occluders() is wanted.
  void update(const lod::patch::CutRequest& view, bool with_occluders, Session& session, lod::draw::PatchMeshes& meshes,
              const Spend& spend, const Fault& fault);

  const lod::patch::Cut& drawn() const { return drawn_; }
  const lod::patch::Cut& wanted() const { return wanted_; }
  /// The drawn cut extended by the patches outside the view; empty unless wanted.
  const std::vector<std::uint32_t>& occluders() const { return occluders_; }
  /// Whether wanted groups wait for the next frame's share.
  bool unfinished() const { return unfinished_; }

 private:
  bool isReady(std::uint32_t group) const { return ready_.count(group) != 0; }
  void uploadWanted(std::uint64_t max_bytes, Session& session, lod::draw::PatchMeshes& meshes, const Spend& spend,
                    const Fault& fault);
  bool makeRoom(std::uint64_t bytes, std::uint64_t limit, const lod::patch::Hierarchy& hierarchy,
                lod::draw::PatchMeshes& meshes);
  bool upload(std::uint32_t group, Session& session, lod::draw::PatchMeshes& meshes, const Fault& fault);

  std::unordered_map<std::uint32_t, std::uint64_t> ready_;  ///< uploaded groups and the update that last wanted them
  std::unordered_set<std::uint32_t> broken_;                ///< not decoded again until their block arrives again
  std::uint64_t updates_ = 0;
  lod::patch::Cut wanted_, drawn_;
  std::vector<std::uint32_t> occluders_;
  bool unfinished_ = false;
};

}  // namespace client
