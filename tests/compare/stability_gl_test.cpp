// Every method where methods fail: a scene and views for each way to fail, and for each method how far off it is when
// everything has arrived. stability.csv holds the bounds (docs/stability.md).
//
// LUMIGRID_STABILITY=FOLDER: larger pictures, kept there beside the figures, as `./test --stability` asks for.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <optional>
#include <ostream>

#include "base/file.h"
#include "base/format_text.h"
#include "base/jpeg/jpeg.h"
#include "base/json/camera_file.h"
#include "base/png/png.h"
#include "compare/accuracy.h"
#include "compare/csv.h"
#include "compare/sim/matrix.h"
#include "repository/store.h"
#include "tests/support/added_methods.h"
#include "tests/support/failure_meshes.h"
#include "tests/support/made_scene.h"
#include "tests/support/mesh_reader.h"
#include "tests/support/temporary_directory.h"

namespace {

using support::Mesh;
using Views = std::vector<base::ViewCamera>;

std::string reportFolder() {
  const char* folder = std::getenv("LUMIGRID_STABILITY");
  return folder == nullptr ? "" : folder;
}

base::ViewCamera lookAt(const glm::dvec3& from, const glm::dvec3& to) {
  base::ViewCamera view;
  view.position = from;
  view.direction = glm::normalize(to - from);
  view.up = std::abs(view.direction.z) > 0.99 ? glm::dvec3(0, 1, 0) : glm::dvec3(0, 0, 1);
  view.width = reportFolder().empty() ? 320 : 960;
  view.height = view.width * 3 / 4;  // a sheet shrinks it to kCell
  return view;
}

Mesh scan() {
  mesh::generate::SampleOptions sample;
  sample.triangles = 60'000;
  return support::makeSample(sample);
}

/// Looks at the middle of a box from `diagonals` away.
base::ViewCamera lookAtBox(const base::Scene& scene, double diagonals) {
  const glm::dvec3 middle = 0.5 * (scene.box_min + scene.box_max);
  const double size = glm::length(scene.box_max - scene.box_min);
  return lookAt(middle + diagonals * size * glm::normalize(glm::dvec3(1.1, 0.5, 0.3)), middle);
}

/// The place of a grid's point, world, moved by `cells` of its spacing.
glm::dvec3 pointOf(const base::Scene& scene, const repository::Grid& grid, const glm::vec3& cells) {
  return scene.origin + glm::dvec3(grid.point(3, 1, 2) + grid.spacing * cells);
}

Views at(const glm::dvec3& from, const glm::dvec3& to) {
  return {lookAt(from, to)};
}

/// One way to fail.
struct Failure {
  std::string name;
  std::function<Mesh()> mesh;
  std::function<Views(const base::Scene&, const repository::Grid&)> views;
  double lost_faces = 0.0;  ///< share of the repository's images that are gone
};

std::vector<Failure> failures() {
  const auto fixed = [](const glm::dvec3& from, const glm::dvec3& to) {
    return [from, to](const base::Scene&, const repository::Grid&) { return at(from, to); };
  };
  const auto scanFrom = [](double diagonals) {
    return
        [diagonals](const base::Scene& scene, const repository::Grid&) { return Views{lookAtBox(scene, diagonals)}; };
  };
  const auto scanFromPoint = [](const glm::vec3& cells) {
    return [cells](const base::Scene& scene, const repository::Grid& grid) {
      return at(pointOf(scene, grid, cells), 0.5 * (scene.box_min + scene.box_max));
    };
  };
  const auto farAway = [] {
    Mesh mesh = scan();
    mesh.origin = {1e6, 4e6, 100.0};
    return mesh;
  };
  const auto teleports = [](const base::Scene& scene, const repository::Grid&) {
    Views views;
    const glm::dvec3 middle = 0.5 * (scene.box_min + scene.box_max);
    const double size = glm::length(scene.box_max - scene.box_min);
    for (int i = 0; i < 60; ++i)
      views.push_back(lookAt(middle + size * glm::dvec3(std::cos(2.4 * i), std::sin(2.4 * i), 0.5), middle));
    return views;
  };
  const auto boxes = [] {
    Mesh mesh = support::box({-1, -1, -0.1F}, {1, 1, 0}, 1);
    support::append(mesh, support::box({-0.3F, -0.3F, 0.001F}, {0.3F, 0.3F, 0.6F}, 1));
    return mesh;
  };
  const auto ball = [] { return support::bumpySphere(100, 200, 0.05F); };
  return {
      {"even_scan", scan, scanFrom(1.2)},
      {"close_up", ball, fixed({1.25, 0.0, 0.0}, {0.9, 0.05, 0.05})},
      {"deep_concavity", support::cup, fixed({0.28, 0.1, 1.9}, {0, 0, -0.9})},
      {"interior", support::room, fixed({-0.75, -0.7, 0.05}, {0.4, 0.3, 0})},
      {"thin_wires", support::wires, fixed({1.6, 1.2, 1.2}, {0, 0, 0})},
      {"leaves", support::leaves, fixed({2.0, 1.0, 0.8}, {0, 0, 0})},
      {"large_flats", boxes, fixed({2.2, 1.4, 1.6}, {0, 0, 0.1})},
      {"sharp_corners", [] { return support::box(glm::vec3(-0.5F), glm::vec3(0.5F), 60); },
       fixed({1.3, 1.0, 0.9}, {0.2, 0.2, 0.2})},
      {"silhouette_against_detail", support::ballBeforeSpeckles, fixed({0.9, 0.2, 1.4}, {0.5, 0.5, 0.1})},
      {"fine_colors", support::speckledPlate, fixed({0.5, -0.3, 0.9}, {0.5, 0.5, 0})},
      {"inside_the_model", ball, fixed({0.3, 0.2, 0.1}, {1, 0.1, 0})},
      {"far_outside", scan, scanFrom(8.0)},
      {"on_a_grid_point", scan, scanFromPoint(glm::vec3(0.0F))},
      {"on_a_cell_face", scan, scanFromPoint({0.5F, 0.5F, 0.0F})},
      {"teleports_every_frame", scan, teleports},
      {"noisy_lines", support::noisyLines, fixed({0.5, -0.4, 0.7}, {0.5, 0.5, 0})},
      {"giant_triangle", support::ballOnAGiant, fixed({4.5, 3.0, 3.0}, {0, 0, 0.5})},
      {"coordinates_of_a_million", farAway, scanFrom(1.2)},
      {"repository_with_holes", scan, scanFrom(1.2), 0.4},
  };
}

/// At rest images may take so many decibels from what patches alone show. An eye on a grid point loses 0.3: its image
/// is believed, whatever it costs.
constexpr double kHarmDb = 0.5;

struct Bound {
  double min_psnr_db = 0.0;
  double max_holes_share = 1.0;
};
void PrintTo(const Failure& failure, std::ostream* out) {
  *out << failure.name;
}

/// By failure and method.
using Bounds = std::map<std::pair<std::string, std::string>, Bound>;

Bounds readBounds() {
  const auto bytes = base::readFile(LUMIGRID_SOURCE_DIR "/tests/compare/stability.csv");
  EXPECT_TRUE(bytes) << bytes.error().message;
  const auto table = bytes ? compare::parseCsv({bytes->begin(), bytes->end()}) : std::nullopt;
  EXPECT_TRUE(table) << "stability.csv is no table";
  Bounds bounds;
  for (const auto& row : table.value_or(compare::CsvTable()).rows)
    bounds[{row.at("failure"), row.at("method")}] = {std::stod(row.at("min_psnr_db")),
                                                     std::stod(row.at("max_holes_share"))};
  return bounds;
}

class Stability : public testing::TestWithParam<Failure> {
 protected:
  void build(const Failure& failure) {
    Mesh mesh = failure.mesh();
    support::colorByPlace(mesh);
    const support::SceneContents contents{.splats = true, .points = 5};
    const auto scene = support::makeScene(mesh, directory_.path(), contents);
    ASSERT_TRUE(scene) << scene.error().message;
    for (const auto add : {support::addNodes, support::addUmbrellas}) {
      const auto added = add(mesh, directory_.path());
      ASSERT_TRUE(added) << added.error().message;
    }
    scene_ = *scene;
    grid_ = support::gridOf(*scene, contents);
    if (failure.lost_faces > 0.0) loseFaces(failure.lost_faces);
  }
  void loseFaces(double lost_faces) {
    auto store = repository::openLmdbStore(directory_ / "images", repository::StoreMode::kWrite);
    ASSERT_TRUE(store) << store.error().message;
    std::vector<repository::FaceKey> lost;
    ASSERT_TRUE((*store)->forEachKey([&](const repository::FaceKey& key) {
      const std::uint32_t mixed = 7 * key.x + 13 * key.y + 29 * key.z + 5 * key.d;
      if (mixed % 10 < 10.0 * lost_faces) lost.push_back(key);
      return true;
    }));
    ASSERT_TRUE((*store)->erase(lost));
  }
  std::vector<compare::PlayedRun> play(const std::string& name, const Views& views) {
    compare::MatrixOptions options;
    options.scenes = {directory_.path()};
    options.parts = {{{"orbit"}, {compare::parseLink("1Gbit/1ms").value()}}};
    options.path_files = {directory_ / "path.json"};
    options.stop_seconds = 0.5;
    options.play.instants = 1;
    options.truth_supersampling = 8;  // 4 x 4 samples in rows and columns suit some samplings of upright edges
    options.report = reportFolder().empty() ? directory_ / "report" : reportFolder() + "/" + name;
    options.pictures = !reportFolder().empty();
    const base::CameraPath path{views, views.size() > 1 ? 60.0 : 0.0, views.size() > 1};
    EXPECT_TRUE(base::writeFileAtomically(options.path_files[0], base::viewOfText(base::formatCameraPath(path))));
    auto runs = compare::playMatrix(options, [](const std::string&) {});
    EXPECT_TRUE(runs) << runs.error().message;
    return runs ? std::move(*runs) : std::vector<compare::PlayedRun>();
  }

