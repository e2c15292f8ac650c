// Parts that were simplified each by itself are joined without a gap.
#include "lod/hlod/builder/cracks.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "lod/hlod/builder/collapse.h"
#include "lod/hlod/builder/node_build.h"
#include "tests/lod/hlod/builder/node_meshes.h"
#include "tests/support/surface_distance.h"
#include "tests/support/test_meshes.h"

namespace {

using namespace lod::hlod::builder;

AppearanceOptions shapeAlone() {
  AppearanceOptions options;
  options.normals = options.colors = false;
  return options;
}

/// A height field in four parts, each simplified by itself within `limit`.
std::vector<NodeMesh> simplifiedQuarters(const NodeMesh& whole, float limit) {
  std::vector<NodeMesh> parts(4);
  for (NodeMesh& part : parts) {
    part.positions = whole.positions, part.normals = whole.normals;
    part.on_rim = whole.on_rim;
  }
  for (std::size_t i = 0; i < whole.indices.size(); i += 3) {
    const glm::vec3 middle = (whole.positions[whole.indices[i]] + whole.positions[whole.indices[i + 1]] +
                              whole.positions[whole.indices[i + 2]]) /
                             3.0F;
    NodeMesh& part = parts[(middle.x > 5000.0F ? 1U : 0U) + (middle.y > 5000.0F ? 2U : 0U)];
    part.indices.insert(part.indices.end(), {whole.indices[i], whole.indices[i + 1], whole.indices[i + 2]});
  }
  for (NodeMesh& part : parts) {
    dropUnusedVertices(part);
    applyCollapses(part, collapseWithin(part, limit, shapeAlone()));
  }
  return parts;
}

std::size_t innerOpenEdges(const NodeMesh& mesh) {
  std::size_t inner = 0;
  for (const OpenEdge edge : openEdges(mesh.indices)) {
    const glm::uvec2 ends = endsOf(edge, mesh.indices);
    const auto isRim = [&](int axis) {
      const float a = mesh.positions[ends.x][axis], b = mesh.positions[ends.y][axis];
      return a == b && (a == 0.0F || a == 10000.0F);
    };
    inner += isRim(0) || isRim(1) ? 0 : 1;
  }
  return inner;
}

TEST(HlodCracks, neighboursThatKeptOtherVerticesAreJoined) {
  const NodeMesh source = support::nodeMesh(support::openGrid(80, 0.2F), 10000.0F);
  std::vector<NodeMesh> parts = simplifiedQuarters(source, 60.0F);
  NodeMesh loose;
  {
    // Without closing, many edges of the inner borders meet no triangle on the other side.
    std::vector<NodeMesh> copies = parts;
    for (NodeMesh& copy : copies) copy.error = 0.0F;
    loose = mergeParts(copies);
  }
  const float before_closing = parts.front().error;
  const NodeMesh joined = mergeParts(parts);
  // The triangles that were bent are off by more than they were, and each knows by how much.
  ASSERT_EQ(joined.errors.size(), joined.triangles());
  EXPECT_GT(joined.error, before_closing);
  EXPECT_EQ(joined.error, *std::max_element(joined.errors.begin(), joined.errors.end()));
  EXPECT_GT(innerOpenEdges(loose), 40U);
  EXPECT_LT(innerOpenEdges(joined), innerOpenEdges(loose) / 20);
  const support::Surface before = support::surfaceOf(source), after = support::surfaceOf(joined);
  const auto bound = [&](const std::vector<float>& values) {
    return static_cast<double>(*std::max_element(values.begin(), values.end()));
  };
  EXPECT_LE(support::sampledDistance(before, support::NearestSurface(after), 40000).max, bound(joined.bounds.toward));
  EXPECT_LE(support::sampledDistance(after, support::NearestSurface(before), 40000).max, bound(joined.bounds.from));
}

// One edge of the scene's length among many short ones, with many vertices on it.
TEST(HlodCracks, aLongEdgeTakesTheVerticesOfManyShortOnes) {
  constexpr std::uint32_t kParts = 30'000;
  NodeMesh mesh;
  std::vector<std::uint64_t> parts;
  const auto add = [&](const glm::vec3& place, std::uint64_t part) {
    mesh.positions.push_back(place);
    mesh.normals.emplace_back(0.0F, 0.0F, 1.0F);
    mesh.on_rim.push_back(0);
    parts.push_back(part);
  };
  add({0, 100, 0}, 1), add({kParts * 2, 100, 0}, 1), add({kParts, 50'000, 0}, 1);
  mesh.indices = {0, 1, 2};
  for (std::uint32_t i = 0; i < kParts; ++i) {
    const auto x = static_cast<float>(2 * i + 1);
    add({x, 100, 0}, 2), add({x - 1, 99, 0}, 2), add({x + 1, 99, 0}, 2);
    mesh.indices.insert(mesh.indices.end(), {3 + 3 * i, 4 + 3 * i, 5 + 3 * i});
  }
  EXPECT_EQ(closeCracks(mesh, parts, 0.4F), kParts);
  EXPECT_EQ(mesh.triangles(), 1 + 2 * kParts);
}

TEST(HlodCracks, aPartIsNotJoinedToItself) {
  // A slit narrower than the reach, both sides of one part, with other vertices on each side.
  NodeMesh mesh;
  mesh.positions = {{0, 0, 0}, {100, 0, 0}, {50, -50, 0}, {0, 1, 0}, {50, 2, 0}, {100, 1, 0}, {50, 60, 0}};
  mesh.normals.assign(mesh.positions.size(), glm::vec3(0.0F, 0.0F, 1.0F));
  mesh.on_rim.assign(mesh.positions.size(), 0);
  mesh.indices = {2, 1, 0, 3, 4, 6, 4, 5, 6};
  NodeMesh other = mesh;
  const std::vector<std::uint64_t> one(mesh.positions.size(), 1);
  EXPECT_EQ(closeCracks(mesh, one, 5.0F), 0U);
  // Two parts are joined.
  const std::vector<std::uint64_t> two{1, 1, 1, 2, 2, 2, 2};
  EXPECT_EQ(closeCracks(other, two, 5.0F), 1U);
  EXPECT_EQ(other.triangles(), 4U);
}

}  // namespace
