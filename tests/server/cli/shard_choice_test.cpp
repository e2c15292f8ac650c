#include "server/cli/shard_choice.h"

#include <gtest/gtest.h>

#include <map>

namespace server::cli {
namespace {

using repository::Shard;
using Variables = std::map<std::string, std::string>;

Environment environmentOf(const Variables& variables) {
  return [&variables](const char* name) -> const char* {
    const auto it = variables.find(name);
    return it == variables.end() ? nullptr : it->second.c_str();
  };
}

void expectAuto(const Variables& variables, const Shard& expected) {
  const auto shard = shardFromLauncher(environmentOf(variables));
  ASSERT_TRUE(shard) << shard.error().message;
  EXPECT_EQ(*shard, expected);
}

void expectRefused(const Variables& variables, const std::string& piece) {
  const auto shard = shardFromLauncher(environmentOf(variables));
  ASSERT_FALSE(shard);
  EXPECT_NE(shard.error().message.find(piece), std::string::npos) << shard.error().message;
}

Variables arrayTask(const std::string& id, const std::string& count, const std::string& min, const std::string& max,
                    const std::string& step = "1") {
  return {{"SLURM_ARRAY_TASK_ID", id},   {"SLURM_ARRAY_TASK_COUNT", count}, {"SLURM_ARRAY_TASK_MIN", min},
          {"SLURM_ARRAY_TASK_MAX", max}, {"SLURM_ARRAY_TASK_STEP", step},   {"SLURM_PROCID", "0"},
          {"SLURM_NTASKS", "1"}};
}

TEST(ShardChoice, aTaskOfAnArrayTakesItsPlaceInIt) {
  expectAuto(arrayTask("0", "16", "0", "15"), {0, 16});
  expectAuto(arrayTask("15", "16", "0", "15"), {15, 16});
  expectAuto(arrayTask("1", "4", "1", "4"), {0, 4});        // --array=1-4
  expectAuto(arrayTask("8", "4", "4", "10", "2"), {2, 4});  // --array=4-10:2
  expectAuto({{"SLURM_ARRAY_TASK_ID", "7"}, {"SLURM_ARRAY_TASK_COUNT", "3"}, {"SLURM_ARRAY_TASK_MIN", "5"}}, {2, 3});
}

TEST(ShardChoice, anArrayWithHolesIsRefused) {
  expectRefused(arrayTask("5", "3", "1", "7"), "holes");  // --array=1,5,7
  expectRefused(arrayTask("3", "2", "3", "9"), "holes");
  expectRefused(arrayTask("3", "2", "3", "4", "0"), "holes");
}

TEST(ShardChoice, ranksOfEveryLauncherAreKnown) {
  expectAuto({{"OMPI_COMM_WORLD_RANK", "2"}, {"OMPI_COMM_WORLD_SIZE", "5"}}, {2, 5});
  expectAuto({{"PMI_RANK", "4"}, {"PMI_SIZE", "5"}}, {4, 5});
  expectAuto({{"SLURM_PROCID", "3"}, {"SLURM_NTASKS", "8"}}, {3, 8});
  expectAuto({{"SLURM_PROCID", "1"}, {"SLURM_STEP_NUM_TASKS", "2"}, {"SLURM_NTASKS", "8"}}, {1, 2});
  // Where mpirun runs within a job, mpirun counts, since it started the process.
  expectAuto(
      {{"OMPI_COMM_WORLD_RANK", "1"}, {"OMPI_COMM_WORLD_SIZE", "2"}, {"SLURM_PROCID", "0"}, {"SLURM_NTASKS", "2"}},
      {1, 2});
}

TEST(ShardChoice, ranksWithinATaskDivideItsShare) {
  Variables variables = arrayTask("2", "4", "0", "3");
  variables.insert({{"OMPI_COMM_WORLD_RANK", "1"}, {"OMPI_COMM_WORLD_SIZE", "3"}});
  expectAuto(variables, {7, 12});
}

TEST(ShardChoice, refusesAmbiguousAndMalformedRanks) {
  expectRefused({}, "say --shard i/n");
  expectRefused({{"OMPI_COMM_WORLD_RANK", "1"}}, "say --shard i/n");  // without a size
  expectRefused({{"OMPI_COMM_WORLD_RANK", "5"}, {"OMPI_COMM_WORLD_SIZE", "5"}}, "OMPI_COMM_WORLD_RANK=5");
  expectRefused({{"PMI_RANK", "x"}, {"PMI_SIZE", "5"}}, "PMI_RANK=x");
  expectRefused({{"PMI_RANK", "-1"}, {"PMI_SIZE", "5"}}, "PMI_RANK=-1");
  expectRefused({{"PMI_RANK", "1"}, {"PMI_SIZE", "99999"}}, "n must be 1 to");
  expectRefused({{"PMI_RANK", "1"}, {"PMI_SIZE", "99999999999999999999"}}, "PMI_SIZE=");
}

TEST(ShardChoice, withoutTheOptionOnlyRanksOfMpiCount) {
  const auto choice = [](const Variables& variables) { return *shardFromRanks(environmentOf(variables)); };
  EXPECT_EQ(choice({{"OMPI_COMM_WORLD_RANK", "2"}, {"OMPI_COMM_WORLD_SIZE", "5"}}), (Shard{2, 5}));
  EXPECT_EQ(choice({{"PMI_RANK", "0"}, {"PMI_SIZE", "2"}}), (Shard{0, 2}));
  EXPECT_EQ(choice({{"PMI_RANK", "0"}, {"PMI_SIZE", "1"}}), std::nullopt);
  EXPECT_EQ(choice({}), std::nullopt);
  EXPECT_EQ(choice(arrayTask("2", "4", "0", "3")), std::nullopt);
}

}  // namespace
}  // namespace server::cli
