#include "lod/pmr/stream.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <deque>
#include <map>
#include <random>
#include <set>

#include "lod/pmr/leaf_picture.h"
#include "tests/lod/pmr/stream_host.h"
#include "tests/support/made_pmr.h"
#include "tests/support/random_views.h"

namespace lod::pmr {
namespace {

const support::MadePmr& made() {
  static const support::MadePmr file = support::madePmr(192, true, 1500);
  return file;
}

std::shared_ptr<const FileBytes> local(base::ByteView bytes = made().file) {
  return std::make_shared<MemoryBytes>(bytes);
}

TraverseRequest viewFrom(double distance, int size = 600) {
  base::ViewCamera view;
  view.position = glm::dvec3(0.2, 0.3, distance);
  view.width = view.height = size;
  TraverseRequest request;
  request.camera = base::cameraForScene(view, glm::dvec3(0.0), made().header.bounds);
  return request;
}

/// The levels that a view asks for, by leaf.
std::map<std::uint32_t, std::uint32_t> levelsAskedFor(const TraverseRequest& request) {
  std::vector<ChosenLeaf> chosen;
  Octree(made().leaves).choose(made().leaves, request, chosen);
  std::map<std::uint32_t, std::uint32_t> levels;
  for (const ChosenLeaf& one : chosen) levels[one.leaf] = one.level;
  return levels;
}
std::map<std::uint32_t, std::uint32_t> levelsOf(const std::vector<DrawnLeaf>& drawn) {
  std::map<std::uint32_t, std::uint32_t> levels;
  for (const DrawnLeaf& one : drawn) levels[one.picture->leaf] = one.picture->level;
  EXPECT_EQ(levels.size(), drawn.size()) << "a leaf is drawn twice";
  return levels;
}

std::vector<DrawnLeaf> drawLocally(const TraverseRequest& request) {
  Stream stream(local(), {});
  std::vector<DrawnLeaf> drawn;
  stream.update(request, drawn);
  EXPECT_TRUE(stream.complete()) << stream.problem();
  return drawn;
}

TEST(PmrStreamTest, aPictureHasThePointsAndTrianglesOfItsLeaf) {
  TraverseRequest request = viewFrom(3.0, 2000);
  request.cull = false;
  const std::vector<DrawnLeaf> drawn = drawLocally(request);
  ASSERT_EQ(drawn.size(), made().leaves.size());
  for (const DrawnLeaf& one : drawn) {
    const LeafPicture& picture = *one.picture;
    const auto& content = made().contents[picture.leaf];
    const Leaf& leaf = made().leaves[picture.leaf];
    EXPECT_EQ(picture.vertices.size(), leaf.verticesAt(picture.level));
    EXPECT_EQ(picture.list.points.size(), leaf.pointsAt(picture.level));
    EXPECT_EQ(picture.list.corners.size(), 3U * leaf.levels[picture.level].triangles);
    for (std::size_t v = 0; v < picture.vertices.size(); ++v) {
      const CodedPoint& point = content.vertices[v];
      ASSERT_EQ(picture.vertices[v].position, made().header.lattice.position(point.place));
      ASSERT_EQ(picture.vertices[v].color, glm::u8vec4(point.color, 255));
      const glm::vec3 normal = decodeNormal(point.normal);
      for (int k = 0; k < 3; ++k)
        ASSERT_NEAR(static_cast<float>(picture.vertices[v].normal[static_cast<std::size_t>(k)]) / 127.0F, normal[k],
                    0.005F);
    }
    for (const std::uint16_t p : picture.list.points) ASSERT_TRUE(content.is_own[p]);
  }
}

TEST(PmrStreamTest, aStreamedFileDrawsWhatTheLocalOneDraws) {
  support::RandomViews views(5, made().header.bounds, 500);
  Stream stream(made().file.size(), {});
  Host host(stream, made().file);
  double now = 0.0;
  for (int i = 0; i < 30; ++i) {
    TraverseRequest request;
    request.camera = views.next();
    request.tolerance = static_cast<float>(views.number(0.5, 5.0));
    const std::vector<DrawnLeaf> drawn = fetchAll(stream, host, request, now);
    ASSERT_TRUE(stream.complete()) << stream.problem();
    EXPECT_EQ(levelsOf(drawn), levelsAskedFor(request)) << "view " << i;
    const std::vector<DrawnLeaf> locally = drawLocally(request);
    ASSERT_EQ(drawn.size(), locally.size());
    for (std::size_t k = 0; k < drawn.size(); ++k) {
      EXPECT_EQ(drawn[k].picture->leaf, locally[k].picture->leaf);
      EXPECT_EQ(drawn[k].pixel, locally[k].pixel);
      EXPECT_EQ(drawn[k].picture->list.corners, locally[k].picture->list.corners);
    }
    EXPECT_EQ(stream.stats().lacking, 0U);
    EXPECT_FALSE(stream.limitedByMemory());
  }
  EXPECT_EQ(stream.warning(), "");
}

// A stream never shows a leaf finer than asked for while the level itself is not here, and shows all leaves coarsely
// before any finely.
TEST(PmrStreamTest, theCoarsestLevelOfAllLeavesComesFirst) {
  const TraverseRequest request = viewFrom(2.2, 1500);
  StreamOptions options;
  options.max_requests = 1;
  Stream stream(made().file.size(), options);
  Host host(stream, made().file);
  double now = 0.0;
  const auto asked = levelsAskedFor(request);
  bool all_seen = false;
  fetchAll(stream, host, request, now, [&](const std::vector<DrawnLeaf>& drawn) {
    for (const auto& [leaf, level] : levelsOf(drawn)) {
      EXPECT_GE(level, asked.at(leaf));
      if (level != kCoarsest) all_seen |= drawn.size() == asked.size();
      if (level != kCoarsest && !all_seen) ADD_FAILURE() << "a leaf is fine while others are not here";
    }
  });
  EXPECT_TRUE(stream.complete());
  const std::uint64_t base_end = kHeaderBytes + made().header.table_bytes + made().header.base_bytes;
  bool fine = false;
  for (const ByteRange& range : host.asked) {
    fine |= range.offset >= base_end;
    EXPECT_TRUE(!fine || range.offset >= base_end);
    EXPECT_LE(range.length, StreamOptions{}.max_request_bytes);
  }
  EXPECT_TRUE(fine);
}

// Bytes under way delay what a new view needs: over a slow link they must be few, however many are wanted.
TEST(PmrStreamTest, aSlowLinkHasLittleUnderWay) {
  constexpr double kBytesPerSecond = 20'000.0;
  TraverseRequest request = viewFrom(2.2, 3000);
  request.cull = false;
  Stream stream(made().file.size(), {});
  std::deque<ByteRange> asked;
  std::vector<DrawnLeaf> drawn;
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
  EXPECT_LT(longest, 30'000U);  // single chunks
}

TEST(PmrStreamTest, neighboursAreJoined) {
  TraverseRequest request = viewFrom(2.2, 3000);
  request.cull = false;
  Stream stream(made().file.size(), {});
  Host host(stream, made().file);
  double now = 0.0;
  fetchAll(stream, host, request, now);
  std::uint64_t bytes = 0;
  for (const ByteRange& range : host.asked) bytes += range.length;
  // Nearly the whole file is asked for, in requests of nearly the largest size.
  EXPECT_LE(host.asked.size(), 4 + 3 * bytes / StreamOptions{}.max_request_bytes);
}

TEST(PmrStreamTest, lossAndDamageOnTheLinkAreRepaired) {
  std::mt19937 random(3);
  const TraverseRequest request = viewFrom(2.2);
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
  std::vector<DrawnLeaf> drawn;
  for (int turn = 0; turn < 3000 && !stream.complete(); ++turn) {
    now += 0.2;
    host.acceptRequests(now);
    if (host.underWay() > 0) host.answerOne(now, random());
    stream.update(request, drawn);
  }
  EXPECT_TRUE(stream.complete()) << stream.problem();
  EXPECT_EQ(levelsOf(drawn), levelsAskedFor(request));
  EXPECT_GT(stream.stats().failures, 3U);
  EXPECT_EQ(stream.stats().damaged, 0U);
}

TEST(PmrStreamTest, aChunkThatStaysDamagedIsGivenUpAndACoarserLevelReplacesIt) {
  const TraverseRequest request = viewFrom(2.2);
  const auto asked = levelsAskedFor(request);
  const auto victim = *std::find_if(asked.begin(), asked.end(), [](const auto& one) { return one.second < 8; });
  base::Bytes bytes = made().file;
  bytes[made().leaves[victim.first].levels[victim.second].triangle_offset] ^= 1;
  auto expected = asked;
  ++expected[victim.first];

  Stream stream(bytes.size(), {});
  Host host(stream, bytes);
  double now = 0.0;
  EXPECT_EQ(levelsOf(fetchAll(stream, host, request, now)), expected);
  EXPECT_TRUE(stream.complete());
  EXPECT_EQ(stream.stats().damaged, 1U);
  EXPECT_EQ(stream.warning(),
            "leaf " + std::to_string(victim.first) + " is damaged: checksums do not match; publish the scene again");

  Stream whole(local(bytes), {});
  std::vector<DrawnLeaf> drawn;
  whole.update(request, drawn);
  EXPECT_EQ(levelsOf(drawn), expected);
  EXPECT_TRUE(whole.complete());
  EXPECT_EQ(whole.stats().damaged, 1U);

  // Without its coarsest points nothing of a leaf can be drawn.
  bytes[made().leaves[victim.first].levels[kCoarsest].point_offset] ^= 1;
  Stream without(local(bytes), {});
  without.update(request, drawn);
  EXPECT_EQ(drawn.size(), asked.size() - 1);
  EXPECT_TRUE(without.complete());
}

TEST(PmrStreamTest, pausesGrowWhileRequestsFail) {
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

TEST(PmrStreamTest, aFrontThatIsWrongIsAProblem) {
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

TEST(PmrStreamTest, littleMemoryKeepsLeavesCoarseAndIsNeverExceeded) {
  TraverseRequest request = viewFrom(2.2, 4000);
  request.cull = false;
  StreamOptions options;
  options.memory_bytes = kMinStreamMemory;
  Stream stream(made().file.size(), options);
  Host host(stream, made().file);
  double now = 0.0;
  const std::uint64_t table = made().leaves.size() * 1000;
  const auto within = [&](const auto&) { EXPECT_LE(stream.stats().memory_bytes, kMinStreamMemory + table); };
  const std::vector<DrawnLeaf> drawn = fetchAll(stream, host, request, now, within);
  EXPECT_TRUE(stream.complete());
  EXPECT_TRUE(stream.limitedByMemory());
  EXPECT_EQ(drawn.size(), made().leaves.size());
  EXPECT_GT(stream.stats().lacking, 0U);
  EXPECT_LT(stream.stats().lacking, drawn.size());
  const std::size_t asked = host.asked.size();
  std::vector<DrawnLeaf> again;
  stream.update(request, again);
  host.acceptRequests(now + 1.0);
  EXPECT_EQ(host.asked.size(), asked) << "asks for what there is no memory for";

  // Views that wander about stay within memory, too, and each becomes complete.
  support::RandomViews views(8, made().header.bounds, 2000);
  for (int i = 0; i < 40; ++i) {
    request.camera = views.next();
    request.cull = true;
    fetchAll(stream, host, request, now, within);
    ASSERT_TRUE(stream.complete()) << "view " << i;
  }
}

TEST(PmrStreamTest, decodingIsSpreadOverFrames) {
  const TraverseRequest request = viewFrom(2.2, 2000);
  StreamOptions options;
  options.decode_per_frame = 1;
  Stream stream(local(), options);
  std::vector<DrawnLeaf> drawn;
  std::size_t frames = 0;
  do {
    stream.update(request, drawn);
    ++frames;
  } while (stream.decoding() && frames < 10'000);
  EXPECT_TRUE(stream.complete());
  EXPECT_EQ(levelsOf(drawn), levelsAskedFor(request));
  EXPECT_GE(frames, drawn.size());
}

TEST(PmrStreamTest, leavesAreDrawnFrontToBack) {
  const TraverseRequest request = viewFrom(2.5);
  float before = -1e9F;
  for (const DrawnLeaf& one : drawLocally(request)) {
    const glm::vec3 center = made().leaves[one.picture->leaf].box.center();
    const float depth = -(request.camera.eye_from_scene * glm::vec4(center, 1.0F)).z;
    EXPECT_GE(depth, before - 0.01F);
    before = depth;
  }
}

}  // namespace
}  // namespace lod::pmr
