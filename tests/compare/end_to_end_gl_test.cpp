// Tests the whole way from a mesh to a picture: hierarchy, repository, server, socket, client.
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <thread>

#include "base/jpeg/jpeg.h"
#include "base/json/scene_file.h"
#include "client/native/headless.h"
#include "compare/accuracy.h"
#include "compare/run.h"
#include "repository/faces/coverage.h"
#include "repository/faces/face_value.h"
#include "repository/sampling/cube_face.h"
#include "server/net/server.h"
#include "tests/support/baked_statue.h"

namespace {

namespace fs = std::filesystem;

/// Holds a baked scene of the generated statue, made once for all tests here.
class EndToEnd : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    support::BakedStatue statue;
    support::bakeStatue("end_to_end", statue);
    directory_ = statue.directory;
    scene_ = statue.scene;
    grid_ = statue.grid;
  }
  static void TearDownTestSuite() { fs::remove_all(directory_); }

  // Returns the stored face as RGBA, or an empty image.
  static base::Image storedFace(const repository::FaceKey& key) {
    auto store = repository::openLmdbStore(directory_ + "/images", repository::StoreMode::kRead);
    if (!store) return {};
    auto bytes = (*store)->get(key);
    if (!bytes || !bytes->has_value()) return {};
    auto value = repository::decodeFaceValue(**bytes);
    if (!value || value->empty) return {};
    auto rgb = base::decodeJpeg(value->picture);
    if (!rgb) return {};
    base::Image rgba(rgb->width, rgb->height, 4);
    base::Image mask(rgb->width, rgb->height, 1);
    std::fill(mask.pixels.begin(), mask.pixels.end(), std::uint8_t{255});
    if (!value->coverage.empty()) mask = repository::decodeCoverage(value->coverage, rgb->width, rgb->height).value();
    for (std::size_t i = 0; i < mask.pixels.size(); ++i) {
      for (std::size_t c = 0; c < 3; ++c) rgba.pixels[4 * i + c] = rgb->pixels[3 * i + c];
      rgba.pixels[4 * i + 3] = mask.pixels[i];
    }
    return rgba;
  }

  static base::ViewCamera faceView(const repository::FaceKey& key) {
    base::ViewCamera view;
    view.position = scene_.origin + glm::dvec3(grid_.point(key.x, key.y, key.z));
    view.direction = glm::dvec3(repository::faceDirection(key.d));
    view.up = glm::dvec3(repository::faceUp(key.d));
    view.fov_y = 0.5 * M_PI;
    view.width = view.height = static_cast<int>(grid_.face_size);
    return view;
  }

  // Draws pictures along a path with a server and a client over a socket.
  static std::vector<base::Image> view(const std::vector<base::ViewCamera>& path, bool images, float tolerance,
                                       int samples = 16) {
    std::vector<base::Image> pictures;
    server::ServerOptions options;
    options.port = 0;
    options.render_frames = false;
    auto server = server::Server::open({directory_}, options);
    EXPECT_TRUE(server) << server.error().message;
    if (!server) return pictures;
    std::thread thread([&] { (void)(*server)->run(false); });
    client::HeadlessOptions headless;
    headless.url = "ws://127.0.0.1:" + std::to_string((*server)->port()) + "/";
    headless.path = path;
    headless.settle_seconds = 60;
    headless.viewer.session.images = images;
    headless.viewer.session.frames = false;
    headless.viewer.session.setPatchTolerance(tolerance);
    headless.viewer.lumigraph.max_samples = samples;
    headless.viewer.method = images ? client::Method::kLumigraph : client::Method::kPatches;
    headless.on_frame = [&](const client::HeadlessFrame& frame) {
      EXPECT_TRUE(frame.stats.complete) << "frame " << frame.index;
      pictures.push_back(frame.image);
    };
    auto done = client::runHeadless(headless);
    EXPECT_TRUE(done) << done.error().message;
    (*server)->stop();
    thread.join();
    return pictures;
  }

  inline static std::string directory_;
  inline static base::Scene scene_;
  inline static repository::Grid grid_;
};

