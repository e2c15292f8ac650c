#pragma once
// `lumigrid verify --cuts`: random cuts of the patch hierarchy, rebuilt as half-edge meshes by OpenMesh. That is a
// second way to the claim that every cut is watertight, independent of the code that builds hierarchies.
#include <cstdint>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "base/error.h"
#include "lod/patch/format.h"

namespace server::cli {

/// A line for each thing that is wrong.
using Faults = std::vector<std::string>;

/// Called with the share of the images that is read, 0..1; returns false to stop.
using VerifyProgress = std::function<bool(double done)>;

/// The topology of one cut as a surface whose vertices are merged where they share a lattice point.
struct CutTopology {
  std::uint64_t triangles = 0;
  std::uint64_t open_edges = 0;             ///< edges with a triangle on one side only
  std::uint64_t non_manifold_vertices = 0;  ///< lattice points where more than one fan of triangles meets
  std::uint64_t inconsistent_edges = 0;     ///< edges whose two triangles run along them in the same direction
};

struct CutReport {
  std::uint64_t seed = 0;
  CutTopology source;             ///< the cut of all leaves
  std::vector<CutTopology> cuts;  ///< the random ones
  Faults faults;                  ///< open edges and flipped neighbours that the source does not have
};

/// Checks `count` cuts; the same seed gives the same cuts. A cut is at fault when it has an open edge that does not run
/// along the source's border (farther from it than one and a half times the stated error there), more open edges than
/// the source, or more inconsistent edges than the source and a fivehundredth of the cut's open edges. Needs about 200
/// bytes of memory per triangle of the source. Errors: damaged blocks; kCancelled when `progress` returns false.
base::Result<CutReport> verifyCuts(const lod::patch::PatchFile& patches, std::uint32_t count, std::uint64_t seed,
                                   const VerifyProgress& progress);

/// A line for the source and one for each cut.
std::string cutsAsText(const CutReport& report);
nlohmann::json cutsAsJson(const CutReport& report);

}  // namespace server::cli
