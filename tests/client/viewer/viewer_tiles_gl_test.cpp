// A viewer of a scene whose faces are pyramids of tiles: the tiles are cut from the server's own pictures, stored as
// the repository stores them, sent, decoded and blended.
#include <cmath>
#include <limits>
#include <set>

#include "base/jpeg/jpeg.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_image.h"
#include "repository/faces/face_value.h"
#include "repository/sampling/cube_face.h"
#include "server/render/scene_renderer.h"
#include "tests/client/viewer/viewer_fixture.h"
#include "tests/support/temporary_directory.h"

namespace client {
namespace {

using repository::FaceKey;
using repository::kTileBorder;
using repository::kTileCore;
using repository::kTileSide;

constexpr std::uint32_t kDepth = 2;
constexpr std::uint32_t kDown = 5;
constexpr int kWidth = 320, kHeight = 240;

/// Decodes at once.
class ImmediateDecoder : public ImageDecoder {
 public:
  void submit(std::uint64_t id, base::ByteView coded) override {
    auto image = repository::decodeFaceImage(coded, 0);
    done_.push_back({id, image ? std::move(*image) : base::Image{}, image ? "" : image.error().message});
  }
  std::vector<DecodedImage> takeDecoded() override { return std::exchange(done_, {}); }
  std::size_t pending() const override { return done_.size(); }

 private:
  std::vector<DecodedImage> done_;
};

/// Returns the picture with half as many pixels on each side.
base::Image halved(const base::Image& image) {
  base::Image half(image.width / 2, image.height / 2, 4);
  for (int y = 0; y < half.height; ++y)
    for (int x = 0; x < half.width; ++x)
      for (int c = 0; c < 4; ++c) {
        const int sum = image.at(2 * x, 2 * y)[c] + image.at(2 * x + 1, 2 * y)[c] + image.at(2 * x, 2 * y + 1)[c] +
                        image.at(2 * x + 1, 2 * y + 1)[c];
        half.at(x, y)[c] = static_cast<std::uint8_t>((sum + 2) / 4);
      }
  return half;
}

base::Image cut(const base::Image& image, std::uint32_t left, std::uint32_t top, std::uint32_t side) {
  base::Image part(static_cast<int>(side), static_cast<int>(side), 4);
  for (int y = 0; y < part.height; ++y)
    for (int x = 0; x < part.width; ++x)
      std::copy_n(image.at(static_cast<int>(left) + x, static_cast<int>(top) + y), 4, part.at(x, y));
  return part;
}

base::Bytes valueOf(const base::Image& rgba, std::uint8_t children) {
  base::Image rgb(rgba.width, rgba.height, 3);
  base::Image mask(rgba.width, rgba.height, 1);
  bool any = false;
  for (int y = 0; y < rgba.height; ++y)
    for (int x = 0; x < rgba.width; ++x) {
      std::copy_n(rgba.at(x, y), 3, rgb.at(x, y));
      mask.at(x, y)[0] = rgba.at(x, y)[3] >= 128 ? 255 : 0;
      any = any || mask.at(x, y)[0] != 0;
    }
  if (!any) return repository::encodeFaceValue({});
  const auto jpeg = base::encodeJpeg(rgb, 95, base::Subsampling::k444);
  EXPECT_TRUE(bool(jpeg));
  const base::Bytes coverage = repository::encodeCoverage(mask);
  return repository::encodeFaceValue({false, *jpeg, coverage, children});
}

double psnr(const base::Image& a, const base::Image& b) {
  double sum = 0.0;
  for (std::size_t i = 0; i < a.pixels.size(); ++i) {
    const double d = static_cast<double>(a.pixels[i]) - static_cast<double>(b.pixels[i]);
    sum += d * d;
  }
  return sum == 0.0 ? 99.0 : 10.0 * std::log10(255.0 * 255.0 * static_cast<double>(a.pixels.size()) / sum);
}

constexpr int kLeaves = 32;

/// The square of the scripted scene, of 128 units with vertices 1 apart, and four sampling points 120 above it. Their
/// tiles have 1, 2 and 4 pixels a unit.
class ViewerTiles : public ViewerFixture {
 protected:
  ViewerTiles() : ViewerFixture(kLeaves) { server.welcome.grid.spacing = 64.0F; }
  void SetUp() override {
    ViewerFixture::SetUp();
    auto made = base::gl::RenderTarget::create(kWidth, kHeight);
    ASSERT_TRUE(bool(made));
    target = std::move(*made);
    plain_grid_ = server.welcome.grid;
    server.welcome.grid = repository::withTiles(server.welcome.grid, kDepth);
    plain_grid_.face_size = server.welcome.grid.face_size;
    const std::string path = directory_ / "patch.lgp";
    ASSERT_TRUE(bool(support::writeSynthetic(support::syntheticHierarchy(kLeaves), path)));
    auto patches = lod::patch::PatchFile::open(path);
    ASSERT_TRUE(bool(patches)) << patches.error().message;
    patches_.emplace(std::move(*patches));
    base::Scene scene;
    scene.origin = server.welcome.origin;
    scene.box_min = scene.origin + glm::dvec3(server.welcome.box_min);
    scene.box_max = scene.origin + glm::dvec3(server.welcome.box_max);
    // The viewer shades by another light than that of the pictures, so that a place without images shows.
    server.welcome.light_direction = glm::normalize(glm::vec3(1.0F, 0.0F, 0.2F));
    scene.light.direction = glm::normalize(glm::vec3(0.3F, 0.3F, 1.0F));
    auto renderer = server::SceneRenderer::create(scene, *patches_);
    ASSERT_TRUE(bool(renderer)) << renderer.error().message;
    renderer_ = std::move(*renderer);
  }
  void TearDown() override {
    renderer_.reset();
    ViewerFixture::TearDown();
  }
  std::unique_ptr<ImageDecoder> makeDecoder() override { return std::make_unique<ImmediateDecoder>(); }

