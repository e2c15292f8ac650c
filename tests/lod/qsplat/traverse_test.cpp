#include "lod/qsplat/traverse.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>

#include "base/parallel.h"
#include "tests/support/decoded_splats.h"
#include "tests/support/random_views.h"
#include "tests/support/splat_tree.h"
#include "tests/support/test_meshes.h"

namespace lod::qsplat {
namespace {

struct Model {
  support::Mesh mesh;
  base::Bytes file;
  Header header;

  explicit Model(support::Mesh source, bool wide_pointers = false)
      : mesh(std::move(source)), file(support::splatFile(mesh, wide_pointers)), header(*readHeader(file)) {}
};

const Model& ball() {
  static const Model made(support::bumpySphere(60, 120, 0.1F));
  return made;
}
const Model& ring() {
  static const Model made(support::torus(120, 50), true);
  return made;
}

/// Holds a point of the surface and the normal of its facet.
struct Sample {
  glm::vec3 at;
  glm::vec3 normal;
};

std::vector<Sample> samplesOf(const support::Mesh& mesh, std::size_t count) {
  std::mt19937 random(11);
  std::uniform_real_distribution<float> unit(0.0F, 1.0F);
  std::vector<Sample> samples;
  for (std::size_t i = 0; i < count; ++i) {
    const std::size_t t = random() % mesh.triangleCount();
    const glm::vec3 &a = mesh.positions[mesh.indices[3 * t]], &b = mesh.positions[mesh.indices[3 * t + 1]],
                    &c = mesh.positions[mesh.indices[3 * t + 2]];
    const float r = std::sqrt(unit(random)), s = unit(random);
    const glm::vec3 cross = glm::cross(b - a, c - a);
    if (glm::length(cross) == 0.0F) continue;
    samples.push_back({(1.0F - r) * a + r * (1.0F - s) * b + r * s * c, glm::normalize(cross)});
  }
  return samples;
}

bool isSeen(const Sample& sample, const base::Camera& camera) {
  const glm::vec4 clip = camera.clipFromScene() * glm::vec4(sample.at, 1.0F);
  if (clip.w <= 0.0F || std::abs(clip.x) > clip.w || std::abs(clip.y) > clip.w || std::abs(clip.z) > clip.w)
    return false;
  return glm::dot(camera.towardsViewer(sample.at), sample.normal) > 0.0F;
}

bool isCovered(const glm::vec3& point, const std::vector<Splat>& splats) {
  return std::any_of(splats.begin(), splats.end(), [&](const Splat& splat) {
    const glm::vec3 d = point - splat.center;
    return glm::dot(d, d) <= splat.radius * splat.radius * 1.00001F;
  });
}

// Returns how many visible points of the surface no splat contains.
int missing(const std::vector<Sample>& samples, const base::Camera& camera, const std::vector<Splat>& splats) {
  return static_cast<int>(std::count_if(samples.begin(), samples.end(), [&](const Sample& sample) {
    return isSeen(sample, camera) && !isCovered(sample.at, splats);
  }));
}

TraverseRequest requestFor(const base::Camera& camera, float cutoff_px) {
  TraverseRequest request;
  request.camera = camera;
  request.cutoff_px = cutoff_px;
  return request;
}

TEST(TraverseTest, withoutCullingAndCutOffAllLeavesAreDrawnAndAllNodesMet) {
  for (const Model* model : {&ball(), &ring()}) {
    MemoryBlocks blocks(model->file, model->header);
    TraverseRequest request = requestFor(support::RandomViews(1, model->header.root, 64).next(), 0.0F);
    request.cull = request.cull_back_faces = false;
    const Traversal all = traverse(blocks, request);
    EXPECT_EQ(all.nodes, model->header.nodes);
    EXPECT_EQ(all.splats.size(), model->header.leaves);
    EXPECT_EQ(all.outside + all.facing_away, 0U);
    EXPECT_FALSE(all.damaged);
    EXPECT_TRUE(all.wanted.empty());
    for (const Splat& splat : all.splats) ASSERT_EQ(splat.normal & ~0x3FFF, Splat::kLeaf);
  }
}

TEST(TraverseTest, splatsHaveTheLooksOfTheirNodes) {
  MemoryBlocks blocks(ring().file, ring().header);
  TraverseRequest request = requestFor(support::RandomViews(1, ring().header.root, 64).next(), 0.0F);
  request.cull = request.cull_back_faces = false;
  // Vertices are found by position: a leaf's sphere has its vertex near its middle.
  for (const Splat& splat : traverse(blocks, request).splats) {
    float nearest = 1e9F;
    std::size_t vertex = 0;
    for (std::size_t v = 0; v < ring().mesh.positions.size(); ++v) {
      const float d = glm::length(ring().mesh.positions[v] - splat.center);
      if (d < nearest) nearest = d, vertex = v;
    }
    ASSERT_LE(nearest, splat.radius);
    if (nearest > 0.2F * splat.radius) continue;  // may be a neighbour's
    const glm::vec3 wanted(ring().mesh.colors[vertex]);
    const glm::vec3 got(support::decodeColor(splat.color));
    EXPECT_LE(glm::length(wanted - got), 60.0F);
  }
  MemoryBlocks plain(ball().file, ball().header);
  for (const Splat& splat : traverse(plain, requestFor(request.camera, 1.0F)).splats) ASSERT_EQ(splat.color, kWhite565);
}

TEST(TraverseTest, splatsHoldAllOfTheSurfaceThatIsSeenAtAnyCutOff) {
  for (const Model* model : {&ball(), &ring()}) {
    const std::vector<Sample> samples = samplesOf(model->mesh, 600);
    MemoryBlocks blocks(model->file, model->header);
    support::RandomViews views(3, model->header.root, 400);
    std::uint64_t outside = 0, facing_away = 0;
    for (int i = 0; i < 150; ++i) {
      const base::Camera camera = views.next();
      const float cutoff = static_cast<float>(std::pow(10.0, views.number(-0.3, 2.3)));
      const Traversal found = traverse(blocks, requestFor(camera, cutoff));
      ASSERT_EQ(missing(samples, camera, found.splats), 0) << "view " << i << ", cut-off " << cutoff;
      outside += found.outside;
      facing_away += found.facing_away;
    }
    EXPECT_GT(outside, 1000U);
    EXPECT_GT(facing_away, 1000U);
  }
}

/// A plain traversal as the papers describe it: it tests every node by itself, without short cuts, in double precision
/// where nodes are culled.
class PlainTraversal {
 public:
  PlainTraversal(const Model& model, const TraverseRequest& request)
      : model_(model), request_(request), layout_(model.header), frustum_(request.camera.clipFromScene()) {}

