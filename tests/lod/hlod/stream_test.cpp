#include "lod/hlod/stream.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <random>
#include <set>

#include "lod/hlod/block.h"
#include "tests/lod/hlod/made_stream.h"
#include "tests/support/random_views.h"

namespace lod::hlod {
namespace {

Numbers nodesOf(const std::vector<DrawnNode>& drawn) {
  Numbers nodes;
  for (const DrawnNode& one : drawn) nodes.push_back(one.picture->node);
  return nodes;
}

/// No drawn node lies below another one.
void expectNoPlaceTwice(const std::vector<DrawnNode>& drawn) {
  for (const DrawnNode& a : drawn)
    for (const DrawnNode& b : drawn) EXPECT_TRUE(&a == &b || !isAbove(a.picture->node, b.picture->node));
}

TEST(HlodStreamTest, aPictureHasTheGeometryOfItsNode) {
  TraverseRequest request = viewFrom(2.0);
  request.cull = false;
  request.tolerance = 3.0F;
  Stream stream(local(), {});
  std::vector<DrawnNode> drawn;
  stream.update(request, drawn);
  ASSERT_GT(drawn.size(), 1U);
  bool points = false;
  for (const DrawnNode& one : drawn) {
    const NodePicture& picture = *one.picture;
    const Node& node = made().nodes[picture.node];
    EXPECT_EQ(picture.points, node.points);
    EXPECT_EQ(picture.triangles.size(), std::size_t{3} * node.triangles);
    EXPECT_EQ(picture.edges.size(), std::size_t{2} * node.edges);
    EXPECT_EQ(picture.error, node.error);
    EXPECT_EQ(one.error_px, projectedError(request.camera, node.box, node.error));
    points |= picture.points > 0;
    const auto decoded =
        decodeBlock(base::ByteView(made().file).subspan(node.picture.offset, node.picture.bytes), node, {true, false});
    ASSERT_TRUE(decoded);
    ASSERT_EQ(picture.vertices.size(), decoded->points.size() + decoded->vertices.size());
    for (std::size_t i = 0; i < picture.vertices.size(); ++i) {
      const NodeVertex& vertex = i < node.points ? decoded->points[i] : decoded->vertices[i - node.points];
      ASSERT_EQ(picture.vertices[i].position, made().header.lattice.position(vertex.place * (1 << node.step_bits)));
      ASSERT_EQ(picture.vertices[i].color, glm::u8vec4(vertex.color, 255));
      for (int k = 0; k < 3; ++k)
        ASSERT_NEAR(picture.vertices[i].normal[static_cast<std::size_t>(k)], 127.0F * vertex.normal[k], 0.501F);
    }
    for (std::size_t i = 0; i < picture.triangles.size(); ++i)
      ASSERT_EQ(picture.triangles[i], decoded->triangles[i] + node.points);
    for (std::size_t i = 0; i < picture.edges.size(); ++i) ASSERT_EQ(picture.edges[i], decoded->edges[i] + node.points);
  }
  EXPECT_TRUE(points);
}

TEST(HlodStreamTest, aRefinedViewIsTheCutOfTheWholeFile) {
  support::RandomViews views(5, made().header.bounds, 500);
  Stream stream(made().file.size(), {});
  Stream whole(local(), {});
  Host host(stream, made().file);
  double now = 0.0;
  for (int i = 0; i < 40; ++i) {
    TraverseRequest request;
    request.camera = views.next();
    request.tolerance = static_cast<float>(views.number(0.3, 5.0));
    request.cull_back_faces = i % 3 == 0;
    if (i % 4 == 0)
      request.camera.section = glm::vec4(glm::vec3(views.direction()), static_cast<float>(views.number(-0.5, 0.5)));
    const std::vector<DrawnNode> drawn = fetchAll(stream, host, request, now);
    ASSERT_TRUE(stream.complete()) << stream.problem();
    EXPECT_EQ(nodesOf(drawn), cutOf(request)) << "view " << i;
    std::vector<DrawnNode> locally;
    whole.update(request, locally);
    EXPECT_TRUE(whole.complete());
    EXPECT_EQ(nodesOf(locally), cutOf(request)) << "view " << i;
    for (const DrawnNode& one : drawn) EXPECT_FALSE(one.awaits_finer);
    EXPECT_EQ(stream.stats().lacking, 0U);
    EXPECT_EQ(stream.stats().drawn, drawn.size());
    EXPECT_FALSE(stream.limitedByMemory());
  }
  EXPECT_EQ(stream.warning(), "");
}

TEST(HlodStreamTest, aNodeIsDrawnUntilAllItsSeenChildrenAreHere) {
  const TraverseRequest request = viewFrom(1.2, 1500);
  StreamOptions options;
  options.max_requests = 1;
  options.max_request_bytes = 4000;
  Stream stream(made().file.size(), options);
  Host host(stream, made().file);
  double now = 0.0;
  const Numbers cut = cutOf(request);
  std::set<std::size_t> sizes;
  bool waits = false;
  const std::vector<DrawnNode> last = fetchAll(stream, host, request, now, [&](const std::vector<DrawnNode>& drawn) {
    if (drawn.empty()) return;
    sizes.insert(drawn.size());
    for (const DrawnNode& one : drawn) waits |= one.awaits_finer;
    // Each node of the cut is covered once, by itself or by a node above it that says that it waits.
    for (const std::uint32_t node : cut) {
      const auto covers = [&](const DrawnNode& one) { return isAbove(one.picture->node, node); };
      ASSERT_EQ(std::count_if(drawn.begin(), drawn.end(), covers), 1);
      const auto cover = std::find_if(drawn.begin(), drawn.end(), covers);
      EXPECT_EQ(cover->awaits_finer, cover->picture->node != node);
    }
  });
  EXPECT_TRUE(stream.complete());
  EXPECT_EQ(nodesOf(last), cut);
  EXPECT_TRUE(waits);
  EXPECT_GT(sizes.size(), 10U);
}

TEST(HlodStreamTest, whatLooksWorstComesFirst) {
  const TraverseRequest request = viewFrom(1.2, 1500);
  StreamOptions options;
  options.max_requests = 1;
  options.max_request_bytes = 1;  // single blocks
  Stream stream(made().file.size(), options);
  Host host(stream, made().file);
  double now = 0.0;
  fetchAll(stream, host, request, now);
  std::vector<float> errors;
  for (const ByteRange& range : host.asked) {
    const auto node = std::find_if(made().nodes.begin(), made().nodes.end(), [&](const Node& one) {
      return one.picture.offset == range.offset && one.picture.bytes == range.length;
    });
    if (node == made().nodes.end()) continue;  // the front
    const Node& parent = made().nodes[parentOf(static_cast<std::uint32_t>(node - made().nodes.begin()))];
    errors.push_back(projectedError(request.camera, parent.box, parent.error));
  }
  ASSERT_GT(errors.size(), 50U);
  EXPECT_TRUE(std::is_sorted(errors.rbegin(), errors.rend()));
  EXPECT_GT(errors.front(), 2.0F * errors.back());
}

// Bytes under way delay what a new view needs: over a slow link they must be few, however many are wanted.
TEST(HlodStreamTest, aSlowLinkHasLittleUnderWay) {
  constexpr double kBytesPerSecond = 20'000.0;
  TraverseRequest request = viewFrom(1.0, 3000);
  request.cull = false;
  Stream stream(made().file.size(), {});
  std::deque<ByteRange> asked;
  std::vector<DrawnNode> drawn;
  std::uint64_t under_way = 0, most = 0, longest = 0;
  double now = 0.0;
  for (int answers = 0; answers < 60; ++answers) {
    stream.update(request, drawn);
    for (const ByteRange& range : stream.nextRequests(now)) {
      asked.push_back(range);
      under_way += range.length;
      if (stream.header() != nullptr) longest = std::max(longest, range.length);
    }
    if (asked.empty()) break;
    if (answers > 5) most = std::max(most, under_way);
    const ByteRange range = asked.front();
    asked.pop_front();
    under_way -= range.length;
    now += static_cast<double>(range.length) / kBytesPerSecond;
    stream.acceptAnswer(range.id, base::ByteView(made().file).subspan(range.offset, range.length), now);
  }
  EXPECT_GT(most, 0U);
  EXPECT_LT(most, static_cast<std::uint64_t>(kBytesPerSecond) + longest);
  EXPECT_LT(longest, 30'000U);
}

TEST(HlodStreamTest, neighboursAreJoinedAndNothingComesTwice) {
  TraverseRequest request = viewFrom(1.0, 3000);
  request.cull = false;
  Stream stream(made().file.size(), {});
  Host host(stream, made().file);
  double now = 0.0;
  fetchAll(stream, host, request, now);
  ASSERT_TRUE(stream.complete());
  std::uint64_t bytes = 0;
  for (const ByteRange& range : host.asked) {
    bytes += range.length;
    EXPECT_LE(range.length, StreamOptions{}.max_request_bytes);
  }
  // All pictures are asked for, in far fewer requests than there are nodes, and no casters.
  EXPECT_LT(host.asked.size(), made().nodes.size() / 8);
  EXPECT_LE(bytes, made().nodes[0].caster.offset + 65'536);
}

TEST(HlodStreamTest, aSmallFileComesInOneRequest) {
  const support::MadeHlod small = support::madeHlod(1, 8);
  ASSERT_LT(small.file.size(), 131'072U);
  Stream stream(small.file.size(), {});
  Host host(stream, small.file);
  double now = 0.0;
  TraverseRequest request = viewFrom(1.0, 3000);
  request.cull = false;
  EXPECT_EQ(fetchAll(stream, host, request, now).size(), 4U);
  EXPECT_TRUE(stream.complete());
  EXPECT_EQ(host.asked.size(), 1U);
  EXPECT_EQ(stream.stats().bytes_received, small.file.size());
}

TEST(HlodStreamTest, zoomingOutShowsSomethingAtOnce) {
  Stream stream(made().file.size(), {});
  Host host(stream, made().file);
  double now = 0.0;
  fetchAll(stream, host, viewFrom(0.5), now);
  const std::size_t asked = host.asked.size();
  for (const double distance : {1.0, 2.0, 4.0, 8.0}) {
    std::vector<DrawnNode> drawn;
    const TraverseRequest request = viewFrom(distance);
    stream.update(request, drawn);
    ASSERT_FALSE(drawn.empty());
    for (const std::uint32_t node : cutOf(request))
      EXPECT_TRUE(std::any_of(drawn.begin(), drawn.end(), [&](const DrawnNode& one) {
        return isAbove(one.picture->node, node) || isAbove(node, one.picture->node);
      }));
    expectNoPlaceTwice(drawn);
  }
  EXPECT_EQ(host.asked.size(), asked);
}

TEST(HlodStreamTest, lossAndDamageOnTheLinkAreRepaired) {
  std::mt19937 random(3);
  const TraverseRequest request = viewFrom(1.2);
  StreamOptions options;
  options.max_request_bytes = 20'000;
  Stream stream(made().file.size(), options);
  Host host(stream, made().file);
  std::set<std::uint64_t> damaged;
  host.spoil = [&](const ByteRange& range, base::Bytes bytes) -> std::optional<base::Bytes> {
    const auto kind = random() % 6;
    if (kind == 0) return std::nullopt;
    if (kind == 1) return base::Bytes(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(bytes.size() / 2));
    if (kind == 2 && damaged.insert(range.offset).second) bytes[random() % bytes.size()] ^= 0x40;
    return bytes;
  };
  double now = 0.0;
  std::vector<DrawnNode> drawn;
  for (int turn = 0; turn < 3000 && !stream.complete(); ++turn) {
    now += 0.2;
    host.acceptRequests(now);
    if (host.underWay() > 0) host.answerOne(now, random());
    stream.update(request, drawn);
  }
  EXPECT_TRUE(stream.complete()) << stream.problem();
  EXPECT_EQ(nodesOf(drawn), cutOf(request));
  EXPECT_GT(stream.stats().failures, 3U);
  EXPECT_EQ(stream.stats().damaged, 0U);
}

TEST(HlodStreamTest, theParentOfANodeThatStaysDamagedIsDrawnForGood) {
  TraverseRequest request = viewFrom(1.2);
  request.cull = false;
  const Numbers cut = cutOf(request);
  const std::uint32_t victim = cut[cut.size() / 2];
  ASSERT_NE(victim, 0U);
  base::Bytes bytes = made().file;
  bytes[made().nodes[victim].picture.offset + 20] ^= 1;
  Numbers expected;
  for (const std::uint32_t node : cut)
    if (!isAbove(parentOf(victim), node)) expected.push_back(node);
  expected.push_back(parentOf(victim));
  std::sort(expected.begin(), expected.end());
  const auto sorted = [](Numbers nodes) {
    std::sort(nodes.begin(), nodes.end());
    return nodes;
  };

  Stream stream(bytes.size(), {});
  Host host(stream, bytes);
  double now = 0.0;
  const std::vector<DrawnNode> drawn = fetchAll(stream, host, request, now);
  EXPECT_EQ(sorted(nodesOf(drawn)), expected);
  for (const DrawnNode& one : drawn) EXPECT_FALSE(one.awaits_finer);
  EXPECT_TRUE(stream.complete());
  EXPECT_EQ(stream.stats().damaged, 1U);
  EXPECT_EQ(stream.stats().failures, 3U);
  EXPECT_EQ(stream.warning(),
            "node " + std::to_string(victim) + " is damaged: checksums do not match; publish the scene again");

  Stream whole(local(bytes), {});
  std::vector<DrawnNode> locally;
  whole.update(request, locally);
  EXPECT_EQ(sorted(nodesOf(locally)), expected);
  EXPECT_TRUE(whole.complete());
  EXPECT_EQ(whole.stats().damaged, 1U);
  EXPECT_NE(whole.warning().find("copy the file"), std::string::npos);

  // Without the root's picture its children are drawn.
  bytes = made().file;
  bytes[made().nodes[0].picture.offset] ^= 1;
  Stream rootless(bytes.size(), {});
  Host other(rootless, bytes);
  const TraverseRequest far = viewFrom(200.0);
  ASSERT_EQ(cutOf(far), Numbers{0});
  EXPECT_EQ(fetchAll(rootless, other, far, now).size(), 4U);
  EXPECT_TRUE(rootless.complete());
}

TEST(HlodStreamTest, pausesGrowWhileRequestsFail) {
  Stream stream(made().file.size(), {});
  double now = 10.0;
  std::vector<double> tries;
  for (; now < 30.0; now += 0.01)
    for (const ByteRange& range : stream.nextRequests(now)) {
      tries.push_back(now);
      stream.acceptFailure(range.id, now);
    }
  ASSERT_GE(tries.size(), 6U);
  for (std::size_t i = 2; i < tries.size(); ++i)
    EXPECT_GE(tries[i] - tries[i - 1], std::min(1.9 * (tries[i - 1] - tries[i - 2]), 4.9));
}

TEST(HlodStreamTest, aFrontThatIsWrongIsAProblem) {
  const auto problemOf = [](base::Bytes bytes, std::uint64_t length) {
    Stream stream(length, {});
    Host host(stream, bytes);
    double now = 0.0;
    fetchAll(stream, host, viewFrom(3.0), now);
    EXPECT_EQ(stream.header(), nullptr);
    EXPECT_FALSE(stream.complete());
    EXPECT_TRUE(stream.nextRequests(now + 100.0).empty());
    Stream whole(local(bytes), {});
    EXPECT_FALSE(whole.problem().empty());
    return stream.problem();
  };
  const std::uint64_t length = made().file.size();
  base::Bytes bytes = made().file;
  bytes[40] ^= 1;
  EXPECT_NE(problemOf(bytes, length).find("checksum"), std::string::npos);
  bytes = made().file;
  bytes[kHeaderBytes + 5] ^= 1;
  EXPECT_NE(problemOf(bytes, length).find("table"), std::string::npos);
  bytes = made().file;
  bytes.push_back(0);
  EXPECT_NE(problemOf(bytes, length + 1).find("header says"), std::string::npos);
  EXPECT_FALSE(Stream(5, {}).problem().empty());

  Stream stopped(length, {});
  stopped.giveUp("enough");
  EXPECT_EQ(stopped.problem(), "enough");
  EXPECT_TRUE(stopped.nextRequests(1.0).empty());
}

TEST(HlodStreamTest, littleMemoryKeepsNodesCoarseAndIsNeverExceeded) {
  TraverseRequest request = viewFrom(1.2, 4000);
  request.cull = false;
  StreamOptions options;
  options.memory_bytes = kMinStreamMemory;
  Stream stream(made().file.size(), options);
  Host host(stream, made().file);
  double now = 0.0;
  const std::uint64_t table = made().nodes.size() * 500;
  const auto within = [&](const auto&) { EXPECT_LE(stream.stats().memory_bytes, kMinStreamMemory + table); };
  const std::vector<DrawnNode> drawn = fetchAll(stream, host, request, now, within);
  EXPECT_TRUE(stream.complete());
  EXPECT_TRUE(stream.limitedByMemory());
  EXPECT_GT(drawn.size(), 10U);
  EXPECT_LT(drawn.size(), cutOf(request).size());
  expectNoPlaceTwice(drawn);
  const std::size_t asked = host.asked.size();
  std::vector<DrawnNode> again;
  stream.update(request, again);
  EXPECT_EQ(nodesOf(again), nodesOf(drawn));
  host.acceptRequests(now + 1.0);
  EXPECT_EQ(host.asked.size(), asked) << "asks for what there is no memory for";

  // Views that wander about stay within memory, too, and each becomes complete.
  support::RandomViews views(8, made().header.bounds, 2000);
  Stream whole(local(), options);
  for (int i = 0; i < 40; ++i) {
    request.camera = views.next();
    request.cull = true;
    fetchAll(stream, host, request, now, within);
    ASSERT_TRUE(stream.complete()) << "view " << i;
    whole.update(request, again);
    EXPECT_TRUE(whole.complete());
    EXPECT_LE(whole.stats().memory_bytes, kMinStreamMemory + table);
  }
}

TEST(HlodStreamTest, nodesNotUsedForLongestAreDroppedFirst) {
  StreamOptions options;
  options.memory_bytes = kMinStreamMemory;
  Stream stream(local(), options);
  std::vector<DrawnNode> drawn;
  const auto lookAt = [&](double x, double y) {
    base::ViewCamera view;
    view.position = glm::dvec3(x, y, 0.4);
    view.width = view.height = 400;
    TraverseRequest request;
    request.camera = base::cameraForScene(view, glm::dvec3(0.0), made().header.bounds);
    stream.update(request, drawn);
    EXPECT_TRUE(stream.complete());
    EXPECT_FALSE(stream.limitedByMemory());
    return drawn;
  };
  const std::vector<DrawnNode> first = lookAt(-0.8, -0.8);
  std::vector<std::weak_ptr<const NodePicture>> pictures;
  for (const DrawnNode& one : first) pictures.push_back(one.picture);
  const auto kept = [&] {
    return std::count_if(pictures.begin(), pictures.end(), [](const auto& one) { return one.use_count() > 1; });
  };
  const auto all = static_cast<std::ptrdiff_t>(pictures.size());
  EXPECT_EQ(kept(), all);
  for (double x = -0.75; x < 0.9; x += 0.05) {
    lookAt(x, 0.8);
    lookAt(-0.8, -0.8);
    EXPECT_EQ(kept(), all) << "what was used a frame ago is dropped";
  }
  for (double x = -0.75; x < 0.9; x += 0.05)
    for (double y = -0.3; y < 0.9; y += 0.1) lookAt(x, y);
  EXPECT_LT(kept(), all) << "nothing is dropped";
}

TEST(HlodStreamTest, decodingIsSpreadOverFrames) {
  const TraverseRequest request = viewFrom(1.2, 1000);
  StreamOptions options;
  options.decode_per_frame = 1;
  Stream stream(local(), options);
  std::vector<DrawnNode> drawn;
  std::size_t frames = 0;
  do {
    stream.update(request, drawn);
    ++frames;
    ASSERT_FALSE(drawn.empty());
    expectNoPlaceTwice(drawn);
  } while (stream.decoding() && frames < 10'000);
  EXPECT_TRUE(stream.complete());
  EXPECT_EQ(nodesOf(drawn), cutOf(request));
  EXPECT_GE(frames, drawn.size());
}

TEST(HlodStreamTest, nodesAreDrawnFrontToBack) {
  const TraverseRequest request = viewFrom(2.5);
  Stream stream(local(), {});
  std::vector<DrawnNode> drawn;
  stream.update(request, drawn);
  float before = -1e9F;
  for (const DrawnNode& one : drawn) {
    const glm::vec3 center = made().nodes[one.picture->node].box.center();
    const float depth = -(request.camera.eye_from_scene * glm::vec4(center, 1.0F)).z;
    EXPECT_GE(depth, before);
    before = depth;
  }
}

}  // namespace
}  // namespace lod::hlod
