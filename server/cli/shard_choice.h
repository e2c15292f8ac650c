#pragma once
// Tells which shard a process takes, from the environment that its launcher gives it.
#include <functional>
#include <optional>
#include <string>

#include "base/error.h"
#include "repository/sampling/shard.h"

namespace server::cli {

/// Returns the value of an environment variable, null when it is not set: std::getenv, or a test's.
using Environment = std::function<const char*(const char* name)>;

/// The shard for `--shard auto`: the task's place in a Slurm job array times the rank within the task (Open MPI, PMI as
/// of MPICH and Intel MPI, or srun). Errors: kNotFound when no launcher says anything; kInvalidInput for an array with
/// holes or numbers that do not fit.
base::Result<repository::Shard> shardFromLauncher(const Environment& environment);

/// The shard without --shard: the rank, where an MPI launcher started more than one process; nothing otherwise. Slurm's
/// variables do not count: an array may be there for other reasons.
base::Result<std::optional<repository::Shard>> shardFromRanks(const Environment& environment);

}  // namespace server::cli