  std::vector<Splat> run() {
    visit(kBlockBytes, 1, model_.header.nodes > 1, model_.header.root);
    return splats_;
  }

 private:
  bool isOutside(const base::Sphere& s) const {
    return std::any_of(frustum_.planes.begin(), frustum_.planes.end(), [&](const glm::vec4& plane) {
      return glm::dot(glm::dvec3(plane), glm::dvec3(s.center)) + static_cast<double>(plane.w) <
             -(1.0 + 1e-6) * static_cast<double>(s.radius);
    });
  }

  // Compares each direction of the cone with each ray to the sphere, by angles.
  bool isTurnedAway(const base::Sphere& s, const Node& node, bool has_pointer) const {
    const double sine = static_cast<double>(coneSines(has_pointer)[node.coneField()]);
    if (sine > 1.0) return false;
    const glm::dvec4 eye(request_.camera.homogeneousEye());
    const glm::dvec3 ray = eye.w * glm::dvec3(s.center) - glm::dvec3(eye);
    const double distance = glm::length(ray);
    const double spread = std::asin(std::min(1.0, eye.w * static_cast<double>(s.radius) / distance)) + std::asin(sine);
    const double between =
        std::acos(std::clamp(glm::dot(ray, glm::dvec3(normalTable()[node.normalCode()])) / distance, -1.0, 1.0));
    return between + spread < 1.5707963;
  }

