#include "server/cli/shard_choice.h"

#include <tuple>

#include "base/number.h"

namespace server::cli {
namespace {

using base::Error;
using base::ErrorCode;
using base::Result;
using repository::Shard;

Result<std::optional<std::uint64_t>> numberFrom(const Environment& environment, const char* name) {
  const char* text = environment(name);
  if (text == nullptr) return std::optional<std::uint64_t>();
  const auto value = base::parseDecimal(text);
  if (!value || *value > 1U << 30)
    return Error{ErrorCode::kInvalidInput, std::string(name) + "=" + text + " is no usable number; say --shard i/n"};
  return value;
}

// Reads a shard from two variables; nothing unless both are set.
Result<std::optional<Shard>> placeFrom(const Environment& environment, const char* index_name, const char* count_name) {
  LUMIGRID_ASSIGN_OR_RETURN(auto index, numberFrom(environment, index_name));
  LUMIGRID_ASSIGN_OR_RETURN(auto count, numberFrom(environment, count_name));
  if (!index || !count) return std::optional<Shard>();
  if (*index >= *count)
    return Error{ErrorCode::kInvalidInput, std::string(index_name) + "=" + std::to_string(*index) + " is not below " +
                                               count_name + "=" + std::to_string(*count) + "; say --shard i/n"};
  return std::optional(Shard{static_cast<std::uint32_t>(*index), static_cast<std::uint32_t>(*count)});
}

Result<std::optional<Shard>> firstOf(const Environment& environment,
                                     std::initializer_list<std::pair<const char*, const char*>> names) {
  for (const auto& [index, count] : names) {
    auto place = placeFrom(environment, index, count);
    if (!place || *place) return place;
  }
  return std::optional<Shard>();
}

// --array=4-10:2 starts tasks 4, 6, 8, 10, which take shards 0 to 3.
Result<std::optional<Shard>> placeInArray(const Environment& environment) {
  std::uint64_t values[5] = {0, 0, 0, 0, 1};
  const char* names[5] = {"SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_COUNT", "SLURM_ARRAY_TASK_MIN",
                          "SLURM_ARRAY_TASK_MAX", "SLURM_ARRAY_TASK_STEP"};
  for (int i = 0; i < 5; ++i) {
    LUMIGRID_ASSIGN_OR_RETURN(auto number, numberFrom(environment, names[i]));
    if (!number && i < 2) return std::optional<Shard>();
    if (number)
      values[i] = *number;
    else if (i == 3)
      values[3] = values[2] + values[1] - 1;
  }
  const auto [id, count, min, max, step] = std::tie(values[0], values[1], values[2], values[3], values[4]);
  const bool regular = step > 0 && min <= id && id <= max && (id - min) % step == 0 && (max - min) / step + 1 == count;
  if (!regular)
    return Error{ErrorCode::kInvalidInput,
                 "the job array has holes, so its tasks do not say which shard is theirs; say --shard "
                 "$SLURM_ARRAY_TASK_ID/n"};
  return std::optional(Shard{static_cast<std::uint32_t>((id - min) / step), static_cast<std::uint32_t>(count)});
}

Result<Shard> checked(std::uint64_t index, std::uint64_t count) {
  return repository::parseShard(std::to_string(index) + "/" + std::to_string(count));
}

}  // namespace

Result<Shard> shardFromLauncher(const Environment& environment) {
  LUMIGRID_ASSIGN_OR_RETURN(auto array, placeInArray(environment));
  LUMIGRID_ASSIGN_OR_RETURN(auto rank, firstOf(environment, {{"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"},
                                                             {"PMI_RANK", "PMI_SIZE"},
                                                             {"SLURM_PROCID", "SLURM_STEP_NUM_TASKS"},
                                                             {"SLURM_PROCID", "SLURM_NTASKS"}}));
  if (!array && !rank)
    return Error{ErrorCode::kNotFound,
                 "--shard auto: neither a Slurm job array nor an MPI launcher or srun started this; say --shard i/n"};
  const Shard outer = array.value_or(Shard{});
  const Shard inner = rank.value_or(Shard{});
  return checked(std::uint64_t{outer.index} * inner.count + inner.index, std::uint64_t{outer.count} * inner.count);
}

Result<std::optional<Shard>> shardFromRanks(const Environment& environment) {
  LUMIGRID_ASSIGN_OR_RETURN(
      auto rank, firstOf(environment, {{"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE"}, {"PMI_RANK", "PMI_SIZE"}}));
  if (!rank || rank->count <= 1) return std::optional<Shard>();
  LUMIGRID_ASSIGN_OR_RETURN(auto shard, checked(rank->index, rank->count));
  return std::optional(shard);
}

}  // namespace server::cli
