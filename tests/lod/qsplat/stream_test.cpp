#include "lod/qsplat/stream/stream.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>

#include "tests/lod/qsplat/stream_host.h"
#include "tests/support/decoded_splats.h"
#include "tests/support/random_views.h"
#include "tests/support/splat_tree.h"
#include "tests/support/test_meshes.h"

namespace lod::qsplat {
namespace {

/// Returns about 250 blocks of a closed surface.
const base::Bytes& file() {
  static const base::Bytes bytes = support::splatFile(support::bumpySphere(120, 240, 0.1F));
  return bytes;
}
const Header& header() {
  static const Header read = *readHeader(file());
  return read;
}
constexpr int kPixels = 256;

base::Camera cameraFrom(const glm::dvec3& direction, double distance = 3.0, int pixels = kPixels) {
  base::ViewCamera view;
  view.position = glm::dvec3(header().root.center) - distance * header().root.radius * glm::normalize(direction);
  view.direction = glm::normalize(direction);
  view.up = {0.1, 0.9, 0.3};
  view.width = view.height = pixels;
  return base::cameraForScene(view, glm::dvec3(0.0), header().root);
}

TraverseRequest requestFor(const base::Camera& camera, float cutoff_px = 1.0F) {
  TraverseRequest request;
  request.camera = camera;
  request.cutoff_px = cutoff_px;
  return request;
}

std::vector<Splat> localSplats(const TraverseRequest& request) {
  MemoryBlocks blocks(file(), header());
  return traverse(blocks, request).splats;
}

TEST(StreamTest, refinementIsMonotone) {
  Stream stream(file().size(), withoutIdling());
  Host host(stream, file());
  double now = 0.0;
  std::size_t nodes = 0;
  float coarsest = 1e30F;
  fetchAll(stream, host, requestFor(cameraFrom({0.3, -0.4, -0.8})), now, [&](const Traversal& found) {
    EXPECT_GE(found.nodes, nodes);
    nodes = found.nodes;
    float largest = 0.0F;
    for (const Splat& splat : found.splats)
      if ((splat.normal & Splat::kStandIn) != 0) largest = std::max(largest, splat.radius);
    if (found.splats.empty()) return;
    EXPECT_LE(largest, coarsest);
    coarsest = largest;
  });
  EXPECT_EQ(coarsest, 0.0F);
}

// All orders fetch the same blocks in the end; only the sequence differs.
TEST(StreamTest, eachOrderBringsAllAndBySizeTheLargestFirst) {
  const TraverseRequest request = requestFor(cameraFrom({0.2, 0.5, -1.0}, 1.6, 512));
  const std::vector<Splat> local = localSplats(request);
  for (const auto& [order, name] : kStreamOrderNames) {
    StreamOptions options = withoutIdling();
    options.order = order;
    options.max_requests = 1;
    options.max_request_blocks = 1;
    Stream stream(file().size(), options);
    Host host(stream, file());
    double now = 0.0;
    float last = 1e30F;
    const Traversal found = fetchAll(stream, host, request, now, [&](const Traversal& picture) {
      if (order != StreamOrder::kSize || picture.wanted.empty()) return;
      EXPECT_LE(picture.wanted[0].priority, last);
      last = picture.wanted[0].priority;
    });
    EXPECT_EQ(found.splats, local) << name;
    EXPECT_EQ(streamOrderFromName(name), order);
  }
  EXPECT_FALSE(streamOrderFromName("upside down").has_value());
}

TEST(StreamTest, sweepsGoFromTheTopDownEachFinerThanTheOneBefore) {
  const base::Camera camera = cameraFrom({0.0, 0.0, -1.0});
  const Priority priority = sweepPriority(camera.height);
  const auto of = [&](float size, float y) { return priority({1, 3, 0.1F, size, {20.0F, y}}); };
  EXPECT_GT(of(30.0F, 10.0F), of(30.0F, 200.0F));
  EXPECT_GT(of(46.0F, 250.0F), of(32.0F, 0.0F));           // a sweep apart: √2
  EXPECT_EQ(of(33.0F, 100.0F), of(45.0F, 100.0F));         // the same sweep
  EXPECT_NEAR(of(33.0F, 256.0F), 11.0F * 1000.0F, 0.01F);  // ⌈log_√2 33⌉ = 11
}

TEST(StreamTest, requestsBlocksUnderTheLensFirst) {
  StreamOptions options = withoutIdling();
  options.max_request_blocks = 1;
  options.max_requests = 1;
  Stream stream(file().size(), options);
  Host host(stream, file());
  const base::Camera camera = cameraFrom({0.0, 0.0, -1.0}, 2.5, 512);
  const TraverseRequest request = requestFor(camera);
  const Lens lens{{256.0F, 400.0F}, 40.0F};
  const auto coarsestSeen = [&](const Traversal& found, bool through) {
    float largest = 0.0F;
    for (const Splat& splat : found.splats) {
      const glm::vec4 clip = camera.clipFromScene() * glm::vec4(splat.center, 1.0F);
      const glm::vec2 at(256.0F * (1.0F + clip.x / clip.w), 256.0F * (1.0F - clip.y / clip.w));
      const float size = support::projectedDiameter(splat.center, splat.radius, camera);
      const bool inside = glm::length(at - lens.center_px) <= lens.radius_px + 0.5F * size;
      if (inside == through && (splat.normal & Splat::kStandIn) != 0) largest = std::max(largest, size);
    }
    return largest;
  };
  Traversal found;
  double now = 0.0;
  for (int turn = 0; turn < 5000; ++turn) {
    stream.traverse(request, lens, found);
    if (stream.header() != nullptr && coarsestSeen(found, true) == 0.0F && !found.splats.empty()) break;
    host.acceptRequests(now);
    now += 0.01;
    if (host.underWay() > 0) host.answerOne(now);
  }
  EXPECT_EQ(coarsestSeen(found, true), 0.0F) << "the lens is not refined";
  EXPECT_GT(coarsestSeen(found, false), 8.0F) << "all else came with it";
  EXPECT_LT(host.sent, file().size() / 3);
}

TEST(StreamTest, theBudgetHoldsTheRootStaysAndNoDrawnBlockGoes) {
  StreamOptions options;
  options.memory_bytes = kMinStreamMemory;
  Stream stream(file().size(), options);
  Host host(stream, file());
  support::RandomViews views(9, header().root, 400);
  double now = 0.0;
  std::size_t least_splats = ~std::size_t{0};
  for (int i = 0; i < 40; ++i) {
    const TraverseRequest request = requestFor(views.next(), 0.5F);
    std::uint64_t nodes = 0;
    const Traversal found = fetchAll(stream, host, request, now, [&](const Traversal& picture) {
      EXPECT_GE(picture.nodes, nodes) << "a block of the drawn cut was dropped";
      nodes = picture.nodes;
      // The header counts as present, but is not kept as a block.
      ASSERT_LE(stream.stats().present * kBlockBytes, options.memory_bytes + kBlockBytes);
    });
    ASSERT_TRUE(stream.complete()) << i;
    least_splats = std::min(least_splats, found.splats.size());
  }
  EXPECT_GT(stream.stats().evicted, 100U);
  EXPECT_GT(least_splats, 0U);
}

TEST(StreamTest, atRestTheSurroundingsComeAndThenTheWholeFile) {
  StreamOptions options;
  options.idle_bytes = file().size();
  Stream stream(file().size(), options);
  Host host(stream, file());
  double now = 0.0;
  const base::Camera camera = cameraFrom({0.0, 0.0, -1.0}, 1.3);
  fetchAll(stream, host, requestFor(camera), now);
  ASSERT_TRUE(stream.complete());
  const std::uint64_t of_view = stream.stats().present;
  const std::uint64_t generation = stream.generation();

  // Blocks of the surroundings must not cause another traversal.
  while (stream.stats().present < (of_view + header().blocks()) / 2) {
    host.acceptRequests(now += 0.01);
    ASSERT_GT(host.underWay(), 0U);
    host.answerOne(now);
  }
  EXPECT_EQ(stream.generation(), generation) << "what is for later must not draw the picture again";
  for (int i = 0; i < 5000 && stream.stats().present < header().blocks(); ++i) {
    host.acceptRequests(now += 0.01);
    if (host.underWay() > 0) host.answerOne(now);
  }
  EXPECT_EQ(stream.stats().present, header().blocks());
  EXPECT_TRUE(stream.nextRequests(now + 1.0).empty());
}

TEST(StreamTest, aSmallTurnAtRestFindsItsBlocksHere) {
  StreamOptions options;
  options.idle_bytes = 60 * kBlockBytes;
  Stream stream(file().size(), options);
  Host host(stream, file());
  double now = 0.0;
  fetchAll(stream, host, requestFor(cameraFrom({0.0, 0.0, -1.0}, 1.15)), now);
  const auto lacking = [&](const base::Camera& camera) {
    MemoryBlocks all(file(), header());
    all.trackUse();
    traverse(all, requestFor(camera));
    Traversal found;
    stream.traverse(requestFor(camera), std::nullopt, found);
    return found.wanted.size();
  };
  const base::Camera turned = cameraFrom({0.06, 0.0, -1.0}, 1.15);
  const std::size_t before = lacking(turned);
  fetchAll(stream, host, requestFor(cameraFrom({0.0, 0.0, -1.0}, 1.15)), now);
  for (int i = 0; i < 2000; ++i) {
    host.acceptRequests(now += 0.01);
    if (host.underWay() > 0) host.answerOne(now);
  }
  EXPECT_GT(before, 0U);
  EXPECT_LT(lacking(turned), before);
}

// ---- bad hosts ----

TEST(StreamTest, aDamagedBlockIsAskedForAgainThenGivenUpAndItsParentsStandIn) {
  const TraverseRequest request = requestFor(cameraFrom({0.0, 0.0, -1.0}));
  const std::uint64_t bad = 20;
  for (const int times : {1, 2, 1000}) {
    Stream stream(file().size(), withoutIdling());
    Host host(stream, file());
    int left = times;
    int asked = 0;
    host.spoil = [&](const ByteRange& range, base::Bytes bytes) -> std::optional<base::Bytes> {
      const std::uint64_t first = range.offset / kBlockBytes;
      if (bad < first || bad >= first + range.length / kBlockBytes) return bytes;
      ++asked;
      if (left-- > 0) bytes[(bad - first) * kBlockBytes + 77] ^= 0x10;
      return bytes;
    };
    double now = 0.0;
    const Traversal found = fetchAll(stream, host, request, now);
    ASSERT_TRUE(stream.complete());
    if (times < 1000) {
      EXPECT_EQ(asked, times + 1);
      EXPECT_EQ(found.splats, localSplats(request));
      EXPECT_EQ(stream.warning(), "");
    } else {
      EXPECT_EQ(asked, 3);
      EXPECT_LT(found.splats.size(), localSplats(request).size());
      EXPECT_EQ(stream.warning(), "block 20 is damaged: checksum does not match; publish the scene again");
      EXPECT_EQ(stream.stats().given_up, 1U);
      EXPECT_EQ(stream.problem(), "");
    }
  }
}

TEST(StreamTest, aBlockInAnothersPlaceIsNotTaken) {
  base::Bytes swapped = file();
  std::swap_ranges(swapped.begin() + 30 * kBlockBytes, swapped.begin() + 31 * kBlockBytes,
                   swapped.begin() + 31 * kBlockBytes);
  Stream stream(swapped.size(), withoutIdling());
  Host host(stream, swapped);
  double now = 0.0;
  fetchAll(stream, host, requestFor(cameraFrom({0.0, 0.0, -1.0})), now);
  fetchAll(stream, host, requestFor(cameraFrom({0.0, 0.0, 1.0})), now);
  EXPECT_EQ(stream.stats().given_up, 2U);
}

TEST(StreamTest, aHostThatIsAwayIsAskedLessAndLess) {
  Stream stream(file().size(), withoutIdling());
  Host host(stream, file());
  host.spoil = [](const ByteRange&, const base::Bytes&) { return std::nullopt; };
  for (double now = 0.0; now < 30.0; now += 0.01) {
    host.acceptRequests(now);
    if (host.underWay() > 0) host.answerOne(now);
  }
  EXPECT_GE(host.asked.size(), 7U);
  EXPECT_LE(host.asked.size(), 12U);
  EXPECT_EQ(stream.problem(), "");
}

// When a connection breaks, all requests under way fail together: only the first one starts a pause.
TEST(StreamTest, requestsThatFailTogetherArePausedForOnce) {
  StreamOptions options = withoutIdling();
  options.max_request_blocks = 3;
  Stream stream(file().size(), options);
  Host host(stream, file());
  const TraverseRequest request = requestFor(cameraFrom({0.4, 0.1, -1.0}));
  Traversal found;
  double now = 0.0;
  while (host.underWay() < 4 && now < 10.0) {
    stream.traverse(request, std::nullopt, found);
    host.acceptRequests(now);
    now += 0.01;
    if (host.underWay() > 0 && host.underWay() < 4) host.answerOne(now);
  }
  const std::size_t together = host.underWay();
  ASSERT_GE(together, 4U);
  host.spoil = [](const ByteRange&, const base::Bytes&) { return std::nullopt; };
  while (host.underWay() > 0) host.answerOne(now);
  EXPECT_EQ(stream.stats().failures, together);
  stream.traverse(request, std::nullopt, found);
  EXPECT_TRUE(stream.nextRequests(now + 0.2).empty());
  EXPECT_FALSE(stream.nextRequests(now + 0.3).empty());
}

TEST(StreamTest, filesThatCannotBeAreNamed) {
  const auto problemOf = [](std::uint64_t said, const base::Bytes& bytes) {
    Stream stream(said, withoutIdling());
    Host host(stream, bytes);
    for (double now = 0.0; now < 20.0 && stream.problem().empty(); now += 0.05) {
      host.acceptRequests(now);
      if (host.underWay() > 0) host.answerOne(now);
    }
    EXPECT_TRUE(stream.nextRequests(100.0).empty());
    Traversal found;
    stream.traverse(requestFor(cameraFrom({0.0, 0.0, -1.0})), std::nullopt, found);
    EXPECT_TRUE(found.splats.empty());
    return stream.problem();
  };
  EXPECT_NE(problemOf(1023, file()).find("no number of blocks"), std::string::npos);
  EXPECT_NE(problemOf(0, file()).find("no number of blocks"), std::string::npos);
  EXPECT_NE(problemOf(std::uint64_t{1} << 50, file()).find("too many"), std::string::npos);
  EXPECT_NE(problemOf(file().size() - kBlockBytes, file()).find("its header says"), std::string::npos);
  EXPECT_NE(problemOf(file().size(), base::Bytes(file().size(), 7)).find("not a qsplat.lgq"), std::string::npos);
  base::Bytes newer = file();
  newer[8] = 9;
  EXPECT_NE(problemOf(file().size(), newer).find("version 9"), std::string::npos);
}

TEST(StreamTest, aFileThatContradictsItselfIsNamedWhateverItsChecksumsSay) {
  // Make the root's group point to itself.
  base::Bytes loop = file();
  const std::uint32_t half = kBlockBytes / 2;
  std::memcpy(&loop[kBlockBytes + header().nodeBytes()], &half, sizeof(half));
  sealBlock(&loop[kBlockBytes], 1);
  Stream stream(loop.size(), withoutIdling());
  Host host(stream, loop);
  double now = 0.0;
  fetchAll(stream, host, requestFor(cameraFrom({0.0, 0.0, -1.0})), now);
  EXPECT_NE(stream.problem().find("don't make a tree"), std::string::npos);
  EXPECT_FALSE(stream.complete());
}

TEST(StreamTest, wastedBytesAreThoseThatNoFrameLookedInto) {
  Stream stream(file().size(), withoutIdling());
  Host host(stream, file());
  double now = 0.0;
  const TraverseRequest from_afar = requestFor(cameraFrom({0.0, 0.0, -1.0}, 30.0), 4.0F);
  fetchAll(stream, host, from_afar, now);
  const std::uint64_t of_front = stream.bytesWasted();
  EXPECT_LE(of_front, 8U * kBlockBytes);  // the first request is made blindly

  // The view is left before its blocks arrive.
  Traversal found;
  stream.traverse(requestFor(cameraFrom({0.0, 0.0, 1.0}), 0.3F), std::nullopt, found);
  host.acceptRequests(now);
  ASSERT_GT(host.underWay(), 0U);
  stream.traverse(from_afar, std::nullopt, found);
  std::uint64_t late = 0;
  for (; host.underWay() > 0; host.answerOne(now)) late += 1;
  EXPECT_GT(late, 0U);
  EXPECT_GE(stream.bytesWasted(), late * kBlockBytes);
}

}  // namespace
}  // namespace lod::qsplat
