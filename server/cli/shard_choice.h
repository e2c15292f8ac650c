#pragma once
// Which shard a process takes, by what its launcher says.
#include <functional>
#include <optional>
#include <string>

#include "base/error.h"
#include "repository/sampling/shard.h"

namespace server::cli {

/// Value of an environment variable, null when it is not set: std::getenv, or a test's.
using Environment = std::function<const char*(const char* name)>;

/// `--shard auto`: the task's place in a Slurm job array times the rank within the task (Open MPI, PMI as of MPICH and
/// Intel MPI, or srun). Errors: kNotFound when no launcher says anything; kInvalidInput for an array with holes or
/// numbers that do not fit.
base::Result<repository::Shard> shardFromLauncher(const Environment& environment);

/// Without --shard: the rank, where an MPI launcher started more than one; nothing otherwise. Slurm's variables are not
/// asked: an array may be there for other reasons.
base::Result<std::optional<repository::Shard>> shardFromRanks(const Environment& environment);

}  // namespace server::cli