  void openAll(ViewerOptions options = {}) {
    options.session.setPatchTolerance(0.0F);
    options.samples = 1;
    options.lumigraph.tuning.shade_weight = 0.0F;  // images alone colour the surface
    open(options);
    receiveAllGroups();
  }
  base::Image picture(const base::Camera& camera) {
    auto drawn = renderer_->render(camera, {.tolerance_px = 0.0F, .supersampling = 2});
    EXPECT_TRUE(bool(drawn));
    return drawn->rgba;
  }
  base::Sphere sphere() const {
    const protocol::Welcome& w = server.welcome;
    return {0.5F * (w.box_min + w.box_max), 0.5F * glm::length(w.box_max - w.box_min)};
  }
  static std::vector<FaceKey> faces() {
    return {{1, 1, 2, kDown}, {2, 1, 2, kDown}, {1, 2, 2, kDown}, {2, 2, 2, kDown}};
  }
  void send(const FaceKey& key, const base::Bytes& value) {
    receive(protocol::encode(protocol::ServerMessage(protocol::Face{key, value})));
  }

  /// Sends the tiles of one depth of a face, those of the places that `wanted` names.
  void sendTiles(const FaceKey& face, std::uint32_t depth,
                 const std::function<bool(const repository::TilePlace&)>& wanted = {}) {
    base::Image whole = picture(repository::wholeFaceCamera(server.welcome.grid, face, sphere()));
    for (std::uint32_t d = kDepth; d > depth; --d) whole = halved(whole);
    const std::uint32_t first = (kTileBorder << depth) - kTileBorder;
    for (std::uint32_t y = 0; y < 1U << depth; ++y)
      for (std::uint32_t x = 0; x < 1U << depth; ++x) {
        if (wanted && !wanted({depth, x, y})) continue;
        FaceKey key = face;
        key.tile = repository::tileAt({depth, x, y});
        const base::Image tile = cut(whole, first + kTileCore * x, first + kTileCore * y, kTileSide);
        send(key, valueOf(tile, depth < kDepth ? 0xF : 0));
      }
  }
  /// A view of a part of the square, of 3.6 pixels a unit.
  base::ViewCamera look() const {
    base::ViewCamera view = server.lookDown(80.0);
    view.position += glm::dvec3(1.7, -1.4, 0.0);
    view.width = kWidth;
    view.height = kHeight;
    return view;
  }
  base::Image truth() { return picture(base::cameraForScene(look(), server.welcome.origin, sphere())); }

