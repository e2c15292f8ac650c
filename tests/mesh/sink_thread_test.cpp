// A sink in a thread of its own gets the reader's blocks in their order, and its errors are returned.
#include "mesh/sink_thread.h"

#include <gtest/gtest.h>

namespace {

using namespace mesh;

// Keeps the first coordinate of each vertex and all corners, and refuses the vertex `bad`.
struct Keeper : MeshSink {
  double bad = -1.0;
  std::vector<double> seen;
  std::vector<std::uint64_t> corners;
  int restarts = 0;

  base::Result<void> vertices(const VertexBlock& block) override {
    for (const glm::dvec3& p : block.positions) {
      if (p.x == bad) return base::Error{base::ErrorCode::kInvalidInput, "bad vertex"};
      seen.push_back(p.x);
    }
    return {};
  }
  base::Result<void> triangles(const TriangleBlock& block) override {
    corners.insert(corners.end(), block.corners.begin(), block.corners.end());
    return {};
  }
  base::Result<void> restart() override {
    seen.clear(), corners.clear(), ++restarts;
    return {};
  }
};

// Passes blocks of 10 vertices 0, 1, 2 … in one buffer that is overwritten; stops at the first error.
base::Result<void> passBlocks(MeshSink& sink, int blocks) {
  std::vector<glm::dvec3> positions(10);
  for (int b = 0; b < blocks; ++b) {
    for (int i = 0; i < 10; ++i) positions[static_cast<std::size_t>(i)].x = 10 * b + i;
    LUMIGRID_TRY(sink.vertices({positions, {}, {}}));
    const std::vector<std::uint64_t> corners(3, static_cast<std::uint64_t>(b));
    LUMIGRID_TRY(sink.triangles({corners, {}, {}, {}, {}}));
  }
  return {};
}

TEST(SinkThread, keepsTheOrderAndCopiesBlocks) {
  Keeper keeper;
  SinkThread thread(keeper);
  ASSERT_TRUE(passBlocks(thread, 50));
  ASSERT_TRUE(thread.finish());
  ASSERT_EQ(keeper.seen.size(), 500U);
  for (std::size_t i = 0; i < keeper.seen.size(); ++i) EXPECT_EQ(keeper.seen[i], static_cast<double>(i));
  ASSERT_EQ(keeper.corners.size(), 150U);
  for (std::size_t i = 0; i < keeper.corners.size(); ++i) EXPECT_EQ(keeper.corners[i], i / 3);
}

TEST(SinkThread, returnsAnErrorAndPassesNothingOnAfterIt) {
  Keeper keeper;
  keeper.bad = 42.0;
  SinkThread thread(keeper);
  (void)passBlocks(thread, 50);
  const auto finished = thread.finish();
  ASSERT_FALSE(finished);
  EXPECT_EQ(finished.error().message, "bad vertex");
  EXPECT_EQ(keeper.seen.size(), 42U);
  EXPECT_EQ(keeper.corners.size(), 12U);
  EXPECT_FALSE(passBlocks(thread, 1));
}

TEST(SinkThread, restartDropsTheBlocksBefore) {
  Keeper keeper;
  SinkThread thread(keeper);
  ASSERT_TRUE(passBlocks(thread, 7));
  ASSERT_TRUE(thread.restart());
  EXPECT_EQ(keeper.restarts, 1);
  ASSERT_TRUE(passBlocks(thread, 2));
  ASSERT_TRUE(thread.finish());
  EXPECT_EQ(keeper.seen.size(), 20U);
}

}  // namespace
