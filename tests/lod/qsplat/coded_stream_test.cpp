// A coded file over a link: what a plain one shows, sooner.
#include <gtest/gtest.h>

#include <algorithm>
#include <map>
#include <random>

#include "tests/lod/qsplat/stream_host.h"
#include "tests/support/coded_splats.h"
#include "tests/support/random_views.h"
#include "tests/support/splat_tree.h"
#include "tests/support/test_meshes.h"

namespace lod::qsplat {
namespace {

const base::Bytes& plainFile() {
  static const base::Bytes bytes = support::splatFile(support::bumpySphere(120, 240, 0.1F));
  return bytes;
}
const base::Bytes& codedFile() {
  static const base::Bytes bytes = support::codedSplats(plainFile());
  return bytes;
}
const Header& header() {
  static const Header read = *readHeader(codedFile());
  return read;
}

TraverseRequest requestFor(const base::Camera& camera) {
  TraverseRequest request;
  request.camera = camera;
  request.cutoff_px = 0.7F;
  return request;
}

std::vector<Splat> localSplats(const TraverseRequest& request) {
  const auto blocks = blocksOfFile(codedFile(), header());
  MappedBlocks plain(plainFile(), *readHeader(plainFile()));
  const std::vector<Splat> splats = traverse(**blocks, request).splats;
  EXPECT_EQ(splats, traverse(plain, request).splats);
  return splats;
}

TEST(CodedStreamTest, theFullyStreamedCutEqualsTheLocalOneOfEitherForm) {
  Stream stream(codedFile().size(), withoutIdling());
  Host host(stream, codedFile());
  double now = 0.0;
  support::RandomViews views(5, header().root, 300);
  for (int i = 0; i < 30; ++i) {
    const TraverseRequest request = requestFor(views.next());
    const Traversal found = fetchAll(stream, host, request, now);
    ASSERT_TRUE(stream.complete());
    ASSERT_EQ(stream.problem(), "");
    EXPECT_EQ(found.splats, localSplats(request)) << "view " << i;
  }
  // Of the first answer only the piece of a block at its end came twice.
  EXPECT_LE(host.sent, codedFile().size() + kMostCodedBytes);
  EXPECT_EQ(stream.stats().bytes_received, host.sent);
}

TEST(CodedStreamTest, theFirstAnswerHoldsNoFewerBlocksThanThatOfAPlainFile) {
  std::map<bool, std::uint64_t> present, bytes;
  for (const bool coded : {false, true}) {
    const base::Bytes& file = coded ? codedFile() : plainFile();
    Stream stream(file.size(), withoutIdling());
    Host host(stream, file);
    host.ask(0.0);
    ASSERT_EQ(host.asked.size(), 1U);
    bytes[coded] = host.asked[0].length;
    host.answerOne(0.1);
    present[coded] = stream.stats().present;
  }
  EXPECT_EQ(bytes[true], bytes[false]);
  EXPECT_GE(present[true], present[false]);
}

TEST(CodedStreamTest, failuresCutsNewViewsAndLittleMemoryEndWell) {
  for (unsigned seed = 1; seed <= 12; ++seed) {
    StreamOptions options;
    options.most_requests = 1 + seed % 7;
    options.most_request_blocks = 1 + seed * 3 % 17;
    options.idle_bytes = seed % 2 == 0 ? 1'000'000 : 0;
    options.memory_bytes = seed % 3 == 0 ? kLeastStreamMemory : 10'000'000;
    Stream stream(codedFile().size(), options);
    Host host(stream, codedFile());
    std::mt19937 random(seed);
    host.spoil = [&](const ByteRange&, base::Bytes bytes) -> std::optional<base::Bytes> {
      const unsigned how = random() % 6;
      if (how == 0) return std::nullopt;
      if (how == 1) bytes.resize(random() % bytes.size());
      return bytes;
    };
    support::RandomViews views(seed, header().root, 400);
    TraverseRequest request = requestFor(views.next());
    Traversal found;
    double now = 0.0;
    for (int turn = 0; turn < 600; ++turn) {
      now += 0.05;
      if (random() % 40 == 0) request = requestFor(views.next());
      if (random() % 2 == 0) stream.traverse(request, std::nullopt, found);
      host.ask(now);
      ASSERT_FALSE(HasFatalFailure());
      if (host.underWay() > 0 && random() % 3 != 0) host.answerOne(now, random() % 2 == 0);
      ASSERT_EQ(stream.problem(), "");
      ASSERT_LE(stream.stats().present * kBlockBytes, options.memory_bytes + kBlockBytes);
    }
    host.spoil = {};
    while (host.underWay() > 0) host.answerOne(now);
    fetchAll(stream, host, request, now);
    EXPECT_TRUE(stream.complete()) << "seed " << seed;
    if (options.memory_bytes > plainFile().size()) {
      stream.traverse(request, std::nullopt, found);
      EXPECT_EQ(found.splats, localSplats(request));
    } else {
      EXPECT_GT(stream.stats().evicted, 0U);
    }
  }
}

TEST(CodedStreamTest, aConnectionDroppedAtAnyRequestIsMended) {
  // Drop 0 drops nothing, and counts.
  std::size_t requests = 1;
  for (std::size_t drop = 0; drop <= requests; ++drop) {
    Stream stream(codedFile().size(), withoutIdling());
    Host host(stream, codedFile());
    std::size_t answers = 0;
    host.spoil = [&](const ByteRange&, base::Bytes bytes) {
      return ++answers == drop ? std::nullopt : std::optional(std::move(bytes));
    };
    support::RandomViews views(2, header().root, 200);
    const TraverseRequest request = requestFor(views.next());
    double now = 0.0;
    EXPECT_EQ(fetchAll(stream, host, request, now).splats, localSplats(request)) << "request " << drop;
    EXPECT_EQ(stream.stats().failures, drop == 0 ? 0U : 1U);
    if (drop == 0) requests = host.asked.size();
  }
}

TEST(CodedStreamTest, aDamagedBlockIsGivenUpAndAllElseIsDrawn) {
  base::Bytes bad = codedFile();
  bad[bad.size() * 2 / 3] ^= 16;
  Stream stream(bad.size(), withoutIdling());
  Host host(stream, bad);
  support::RandomViews views(4, header().root, 400);
  double now = 0.0;
  for (int i = 0; i < 20; ++i) fetchAll(stream, host, requestFor(views.next()), now);
  EXPECT_TRUE(stream.complete());
  EXPECT_EQ(stream.problem(), "");
  EXPECT_EQ(stream.stats().given_up, 1U);
  EXPECT_NE(stream.warning().find("is damaged: checksum does not match"), std::string::npos);
}

TEST(CodedStreamTest, atRestTheWholeFileComes) {
  StreamOptions options;
  options.idle_bytes = plainFile().size();
  Stream stream(codedFile().size(), options);
  Host host(stream, codedFile());
  double now = 0.0;
  support::RandomViews views(6, header().root, 200);
  fetchAll(stream, host, requestFor(views.next()), now);
  for (int i = 0; i < 5000 && stream.stats().present < header().blocks(); ++i) {
    host.ask(now += 0.01);
    if (host.underWay() > 0) host.answerOne(now);
  }
  EXPECT_EQ(stream.stats().present, header().blocks());
  EXPECT_TRUE(stream.requests(now + 1.0).empty());
}

TEST(CodedStreamTest, aHeaderOfAnotherFileOrOfTooManyBlocksIsTold) {
  {
    base::Bytes longer = codedFile();
    longer.resize(longer.size() + kBlockBytes, 0);
    Stream stream(longer.size(), withoutIdling());
    Host host(stream, longer);
    host.ask(0.0);
    host.answerOne(0.1);
    EXPECT_NE(stream.problem().find("but its header says"), std::string::npos);
  }
  {
    base::Bytes damaged = codedFile();
    damaged[200] ^= 1;  // a table
    Stream stream(damaged.size(), withoutIdling());
    Host host(stream, damaged);
    for (double now = 0.0; now < 60.0 && stream.problem().empty(); now += 1.0) {
      host.ask(now);
      if (host.underWay() > 0) host.answerOne(now);
    }
    EXPECT_NE(stream.problem().find("header: checksum does not match"), std::string::npos);
    EXPECT_EQ(stream.header(), nullptr);
  }
}

}  // namespace
}  // namespace lod::qsplat
