#include "lod/patch/ray_cast.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <set>

#include "lod/patch/codec.h"
#include "lod/patch/format.h"
#include "lod/patch/traverse.h"
#include "tests/lod/patch/built_scene.h"
#include "tests/support/synthetic_hierarchy.h"

namespace lod::patch {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();

// ---- scenes ----

struct Facet {
  glm::dvec3 a, b, c;
};

std::vector<Facet> facetsOf(const PatchFile& file, const std::vector<std::uint32_t>& patches) {
  std::vector<Facet> facets;
  for (const std::uint32_t p : patches) {
    const auto geometry = file.geometry(p);
    const auto corner = [&](std::size_t i) {
      return glm::dvec3(file.hierarchy().lattice.position(geometry->positions[geometry->indices[i]]));
    };
    for (std::size_t i = 0; i < geometry->indices.size(); i += 3)
      facets.push_back({corner(i), corner(i + 1), corner(i + 2)});
  }
  return facets;
}

std::vector<Facet> leafFacets(const PatchFile& file) {
  return facetsOf(file, support::levelCut(file.hierarchy(), 0));
}

// ---- the independent way: every triangle by Moeller and Trumbore 1997 ----

/// Holds the least of the three weights of the ray's intersection with the triangle (negative: outside), and its
/// distance.
struct FacetCrossing {
  double least_weight = -1.0;
  double distance = kInfinity;
};

FacetCrossing crossingOf(const Ray& ray, const Facet& f) {
  const glm::dvec3 d = glm::normalize(ray.direction);
  const glm::dvec3 e1 = f.b - f.a;
  const glm::dvec3 e2 = f.c - f.a;
  const glm::dvec3 p = glm::cross(d, e2);
  const double det = glm::dot(e1, p);
  if (std::abs(det) < 1e-14 * glm::length(e1) * glm::length(e2)) return {};
  const glm::dvec3 s = ray.origin - f.a;
  const glm::dvec3 q = glm::cross(s, e1);
  const double v = glm::dot(s, p) / det;
  const double w = glm::dot(d, q) / det;
  return {std::min({v, w, 1.0 - v - w}), glm::dot(e2, q) / det};
}

/// Returns the nearest distance over all triangles grown (margin > 0) or shrunk by a share of themselves.
double nearest(const Ray& ray, const std::vector<Facet>& facets, double margin) {
  double distance = kInfinity;
  for (const Facet& f : facets) {
    const FacetCrossing at = crossingOf(ray, f);
    if (at.least_weight >= -margin && at.distance >= 0.0 && at.distance <= ray.max_distance)
      distance = std::min(distance, at.distance);
  }
  return distance;
}

/// The hit must lie between those of grown and shrunk triangles, which nearly always agree.
void expectNearest(const Ray& ray, const RayCast& cast, const std::vector<Facet>& facets) {
  const double from = nearest(ray, facets, 1e-9);
  const double to = nearest(ray, facets, -1e-9);
  const double got = cast.hit ? cast.hit->distance : kInfinity;
  const double slack = 1e-9 * (1.0 + glm::length(ray.origin));
  EXPECT_GE(got, from - slack);
  EXPECT_LE(got, to + slack);
  if (!cast.hit) return;
  const glm::dvec3 reached = ray.origin + got * glm::normalize(ray.direction);
  EXPECT_LT(glm::length(cast.hit->point - reached), slack);
  EXPECT_NEAR(glm::length(cast.hit->normal), 1.0, 1e-12);
  EXPECT_EQ(cast.hit->front, glm::dot(cast.hit->normal, ray.direction) < 0.0);
}

/// The hit's triangle and weights must give the hit's point.
void expectTriangleNamed(const PatchFile& file, const RayHit& hit, double slack) {
  const auto geometry = file.geometry(hit.patch);
  ASSERT_TRUE(geometry);
  ASSERT_LT(std::size_t{3} * hit.triangle + 2, geometry->indices.size());
  EXPECT_EQ(file.hierarchy().patches[hit.patch].consumer, hit.group);
  glm::dvec3 point(0.0);
  for (int k = 0; k < 3; ++k)
    point += hit.weights[k] *
             glm::dvec3(file.hierarchy().lattice.position(
                 geometry->positions[geometry->indices[std::size_t{3} * hit.triangle + static_cast<std::size_t>(k)]]));
  EXPECT_LT(glm::length(point - hit.point), slack);
}

support::Mesh movedFar(support::Mesh mesh) {
  for (glm::vec3& p : mesh.positions) p += glm::vec3(700.0F, -900.0F, 300.0F);
  return mesh;
}

struct NamedMesh {
  std::string name;
  support::Mesh mesh;
};

std::vector<NamedMesh> meshes() {
  return {{"sphere", support::bumpySphere(40, 60)}, {"torus", support::torus(60, 40)},
          {"grid", support::openGrid(40)},          {"soup", support::triangleSoup(2500, 0.1F)},
          {"tiny", support::tinyComponents(400)},   {"far", movedFar(support::bumpySphere(30, 40))}};
}

// ---- claims ----

TEST(RayCast, findsTheNearestOfAllTriangles) {
  for (const NamedMesh& named : meshes()) {
    SCOPED_TRACE(named.name);
    const BuiltScene scene(named.mesh, named.name);
    ASSERT_GT(scene.hierarchy().groups.size(), 3U);
    const std::vector<Facet> facets = leafFacets(scene.file());
    RandomRays rays(scene.file());
    int hits = 0;
    for (int i = 0; i < 400; ++i) {
      Ray ray = rays.next();
      if (i % 2 == 1) {  // at one of the triangles: small ones are missed otherwise
        const Facet& f = facets[static_cast<std::size_t>(i) * 7919 % facets.size()];
        ray.direction = (f.a + f.b + f.c) / 3.0 - ray.origin;
      }
      const RayCast cast = scene.cast(ray);
      expectNearest(ray, cast, facets);
      if (!cast.hit) continue;
      ++hits;
      EXPECT_EQ(scene.hierarchy().patches[cast.hit->patch].producer, kNoGroup);
      EXPECT_DOUBLE_EQ(cast.hit->accuracy, scene.hierarchy().lattice.step);
      expectTriangleNamed(scene.file(), *cast.hit, 1e-9 * (1.0 + glm::length(ray.origin)));
    }
    EXPECT_GE(hits, 200);
  }
}

TEST(RayCast, meetsWhatLiesWithinTheDistanceAlone) {
  const BuiltScene scene(support::torus(60, 40), "distance");
  const std::vector<Facet> facets = leafFacets(scene.file());
  RandomRays rays(scene.file());
  for (int i = 0; i < 100; ++i) {
    Ray ray = rays.next();
    const RayCast far = scene.cast(ray);
    if (!far.hit) continue;
    ray.max_distance = far.hit->distance;
    EXPECT_TRUE(scene.cast(ray).hit);
    ray.max_distance = far.hit->distance * (1.0 - 1e-9);
    EXPECT_FALSE(scene.cast(ray).hit);
  }
}

TEST(RayCast, slipsThroughNoEdgeOrCornerOfAClosedSurface) {
  const BuiltScene scene(support::bumpySphere(40, 60), "watertight");
  const std::vector<Facet> facets = leafFacets(scene.file());
  std::mt19937 random(5);
  std::uniform_int_distribution<std::size_t> any(0, facets.size() - 1);
  std::uniform_real_distribution<double> share(0.0, 1.0);
  RandomRays rays(scene.file());
  for (int i = 0; i < 2000; ++i) {
    const Facet& f = facets[any(random)];
    const double s = i % 3 == 0 ? 0.0 : i % 3 == 1 ? 0.5 : share(random);
    const glm::dvec3 target = f.a + s * (f.b - f.a);
    // From within every ray meets the surface; from outside one aimed at it does, up to the silhouette.
    const glm::dvec3 inside = 0.3 * rays.unit();
    EXPECT_TRUE(scene.cast({inside, target - inside}).hit) << i;
    const glm::dvec3 outside = 5.0 * glm::normalize(target) + 0.2 * rays.unit();
    const RayCast cast = scene.cast({outside, target - outside});
    ASSERT_TRUE(cast.hit) << i;
    EXPECT_LE(cast.hit->distance, glm::length(target - outside) + 1e-12);
  }
}

TEST(RayCast, keepsToAxesThroughVertices) {
  // The vertices of a flat grid lie exactly below the rays, which run along an axis.
  const BuiltScene scene(support::openGrid(40, 0.0F), "axes");
  const Lattice& lattice = scene.hierarchy().lattice;
  const auto leaves = support::levelCut(scene.hierarchy(), 0);
  for (const std::uint32_t p : leaves) {
    const auto geometry = scene.file().geometry(p);
    for (std::size_t v = 0; v < geometry->positions.size(); v += 7) {
      const glm::dvec3 at(lattice.position(geometry->positions[v]));
      const RayCast cast = scene.cast({at + glm::dvec3(0.0, 0.0, 2.0), {0.0, 0.0, -3.0}});
      ASSERT_TRUE(cast.hit);
      EXPECT_NEAR(cast.hit->distance, 2.0, 1e-12);
      EXPECT_NEAR(std::abs(cast.hit->normal.z), 1.0, 1e-12);
    }
  }
}

TEST(RayCast, passesAlongAPlaneWithoutMeetingIt) {
  const BuiltScene scene(support::openGrid(40, 0.0F), "along");
  glm::dvec3 in_plane(scene.hierarchy().lattice.position(scene.file().geometry(0)->positions[0]));
  in_plane.x = -1.0;
  EXPECT_FALSE(scene.cast({in_plane, {1.0, 0.0, 0.0}}).hit);
  EXPECT_FALSE(scene.cast({in_plane + glm::dvec3(0.0, 0.0, 1e-9), {1.0, 0.0, 0.0}}).hit);
}

TEST(RayCast, tellsWhichSideItMet) {
  const BuiltScene scene(support::bumpySphere(40, 60), "sides");
  const RayCast outside = scene.cast({{3.0, 0.1, 0.2}, {-1.0, 0.0, 0.0}});
  const RayCast inside = scene.cast({{0.0, 0.1, 0.2}, {1.0, 0.0, 0.0}});
  ASSERT_TRUE(outside.hit && inside.hit);
  EXPECT_TRUE(outside.hit->front);
  EXPECT_FALSE(inside.hit->front);
  EXPECT_GT(outside.hit->normal.x, 0.5);
}

TEST(RayCast, reachesFromFarAwayAsExactlyAsDoublesDo) {
  const BuiltScene scene(support::openGrid(40), "distant");
  const RayCast near = scene.cast({{0.371, 0.617, 1.0}, {0.0, 0.0, -1.0}});
  const RayCast far = scene.cast({{0.371, 0.617, 1e7}, {0.0, 0.0, -1.0}});
  ASSERT_TRUE(near.hit && far.hit);
  EXPECT_NEAR(near.hit->point.z, far.hit->point.z, 1e-8);
  EXPECT_EQ(near.hit->triangle, far.hit->triangle);
}

TEST(RayCast, onACoarseCutFindsTheCutsNearestFacet) {
  const BuiltScene scene(support::torus(80, 60), "coarse");
  std::set<float> errors;
  for (const Group& group : scene.hierarchy().groups)
    if (std::isfinite(group.error)) errors.insert(group.error);
  ASSERT_GE(errors.size(), 3U);
  for (const float tolerance :
       {*errors.begin(), *std::next(errors.begin(), static_cast<int>(errors.size() / 2)), *errors.rbegin(), 1e6F}) {
    SCOPED_TRACE(tolerance);
    const Cut cut = selectUniformCut(scene.hierarchy(), tolerance);
    const std::vector<Facet> facets = facetsOf(scene.file(), cut.patches);
    RandomRays rays(scene.file());
    for (int i = 0; i < 200; ++i) {
      const Ray ray = rays.next();
      const RayCast cast = scene.cast(ray, tolerance);
      expectNearest(ray, cast, facets);
      if (!cast.hit) continue;
      EXPECT_LE(cast.hit->accuracy, static_cast<double>(tolerance) + scene.hierarchy().lattice.step);
    }
  }
}

// ---- blocks that are not here ----

/// A client has only those blocks of a file that were fetched.
struct PartialBlocks {
  const PatchFile& file;
  std::set<std::uint32_t> here;
  base::Bytes held = {};

