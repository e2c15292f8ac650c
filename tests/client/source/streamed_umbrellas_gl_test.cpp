#include "client/source/streamed_umbrellas.h"

#include <gtest/gtest.h>

#include "tests/support/made_pmr.h"
#include "tests/support/streamed_viewer.h"

namespace client {
namespace {

class StreamedUmbrellasTest : public support::StreamedViewer<StreamedUmbrellas> {
 protected:
  static const base::Bytes& file() {
    static const base::Bytes bytes = support::madePmr(128).file;
    return bytes;
  }
  void open(const StreamedOptions& options, const base::Bytes& bytes = file(), int samples = 1) {
    openAtHost(viewerOptions(samples), "pmr.lgm", bytes, 1.5F, options);
  }
  /// Shows a whole file, as one that is on this machine.
  void openWhole(const StreamedOptions& options, const base::Bytes& bytes) {
    show(viewerOptions(1),
         std::make_shared<StreamedUmbrellas>(FilePlace{"torus", "pmr.lgm", bytes.size()}, protocol::Welcome(),
                                             std::make_shared<lod::MemoryBytes>(bytes), options));
  }
  static ViewerOptions viewerOptions(int samples) {
    ViewerOptions options;
    options.method = Method::kPmr;
    options.samples = samples;
    return options;
  }
  static base::ViewCamera view(double turn = 0.0, double distance = 3.5) { return viewFrom(turn, distance); }
};

StreamedOptions still() {
  StreamedOptions options;
  options.frame_seconds = 0.0;
  options.decode_per_frame = 0;
  return options;
}

TEST_F(StreamedUmbrellasTest, theFinishedPictureDoesNotDependOnHowItCame) {
  open(still());
  fetchAll(view());
  const base::Image at_once = draw(view());
  EXPECT_GT(viewer_->stats().streamed.umbrellas.triangles, 1000U);
  open(still());
  host_->at_a_time = 2;
  for (int i = 0; i < 2000 && !viewer_->allHere(); ++i) {
    pump();
    draw(view(i % 2 == 0 ? 0.2 : 0.0));
  }
  fetchAll(view());
  EXPECT_EQ(draw(view()).pixels, at_once.pixels);
  EXPECT_EQ(viewer_->stats().accuracy, Accuracy::kFine);
  EXPECT_TRUE(viewer_->stats().complete);
  EXPECT_FALSE(viewer_->stats().busy);
  EXPECT_GT(viewer_->stats().session.bytes_received, 10'000U);

  openWhole(still(), file());
  pump();
  EXPECT_EQ(viewer_->session().phase(), SessionPhase::kReady);
  EXPECT_EQ(draw(view()).pixels, at_once.pixels);
  EXPECT_TRUE(streamed_->complete());
  EXPECT_EQ(viewer_->stats().streamed.requests, 0U);
}

// A host that answers one request at a time, and a view of which a part is here, drawn in half a second.
class HalfAViewOfUmbrellas : public StreamedUmbrellasTest {
 protected:
  void SetUp() override {
    StreamedUmbrellasTest::SetUp();
    if (IsSkipped()) return;
    StreamedOptions options = still();
    options.clock = [this] { return clock_ += drawing_; };
    open(options);
    host_->at_a_time = 1;
    for (int i = 0; i < 200 && (stream().lacking == 0 || stream().under_way == 0); ++i) {
      pump();
      draw(view());
    }
    ASSERT_GT(stream().lacking, 1U);
    drawing_ = 0.0;
  }
  lod::pmr::StreamStats stream() const { return streamed_->stats().umbrellas.stream; }

  double clock_ = 0.0, drawing_ = 0.5;
};

TEST_F(HalfAViewOfUmbrellas, isDrawnAgainWhenAllIsHereOrDrawingHadItsPart) {
  clock_ += 100.0;
  draw(view());
  clock_ += 0.5;
  const double drawn = clock_;
  glFinish();  // the picture has its end when the GPU is done with it
  pump();
  ASSERT_GT(stream().under_way, 0U);
  EXPECT_FALSE(viewer_->stats().busy);
  clock_ = drawn + 0.5 * DutyCycle::kRest - 0.1;
  EXPECT_FALSE(viewer_->stats().busy);
  clock_ = drawn + 0.5 * DutyCycle::kRest + 0.1;
  EXPECT_TRUE(viewer_->stats().busy) << "so many times what drawing took";
  draw(view());
  EXPECT_FALSE(viewer_->stats().busy) << "nothing came";
  for (int i = 0; i < 1000 && stream().under_way > 0; ++i) pump();
  EXPECT_TRUE(viewer_->stats().busy) << "all that it lacked";
}

TEST_F(HalfAViewOfUmbrellas, isCompleteForOneWhoDoesNotDraw) {
  for (int i = 0; i < 1000 && !viewer_->allHere(); ++i) {
    pump();
    ASSERT_TRUE(bool(viewer_->update(view(), now_)));
  }
  EXPECT_TRUE(viewer_->allHere());
}

TEST_F(StreamedUmbrellasTest, aFrameDecodesItsShareAndTheRestComesInTheNextOnes) {
  openWhole(still(), file());
  pump();
  const base::Image whole = draw(view());
  StreamedOptions options = still();
  options.decode_per_frame = 3000;
  openWhole(options, file());
  pump();
  draw(view());
  EXPECT_FALSE(streamed_->complete());
  int frames = 1;
  for (; viewer_->stats().busy && frames < 1000; ++frames) draw(view());
  EXPECT_GT(frames, 5);
  EXPECT_TRUE(streamed_->complete());
  EXPECT_EQ(draw(view()).pixels, whole.pixels);
}

TEST_F(StreamedUmbrellasTest, damagedChunksAreNamedAndOtherLevelsStandInForThem) {
  openWhole(still(), file());
  pump();
  const base::Image intact = draw(view());
  base::Bytes spoiled = file();
  for (std::size_t i = spoiled.size() / 2; i < spoiled.size(); i += 200) spoiled[i] ^= 1;
  openWhole(still(), spoiled);
  pump();
  for (int i = 0; i < 50; ++i) draw(view());
  const base::Image picture = draw(view());
  EXPECT_NE(picture.pixels, intact.pixels);
  EXPECT_TRUE(streamed_->complete());
  EXPECT_NE(viewer_->stats().streamed.warning, "");
  EXPECT_EQ(viewer_->stats().last_fault, viewer_->stats().streamed.warning);
  EXPECT_GT(viewer_->stats().broken, 0U);
}

TEST_F(StreamedUmbrellasTest, anotherToleranceShowsInTheNextPictureAsIfItHadBeenThereFromTheBeginning) {
  std::vector<StreamedQuality> qualities(3, StreamedQuality(still()));
  qualities[1].tolerance = 16.0F;
  qualities[2].tolerance = 0.25F;
  std::vector<base::Image> pictures;
  std::vector<std::uint64_t> drawn;
  for (const StreamedQuality& quality : qualities) {
    StreamedOptions options = still();
    static_cast<StreamedQuality&>(options) = quality;
    open(options);
    fetchAll(view());
    pictures.push_back(draw(view()));
    drawn.push_back(viewer_->stats().streamed.drawn);
    EXPECT_EQ(viewer_->stats().error_px, quality.tolerance);
  }
  EXPECT_LT(4 * drawn[1], drawn[0]);
  EXPECT_GE(drawn[2], drawn[0]);
  for (const std::size_t i : {0U, 2U, 1U, 0U}) {
    streamed_->setQuality(qualities[i]);
    EXPECT_EQ(streamed_->quality(), qualities[i]);
    fetchAll(view());
    EXPECT_EQ(draw(view()).pixels, pictures[i].pixels) << "quality " << i;
  }
  StreamedQuality least = qualities[0];
  least.tolerance = 0.0F;
  streamed_->setQuality(least);
  EXPECT_EQ(streamed_->quality().tolerance, kMinTolerance);
}

TEST_F(StreamedUmbrellasTest, aMovingViewIsAsCoarseAsTheRateAsksForAndRestRefinesItStepByStep) {
  double clock = 0.0;
  StreamedOptions options;
  makeLate(options, clock);
  open(options);
  host_->at_a_time = 100;
  for (int i = 0; i < 200; ++i) {
    pump();
    draw(view(0.01 * i));
  }
  const StreamedStats moving = viewer_->stats().streamed;
  EXPECT_GT(moving.error_px, 10.0F);
  float last = moving.error_px;
  int frames = 0;
  for (; frames < 500 && !(viewer_->stats().complete && !viewer_->stats().busy); ++frames) {
    pump();
    draw(view(1.99));
    EXPECT_LE(viewer_->stats().streamed.error_px, last);
    last = viewer_->stats().streamed.error_px;
  }
  EXPECT_GT(frames, 5);
  EXPECT_EQ(last, 1.0F);
  EXPECT_GT(viewer_->stats().streamed.drawn, 4 * moving.drawn);
}

TEST_F(StreamedUmbrellasTest, samplesOfAPixelAreAveraged) {
  open(still());
  fetchAll(view());
  const base::Image hard = draw(view());
  open(still(), file(), 4);
  fetchAll(view());
  const base::Image soft = draw(view());
  EXPECT_EQ(viewer_->stats().effort.samples, 4);
  EXPECT_GT(viewer_->stats().memory.renderbuffers, 0U);
  int partly = 0, unlike = 0;
  for (std::size_t i = 0; i < hard.pixels.size(); i += 4) {
    EXPECT_TRUE(hard.pixels[i + 3] == 0 || hard.pixels[i + 3] == 255);
    partly += soft.pixels[i + 3] != 0 && soft.pixels[i + 3] != 255 ? 1 : 0;
    if (soft.pixels[i + 3] != 255 || hard.pixels[i + 3] != 255) continue;
    for (std::size_t c = i; c < i + 3; ++c) unlike += std::abs(soft.pixels[c] - hard.pixels[c]) > 60 ? 1 : 0;
  }
  EXPECT_GT(partly, 100);
  EXPECT_LT(unlike, 500);
}

TEST_F(StreamedUmbrellasTest, theDrawnSurfaceIsFoundUnderThePointer) {
  for (const double distance : {3.5, 40.0}) {
    open(still());
    base::ViewCamera camera = view(0.0, distance);
    camera.fov_y = 2.0 * std::atan(1.6 / distance);
    if (distance > 10.0) camera.width = camera.height = 48;
    fetchAll(camera);
    const base::Image picture = draw(camera);
    int hits = 0;
    int at_the_rim = 0;  // pixels where the rasterizer rounds
    for (int y = 2; y < camera.height; y += camera.height / 16)
      for (int x = 2; x < camera.width; x += camera.width / 16) {
        const bool drawn = picture.at(x, y + kSize - camera.height)[3] != 0;
        const auto point = viewer_->surfaceAt(camera, x + 0.5, y + 0.5);
        at_the_rim += point.has_value() != drawn ? 1 : 0;
        if (!point) continue;
        ++hits;
        const double around = glm::length(glm::dvec2(*point));
        EXPECT_NEAR(std::hypot(around - 1.0, point->z), 0.35, 0.08);
        EXPECT_GT(point->z, -0.1);
      }
    EXPECT_GT(hits, 30);
    EXPECT_LE(at_the_rim, 8);
  }
  // A section that takes the front shows what lies behind it.
  viewer_->setSection(base::SectionPlane{{0.0, 0.0, 1.0}, 0.0});
  const base::ViewCamera camera = view();
  fetchAll(camera);
  draw(camera);
  int behind = 0;
  for (int x = 0; x < kSize; x += 8)
    if (const auto point = viewer_->surfaceAt(camera, x + 0.5, 128.5)) {
      EXPECT_LE(point->z, 1e-5);
      ++behind;
    }
  EXPECT_GT(behind, 3);
}

TEST_F(StreamedUmbrellasTest, drawsCoarserBeyondTheMemoryLimit) {
  StreamedOptions options = still();
  options.memory_bytes = 2'500'000;
  const base::Bytes large = support::madePmr(256).file;
  open(options, large);
  fetchAll(view());
  draw(view());
  const ViewerStats stats = viewer_->stats();
  EXPECT_TRUE(stats.streamed.limited);
  EXPECT_GT(stats.streamed.drawn, 500U);
  EXPECT_LE(stats.memory.total(), options.memory_bytes);
}

TEST_F(StreamedUmbrellasTest, aLostContextAndALostHostComeBack) {
  open(still());
  fetchAll(view());
  const base::Image before = draw(view());
  viewer_->contextLost();
  EXPECT_TRUE(bool(viewer_->draw(view(), now_)));
  EXPECT_TRUE(bool(viewer_->contextRestored()));
  auto target = base::gl::RenderTarget::create(kSize, kSize);
  ASSERT_TRUE(bool(target));
  target_ = std::move(*target);
  EXPECT_EQ(draw(view()).pixels, before.pixels);

  open(still());
  host_->outcome = FetchOutcome::kNetwork;
  for (int i = 0; i < 10; ++i) pump();
  EXPECT_EQ(viewer_->session().phase(), SessionPhase::kDisconnected);
  EXPECT_NE(viewer_->session().problem().find("pmr.lgm"), std::string::npos);
  host_->outcome = FetchOutcome::kBytes;
  for (int i = 0; i < 1000; ++i) pump();
  fetchAll(view());
  EXPECT_EQ(draw(view()).pixels, before.pixels);
}

TEST_F(StreamedUmbrellasTest, aHostThatCannotAnswerIsRefusedWithTheReason) {
  open(still());
  host_->outcome = FetchOutcome::kRangeIgnored;
  for (int i = 0; i < 3; ++i) pump();
  EXPECT_EQ(viewer_->session().phase(), SessionPhase::kRefused);
  EXPECT_NE(viewer_->session().problem().find("pmr.lgm"), std::string::npos);

  const base::Bytes other(2000, 7);
  open(still(), other);
  for (int i = 0; i < 1000; ++i) pump();
  EXPECT_EQ(viewer_->session().phase(), SessionPhase::kRefused);
}

}  // namespace
}  // namespace client
