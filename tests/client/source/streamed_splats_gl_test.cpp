#include "client/source/streamed_splats.h"

#include <gtest/gtest.h>

#include "tests/support/splat_tree.h"
#include "tests/support/streamed_viewer.h"
#include "tests/support/test_meshes.h"

namespace client {
namespace {

class StreamedSplatsTest : public support::StreamedViewer<StreamedSplats> {
 protected:
  static const base::Bytes& file() {
    static const base::Bytes bytes = support::splatFile(support::bumpySphere(120, 240, 0.1F));
    return bytes;
  }
  void open(StreamedOptions options) {
    options.idle_bytes = 0;
    openAtHost(viewerOptions(), "qsplat.lgq", file(), 1.2F, [&](const auto& place, const auto& welcome, auto fetcher) {
      return std::make_shared<StreamedSplats>(place, welcome, std::move(fetcher), options);
    });
  }
  /// Shows the whole file, as one that is on this machine.
  void openWhole(const StreamedOptions& options, const base::Bytes& bytes) {
    const auto header = lod::qsplat::readHeader(bytes);
    ASSERT_TRUE(bool(header));
    show(viewerOptions(),
         std::make_shared<StreamedSplats>(FilePlace{"ball", "qsplat.lgq", bytes.size()}, protocol::Welcome(),
                                          std::make_shared<lod::qsplat::MemoryBlocks>(bytes, *header), options));
  }
  static ViewerOptions viewerOptions() {
    ViewerOptions options;
    options.method = Method::kQsplat;
    return options;
  }
  static base::ViewCamera view(double turn = 0.0) { return viewFrom(turn, 3.0); }
};

StreamedOptions still() {
  StreamedOptions options;
  options.frame_seconds = 0.0;
  return options;
}

TEST_F(StreamedSplatsTest, theFinishedPictureDoesNotDependOnHowItCame) {
  open(still());
  fetchAll(view());
  const base::Image at_once = draw(view());
  open(still());
  host_->at_a_time = 3;
  for (int i = 0; i < 2000 && !viewer_->allHere(); ++i) {
    pump();
    draw(view(i % 2 == 0 ? 0.2 : 0.0));
  }
  fetchAll(view());
  EXPECT_EQ(draw(view()).pixels, at_once.pixels);
  EXPECT_EQ(viewer_->stats().accuracy, Accuracy::kFine);
  EXPECT_GT(viewer_->stats().session.bytes_received, 10'000U);
}

TEST_F(StreamedSplatsTest, aWholeFileIsShownAtOnceAsIfItHadComeAndDamagedBlocksAreNamed) {
  open(still());
  fetchAll(view());
  const base::Image streamed = draw(view());
  openWhole(still(), file());
  pump();
  EXPECT_EQ(viewer_->session().phase(), SessionPhase::kReady);
  EXPECT_EQ(draw(view()).pixels, streamed.pixels);
  EXPECT_TRUE(streamed_->complete());
  EXPECT_FALSE(streamed_->busy());
  EXPECT_EQ(viewer_->stats().streamed.warning, "");
  EXPECT_EQ(viewer_->stats().streamed.splats.stream.requests, 0U);

  base::Bytes spoiled = file();
  for (std::size_t block = 20; block < spoiled.size() / lod::qsplat::kBlockBytes; ++block)
    spoiled[block * lod::qsplat::kBlockBytes + 7] ^= 1;
  openWhole(still(), spoiled);
  pump();
  EXPECT_NE(draw(view()).pixels, streamed.pixels);
  EXPECT_TRUE(streamed_->complete());
  EXPECT_NE(viewer_->stats().streamed.warning.find("damaged: checksum does not match"), std::string::npos);
  EXPECT_GT(viewer_->stats().broken, 0U);
}

TEST_F(StreamedSplatsTest, anotherQualityShowsInTheNextPictureAsIfItHadBeenThereFromTheBeginning) {
  std::vector<StreamedQuality> qualities(4, StreamedQuality{lod::draw::SplatKernel::kCircle, 10.0F, 0.0});
  qualities[1].kernel = lod::draw::SplatKernel::kSquare;
  qualities[2].cutoff_px = 20.0F;
  qualities[3].cutoff_px = 0.0F;
  std::vector<base::Image> pictures;
  for (const StreamedQuality& quality : qualities) {
    StreamedOptions options;
    static_cast<StreamedQuality&>(options) = quality;
    open(options);
    fetchAll(view());
    pictures.push_back(draw(view()));
    EXPECT_EQ(pictures.back().pixels == pictures.front().pixels, pictures.size() == 1);
  }
  // All blocks have arrived.
  for (const std::size_t i : {0U, 2U, 1U, 3U, 0U}) {
    streamed_->setQuality(qualities[i]);
    EXPECT_EQ(streamed_->quality(), qualities[i]);
    EXPECT_EQ(draw(view()).pixels, pictures[i].pixels) << "quality " << i;
    EXPECT_FALSE(streamed_->busy());
    EXPECT_TRUE(streamed_->complete());
  }
}

TEST_F(StreamedSplatsTest, aMovingViewIsAsCoarseAsTheRateAsksForAndRestRefinesItStepByStep) {
  StreamedOptions options;
  double clock = 0.0;
  makeLate(options, clock);
  open(options);
  host_->at_a_time = 100;
  for (int i = 0; i < 200; ++i) {
    pump();
    draw(view(0.01 * i));
  }
  const StreamedStats moving = viewer_->stats().streamed;
  EXPECT_GT(moving.error_px, 20.0F);
  float last = moving.error_px;
  std::uint64_t nodes = moving.splats.nodes;
  int frames = 0;
  for (; frames < 500 && !viewer_->stats().complete; ++frames) {
    pump();
    draw(view(1.99));
    const StreamedStats now = viewer_->stats().streamed;
    EXPECT_LE(now.error_px, last);
    // The number of splats may grow, since a split node shows more exactly which part of it is turned away.
    EXPECT_GE(now.splats.nodes, nodes);
    last = now.error_px;
    nodes = now.splats.nodes;
  }
  EXPECT_GT(frames, 5);
  EXPECT_EQ(last, 1.0F);
  EXPECT_FALSE(viewer_->stats().busy);
}

TEST_F(StreamedSplatsTest, aMovingViewThatIsLateIsDrawnWithFewerSamplesAndAtRestIsThePictureThatItAlwaysWas) {
  using lod::draw::SplatKernel;
  for (const SplatKernel kernel : {SplatKernel::kSquare, SplatKernel::kCircle, SplatKernel::kEllipse}) {
    StreamedOptions options = still();
    options.kernel = kernel;
    open(options);
    fetchAll(view(0.5));
    const base::Image wanted = draw(view(0.5));
    EXPECT_EQ(viewer_->stats().streamed.splats.reduction, 1.0F);

    double clock = 0.0;
    makeLate(options, clock);
    open(options);
    host_->at_a_time = 100;
    for (int i = 0; i < 50; ++i) {
      pump();
      draw(view(0.01 * i));
    }
    EXPECT_GT(viewer_->stats().streamed.splats.reduction, 4.0F);
    const base::Image moving = draw(view(0.5));
    float last = viewer_->stats().streamed.splats.reduction;
    for (int i = 0; i < 300 && !(viewer_->stats().complete && !viewer_->stats().busy); ++i) {
      pump();
      draw(view(0.5));
      EXPECT_LE(viewer_->stats().streamed.splats.reduction, last);
      last = viewer_->stats().streamed.splats.reduction;
    }
    EXPECT_EQ(last, 1.0F);
    EXPECT_NE(moving.pixels, wanted.pixels);
    EXPECT_EQ(draw(view(0.5)).pixels, wanted.pixels);
  }
}

// A page has one thread for drawing and for incoming data.
TEST_F(StreamedSplatsTest, aPictureAtRestIsDrawnAgainWhenAllIsHereOrDrawingHadItsPart) {
  StreamedOptions options = still();
  double clock = 0.0, drawing = 0.5;
  options.clock = [&] { return clock += drawing; };
  open(options);
  // The link is so slow that few requests may be under way; draw until a picture lacks more than that.
  const auto stream = [&] { return streamed_->stats().splats.stream; };
  const auto next = [&] { streamed_->pump(viewer_->session(), now_ += 1.0); };
  do {
    next();
    draw(view());
  } while (stream().wanted < 40);
  drawing = 0.0;
  const double drawn = clock;
  for (int i = 0; i < 2; ++i) next();
  ASSERT_GT(stream().wanted, 0U);
  ASSERT_GT(stream().requested, 0U);
  EXPECT_FALSE(viewer_->stats().busy);
  clock = drawn + 0.5 * DutyCycle::kRest - 0.1;
  EXPECT_FALSE(viewer_->stats().busy);
  clock = drawn + 0.5 * DutyCycle::kRest + 0.1;
  EXPECT_TRUE(viewer_->stats().busy) << "so many times what drawing took";
  draw(view());
  EXPECT_FALSE(viewer_->stats().busy) << "nothing came";
  while (stream().wanted > 0) next();
  next();
  EXPECT_TRUE(viewer_->stats().busy) << "all that it lacked";
}

// Whoever waits for a complete view, and draws none before, asks for the largest splats first all the same.
TEST_F(StreamedSplatsTest, requestsAreOrderedAnewWhileOthersAreUnderWayOnceChoosingHadItsPart) {
  StreamedOptions options = still();
  double clock = 0.0, choosing = 0.0;
  options.clock = [&] { return clock += choosing; };
  const auto stream = [&] { return streamed_->stats().splats.stream; };
  const auto next = [&] { streamed_->pump(viewer_->session(), now_ += 1.0); };
  const auto update = [&] { EXPECT_TRUE(bool(viewer_->update(view(), now_))); };
  open(options);
  do {
    next();
    clock += 1.0;
    update();
  } while (stream().wanted < 40);

  choosing = 0.5;  // the next choice takes this long
  clock += 1.0;
  next();
  update();
  const double chosen = clock;
  choosing = 0.0;
  const std::uint64_t nodes = streamed_->stats().splats.nodes;
  next();
  ASSERT_GT(stream().wanted, 0U);
  ASSERT_GT(stream().requested, 0U);
  clock = chosen + 0.5 * DutyCycle::kRest - 0.1;
  update();
  EXPECT_EQ(streamed_->stats().splats.nodes, nodes) << "before so many times what choosing took";
  clock = chosen + 0.5 * DutyCycle::kRest + 0.1;
  update();
  EXPECT_GT(streamed_->stats().splats.nodes, nodes) << "only when all requests were answered";
}

TEST_F(StreamedSplatsTest, throughTheLensThePictureIsFinerAndElsewhereTheSame) {
  StreamedOptions options = still();
  options.cutoff_px = 12.0F;
  open(options);
  fetchAll(view());
  const base::Image without = draw(view());
  const std::uint64_t splats = viewer_->stats().streamed.drawn;
  EXPECT_EQ(viewer_->stats().streamed.splats.lens_px, 0.0F);

  const lod::qsplat::Lens lens{{110.0F, 140.0F}, 40.0F};
  viewer_->setLens(lens);
  fetchAll(view());
  const base::Image with = draw(view());
  EXPECT_EQ(viewer_->stats().streamed.splats.lens_px, 4.0F);
  EXPECT_GT(viewer_->stats().streamed.drawn, splats + splats / 20);

  options.cutoff_px = 4.0F;
  open(options);
  fetchAll(view());
  const base::Image fine = draw(view());

  // Splats at the rim reach beyond it by their own size on either side.
  int inside = 0, outside = 0, changed = 0;
  for (int y = 0; y < kSize; ++y)
    for (int x = 0; x < kSize; ++x) {
      const float off = glm::length(glm::vec2(x + 0.5F, y + 0.5F) - lens.center_px);
      const auto at = with.pixels.begin() + 4 * (static_cast<std::ptrdiff_t>(y) * kSize + x);
      const auto same = [&](const base::Image& other) {
        return std::equal(at, at + 4, other.pixels.begin() + (at - with.pixels.begin()));
      };
      if (off < lens.radius_px - 2.0F * options.cutoff_px) {
        ++inside;
        EXPECT_TRUE(same(fine)) << x << ", " << y;
        changed += same(without) ? 0 : 1;
      } else if (off > lens.radius_px + 2.0F * 12.0F) {
        ++outside;
        EXPECT_TRUE(same(without)) << x << ", " << y;
      }
    }
  EXPECT_GT(inside, 3000);
  EXPECT_GT(outside, 40'000);
  EXPECT_GT(changed, inside / 2);
}

TEST_F(StreamedSplatsTest, theDrawnSurfaceIsFoundUnderThePointer) {
  open(still());
  fetchAll(view());
  const base::Image picture = draw(view());
  int hits = 0;
  int at_the_rim = 0;  // pixels where the rasterizer rounds
  for (int y = 8; y < kSize; y += 16)
    for (int x = 8; x < kSize; x += 16) {
      const bool drawn = picture.pixels[static_cast<std::size_t>(4 * (y * kSize + x) + 3)] != 0;
      const auto point = viewer_->surfaceAt(view(), x + 0.5, y + 0.5);
      at_the_rim += point.has_value() != drawn ? 1 : 0;
      if (!point) continue;
      ++hits;
      EXPECT_NEAR(glm::length(*point), 1.0, 0.15);
      EXPECT_GT(point->z, 0.0);
    }
  EXPECT_GT(hits, 30);
  EXPECT_LE(at_the_rim, 2);
}

TEST_F(StreamedSplatsTest, drawsCoarserBeyondTheMemoryLimit) {
  StreamedOptions options = still();
  options.memory_bytes = 512 * 1024;
  open(options);
  fetchAll(view());
  draw(view());
  const ViewerStats stats = viewer_->stats();
  EXPECT_TRUE(stats.streamed.limited);
  EXPECT_GT(stats.streamed.error_px, 1.0F);
  EXPECT_GT(stats.streamed.drawn, 500U);
  EXPECT_LE(stats.memory.total(), options.memory_bytes);
}

TEST_F(StreamedSplatsTest, aLostContextAndALostHostComeBack) {
  open(still());
  fetchAll(view());
  const base::Image before = draw(view());
  viewer_->contextLost();
  ASSERT_TRUE(bool(viewer_->contextRestored()));
  EXPECT_EQ(draw(view()).pixels, before.pixels);

  host_->outcome = FetchOutcome::kNetwork;
  EXPECT_TRUE(bool(viewer_->update(view(3.1), now_)));
  pump();
  pump();
  EXPECT_EQ(viewer_->session().phase(), SessionPhase::kDisconnected);
  EXPECT_NE(viewer_->session().problem().find("http://host/scene/qsplat.lgq: no answer"), std::string::npos);
  EXPECT_EQ(draw(view()).pixels, before.pixels) << "what is here can be looked at";
  host_->outcome = FetchOutcome::kBytes;
  now_ += 10.0;
  EXPECT_TRUE(bool(viewer_->update(view(3.1), now_)));
  fetchAll(view(3.1));
  EXPECT_EQ(viewer_->session().phase(), SessionPhase::kReady);
}

TEST_F(StreamedSplatsTest, refusesPermanentFailuresWithTheReason) {
  struct Case {
    FetchOutcome outcome;
    const char* words;
  };
  for (const Case& one : {Case{FetchOutcome::kRangeIgnored, "ignores Range"}, Case{FetchOutcome::kChanged, "changed"},
                          Case{FetchOutcome::kTooShort, "is shorter"}, Case{FetchOutcome::kCompressed, "compresses"}}) {
    open(still());
    pump();
    host_->outcome = one.outcome;
    pump();
    EXPECT_EQ(viewer_->session().phase(), SessionPhase::kRefused);
    EXPECT_NE(viewer_->session().problem().find(one.words), std::string::npos) << viewer_->session().problem();
    const std::size_t asked = host_->asked.size();
    for (int i = 0; i < 100; ++i) pump();
    EXPECT_LE(host_->asked.size(), asked) << "nothing more is asked for";
  }
}

}  // namespace
}  // namespace client