  BlockSource source() {
    return [this](std::uint32_t group) -> base::Result<std::optional<base::ByteView>> {
      if (here.count(group) == 0) return std::optional<base::ByteView>();
      held = *file.block(group);
      return std::optional(base::ByteView(held));
    };
  }
};

TEST(RayCast, asksForTheBlocksThatItNeedsAndNoOthers) {
  const BuiltScene scene(support::torus(80, 60), "blocks");
  RandomRays rays(scene.file());
  std::size_t fetched = 0, casts = 0;
  for (int i = 0; i < 200; ++i) {
    const Ray ray = rays.next();
    const RayCast whole = scene.cast(ray);
    PartialBlocks blocks{scene.file(), {}};
    // Blocks are fetched one at a time, nearest first.
    for (std::size_t round = 0; round <= scene.hierarchy().groups.size(); ++round) {
      const auto cast = castRay(scene.hierarchy(), ray, blocks.source());
      ASSERT_TRUE(cast);
      if (cast->needed.empty()) {
        ASSERT_EQ(cast->hit.has_value(), whole.hit.has_value());
        if (whole.hit) {
          EXPECT_EQ(cast->hit->distance, whole.hit->distance);
        }
        break;
      }
      ASSERT_TRUE(blocks.here.insert(cast->needed.front()).second) << "asked twice";
    }
    fetched += blocks.here.size(), ++casts;
  }
  std::set<std::uint32_t> with_leaves;
  for (const Patch& patch : scene.hierarchy().patches)
    if (patch.producer == kNoGroup) with_leaves.insert(patch.consumer);
  EXPECT_LT(fetched, casts * with_leaves.size() / 2);
}

TEST(RayCast, onAGrowingHierarchyNamesTheRecordsThatItNeeds) {
  const support::SyntheticHierarchy scene = support::syntheticHierarchy(8);
  const Hierarchy& whole = scene.hierarchy;
  std::vector<base::Bytes> blocks(whole.groups.size());
  Hierarchy sized = whole;
  for (std::uint32_t g = 0; g < whole.groups.size(); ++g) {
    const auto patches = *support::encodedBlock(scene, g);
    for (std::size_t i = 0; i < patches.size(); ++i) {
      Patch& row = sized.patches[whole.groups[g].first_patch + i];
      row.block_offset = static_cast<std::uint32_t>(blocks[g].size());
      row.block_bytes = static_cast<std::uint32_t>(patches[i].size());
      blocks[g].insert(blocks[g].end(), patches[i].begin(), patches[i].end());
    }
    sized.groups[g].block_bytes = static_cast<std::uint32_t>(blocks[g].size());
  }
  const BlockSource all = [&](std::uint32_t group) -> base::Result<std::optional<base::ByteView>> {
    return std::optional(base::ByteView(blocks[group]));
  };

  std::mt19937 random(2);
  std::uniform_real_distribution<double> along(0.0, static_cast<double>(scene.side));
  for (int i = 0; i < 100; ++i) {
    const glm::dvec3 from(along(random), along(random), 5.0);
    const Ray ray{from, glm::dvec3(along(random), along(random), 0.0) - from};
    const auto expected = castRay(sized, ray, all);
    ASSERT_TRUE(expected && expected->hit && expected->needed.empty());

    Hierarchy growing;
    growing.lattice = sized.lattice;
    for (;;) {
      const auto cast = castRay(growing, ray, all);
      ASSERT_TRUE(cast);
      if (cast->needed.empty()) {
        ASSERT_TRUE(cast->hit);
        EXPECT_EQ(cast->hit->distance, expected->hit->distance);
        EXPECT_EQ(cast->hit->patch, expected->hit->patch);
        break;
      }
      base::ByteWriter out;
      encodeGroup(sized, cast->needed.front(), out);
      base::ByteReader in(out.view());
      const auto added = addGroup(in, growing, static_cast<std::uint32_t>(sized.groups.size()),
                                  static_cast<std::uint32_t>(sized.patches.size()));
      ASSERT_TRUE(added) << added.error().message;
      ASSERT_EQ(*added, cast->needed.front());
    }
    EXPECT_LT(std::count(growing.known.begin(), growing.known.end(), 1), static_cast<long>(sized.groups.size()));
  }
}

// ---- errors ----

TEST(RayCast, refusesWhatIsNoRay) {
  const BuiltScene scene(support::torus(20, 20), "refuse");
  const double nan = std::nan("");
  const std::vector<Ray> rays{{{nan, 0.0, 0.0}, {0.0, 0.0, 1.0}},
                              {{0.0, 0.0, 0.0}, {0.0, 0.0, 0.0}},
                              {{0.0, 0.0, 0.0}, {0.0, kInfinity, 0.0}},
                              {{0.0, 0.0, 0.0}, {0.0, 0.0, 1.0}, -1.0},
                              {{0.0, 0.0, 0.0}, {0.0, 0.0, 1.0}, nan}};
  for (const Ray& ray : rays) {
    const auto cast = castRay(scene.hierarchy(), ray, blocksOf(scene.file()));
    ASSERT_FALSE(cast);
    EXPECT_EQ(cast.error().code, base::ErrorCode::kInvalidInput);
  }
  const Ray ray{{0.0, 0.0, 3.0}, {0.0, 0.0, -1.0}};
  EXPECT_FALSE(castRay(scene.hierarchy(), ray, blocksOf(scene.file()), -1.0F));
  // Any length of the direction will do.
  EXPECT_TRUE(castRay(scene.hierarchy(), {{1.0, 0.0, 3.0}, {0.0, 0.0, -1e300}}, blocksOf(scene.file()))->hit);
  EXPECT_TRUE(castRay(scene.hierarchy(), {{1.0, 0.0, 3.0}, {0.0, 0.0, -1e-300}}, blocksOf(scene.file()))->hit);
}

TEST(RayCast, passesErrorsOnAndNamesDamagedBlocks) {
  const BuiltScene scene(support::torus(60, 40), "damage");
  const Ray ray{{1.0, 0.0, 3.0}, {0.0, 0.0, -1.0}};
  base::Bytes copy;
  const auto cut_short = [&](std::uint32_t group) -> base::Result<std::optional<base::ByteView>> {
    copy = *scene.file().block(group);
    return std::optional(base::ByteView(copy).first(copy.size() - 1));
  };
  const auto flipped = [&](std::uint32_t group) -> base::Result<std::optional<base::ByteView>> {
    copy = *scene.file().block(group);
    for (std::size_t i = 0; i < copy.size(); i += 50) copy[i] ^= 0x55U;
    return std::optional(base::ByteView(copy));
  };
  for (const BlockSource& source : {BlockSource(cut_short), BlockSource(flipped)}) {
    const auto cast = castRay(scene.hierarchy(), ray, source);
    ASSERT_FALSE(cast);
    EXPECT_EQ(cast.error().code, base::ErrorCode::kInvalidInput);
    EXPECT_NE(cast.error().message.find("patch"), std::string::npos) << cast.error().message;
  }
  const auto lost = [](std::uint32_t) -> base::Result<std::optional<base::ByteView>> {
    return base::Error{base::ErrorCode::kNetwork, "the peer is gone"};
  };
  const auto cast = castRay(scene.hierarchy(), ray, lost);
  ASSERT_FALSE(cast);
  EXPECT_EQ(cast.error().code, base::ErrorCode::kNetwork);
}

}  // namespace
}  // namespace lod::patch
