// A source that several builds share is read once and sorted once, and each part of it goes when none waits for it.
#include "lod/ingest/shared_source.h"

#include <gtest/gtest.h>

#include <filesystem>

#include "tests/support/ply_file.h"
#include "tests/support/temporary_directory.h"
#include "tests/support/test_meshes.h"

namespace {

namespace fs = std::filesystem;
using namespace lod::ingest;
using base::Result;

class SharedBuilds : public testing::Test {
 protected:
  SharedBuilds() {
    support::writePly(files_ / "mesh.ply", support::bumpySphere(40, 40));
    input_ = *sourceFromFiles({files_ / "mesh.ply"}, {}, 1);
    input_.read = [this, read = input_.read](SourceSpool& spool, SourceInfo& notes) {
      ++reads_;
      return read(spool, notes);
    };
    options_.work_directory = files_ / "source.work";
    options_.resume_key = [] { return std::string("key"); };
  }

  /// Runs the first stages of a method, and `then`.
  Result<void> buildMethod(SharedSource& shared, const std::string& name,
                           const std::function<Result<void>(StagedBuild&)>& then) {
    StagedBuildOptions options;
    options.limits = {1, std::uint64_t{512} << 20};
    options.work_directory = files_ / (name + ".work");
    options.resume_key = options_.resume_key;
    options.shared = &shared;
    StagedBuild build(name, options, files_ / name, progress_);
    return build.run(name + " ", [&]() -> Result<void> {
      LUMIGRID_TRY(build.importSource(input_, 0));
      return then(build);
    });
  }
  /// A method that sorts triangles, reads them, and fails or not. Each of its stages is stored.
  Result<void> buildSorted(SharedSource& shared, const std::string& name, std::optional<base::ErrorCode> fails = {}) {
    return buildMethod(shared, name, [&](StagedBuild& build) -> Result<void> {
      LUMIGRID_ASSIGN_OR_RETURN(auto buckets, build.sortTriangles({{}, false, Stage::kPatchLeaves}));
      if (!build.directory().isFinished(Stage::kPatchLeaves)) {
        LUMIGRID_ASSIGN_OR_RETURN(const auto corners, buckets.read(0));
        triangles_ = corners.size() / 3;
        LUMIGRID_TRY(build.directory().finishStage(Stage::kPatchLeaves, {}, {}, [&] { build.leaveBuckets(buckets); }));
      }
      LUMIGRID_TRY(build.directory().settle());
      if (fails) return base::Error{*fails, "failed on purpose"};
      return {};
    });
  }
  Result<void> buildFromSpool(SharedSource& shared, const std::string& name) {
    return buildMethod(shared, name, [&](StagedBuild& build) -> Result<void> {
      LUMIGRID_ASSIGN_OR_RETURN(const auto spool, build.openSpool());
      SpooledTriangles block;
      LUMIGRID_TRY(spool.readTriangles(0, block));
      spooled_ = block.corners.size() / 3;
      build.spoolLeaver()();
      return {};
    });
  }
  bool has(const std::string& name) const { return fs::exists(files_ / ("source.work/" + name)); }

  support::TemporaryDirectory files_;
  SourceInput input_;
  SharedSourceOptions options_;
  Progress progress_;
  int reads_ = 0;
  std::size_t triangles_ = 0, spooled_ = 0;
};

TEST_F(SharedBuilds, theSourceIsReadAndSortedOnceForAll) {
  options_.spool_users = 1;
  options_.bucket_users = 2;
  SharedSource shared(options_);
  ASSERT_TRUE(buildSorted(shared, "first"));
  const std::size_t triangles = triangles_;
  EXPECT_GT(triangles, 1000U);
  EXPECT_TRUE(has("vertices")) << "one method still wants them";
  ASSERT_TRUE(buildFromSpool(shared, "second"));
  EXPECT_EQ(spooled_, triangles);
  triangles_ = 0;
  ASSERT_TRUE(buildSorted(shared, "third"));
  EXPECT_EQ(triangles_, triangles);
  EXPECT_EQ(reads_, 1);
  for (const char* spool : {"vertices", "triangles"}) EXPECT_FALSE(has(spool)) << "none wants them any more";
  EXPECT_TRUE(has("stage3")) << "the last one has left the buckets";
  for (const char* own : {"first.work", "second.work", "third.work"}) EXPECT_FALSE(fs::exists(files_ / own)) << own;
  shared.remove();
  EXPECT_FALSE(fs::exists(files_ / "source.work"));
}

TEST_F(SharedBuilds, aLaterRunGoesOnWithoutReading) {
  options_.bucket_users = 2;
  {
    SharedSource shared(options_);
    ASSERT_TRUE(buildSorted(shared, "first"));
    EXPECT_FALSE(buildSorted(shared, "second", base::ErrorCode::kCancelled));
  }
  options_.bucket_users = 1;
  SharedSource shared(options_);
  triangles_ = 0;
  ASSERT_TRUE(buildSorted(shared, "second"));
  EXPECT_EQ(triangles_, 0U) << "its stage behind the buckets was finished";
  EXPECT_EQ(reads_, 1);
}

// Buckets whose room was given back hold zeros. A method that wants them must not take those for triangles.
TEST_F(SharedBuilds, aMethodThatComesWhenTheBucketsAreGoneReadsAllAgain) {
  options_.bucket_users = 1;
  SharedSource shared(options_);
  ASSERT_TRUE(buildSorted(shared, "first"));
  ASSERT_TRUE(has("stage3"));
  const std::size_t triangles = std::exchange(triangles_, 0);
  const auto late = buildFromSource({}, input_, [&](const SourceInput&) -> Result<bool> {
    LUMIGRID_TRY(buildSorted(shared, "late"));
    return true;
  });
  ASSERT_TRUE(late) << late.error().message;
  EXPECT_EQ(triangles_, triangles);
  EXPECT_EQ(reads_, 2);
}

TEST_F(SharedBuilds, anErrorThatARerunCannotMendRemovesTheSourceToo) {
  options_.bucket_users = 1;
  SharedSource shared(options_);
  EXPECT_FALSE(buildSorted(shared, "first", base::ErrorCode::kInvalidInput));
  EXPECT_FALSE(fs::exists(files_ / "source.work"));
}

}  // namespace
