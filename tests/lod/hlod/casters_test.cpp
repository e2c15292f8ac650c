// Casters of a stream.
#include <gtest/gtest.h>

#include <algorithm>
#include <random>
#include <set>

#include "lod/hlod/block.h"
#include "tests/lod/hlod/made_stream.h"

namespace lod::hlod {
namespace {

using Casters = std::vector<std::shared_ptr<const CasterPicture>>;

Numbers nodesOf(const Casters& casters) {
  Numbers nodes;
  for (const auto& caster : casters) nodes.push_back(caster->node);
  return nodes;
}

/// A cut with nodes of each level but the root, rising.
Numbers wantedCasters() {
  Numbers cut;
  const std::function<void(std::uint32_t, int)> addBelow = [&](std::uint32_t node, int levels) {
    const Node& row = made().nodes[node];
    if (levels == 0) cut.push_back(node);
    for (std::uint32_t child = row.first_child; levels > 0 && child < row.first_child + row.children; ++child)
      addBelow(child, levels - 1);
  };
  for (int levels = 0; levels < 4; ++levels)
    addBelow(made().nodes[0].first_child + static_cast<std::uint32_t>(levels), levels);
  std::sort(cut.begin(), cut.end());
  EXPECT_EQ(cut.size(), 1U + 4U + 16U + 64U);
  EXPECT_TRUE(made().nodes[cut.back()].isLeaf());
  return cut;
}

/// Streams a view and casters until all are here. `each` sees each frame's.
Casters fetchCasters(Stream& stream, Host& host, const TraverseRequest& request, const Numbers& wanted, double& now,
                     const std::function<void(const Casters&)>& each = {}) {
  std::vector<DrawnNode> drawn;
  Casters casters;
  for (int turn = 0; turn < 20'000; ++turn) {
    stream.update(request, drawn);
    stream.updateCasters(wanted, casters);
    if (each) each(casters);
    if (stream.complete() || !stream.problem().empty()) break;
    host.acceptRequests(now);
    now += 0.01;
    if (host.underWay() > 0) host.answerOne(now, static_cast<std::size_t>(turn));
  }
  return casters;
}

base::ByteView blockAt(const BlockPlace& place) {
  return base::ByteView(made().file).subspan(place.offset, place.bytes);
}

TEST(HlodCastersTest, aCasterHasTheShapeOfItsNode) {
  Numbers all(made().nodes.size());
  for (std::uint32_t node = 0; node < all.size(); ++node) all[node] = node;
  Stream stream(local(), {});
  std::vector<DrawnNode> drawn;
  Casters casters;
  stream.updateCasters(all, casters);
  EXPECT_TRUE(casters.empty()) << "there is no view yet";
  // Leaves' pictures may be decoded already or not.
  for (const double distance : {200.0, 0.5}) {
    stream.update(viewFrom(distance, 2000), drawn);
    stream.updateCasters(all, casters);
    ASSERT_EQ(nodesOf(casters), all);
    EXPECT_TRUE(stream.complete());
    for (const auto& caster : casters) {
      const Node& node = made().nodes[caster->node];
      EXPECT_EQ(caster->error, node.caster_error);
      const auto decoded = node.isLeaf() ? decodeBlock(blockAt(node.picture), node, {true, false})
                                         : decodeBlock(blockAt(node.caster), node, {true, true});
      ASSERT_TRUE(decoded);
      ASSERT_EQ(caster->triangles, decoded->triangles);
      ASSERT_EQ(caster->positions.size(), decoded->vertices.size());
      for (std::size_t i = 0; i < caster->positions.size(); ++i)
        ASSERT_EQ(caster->positions[i],
                  made().header.lattice.position(decoded->vertices[i].place * (1 << node.step_bits)));
    }
  }
}

TEST(HlodCastersTest, aboveThoseThatAreMissingTheNearestThatIsHereStandsInOnce) {
  const Numbers wanted = wantedCasters();
  const TraverseRequest request = viewFrom(3.0, 300);
  StreamOptions options;
  options.max_requests = 1;
  options.max_request_bytes = 4000;
  Stream stream(made().file.size(), options);
  Host host(stream, made().file);
  double now = 0.0;
  std::set<std::uint32_t> here;
  std::set<std::uint64_t> lacking;
  int standing_in = 0;
  const Casters last = fetchCasters(stream, host, request, wanted, now, [&](const Casters& casters) {
    const Numbers nodes = nodesOf(casters);
    ASSERT_TRUE(std::adjacent_find(nodes.begin(), nodes.end(), std::greater_equal<>()) == nodes.end());
    if (stream.header() == nullptr || nodes.empty()) return;
    for (const std::uint32_t node : nodes) here.insert(node);
    const std::set<std::uint32_t> shown(nodes.begin(), nodes.end());
    std::set<std::uint32_t> expected;
    std::uint64_t missing = 0;
    for (std::uint32_t node : wanted) {
      missing += here.contains(node) ? 0 : 1;
      while (!here.contains(node) && node != 0) node = parentOf(node);
      if (here.contains(node)) expected.insert(node);
    }
    EXPECT_EQ(shown, expected);
    standing_in += missing > 0 ? 1 : 0;
    EXPECT_EQ(stream.complete(), stream.stats().lacking == 0);
    EXPECT_GE(stream.stats().lacking, missing);
    lacking.insert(missing);
  });
  EXPECT_EQ(nodesOf(last), wanted);
  EXPECT_GT(standing_in, 10);
  EXPECT_GT(lacking.size(), 10U);
  EXPECT_TRUE(stream.complete());

  // A local file has the same.
  Stream whole(local(), {});
  std::vector<DrawnNode> drawn;
  Casters locally;
  whole.update(request, drawn);
  whole.updateCasters(wanted, locally);
  ASSERT_EQ(nodesOf(locally), wanted);
  for (std::size_t i = 0; i < wanted.size(); ++i) {
    EXPECT_EQ(locally[i]->positions, last[i]->positions);
    EXPECT_EQ(locally[i]->triangles, last[i]->triangles);
  }
}

TEST(HlodCastersTest, castersComeBehindPicturesAndTheRootsFirst) {
  const Numbers wanted = wantedCasters();
  const TraverseRequest request = viewFrom(0.8, 600);
  StreamOptions options;
  options.max_requests = 1;
  options.max_request_bytes = 1;  // single blocks
  Stream stream(made().file.size(), options);
  Host host(stream, made().file);
  double now = 0.0;
  fetchCasters(stream, host, request, wanted, now);
  const std::uint64_t casters = made().nodes[0].caster.offset;
  const auto first = std::find_if(host.asked.begin(), host.asked.end(),
                                  [&](const ByteRange& range) { return range.offset >= casters; });
  ASSERT_NE(first, host.asked.end());
  EXPECT_EQ(first->offset, casters);
  // The view has all of its pictures by then.
  std::set<std::uint64_t> before;
  for (auto range = host.asked.begin(); range != first; ++range) before.insert(range->offset);
  for (const std::uint32_t node : cutOf(request)) EXPECT_TRUE(before.contains(made().nodes[node].picture.offset));
  EXPECT_GT(host.asked.end() - first, 20);
}

TEST(HlodCastersTest, callsBehindOneUpdateAddUp) {
  const Numbers wanted = wantedCasters();
  const Numbers some(wanted.begin(), wanted.begin() + static_cast<std::ptrdiff_t>(wanted.size() / 2));
  const Numbers others(wanted.begin() + static_cast<std::ptrdiff_t>(wanted.size() / 2), wanted.end());
  Stream stream(made().file.size(), {});
  Host host(stream, made().file);
  double now = 0.0;
  std::vector<DrawnNode> drawn;
  Casters a, b;
  for (int turn = 0; turn < 1000; ++turn) {
    stream.update(viewFrom(3.0, 300), drawn);
    stream.updateCasters(some, a);
    stream.updateCasters(others, b);
    if (stream.complete()) break;
    host.acceptRequests(now += 0.01);
    if (host.underWay() > 0) host.answerOne(now);
  }
  EXPECT_TRUE(stream.complete());
  EXPECT_EQ(nodesOf(a), some);
  EXPECT_EQ(nodesOf(b), others);
}

TEST(HlodCastersTest, nothingIsFetchedForViewsWithoutShadows) {
  Stream stream(made().file.size(), {});
  Host host(stream, made().file);
  double now = 0.0;
  fetchAll(stream, host, viewFrom(1.0, 1000), now);
  ASSERT_TRUE(stream.complete());
  for (const ByteRange& range : host.asked) EXPECT_LT(range.offset, made().nodes[0].caster.offset);
  // Casters make the same view incomplete, until it is drawn without.
  std::vector<DrawnNode> drawn;
  Casters casters;
  stream.updateCasters(wantedCasters(), casters);
  EXPECT_FALSE(stream.complete());
  EXPECT_GT(stream.stats().lacking, 0U);
  stream.update(viewFrom(1.0, 1000), drawn);
  EXPECT_TRUE(stream.complete());
  EXPECT_EQ(stream.stats().lacking, 0U);
}

TEST(HlodCastersTest, memoryIsNeverExceededAndCastersHaveTheirShare) {
  TraverseRequest request = viewFrom(1.2, 4000);
  request.cull = false;
  StreamOptions options;
  options.memory_bytes = kMinStreamMemory;
  Stream stream(made().file.size(), options);
  Host host(stream, made().file);
  Stream whole(local(), options);
  const std::uint64_t table = made().nodes.size() * 500;
  double now = 0.0;
  const Numbers wanted = wantedCasters();
  const Casters casters = fetchCasters(stream, host, request, wanted, now, [&](const Casters&) {
    EXPECT_LE(stream.stats().memory_bytes, kMinStreamMemory + table);
  });
  EXPECT_TRUE(stream.complete());
  EXPECT_TRUE(stream.limitedByMemory());
  // Some are here, and all others have one above them in their place.
  ASSERT_GT(casters.size(), 3U);
  const Numbers nodes = nodesOf(casters);
  for (const std::uint32_t node : wanted)
    EXPECT_TRUE(std::any_of(nodes.begin(), nodes.end(), [&](std::uint32_t one) { return isAbove(one, node); }));
  EXPECT_NE(nodes, wanted);
  std::vector<DrawnNode> drawn;
  Casters again;
  const std::size_t asked = host.asked.size();
  for (int i = 0; i < 3; ++i) {
    stream.update(request, drawn);
    stream.updateCasters(wanted, again);
    EXPECT_EQ(nodesOf(again), nodes);
    host.acceptRequests(now += 1.0);
    EXPECT_EQ(host.asked.size(), asked) << "asks for what there is no memory for";
    whole.update(request, drawn);
    whole.updateCasters(wanted, again);
    EXPECT_LE(whole.stats().memory_bytes, kMinStreamMemory + table);
  }
  EXPECT_TRUE(whole.complete());
  EXPECT_GT(again.size(), 3U);
}

TEST(HlodCastersTest, oneAboveADamagedCasterStandsInForGood) {
  const Numbers wanted = wantedCasters();
  const TraverseRequest request = viewFrom(3.0, 300);
  for (const bool is_leaf : {false, true}) {
    const std::uint32_t victim = is_leaf ? wanted.back() : wanted.front();
    base::Bytes bytes = made().file;
    const Node& node = made().nodes[victim];
    bytes[(is_leaf ? node.picture : node.caster).offset + 9] ^= 4;
    Numbers expected = wanted;
    std::erase(expected, victim);
    expected.push_back(parentOf(victim));
    std::sort(expected.begin(), expected.end());
    const std::string name = (is_leaf ? "node " : "caster of node ") + std::to_string(victim);

    Stream stream(bytes.size(), {});
    Host host(stream, bytes);
    double now = 0.0;
    EXPECT_EQ(nodesOf(fetchCasters(stream, host, request, wanted, now)), expected);
    EXPECT_TRUE(stream.complete());
    EXPECT_EQ(stream.stats().damaged, 1U);
    EXPECT_EQ(stream.stats().lacking, 0U);
    EXPECT_EQ(stream.warning(), name + " is damaged: checksums do not match; publish the scene again");

    Stream whole(local(bytes), {});
    std::vector<DrawnNode> drawn;
    Casters casters;
    whole.update(request, drawn);
    whole.updateCasters(wanted, casters);
    EXPECT_EQ(nodesOf(casters), expected);
    EXPECT_TRUE(whole.complete());
    EXPECT_EQ(whole.warning(), name + " is damaged: checksums do not match; copy the file again");
  }
}

TEST(HlodCastersTest, lossAndDamageOnTheLinkAreRepaired) {
  std::mt19937 random(5);
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
  const Numbers wanted = wantedCasters();
  std::vector<DrawnNode> drawn;
  Casters casters;
  for (int turn = 0; turn < 3000 && !stream.complete(); ++turn) {
    host.acceptRequests(now += 0.2);
    if (host.underWay() > 0) host.answerOne(now, random());
    stream.update(viewFrom(3.0, 300), drawn);
    stream.updateCasters(wanted, casters);
  }
  EXPECT_TRUE(stream.complete()) << stream.problem();
  EXPECT_EQ(nodesOf(casters), wanted);
  EXPECT_GT(stream.stats().failures, 3U);
  EXPECT_EQ(stream.stats().damaged, 0U);
}

TEST(HlodCastersTest, decodingIsSpreadOverFrames) {
  StreamOptions options;
  options.decode_per_frame = 1;
  Stream stream(local(), options);
  const Numbers wanted = wantedCasters();
  std::vector<DrawnNode> drawn;
  Casters casters;
  std::size_t frames = 0;
  do {
    stream.update(viewFrom(3.0, 300), drawn);
    stream.updateCasters(wanted, casters);
    ++frames;
  } while (stream.decoding() && frames < 10'000);
  EXPECT_TRUE(stream.complete());
  EXPECT_EQ(nodesOf(casters), wanted);
  EXPECT_GE(frames, wanted.size());
}

}  // namespace
}  // namespace lod::hlod