// PSNR over the pixels that both pictures cover.
double psnrWhereBothCover(const base::Image& a, const base::Image& b) {
  double squares = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < a.pixels.size(); i += 4) {
    if (a.pixels[i + 3] < 255 || b.pixels[i + 3] < 255) continue;
    for (std::size_t c = 0; c < 3; ++c, ++count)
      squares += std::pow(double{1.0} * a.pixels[i + c] - b.pixels[i + c], 2);
  }
  EXPECT_GT(count, a.pixels.size() / 40) << "too little of the model in view to judge";
  return 10.0 * std::log10(255.0 * 255.0 * static_cast<double>(count) / std::max(squares, 1e-9));
}

TEST_F(EndToEnd, blendedViewAtAGridPointIsTheStoredFace) {
  int looked = 0;
  for (std::uint32_t d = 0; d < 6 && looked < 3; ++d) {
    // The point is in front of the middle of the model, on the outer layer, and the face looks in along d.
    glm::uvec3 p = grid_.count / 2U;
    const auto axis = static_cast<int>(d / 2);
    p[axis] = d % 2 == 0 ? 0 : grid_.count[axis] - 1;
    const repository::FaceKey key{p.x, p.y, p.z, d};
    const base::Image stored = storedFace(key);
    if (stored.empty()) continue;
    ++looked;
    // Other images that see the same surface keep a small weight at a grid point, so fewer blended images are nearer to
    // the stored one. Measured in the three directions: 44.8, 43.8 and 63.6 dB with 4 images, 39.9, 40.5 and 55.2 dB
    // with 16, the default.
    for (const auto& [samples, min_db] : {std::pair{4, 40.0}, std::pair{16, 39.0}}) {
      const auto pictures = view({faceView(key)}, true, 1.0F, samples);
      ASSERT_EQ(pictures.size(), 1U);
      EXPECT_GE(psnrWhereBothCover(pictures[0], stored), min_db) << "direction " << d << ", " << samples << " images";
    }
  }
  EXPECT_EQ(looked, 3);
}

TEST_F(EndToEnd, imagesBringTheProxyNearerToTheTruth) {
  compare::RunOptions options;
  options.scene = directory_;
  options.report = directory_ + "/report";
  // The cameras stand outside, between grid points.
  const glm::dvec3 center = 0.5 * (scene_.box_min + scene_.box_max);
  for (double angle : {0.4, 2.1, 4.0}) {
    base::ViewCamera camera;
    camera.position =
        center + 0.8 * glm::length(scene_.box_max - scene_.box_min) * glm::dvec3(std::cos(angle), 0.3, std::sin(angle));
    camera.direction = glm::normalize(center - camera.position);
    camera.width = 320;
    camera.height = 240;
    options.path.push_back(camera);
  }
  options.patch_tolerances = {8};
  options.proxy_tolerance = 4;
  options.truth_supersampling = 2;
  options.frames = false;
  options.settle_seconds = 60;
  auto runs = compare::runComparison(options, [](const std::string&) {});
  ASSERT_TRUE(runs) << runs.error().message;
  ASSERT_EQ(runs->size(), 3U);
  const auto& lumigraph = (*runs)[0];
  const auto& proxy = (*runs)[1];
  EXPECT_EQ(lumigraph.method, "lumigraph");
  EXPECT_EQ(proxy.method, "proxy");
  EXPECT_GT(lumigraph.meanPsnr(), proxy.meanPsnr() + 3.0);
  EXPECT_GT(lumigraph.totalBytes(), proxy.totalBytes());
  for (const auto& frame : lumigraph.frames) EXPECT_TRUE(frame.complete);
  EXPECT_TRUE(fs::exists(options.report + "/index.html"));
  EXPECT_EQ(std::distance(fs::directory_iterator(options.report + "/truth"), fs::directory_iterator()), 3);
}

}  // namespace