  support::TemporaryDirectory directory_;
  repository::Grid plain_grid_;
  std::optional<lod::patch::PatchFile> patches_;
  std::unique_ptr<server::SceneRenderer> renderer_;
};

TEST_F(ViewerTiles, theirPictureIsThatOfWholeFacesWithAsManyPixels) {
  ViewerOptions options;
  options.lumigraph.max_samples = 5;
  openAll(options);
  for (const FaceKey& face : faces())
    for (std::uint32_t depth = 0; depth <= kDepth; ++depth) sendTiles(face, depth);
  const base::Image tiled = settle(look());
  EXPECT_EQ(viewer->stats().broken, 0U) << viewer->stats().last_fault;
  EXPECT_GT(viewer->stats().lumigraph.samples_used, 5U) << "of a quarter of an image each";
  EXPECT_LE(viewer->stats().lumigraph.samples_used, 20U);

  server.welcome.grid = plain_grid_;
  openAll(options);
  for (const FaceKey& face : faces())
    send(face, valueOf(picture(repository::faceCamera(plain_grid_, face, sphere())), 0));
  const base::Image plain = settle(look());
  EXPECT_EQ(viewer->stats().broken, 0U) << viewer->stats().last_fault;
  EXPECT_EQ(viewer->stats().lumigraph.samples_used, 4U);
  EXPECT_GE(psnr(plain, tiled), 40.0);
  EXPECT_GE(psnr(truth(), tiled), psnr(truth(), plain) - 0.3);
}

TEST_F(ViewerTiles, aViewThatHasAllIsBlendedFromMoreOfThem) {
  ViewerOptions options;
  options.lumigraph.max_samples = 2;
  openAll(options);
  for (const FaceKey& face : faces()) sendTiles(face, kDepth);
  settle(look());
  EXPECT_EQ(viewer->stats().lumigraph.samples_used, 8U);
  std::uint32_t sequence = 0;
  while (const auto bytes = viewer->session().nextToSend())
    if (const auto message = protocol::decodeClientMessage(*bytes))
      if (const auto* view = std::get_if<protocol::View>(&*message)) sequence = view->sequence;
  receive(protocol::encode(protocol::Completion{sequence}));
  ASSERT_TRUE(viewer->session().complete());
  EXPECT_GE(psnr(truth(), settle(look())), 40.0);
  EXPECT_EQ(viewer->stats().lumigraph.samples_used, 12U);

  // One that moves on is blended from as many as before, once it lacks something.
  base::ViewCamera further = look();
  further.position += glm::dvec3(0.5, 0.0, 0.0);
  settle(further);
  EXPECT_EQ(viewer->stats().lumigraph.samples_used, 8U);
}

TEST_F(ViewerTiles, coarseOnesShowFirstAndFinerOnesSharpenThePicture) {
  openAll();
  const base::Image exact = truth();
  double before = psnr(exact, settle(look()));
  for (std::uint32_t depth = 0; depth <= kDepth; ++depth) {
    for (const FaceKey& face : faces()) sendTiles(face, depth);
    const base::Image now = settle(look());
    EXPECT_EQ(covered(now), covered(exact));
    EXPECT_GE(psnr(exact, now), depth == 0 ? 0.0 : before + 1.0) << depth;
    before = psnr(exact, now);
  }
}

TEST_F(ViewerTiles, whereFinerOnesAreMissingTheirAncestorShows) {
  openAll();
  const base::Image exact = truth();
  for (const FaceKey& face : faces()) sendTiles(face, 0);
  const double coarse = psnr(exact, settle(look()));
  // Tiles whose children are not stored have all there is to see; here the finest are stored only for a half.
  for (const FaceKey& face : faces()) {
    sendTiles(face, 1);
    sendTiles(face, 2, [](const repository::TilePlace& place) { return place.x < 2; });
  }
  const base::Image half = settle(look());
  EXPECT_EQ(covered(half), covered(exact));
  const double halfway = psnr(exact, half);
  for (const FaceKey& face : faces()) sendTiles(face, 2);
  const double all = psnr(exact, settle(look()));
  EXPECT_GT(halfway, coarse + 1.0);
  EXPECT_GT(all, halfway + 0.5);
}

TEST_F(ViewerTiles, thoseOfThePictureStayWhateverArrives) {
  ViewerOptions options;
  options.session.cache_bytes = 2'000'000;
  openAll(options);
  for (const FaceKey& face : faces())
    for (std::uint32_t depth = 0; depth <= kDepth; ++depth) sendTiles(face, depth);
  const base::Image before = settle(look());
  const base::Bytes filler(60'000, 0x5A);
  for (std::uint32_t i = 0; i < 200; ++i) send({i % 4, i / 4 % 4, 0, 4, i / 16}, filler);
  const base::Image after = settle(look());
  EXPECT_GE(psnr(after, before), 50.0);
  EXPECT_LE(viewer->stats().session.cache_bytes, 2'000'000U);
}

}  // namespace
}  // namespace client