  // ---- the picture of docs/stability.md: a row for each failure, of the truth and of each method at rest ----

  static constexpr int kCell = 192, kShrink = 5, kColumns = 8;
  inline static std::vector<std::vector<base::Image>> sheet_;

  /// The picture over grey, a fifth as wide.
  static base::Image shrunk(const std::string& file) {
    const auto picture = base::readPng(file);
    EXPECT_TRUE(picture) << file;
    if (!picture) return {kCell, kCell * 3 / 4, 3};
    const base::Image rgb = compare::overMidGrey(*picture);
    base::Image out(rgb.width / kShrink, rgb.height / kShrink, 3);
    for (int y = 0; y < out.height; ++y)
      for (int x = 0; x < out.width; ++x)
        for (int c = 0; c < 3; ++c) {
          int sum = 0;
          for (int i = 0; i < kShrink * kShrink; ++i)
            sum += rgb.at(kShrink * x + i % kShrink, kShrink * y + i / kShrink)[c];
          out.at(x, y)[c] = static_cast<std::uint8_t>(sum / (kShrink * kShrink));
        }
    return out;
  }
  static std::int64_t difference(const base::Image& a, const base::Image& b) {
    std::int64_t sum = 0;
    for (std::size_t i = 0; i < std::min(a.pixels.size(), b.pixels.size()); ++i)
      sum += std::abs(int{a.pixels[i]} - int{b.pixels[i]});
    return sum;
  }
  /// A path has a truth for each of its views, and names do not say which: the one nearest to the first method's
  /// picture is that of the last view.
  void addToSheet(const std::string& name) {
    const std::filesystem::path report = reportFolder() + "/" + name;
    std::vector<base::Image>& row = sheet_.emplace_back();
    for (const std::string method : {"lumigraph", "static", "patches", "qsplat", "pmr", "hlod", "frames"})
      for (const auto& run : std::filesystem::directory_iterator(report / "frames"))
        if (run.path().filename().string().find("_" + method + "_") != std::string::npos)
          for (const auto& file : std::filesystem::directory_iterator(run.path()))
            if (file.path().string().ends_with("_rest.png")) row.push_back(shrunk(file.path().string()));
    ASSERT_FALSE(row.empty());
    std::optional<base::Image> truth;
    for (const auto& file : std::filesystem::directory_iterator(report / "truth")) {
      base::Image other = shrunk(file.path().string());
      if (!truth || difference(other, row[0]) < difference(*truth, row[0])) truth = std::move(other);
    }
    ASSERT_TRUE(truth);
    row.insert(row.begin(), std::move(*truth));
  }
  static void TearDownTestSuite() {
    if (sheet_.empty()) return;
    const int height = kCell * 3 / 4;
    base::Image all(kColumns * kCell, static_cast<int>(sheet_.size()) * height, 3);
    for (std::size_t r = 0; r < sheet_.size(); ++r)
      for (std::size_t c = 0; c < std::min<std::size_t>(kColumns, sheet_[r].size()); ++c)
        for (int y = 0; y < height; ++y)
          std::copy_n(sheet_[r][c].at(0, y), 3 * kCell,
                      all.at(static_cast<int>(c) * kCell, static_cast<int>(r) * height + y));
    const auto jpeg = base::encodeJpeg(all, 80, base::Subsampling::k420);
    ASSERT_TRUE(jpeg);
    EXPECT_TRUE(base::writeFileAtomically(reportFolder() + "/stability.jpg", *jpeg));
  }

