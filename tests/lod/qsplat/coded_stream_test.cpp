// Streaming a coded file shows the same picture as the plain one, earlier.
#include <gtest/gtest.h>

#include <map>

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

TEST(CodedStreamTest, theFirstAnswerHoldsNoFewerBlocksThanThatOfAPlainFile) {
  std::map<bool, std::uint64_t> present, bytes;
  for (const bool coded : {false, true}) {
    const base::Bytes& file = coded ? codedFile() : plainFile();
    Stream stream(file.size(), withoutIdling());
    Host host(stream, file);
    host.acceptRequests(0.0);
    ASSERT_EQ(host.asked.size(), 1U);
    bytes[coded] = host.asked[0].length;
    host.answerOne(0.1);
    present[coded] = stream.stats().present;
  }
  EXPECT_EQ(bytes[true], bytes[false]);
  EXPECT_GE(present[true], present[false]);
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
    host.acceptRequests(now += 0.01);
    if (host.underWay() > 0) host.answerOne(now);
  }
  EXPECT_EQ(stream.stats().present, header().blocks());
  EXPECT_TRUE(stream.nextRequests(now + 1.0).empty());
}

// By their number alone: coded they would fit.
TEST(CodedStreamTest, reportsAFileOfTooManyBlocksForTheMemory) {
  const base::Bytes large = support::codedSplats(support::splatFile(support::bumpySphere(600, 1200)));
  ASSERT_LT(large.size(), kMaxFilePerMemory * kMinStreamMemory);
  StreamOptions options = withoutIdling();
  options.memory_bytes = kMinStreamMemory;
  Stream stream(large.size(), options);
  EXPECT_EQ(stream.problem(), "");
  Host host(stream, large);
  host.acceptRequests(0.0);
  host.answerOne(0.1);
  EXPECT_NE(stream.problem().find("are too many for 65536 bytes of memory; allow at least"), std::string::npos)
      << stream.problem();
  EXPECT_EQ(stream.header(), nullptr);
}

TEST(CodedStreamTest, reportsADamagedHeaderOrThatOfAnotherFile) {
  {
    base::Bytes longer = codedFile();
    longer.resize(longer.size() + kBlockBytes, 0);
    Stream stream(longer.size(), withoutIdling());
    Host host(stream, longer);
    host.acceptRequests(0.0);
    host.answerOne(0.1);
    EXPECT_NE(stream.problem().find("but its header says"), std::string::npos);
  }
  {
    base::Bytes damaged = codedFile();
    damaged[200] ^= 1;  // a table
    Stream stream(damaged.size(), withoutIdling());
    Host host(stream, damaged);
    for (double now = 0.0; now < 60.0 && stream.problem().empty(); now += 1.0) {
      host.acceptRequests(now);
      if (host.underWay() > 0) host.answerOne(now);
    }
    EXPECT_NE(stream.problem().find("header: checksum does not match"), std::string::npos);
    EXPECT_EQ(stream.header(), nullptr);
  }
}

}  // namespace
}  // namespace lod::qsplat
