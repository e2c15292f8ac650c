#pragma once
// The summary that `lumigrid build` prints at its end.
#include <optional>
#include <string>
#include <vector>

#include "lod/hlod/builder/build.h"
#include "lod/patch/builder/hierarchy_build.h"
#include "lod/pmr/builder/build.h"
#include "lod/qsplat/builder/build.h"
#include "repository/repository.h"
#include "repository/verify.h"
#include "server/bake/bake.h"
#include "server/bake/tune.h"
#include "server/cli/build_command/resume.h"
#include "server/trial/trial.h"

namespace server::cli {

struct BuildReport {
  std::optional<lod::patch::builder::HierarchySummary> hierarchy;  ///< absent when a resumed build had it already
  std::optional<lod::qsplat::builder::BuildSummary> splats;        ///< the same
  std::optional<lod::pmr::builder::BuildSummary> umbrellas;        ///< the same
  std::optional<lod::hlod::builder::BuildSummary> hlod;            ///< the same
  std::vector<std::string> warnings;                               ///< of the source, each a line
  std::optional<Trial> trial;                                      ///< with --methods auto
  std::optional<TuneChoice> tuned;
  std::optional<BakeSummary> bake;             ///< over all shards that this process did
  repository::RemovalCounts removed;           ///< from a finished scene: rendered again, or not ours
  std::vector<repository::ShardGaps> missing;  ///< faces that other shards still lacked at the end
};

/// Prints the report on standard output, as JSON with --json. Warnings were printed when they were met.
void printReport(const BuildArguments& a, const BuildOutput& output, const BuildReport& report);

}  // namespace server::cli
