// Claims that hold for streaming a file of either form.
#include <gtest/gtest.h>

#include <random>

#include "tests/lod/qsplat/stream_host.h"
#include "tests/support/coded_splats.h"
#include "tests/support/random_views.h"
#include "tests/support/splat_tree.h"
#include "tests/support/test_meshes.h"

namespace lod::qsplat {
namespace {

/// Returns about 250 blocks of a closed surface.
const base::Bytes& plainFile() {
  static const base::Bytes bytes = support::splatFile(support::bumpySphere(120, 240, 0.1F));
  return bytes;
}

class StreamOfEitherForm : public testing::TestWithParam<bool> {
 protected:
  static bool coded() { return GetParam(); }
  static const base::Bytes& file() {
    static const base::Bytes bytes = support::codedSplats(plainFile());
    return coded() ? bytes : plainFile();
  }
  static base::Sphere root() { return readHeader(plainFile())->root; }
  static TraverseRequest requestFor(const base::Camera& camera, float cutoff_px = 0.7F) {
    TraverseRequest request;
    request.camera = camera;
    request.cutoff_px = cutoff_px;
    return request;
  }
  /// Returns the splats of the local file, and checks that the plain form has the same.
  static std::vector<Splat> localSplats(const TraverseRequest& request) {
    const auto blocks = openBlocks(file(), *readHeader(file()));
    MemoryBlocks plain(plainFile(), *readHeader(plainFile()));
    const std::vector<Splat> splats = traverse(**blocks, request).splats;
    EXPECT_EQ(splats, traverse(plain, request).splats);
    return splats;
  }
};
INSTANTIATE_TEST_SUITE_P(Forms, StreamOfEitherForm, testing::Values(false, true),
                         [](const auto& form) { return form.param ? "coded" : "plain"; });

TEST_P(StreamOfEitherForm, theFullyStreamedCutEqualsTheLocalOne) {
  Stream stream(file().size(), withoutIdling());
  Host host(stream, file());
  double now = 0.0;
  support::RandomViews views(5, root(), 300);
  for (int i = 0; i < 30; ++i) {
    const TraverseRequest request = requestFor(views.next());
    const Traversal found = fetchAll(stream, host, request, now);
    ASSERT_TRUE(stream.complete());
    ASSERT_EQ(stream.problem(), "");
    EXPECT_EQ(found.splats, localSplats(request)) << "view " << i;
  }
  // No byte came twice; of a coded file, the part of a block at the end of the first answer did.
  EXPECT_LE(host.sent, file().size() + (coded() ? kMaxCodedBytes : 0));
  EXPECT_EQ(stream.stats().bytes_received, host.sent);
  if (!coded()) {
    EXPECT_EQ(stream.stats().present * kBlockBytes, host.sent);
  }
}

TEST_P(StreamOfEitherForm, answersInAnyOrderFailuresAndNewViewsAreNeverAskedForTwiceAtATime) {
  for (unsigned seed = 1; seed <= 20; ++seed) {
    StreamOptions options;
    options.max_requests = 1 + seed % 7;
    options.max_request_blocks = 1 + seed * 3 % 17;
    options.idle_bytes = seed % 2 == 0 ? 1'000'000 : 0;
    options.memory_bytes = seed % 3 == 0 ? kMinStreamMemory : 10'000'000;
    Stream stream(file().size(), options);
    Host host(stream, file());
    std::mt19937 random(seed);
    host.spoil = [&](const ByteRange&, base::Bytes bytes) -> std::optional<base::Bytes> {
      const unsigned how = random() % 6;
      if (how == 0) return std::nullopt;
      if (how == 1) bytes.resize(random() % bytes.size());
      return bytes;
    };
    support::RandomViews views(seed, root(), 400);
    TraverseRequest request = requestFor(views.next());
    Traversal found;
    double now = 0.0;
    for (int turn = 0; turn < 800; ++turn) {
      now += 0.05;
      if (random() % 40 == 0) request = requestFor(views.next(), 0.5F);
      if (random() % 2 == 0) stream.traverse(request, std::nullopt, found);
      host.acceptRequests(now);
      ASSERT_FALSE(HasFatalFailure());
      if (host.underWay() > 0 && random() % 3 != 0) host.answerOne(now, random() % 2 == 0);
      ASSERT_LE(host.underWay(), options.max_requests);
      ASSERT_LE(stream.stats().present * kBlockBytes, options.memory_bytes + kBlockBytes);
      ASSERT_EQ(stream.problem(), "");
    }
    EXPECT_GT(stream.stats().failures, 5U);
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

TEST_P(StreamOfEitherForm, aFailureAtEveryRequestInTurnChangesNothingInTheEnd) {
  support::RandomViews views(2, root(), 200);
  const TraverseRequest request = requestFor(views.next());
  const std::vector<Splat> local = localSplats(request);
  std::size_t requests = 1;
  for (std::size_t victim = 0; victim <= requests; ++victim) {  // the first run, without one, counts them
    StreamOptions options = withoutIdling();
    options.max_request_blocks = 3;
    Stream stream(file().size(), options);
    Host host(stream, file());
    std::size_t answers = 0;
    host.spoil = [&](const ByteRange&, base::Bytes bytes) {
      return ++answers == victim ? std::nullopt : std::optional(std::move(bytes));
    };
    double now = 0.0;
    EXPECT_EQ(fetchAll(stream, host, request, now).splats, local) << "request " << victim;
    EXPECT_EQ(stream.stats().failures, victim == 0 ? 0U : 1U);
    if (victim == 0) requests = host.asked.size();
  }
  EXPECT_GT(requests, 10U);
}

}  // namespace
}  // namespace lod::qsplat
