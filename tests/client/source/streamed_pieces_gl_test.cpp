#include "client/source/streamed_pieces.h"

#include <gtest/gtest.h>

#include "client/source/streamed_hlod.h"
#include "client/source/streamed_umbrellas.h"
#include "tests/support/made_hlod.h"
#include "tests/support/made_pmr.h"
#include "tests/support/streamed_viewer.h"

namespace client {
namespace {

/// A method whose file a stream decodes in pieces, and files of it.
struct PieceMethod {
  Method method = Method::kPmr;
  std::string file_name;
  const base::Bytes& (*file)() = nullptr;
  const base::Bytes& (*large_file)() = nullptr;
  float StreamedQuality::*size = nullptr;  ///< pixels, down to which it is refined
  float least = 0.0F;                      ///< of it
  std::shared_ptr<StreamedView> (*at_host)(const FilePlace&, const protocol::Welcome&, std::unique_ptr<RangeFetcher>,
                                           const StreamedOptions&) = nullptr;
  std::shared_ptr<StreamedView> (*whole)(const FilePlace&, std::shared_ptr<const lod::FileBytes>,
                                         const StreamedOptions&) = nullptr;
  std::uint64_t (*under_way)(const StreamedStats&) = nullptr;
  bool (*is_on_surface)(const glm::dvec3& point) = nullptr;  ///< on the side that is seen from +z
};

template <class View>
std::shared_ptr<StreamedView> atHost(const FilePlace& place, const protocol::Welcome& welcome,
                                     std::unique_ptr<RangeFetcher> fetcher, const StreamedOptions& options) {
  return std::make_shared<View>(place, welcome, std::move(fetcher), options);
}
template <class View>
std::shared_ptr<StreamedView> whole(const FilePlace& place, std::shared_ptr<const lod::FileBytes> bytes,
                                    const StreamedOptions& options) {
  return std::make_shared<View>(place, protocol::Welcome(), std::move(bytes), options);
}

/// A torus, seen along its axis.
template <std::uint32_t side>
const base::Bytes& umbrellaFile() {
  static const base::Bytes bytes = support::madePmr(side).file;
  return bytes;
}
const PieceMethod& umbrellas() {
  static const PieceMethod method{Method::kPmr,
                                  "pmr.lgm",
                                  umbrellaFile<128>,
                                  umbrellaFile<256>,
                                  &StreamedQuality::tolerance,
                                  kMinTolerance,
                                  atHost<StreamedUmbrellas>,
                                  whole<StreamedUmbrellas>,
                                  [](const StreamedStats& stats) { return stats.umbrellas.stream.under_way; },
                                  [](const glm::dvec3& point) {
                                    const double around = glm::length(glm::dvec2(point));
                                    const double off = std::abs(std::hypot(around - 1.0, point.z) - 0.35);
                                    return off < 0.08 && point.z > -0.1;
                                  }};
  return method;
}

/// A bumpy square, seen from above.
template <std::uint32_t depth, std::uint32_t quads>
const base::Bytes& hlodFile() {
  static const base::Bytes bytes = support::madeHlod(depth, quads).file;
  return bytes;
}
const PieceMethod& hlod() {
  static const PieceMethod method{Method::kHlod,
                                  "hlod.lgh",
                                  hlodFile<3, 8>,
                                  hlodFile<4, 16>,
                                  &StreamedQuality::error_px,
                                  kMinErrorPx,
                                  atHost<StreamedHlod>,
                                  whole<StreamedHlod>,
                                  [](const StreamedStats& stats) { return stats.hlod.stream.under_way; },
                                  [](const glm::dvec3& point) {
                                    return std::abs(point.x) < 1.01 && std::abs(point.y) < 1.01 &&
                                           std::abs(point.z) < 0.15;
                                  }};
  return method;
}

std::string nameOfMethod(const ::testing::TestParamInfo<const PieceMethod*>& info) {
  return std::string(nameOf(info.param->method));
}

class StreamedPiecesTest : public support::StreamedViewer<StreamedView>,
                           public ::testing::WithParamInterface<const PieceMethod*> {
 protected:
  static const PieceMethod& method() { return *GetParam(); }
  static const base::Bytes& file() { return method().file(); }
  void open(const StreamedOptions& options, const base::Bytes& bytes = file(), int samples = 1) {
    openAtHost(viewerOptions(samples), method().file_name, bytes, 1.5F,
               [&](const auto& place, const auto& welcome, auto fetcher) {
                 return method().at_host(place, welcome, std::move(fetcher), options);
               });
  }
  /// Shows a whole file, as one that is on this machine.
  void openWhole(const StreamedOptions& options, const base::Bytes& bytes) {
    show(viewerOptions(1), method().whole(FilePlace{"scene", method().file_name, bytes.size()},
                                          std::make_shared<lod::MemoryBytes>(bytes), options));
  }
  static ViewerOptions viewerOptions(int samples) {
    ViewerOptions options;
    options.method = method().method;
    options.samples = samples;
    return options;
  }
  static base::ViewCamera view(double turn = 0.0, double distance = 3.5) { return viewFrom(turn, distance); }
};

INSTANTIATE_TEST_SUITE_P(Of, StreamedPiecesTest, ::testing::Values(&umbrellas(), &hlod()), nameOfMethod);

StreamedOptions still() {
  StreamedOptions options;
  options.frame_seconds = 0.0;
  options.decode_per_frame = 0;
  return options;
}

TEST_P(StreamedPiecesTest, theFinishedPictureDoesNotDependOnHowItCame) {
  open(still());
  fetchAll(view());
  const base::Image at_once = draw(view());
  EXPECT_GT(viewer_->stats().streamed.drawn, 1000U);
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
class HalfAView : public StreamedPiecesTest {
 protected:
  void SetUp() override {
    StreamedPiecesTest::SetUp();
    if (IsSkipped()) return;
    StreamedOptions options = still();
    options.clock = [this] { return clock_ += drawing_; };
    open(options, method().large_file());
    host_->at_a_time = 1;
    for (int i = 0; i < 200 && (lacking() == 0 || underWay() == 0); ++i) {
      pump();
      draw(view());
    }
    ASSERT_GT(lacking(), 1U);
    drawing_ = 0.0;
  }
  std::uint64_t lacking() const { return streamed_->stats().lacking; }
  std::uint64_t underWay() const { return method().under_way(streamed_->stats()); }

  double clock_ = 0.0, drawing_ = 0.5;
};

INSTANTIATE_TEST_SUITE_P(Of, HalfAView, ::testing::Values(&umbrellas(), &hlod()), nameOfMethod);

TEST_P(HalfAView, isDrawnAgainWhenAllIsHereOrDrawingHadItsPart) {
  clock_ += 100.0;
  draw(view());
  clock_ += 0.5;
  const double drawn = clock_;
  glFinish();  // the picture has its end when the GPU is done with it
  pump();
  ASSERT_GT(underWay(), 0U);
  EXPECT_FALSE(viewer_->stats().busy);
  clock_ = drawn + 0.5 * DutyCycle::kRest - 0.1;
  EXPECT_FALSE(viewer_->stats().busy);
  clock_ = drawn + 0.5 * DutyCycle::kRest * 20.0;
  EXPECT_TRUE(viewer_->stats().busy) << "so many times what drawing takes of what came since";
  draw(view());
  EXPECT_FALSE(viewer_->stats().busy) << "nothing came";
  for (int i = 0; i < 1000 && underWay() > 0; ++i) pump();
  EXPECT_TRUE(viewer_->stats().busy) << "all that it lacked";
}

TEST_P(HalfAView, isCompleteForOneWhoDoesNotDraw) {
  for (int i = 0; i < 1000 && !viewer_->allHere(); ++i) {
    pump();
    ASSERT_TRUE(bool(viewer_->update(view(), now_)));
  }
  EXPECT_TRUE(viewer_->allHere());
}

// Half of the points are in the coarsest level, so that its chunks do not come with the file's front.
const base::Bytes& fineBaseFile() {
  static const base::Bytes bytes = [] {
    support::LevelledSurface surface = support::bumpyTorus(192, 192);
    for (std::uint32_t& one : surface.classes) one = one > 0 ? lod::pmr::kCoarsest : 0;
    for (std::uint32_t level = 2; level < lod::pmr::kLevels; ++level) surface.triangles[level] = surface.triangles[1];
    return support::PmrMaker(surface, true, 1000).make().file;
  }();
  return bytes;
}

class ViewWithHoles : public StreamedPiecesTest {};
INSTANTIATE_TEST_SUITE_P(Of, ViewWithHoles, ::testing::Values(&umbrellas()), nameOfMethod);

TEST_P(ViewWithHoles, isDrawnAtOnceWhenTheLastOneIsClosed) {
  double clock = 0.0;
  StreamedOptions options = still();
  options.clock = [&clock] { return clock; };
  open(options, fineBaseFile());
  while (viewer_->session().phase() != SessionPhase::kReady) pump();
  const auto figures = [&] { return streamed_->stats().umbrellas; };
  draw(view());
  clock += 0.5;
  glFinish();  // the picture has its end when the GPU is done with it
  for (int i = 0; i < 1000 && figures().leaves < figures().stream.chosen; ++i) {
    pump();
    EXPECT_EQ(viewer_->stats().busy, figures().leaves == figures().stream.chosen);
  }
  ASSERT_EQ(figures().leaves, figures().stream.chosen);
  ASSERT_GT(figures().stream.under_way, 0U);
  EXPECT_TRUE(viewer_->stats().busy);
  draw(view());
  EXPECT_FALSE(viewer_->stats().busy);
}

TEST_P(StreamedPiecesTest, whatAViewLacksIsAskedForBeforeItsPictureIsDrawn) {
  open(still(), method().large_file());
  while (viewer_->session().phase() != SessionPhase::kReady) pump();
  ASSERT_TRUE(host_->asked.empty());
  draw(view());
  EXPECT_FALSE(host_->asked.empty());
}

TEST_P(StreamedPiecesTest, aFirstViewAsksForNoMoreThanOneWithoutSteps) {
  std::vector<std::uint64_t> bytes;
  for (const double frame_seconds : {0.0, 0.1}) {
    StreamedOptions options = still();
    double clock = 0.0;
    options.clock = [&clock] { return clock += 1e-6; };
    options.frame_seconds = frame_seconds;
    open(options, method().large_file());
    for (int i = 0; i < 1000 && !viewer_->stats().complete; ++i) {
      pump();
      draw(view());
    }
    ASSERT_TRUE(viewer_->stats().complete);
    EXPECT_EQ(viewer_->stats().error_px, options.*(method().size));
    bytes.push_back(viewer_->stats().session.bytes_received);
  }
  EXPECT_EQ(bytes[1], bytes[0]);
}

TEST_P(StreamedPiecesTest, aFrameDecodesItsShareAndTheRestComesInTheNextOnes) {
  openWhole(still(), file());
  pump();
  const base::Image whole = draw(view());
  StreamedOptions options = still();
  options.decode_per_frame = 1000;
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

TEST_P(StreamedPiecesTest, damagedPartsAreNamedAndOthersStandInForThem) {
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

TEST_P(StreamedPiecesTest, anotherSizeShowsInTheNextPictureAsIfItHadBeenThereFromTheBeginning) {
  std::vector<StreamedQuality> qualities(3, StreamedQuality(still()));
  const auto size = method().size;
  qualities[1].*size = 16.0F;
  qualities[2].*size = method().least;
  std::vector<base::Image> pictures;
  std::vector<std::uint64_t> drawn;
  for (const StreamedQuality& quality : qualities) {
    StreamedOptions options = still();
    static_cast<StreamedQuality&>(options) = quality;
    open(options);
    fetchAll(view());
    pictures.push_back(draw(view()));
    drawn.push_back(viewer_->stats().streamed.drawn);
    EXPECT_EQ(viewer_->stats().error_px, quality.*size);
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
  least.*size = 0.0F;
  streamed_->setQuality(least);
  EXPECT_EQ(streamed_->quality().*size, method().least);
}

TEST_P(StreamedPiecesTest, aMovingViewIsAsCoarseAsTheRateAsksForAndRestRefinesItStepByStep) {
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
  EXPECT_EQ(last, options.*(method().size));
  EXPECT_GT(viewer_->stats().streamed.drawn, 4 * moving.drawn);
}

TEST_P(StreamedPiecesTest, samplesOfAPixelAreAveraged) {
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

TEST_P(StreamedPiecesTest, theDrawnSurfaceIsFoundUnderThePointer) {
  for (const double distance : {3.5, 40.0}) {
    open(still());
    base::ViewCamera camera = view(0.0, distance);
    camera.fov_y = 2.0 * std::atan(1.6 / distance);
    if (distance > 10.0) camera.width = camera.height = 48;
    fetchAll(camera);
    const base::Image picture = draw(camera);
    int hits = 0;
    int at_the_rim = 0;  // pixels where the rasterizer rounds
    for (int y = 1; y < camera.height; y += camera.height / 16)
      for (int x = 1; x < camera.width; x += camera.width / 16) {
        const bool drawn = picture.at(x, y + kSize - camera.height)[3] != 0;
        const auto point = viewer_->surfaceAt(camera, x + 0.5, y + 0.5);
        at_the_rim += point.has_value() != drawn ? 1 : 0;
        if (!point) continue;
        ++hits;
        EXPECT_TRUE(method().is_on_surface(*point)) << point->x << " " << point->y << " " << point->z;
      }
    EXPECT_GT(hits, 30);
    EXPECT_LE(at_the_rim, 8);
  }
  // A section that takes the front shows what lies behind it.
  base::ViewCamera camera = view();
  camera.section = base::SectionPlane{{0.0, 0.0, 1.0}, 0.0};
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

TEST_P(StreamedPiecesTest, drawsCoarserBeyondTheMemoryLimit) {
  StreamedOptions options = still();
  options.memory_bytes = 2'500'000;
  open(options, method().large_file());
  fetchAll(view());
  draw(view());
  const ViewerStats stats = viewer_->stats();
  EXPECT_TRUE(stats.streamed.limited);
  EXPECT_GT(stats.streamed.drawn, 500U);
  EXPECT_LE(stats.memory.total(), options.memory_bytes);
}

TEST_P(StreamedPiecesTest, aLostContextAndALostHostComeBack) {
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
  EXPECT_NE(viewer_->session().problem().find(method().file_name), std::string::npos);
  host_->outcome = FetchOutcome::kBytes;
  for (int i = 0; i < 1000; ++i) pump();
  fetchAll(view());
  EXPECT_EQ(draw(view()).pixels, before.pixels);
}

TEST_P(StreamedPiecesTest, aHostThatCannotAnswerIsRefusedWithTheReason) {
  open(still());
  host_->outcome = FetchOutcome::kRangeIgnored;
  for (int i = 0; i < 3; ++i) pump();
  EXPECT_EQ(viewer_->session().phase(), SessionPhase::kRefused);
  EXPECT_NE(viewer_->session().problem().find(method().file_name), std::string::npos);

  const base::Bytes other(2000, 7);
  open(still(), other);
  for (int i = 0; i < 1000; ++i) pump();
  EXPECT_EQ(viewer_->session().phase(), SessionPhase::kRefused);
}

// ---- shadows of nodes ----

using lod::hlod::Shadows;

class HlodShadows : public StreamedPiecesTest {
 protected:
  /// From the side, so that bumps throw shadows on what is seen.
  static constexpr glm::dvec3 kLow{1.0, 0.3, 0.25};

  StreamedOptions shadowed(Shadows shadows) const {
    StreamedOptions options = still();
    options.shadows = shadows;
    return options;
  }
  base::Image finished(const StreamedOptions& options, const glm::dvec3& light = kLow) {
    open(options);
    viewer_->setLight(light);
    fetchAll(view());
    return draw(view());
  }
  const HlodStats stats() const { return viewer_->stats().streamed.hlod; }
  /// How many pixels the second picture shows much darker.
  static int darker(const base::Image& a, const base::Image& b) {
    int count = 0;
    for (std::size_t i = 0; i < a.pixels.size(); i += 4) count += a.pixels[i + 1] > b.pixels[i + 1] + 40 ? 1 : 0;
    return count;
  }
};

INSTANTIATE_TEST_SUITE_P(Of, HlodShadows, ::testing::Values(&hlod()), nameOfMethod);

TEST_P(HlodShadows, fallOnTheSideAwayFromTheLightHoweverTheCastersCame) {
  const base::Image lit = finished(still());
  const base::Image hard = finished(shadowed(Shadows::kHard));
  EXPECT_EQ(stats().shadows, Shadows::kHard);
  EXPECT_GT(stats().casters, 1U);
  EXPECT_GT(darker(lit, hard), 300);
  const base::Image other = finished(shadowed(Shadows::kHard), {-1.0, 0.3, 0.25});
  EXPECT_GT(darker(hard, other), 300);
  EXPECT_GT(darker(other, hard), 300);

  // Casters that come one after the other end in the same picture.
  open(shadowed(Shadows::kHard));
  viewer_->setLight(kLow);
  host_->at_a_time = 1;
  for (int i = 0; i < 2000 && !viewer_->stats().complete; ++i) {
    pump();
    draw(view());
  }
  EXPECT_EQ(draw(view()).pixels, hard.pixels);
  openWhole(shadowed(Shadows::kHard), file());
  viewer_->setLight(kLow);
  pump();
  EXPECT_EQ(draw(view()).pixels, hard.pixels);
}

TEST_P(HlodShadows, aLightThatHasAPlaceShinesFromThereUntilTheViewerHasOneOfTheirOwn) {
  StreamedOptions options = shadowed(Shadows::kHard);
  const base::Image own = finished(options);
  options.light_position = glm::dvec3(-2.0, 0.0, 0.6);
  EXPECT_EQ(finished(options).pixels, own.pixels);
  open(options);
  fetchAll(view());
  const base::Image placed = draw(view());
  EXPECT_GT(darker(own, placed), 300);
}

TEST_P(HlodShadows, aLightThatHasAPlaceAndNoSizeIsAsWideAsTheSunWhenShadowsBecomeSoft) {
  StreamedOptions options = shadowed(Shadows::kHard);
  options.light_position = glm::dvec3(-2.0, 0.0, 0.6);
  options.light_size = 0.0F;
  open(options);
  fetchAll(view());
  const base::Image hard = draw(view());
  StreamedQuality quality = streamed_->quality();
  quality.shadows = Shadows::kSoft;
  streamed_->setQuality(quality);
  fetchAll(view());
  const base::Image soft = draw(view());
  EXPECT_EQ(stats().shadows, Shadows::kSoft);
  EXPECT_NE(soft.pixels, hard.pixels);
}

TEST_P(HlodShadows, softOnesAreHardWhileViewOrLightMoveAndSoftWhenBothRest) {
  const base::Image soft = finished(shadowed(Shadows::kSoft));
  EXPECT_EQ(stats().shadows, Shadows::kSoft) << "every frame is as fine as at rest";
  StreamedOptions options = shadowed(Shadows::kSoft);
  double clock = 0.0;
  makeLate(options, clock);
  open(options);
  viewer_->setLight(kLow);
  const auto expectRest = [&] {
    int frames = 0;
    for (; frames < 1000 && !viewer_->stats().complete; ++frames) {
      pump();
      draw(view());
    }
    EXPECT_LT(frames, 1000);
    EXPECT_FALSE(viewer_->stats().busy);
    EXPECT_EQ(stats().shadows, Shadows::kSoft);
    EXPECT_EQ(draw(view()).pixels, soft.pixels);
  };
  for (int i = 0; i < 20; ++i) {
    pump();
    draw(view(0.01 * i));
  }
  EXPECT_EQ(stats().shadows, Shadows::kHard);
  EXPECT_FALSE(viewer_->stats().complete);
  EXPECT_TRUE(viewer_->stats().busy);
  expectRest();
  viewer_->setLight(glm::dvec3(1.0, 0.35, 0.25));
  draw(view());
  EXPECT_EQ(stats().shadows, Shadows::kHard);
  EXPECT_TRUE(viewer_->stats().busy);
  viewer_->setLight(kLow);
  expectRest();
}

// Else a map with texels for half a pixel would be most of the work of a view whose nodes are off by several.
TEST_P(HlodShadows, texelsOfAViewThatMovesAreAsCoarseAsItsNodes) {
  StreamedOptions options = shadowed(Shadows::kHard);
  double clock = 0.0;
  makeLate(options, clock);
  open(options);
  viewer_->setLight(kLow);
  for (int i = 0; i < 200; ++i) {
    pump();
    draw(view(0.01 * i));
  }
  EXPECT_GT(viewer_->stats().streamed.error_px, 4.0F * options.error_px);
  const std::uint64_t moving = stats().shadow_texels;
  EXPECT_GT(moving, 0U);
  for (int frames = 0; frames < 1000 && !viewer_->stats().complete; ++frames) {
    pump();
    draw(view(1.99));
  }
  EXPECT_GT(stats().shadow_texels, 8 * moving);
  EXPECT_LT(stats().shadow_texels, 40 * moving);
}

TEST_P(HlodShadows, keepTheMemoryLimit) {
  StreamedOptions options = shadowed(Shadows::kHard);
  options.memory_bytes = 2'500'000;
  open(options, method().large_file());
  viewer_->setLight(kLow);
  for (const Shadows shadows : {Shadows::kHard, Shadows::kSoft, Shadows::kNone, Shadows::kSoft}) {
    StreamedQuality quality = streamed_->quality();
    quality.shadows = shadows;
    streamed_->setQuality(quality);
    fetchAll(view());
    draw(view());
    EXPECT_EQ(stats().shadows, shadows);
    EXPECT_LE(viewer_->stats().memory.total(), options.memory_bytes);
    EXPECT_GT(viewer_->stats().streamed.drawn, 500U);
  }
}

}  // namespace
}  // namespace client