  void visit(std::uint64_t offset, std::uint32_t nodes, bool has_pointer, const base::Sphere& parent) {
    const std::uint8_t* group = &model_.file[offset];
    std::uint64_t end = has_pointer ? readPointer(group, nodes, layout_) : 0;
    for (std::uint32_t i = 0; i < nodes; ++i) {
      const Node node = readNode(group, i, layout_);
      const std::uint64_t child = !has_pointer || node.isLeaf() ? 0 : groupPlace(end, layout_.childBytes(node));
      if (child != 0) end = child + layout_.childBytes(node);
      const base::Sphere sphere = decodeSphere(parent, sphereTable()[node.sphereCode()]);
      if (isOutside(sphere) || isTurnedAway(sphere, node, has_pointer)) continue;
      if (child == 0 || support::projectedDiameter(sphere.center, sphere.radius, request_.camera) <= request_.cutoff_px)
        splats_.push_back({sphere.center, sphere.radius, static_cast<std::uint16_t>(node.normalCode()), node.color});
      else
        visit(child, node.children(), !node.childrenAreLeaves(), sphere);
    }
  }

  const Model& model_;
  const TraverseRequest& request_;
  const GroupLayout layout_;
  const base::Frustum frustum_;
  std::vector<Splat> splats_;
};

TEST(TraverseTest, cullingWithShortCutsDropsNothingThatEachNodeByItselfWouldKeep) {
  const auto key = [](const Splat& s) { return std::array{s.center.x, s.center.y, s.center.z, s.radius}; };
  support::RandomViews views(5, ball().header.root, 500);
  std::size_t plain_total = 0, total = 0;
  for (int i = 0; i < 60; ++i) {
    const TraverseRequest request = requestFor(views.next(), static_cast<float>(views.number(0.0, 30.0)));
    MemoryBlocks blocks(ball().file, ball().header);
    const std::vector<Splat> splats = traverse(blocks, request).splats;
    std::set<std::array<float, 4>> drawn;
    for (const Splat& splat : splats) drawn.insert(key(splat));
    const std::vector<Splat> plain = PlainTraversal(ball(), request).run();
    int dropped = 0;
    for (const Splat& splat : plain) dropped += drawn.count(key(splat)) == 0 ? 1 : 0;
    // The exact cone culls slightly more, and a node whose size equals the cut-off may fall on either side.
    EXPECT_LE(dropped, static_cast<int>(plain.size() / 500)) << "view " << i;
    plain_total += plain.size();
    total += splats.size();
  }
  // The short cuts keep few nodes more.
  EXPECT_LE(static_cast<double>(total), 1.1 * static_cast<double>(plain_total));
}

TEST(TraverseTest, aFinerCutOffMeetsAllNodesThatACoarserOneMet) {
  support::RandomViews views(7, ring().header.root, 500);
  for (int i = 0; i < 20; ++i) {
    const base::Camera camera = views.next();
    std::uint64_t before = 0;
    std::set<std::uint64_t> used_before;
    for (const float cutoff : {200.0F, 50.0F, 20.0F, 8.0F, 3.0F, 1.0F, 0.0F}) {
      MemoryBlocks blocks(ring().file, ring().header);
      blocks.trackUse();
      const Traversal found = traverse(blocks, requestFor(camera, cutoff));
      EXPECT_GE(found.nodes, before);
      before = found.nodes;
      std::set<std::uint64_t> used;
      for (std::uint64_t b = 1; b < blocks.header().blocks(); ++b)
        if (blocks.lastUse(b) != 0) used.insert(b);
      EXPECT_TRUE(std::includes(used.begin(), used.end(), used_before.begin(), used_before.end()));
      used_before = used;
      for (const Splat& splat : found.splats) {
        const bool leaf = (splat.normal & Splat::kLeaf) != 0;
        ASSERT_TRUE(leaf || support::projectedDiameter(splat.center, splat.radius, camera) <= cutoff * 1.0001F);
      }
    }
  }
}

// Seen through the lens, splats have at most a third of the size; outside of it nothing changes.
TEST(TraverseTest, aLensRefinesWhatIsSeenThroughItAndNothingElse) {
  MemoryBlocks blocks(ball().file, ball().header);
  support::RandomViews views(31, ball().header.root, 512);
  std::size_t replaced = 0, came = 0;
  for (int i = 0; i < 20; ++i) {
    const float cutoff_px = i % 2 == 0 ? 40.0F : 12.0F;
    TraverseRequest request = requestFor(views.next(), cutoff_px);
    const Traversal without = traverse(blocks, request);
    if (without.splats.empty()) continue;
    // Centre the lens on the splat nearest to the picture's middle.
    const auto seenAt = [&](const Splat& splat) {
      const glm::vec4 clip = request.camera.clipFromScene() * glm::vec4(splat.center, 1.0F);
      return 256.0F * glm::vec2(1.0F + clip.x / clip.w, 1.0F - clip.y / clip.w);
    };
    const auto offMiddle = [&](const Splat& splat) { return glm::length(seenAt(splat) - glm::vec2(256.0F)); };
    const Splat& target =
        *std::min_element(without.splats.begin(), without.splats.end(),
                          [&](const Splat& a, const Splat& b) { return offMiddle(a) < offMiddle(b); });
    const Lens lens{seenAt(target), 60.0F};
    request.lens = lens;
    const Traversal with = traverse(blocks, request);
    EXPECT_GE(with.nodes, without.nodes);

    std::set<std::array<float, 4>> plain, refined;
    const auto keyOf = [](const Splat& splat) {
      return std::array{splat.center.x, splat.center.y, splat.center.z, splat.radius};
    };
    for (const Splat& splat : without.splats) plain.insert(keyOf(splat));
    for (const Splat& splat : with.splats) {
      refined.insert(keyOf(splat));
      const float size = support::projectedDiameter(splat.center, splat.radius, request.camera);
      const bool leaf = (splat.normal & Splat::kLeaf) != 0;
      EXPECT_TRUE(leaf || size <= cutoff_px / 3.0F * 1.0001F || !isSeenThrough(lens, seenAt(splat), size)) << size;
    }
    for (const Splat& splat : without.splats) {
      const float size = support::projectedDiameter(splat.center, splat.radius, request.camera);
      EXPECT_TRUE(refined.contains(keyOf(splat)) || isSeenThrough(lens, seenAt(splat), size));
      replaced += refined.contains(keyOf(splat)) ? 0 : 1;
    }
    for (const auto& splat : refined) came += plain.contains(splat) ? 0 : 1;
  }
  // A splat is replaced by up to nine, fewer where leaves are reached or children face away.
  EXPECT_GT(replaced, 100U);
  EXPECT_GT(came, 3 * replaced);
}

TEST(TraverseTest, aLensIsNoFinerThanCanBeSeenAndNeverCoarser) {
  EXPECT_EQ(cutoffThroughLens(12.0F), 4.0F);
  EXPECT_EQ(cutoffThroughLens(1.0F), 0.5F);
  EXPECT_EQ(cutoffThroughLens(0.25F), 0.25F);
  EXPECT_EQ(cutoffThroughLens(0.0F), 0.0F);
}

TEST(TraverseTest, theResultDoesNotDependOnThreadsOrTheirOrder) {
  support::RandomViews views(9, ball().header.root, 500);
  const ForEach backwards = [](std::size_t count, const std::function<void(std::size_t)>& body) {
    for (std::size_t i = count; i-- > 0;) body(i);
  };
  for (int i = 0; i < 10; ++i) {
    TraverseRequest request = requestFor(views.next(), 1.0F);
    MemoryBlocks blocks(ball().file, ball().header);
    const Traversal one = traverse(blocks, request);
    request.for_each = backwards;
    const Traversal other_way = traverse(blocks, request);
    EXPECT_EQ(other_way.splats, one.splats);
    for (const unsigned threads : {2U, 7U}) {
      request.for_each = [threads](std::size_t count, const std::function<void(std::size_t)>& body) {
        base::parallelFor(count, threads, body);
      };
      MemoryBlocks fresh(ball().file, ball().header);
      const Traversal many = traverse(fresh, request);
      EXPECT_EQ(many.splats, one.splats);
      EXPECT_EQ(many.nodes, one.nodes);
    }
  }
}

TEST(TraverseTest, memoryOfAFrameBeforeIsUsedAgainAndLeavesNothingBehind) {
  support::RandomViews views(10, ball().header.root, 300);
  MemoryBlocks blocks(ball().file, ball().header);
  Traversal kept;
  for (int i = 0; i < 10; ++i) {
    const TraverseRequest request = requestFor(views.next(), 2.0F);
    traverse(blocks, request, kept);
    const Traversal fresh = traverse(blocks, request);
    EXPECT_EQ(kept.splats, fresh.splats);
    EXPECT_EQ(kept.nodes, fresh.nodes);
    EXPECT_EQ(kept.facing_away, fresh.facing_away);
  }
}

// ---- What is not here

/// The blocks of this model arrive one by one.
struct ArrivingBlocks {
  const Model& model;
  GrowingBlocks blocks;
  explicit ArrivingBlocks(const Model& m) : model(m), blocks(m.header) {}
  void put(std::uint64_t number) { blocks.put(number, &model.file[number * kBlockBytes]); }
};

TEST(TraverseTest, withoutTheFirstBlockItAloneIsWanted) {
  ArrivingBlocks arriving(ball());
  const Traversal found =
      traverse(arriving.blocks, requestFor(support::RandomViews(1, ball().header.root, 64).next(), 1.0F));
  EXPECT_TRUE(found.splats.empty());
  ASSERT_EQ(found.wanted.size(), 1U);
  EXPECT_EQ(found.wanted[0].block, 1U);
}

TEST(TraverseTest, whateverIsMissingParentsAreDrawnAndTheWantedBlocksCompleteThePicture) {
  const std::vector<Sample> samples = samplesOf(ball().mesh, 500);
  support::RandomViews views(13, ball().header.root, 600);
  for (int i = 0; i < 20; ++i) {
    const TraverseRequest request = requestFor(views.next(), 1.5F);
    ArrivingBlocks arriving(ball());
    // Random blocks are present, some without the blocks of their parents.
    for (std::uint64_t b = 2; b < ball().header.blocks(); ++b)
      if (views.number(0.0, 1.0) < 0.3) arriving.put(b);
    arriving.put(1);
    Traversal found = traverse(arriving.blocks, request);
    std::set<std::uint64_t> asked;
    while (!found.wanted.empty()) {
      ASSERT_EQ(missing(samples, request.camera, found.splats), 0);
      bool stands_in = false;
      for (const Splat& splat : found.splats) stands_in |= (splat.normal & Splat::kStandIn) != 0;
      EXPECT_TRUE(stands_in);
      for (std::size_t w = 1; w < found.wanted.size(); ++w)
        ASSERT_GE(found.wanted[w - 1].priority, found.wanted[w].priority);
      // The most urgent blocks arrive.
      for (std::size_t w = 0; w < std::min<std::size_t>(found.wanted.size(), 5); ++w) {
        ASSERT_TRUE(asked.insert(found.wanted[w].block).second) << "wanted though it is here";
        arriving.put(found.wanted[w].block);
      }
      traverse(arriving.blocks, request, found);
    }
    MemoryBlocks whole(ball().file, ball().header);
    EXPECT_EQ(found.splats, traverse(whole, request).splats);
  }
}

TEST(TraverseTest, droppedBlocksAreWantedAgain) {
  ArrivingBlocks arriving(ball());
  for (std::uint64_t b = 1; b < ball().header.blocks(); ++b) arriving.put(b);
  arriving.blocks.trackUse();
  arriving.blocks.beginFrame(7);
  const TraverseRequest request = requestFor(support::RandomViews(2, ball().header.root, 400).next(), 1.0F);
  const Traversal whole = traverse(arriving.blocks, request);
  std::uint64_t last_used = 0;
  for (std::uint64_t b = 1; b < ball().header.blocks(); ++b)
    if (arriving.blocks.lastUse(b) == 7) last_used = b;
  ASSERT_GT(last_used, 1U);
  arriving.blocks.drop(last_used);
  const Traversal found = traverse(arriving.blocks, request);
  ASSERT_EQ(found.wanted.size(), 1U);
  EXPECT_EQ(found.wanted[0].block, last_used);
  EXPECT_LT(found.splats.size(), whole.splats.size());
}

TEST(TraverseTest, theWantedCarryWhatOrdersAskAbout) {
  ArrivingBlocks arriving(ball());
  arriving.put(1);
  TraverseRequest request = requestFor(support::RandomViews(4, ball().header.root, 500).next(), 1.0F);
  std::vector<MissingChildren> wants;
  request.priority = [&](const MissingChildren& want) {
    wants.push_back(want);
    return static_cast<float>(want.radius);
  };
  const Traversal found = traverse(arriving.blocks, request);
  ASSERT_FALSE(wants.empty());
  std::map<std::uint64_t, float> largest;
  for (const MissingChildren& want : wants) {
    EXPECT_GT(want.block, 1U);
    EXPECT_GT(want.level, 0U);
    EXPECT_GT(want.size_px, request.cutoff_px);
    largest[want.block] = std::max(largest[want.block], want.radius);
  }
  EXPECT_EQ(found.wanted.size(), largest.size());
  for (const WantedBlock& wanted : found.wanted) EXPECT_EQ(wanted.priority, largest[wanted.block]);
}

TEST(TraverseTest, sweepsGoFromTopToBottomAndEachIsFinerThanTheOneBefore) {
  const Priority priority = sweepPriority(600);
  const auto at = [](float size_px, float y) { return MissingChildren{9, 3, 1.0F, size_px, {10.0F, y}}; };
  EXPECT_GT(priority(at(100.0F, 10.0F)), priority(at(100.0F, 500.0F)));
  EXPECT_GT(priority(at(100.0F, 599.0F)), priority(at(60.0F, 0.0F)));
  // Within a sweep sizes don't count: 2^6.5 < size <= 2^7 (base √2: 13 and 14).
  EXPECT_EQ(priority(at(100.0F, 10.0F)), priority(at(127.0F, 10.0F)));
  EXPECT_LT(priority(at(90.0F, 10.0F)), priority(at(91.0F, 10.0F)));
  EXPECT_EQ(std::floor(priority(at(100.0F, 599.9F)) / 1000.0F), 14.0F);
}

// ---- Views of other kinds

TEST(TraverseTest, parallelViewsCutAllNodesAtOneSize) {
  base::ViewCamera view;
  view.position = {5, 0, 0};
  view.direction = {-1, 0, 0};
  view.up = {0, 0, 1};
  view.width = view.height = 500;
  view.ortho_height = 2.5;
  const base::Camera camera = base::cameraForScene(view, glm::dvec3(0.0), ball().header.root);
  MemoryBlocks blocks(ball().file, ball().header);
  const Traversal found = traverse(blocks, requestFor(camera, 20.0F));
  ASSERT_FALSE(found.splats.empty());
  for (const Splat& splat : found.splats)
    EXPECT_TRUE((splat.normal & Splat::kLeaf) != 0 || 2.0F * splat.radius * 200.0F <= 20.001F);
  EXPECT_EQ(missing(samplesOf(ball().mesh, 500), camera, found.splats), 0);
}

TEST(TraverseTest, aSectionLeavesOutWhatLiesBeyondAndShowsTheInsideOfTheRest) {
  const base::Camera camera = support::RandomViews(21, ball().header.root, 400).next();
  TraverseRequest request = requestFor(camera, 0.0F);
  request.cull = false;
  request.camera.section = {1.0F, 0.0F, 0.0F, 0.25F};
  MemoryBlocks blocks(ball().file, ball().header);
  const Traversal found = traverse(blocks, request);
  std::size_t expected = 0;
  for (const glm::vec3& p : ball().mesh.positions) expected += p.x <= 0.25F ? 1 : 0;
  EXPECT_GE(found.splats.size(), expected);
  EXPECT_LE(found.splats.size(), expected + expected / 5);
  for (const Splat& splat : found.splats) EXPECT_LE(splat.center.x - splat.radius, 0.2501F);
  EXPECT_EQ(found.facing_away, 0U);
}

TEST(TraverseTest, aRootThatIsALeafIsDrawn) {
  Header header;
  header.file_bytes = 2 * kBlockBytes;
  header.nodes = header.leaves = header.groups = header.levels = 1;
  header.root = {{0, 0, 0}, 1.0F};
  base::Bytes file = headerBytes(header);
  file.resize(header.file_bytes, 0);
  const std::uint32_t bits = packLeaf(kWholeParent, encodeNormal({0, 1, 0}), kLeafConeCodes - 1);
  std::memcpy(&file[kBlockBytes], &bits, sizeof(bits));
  sealBlock(&file[kBlockBytes], 1);
  ASSERT_TRUE(checkTree(file).empty()) << checkTree(file)[0];
  MemoryBlocks blocks(file, *readHeader(file));
  const Traversal found = traverse(blocks, requestFor(support::RandomViews(1, header.root, 64).next(), 1.0F));
  ASSERT_EQ(found.splats.size(), 1U);
  EXPECT_EQ(found.splats[0].radius, 1.0F);
}

// ---- Files that lie

TEST(TraverseTest, aDamagedBlockIsNotUsed) {
  base::Bytes file = ball().file;
  file[5 * kBlockBytes + 100] ^= 1;
  MemoryBlocks blocks(file, ball().header);
  TraverseRequest request = requestFor(support::RandomViews(1, ball().header.root, 64).next(), 0.0F);
  request.cull = request.cull_back_faces = false;
  const Traversal found = traverse(blocks, request);
  EXPECT_EQ(blocks.damagedBlock(), 5U);
  ASSERT_EQ(found.wanted.size(), 1U);
  EXPECT_EQ(found.wanted[0].block, 5U);
  EXPECT_EQ(missing(samplesOf(ball().mesh, 300), request.camera, found.splats), 0);
}

// Both children of every node lead to the same group one level on: there are 2^100 paths down.
TEST(TraverseTest, aFileWhoseWaysMeetAgainAndAgainEndsAtItsNumberOfNodes) {
  constexpr std::uint32_t kLevels = 101;
  Header header;
  header.levels = kLevels;
  header.root = {{0, 0, 0}, 1.0F};
  const GroupLayout layout(false, false);
  std::vector<std::uint64_t> places;
  std::uint64_t end = kBlockBytes;
  for (std::uint32_t level = 0; level < 2 * kLevels - 1; ++level) {
    const std::uint32_t bytes = layout.bytes(level == 0 ? 1 : 2, true);
    places.push_back(groupPlace(end, bytes));
    end = places.back() + bytes;
  }
  header.file_bytes = (end + kBlockBytes - 1) / kBlockBytes * kBlockBytes;
  header.groups = 2 * (kLevels - 1) + 1;
  header.nodes = 1 + 2 * (header.groups - 1);
  header.leaves = header.nodes - (header.groups - 1);
  header.pointers = header.groups - 1;
  base::Bytes file = headerBytes(header);
  file.resize(header.file_bytes, 0);
  // Each group points to the next two, which overlap those of the next group.
  for (std::size_t g = 0; g + 2 < places.size(); ++g) {
    const std::uint32_t nodes = g == 0 ? 1 : 2;
    const std::uint32_t bits = packNode(kWholeParent, 0, kAnyDirection, 2, false);
    for (std::uint32_t i = 0; i < nodes; ++i) std::memcpy(&file[places[g] + 4 * i], &bits, sizeof(bits));
    const auto half = static_cast<std::uint32_t>(places[g + 1] / 2);
    std::memcpy(&file[places[g] + 4 * nodes], &half, sizeof(half));
  }
  for (std::uint64_t b = 1; b < header.blocks(); ++b) sealBlock(&file[b * kBlockBytes], static_cast<std::uint32_t>(b));
  const auto read = readHeader(file);
  ASSERT_TRUE(read) << read.error().message;
  for (const bool threads : {false, true}) {
    MemoryBlocks blocks(file, *read);
    TraverseRequest request = requestFor(support::RandomViews(1, header.root, 64).next(), 0.0F);
    if (threads)
      request.for_each = [](std::size_t count, const std::function<void(std::size_t)>& body) {
        base::parallelFor(count, 3, body);
      };
    const Traversal found = traverse(blocks, request);
    EXPECT_TRUE(found.damaged);
    EXPECT_LE(found.splats.size(), 100'000U);
  }
}

TEST(TraverseTest, aPointerThatLeadsBackOrBeyondIsNotFollowed) {
  for (const std::uint32_t half : {0U, kBlockBytes / 2, 0x7FFFFFFFU, 0xFFFFFFFFU}) {
    base::Bytes file = ball().file;
    std::memcpy(&file[kBlockBytes + ball().header.nodeBytes()], &half, sizeof(half));
    sealBlock(&file[kBlockBytes], 1);
    MemoryBlocks blocks(file, ball().header);
    const Traversal found = traverse(blocks, requestFor(support::RandomViews(1, ball().header.root, 64).next(), 0.0F));
    EXPECT_TRUE(found.damaged);
    ASSERT_EQ(found.splats.size(), 1U);
    EXPECT_NE(found.splats[0].normal & Splat::kStandIn, 0);
  }
}

}  // namespace
}  // namespace lod::qsplat