  const support::TemporaryDirectory directory_;
  base::Scene scene_;
  repository::Grid grid_;
};

TEST_P(Stability, everyMethodHoldsItsBounds) {
  const Failure& failure = GetParam();
  build(failure);
  if (HasFatalFailure()) return;
  const Bounds bounds = readBounds();
  const auto runs = play(failure.name, failure.views(scene_, grid_));
  EXPECT_GE(runs.size(), 6U) << "a method is left out";
  std::map<std::string, double> psnr_db;
  for (const compare::PlayedRun& run : runs) {
    const std::string& method = run.setting.method;
    const compare::DisplayedFrame& rest = run.frames.back();
    const compare::Accuracy& a = rest.accuracy;
    std::printf("%s,%s,%.2f,%.4f,%.2f\n", failure.name.c_str(), method.c_str(), a.psnr_db, a.missing_share,
                a.silhouette_p95_px);
    psnr_db[method] = a.psnr_db;
    EXPECT_EQ(rest.kind, compare::InstantKind::kRest) << method;
    EXPECT_GE(run.rest_seconds, 0.0) << method << " never came to rest";
    if (!reportFolder().empty()) continue;  // the bounds are those of small pictures
    const auto bound = bounds.find({failure.name, method});
    EXPECT_NE(bound, bounds.end()) << failure.name << "," << method << ": stability.csv has no bound";
    if (bound == bounds.end()) continue;
    EXPECT_GE(a.psnr_db, bound->second.min_psnr_db) << method;
    EXPECT_LE(a.missing_share, bound->second.max_holes_share) << method;
  }
  if (!reportFolder().empty()) return addToSheet(failure.name);
  EXPECT_GE(psnr_db["static"], psnr_db["patches"] - kHarmDb) << "images make the patches worse";
}

INSTANTIATE_TEST_SUITE_P(Where, Stability, testing::ValuesIn(failures()),
                         [](const auto& failure) { return failure.param.name; });

}  // namespace
