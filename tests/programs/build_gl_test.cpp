// Builds with images are resumed, killed and repaired.
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <map>
#include <nlohmann/json.hpp>
#include <random>
#include <thread>

#include "base/file.h"
#include "base/json/scene_file.h"
#include "repository/faces/face_value.h"
#include "repository/store.h"
#include "tests/programs/face_values.h"
#include "tests/programs/run_program.h"

namespace {

using nlohmann::json;
using programs::faceValues;
using programs::run;

class Build : public programs::ProgramTest {};

TEST_F(Build, aFinishedSceneIsDescribedAndVerified) {
  const std::string scene = smallScene();
  const auto info = run("lumigrid", {"info", scene, "--json"});
  ASSERT_EQ(info.status, 0) << info.err;
  const json j = json::parse(info.out);
  EXPECT_NEAR(j["triangles"].get<double>(), 10000, 200);
  EXPECT_EQ(j["hierarchy"]["levels"].back()["patches"], 1);
  EXPECT_LE(j["hierarchy"]["levels"].back()["triangles"].get<int>(), 2000);
  const std::uint64_t faces = j["images"]["images"].get<std::uint64_t>() + j["images"]["empty"].get<std::uint64_t>();
  EXPECT_EQ(faces, faceValues(scene).size());
  EXPECT_EQ(faces, j["images"]["expected"].get<std::uint64_t>());
  EXPECT_GT(j["images"]["empty"].get<int>(), 0);
  const auto verified = run("lumigrid", {"verify", scene});
  EXPECT_EQ(verified.status, 0) << verified.out << verified.err;

  const auto cuts = run("lumigrid", {"verify", scene, "--cuts", "3", "--seed", "5", "--json"});
  ASSERT_EQ(cuts.status, 0) << cuts.out << cuts.err;
  const json report = json::parse(cuts.out)["cuts"];
  EXPECT_EQ(report["seed"], 5);
  EXPECT_EQ(report["source"]["triangles"], j["triangles"]);
  ASSERT_EQ(report["cuts"].size(), 3U);
  for (const json& cut : report["cuts"]) EXPECT_EQ(cut["open_edges"], report["source"]["open_edges"]);
}

// A sheet of 20² quads in four tiles that were rounded apart.
std::string tiledMesh() {
  std::string vertices, faces;
  int count = 0;
  for (int tile = 0; tile < 4; ++tile) {
    const int x0 = tile % 2 * 10, y0 = tile / 2 * 10, first = count;
    for (int y = 0; y <= 10; ++y)
      for (int x = 0; x <= 10; ++x, ++count)
        vertices += std::to_string(x0 + x + 0.02 * tile) + " " + std::to_string(y0 + y - 0.03 * tile) + " " +
                    std::to_string(0.05 * tile + 0.1 * ((x0 + x) % 3)) + "\n";
    for (int y = 0; y < 10; ++y)
      for (int x = 0; x < 10; ++x) {
        const int a = first + 11 * y + x;
        faces += "4 " + std::to_string(a) + " " + std::to_string(a + 1) + " " + std::to_string(a + 12) + " " +
                 std::to_string(a + 11) + "\n";
      }
  }
  return "ply\nformat ascii 1.0\nelement vertex " + std::to_string(count) +
         "\nproperty float x\nproperty float y\nproperty float z\nelement face 400\nproperty list uchar int "
         "vertex_indices\nend_header\n" +
         vertices + faces;
}

TEST_F(Build, theTilesOfAScanAreStitchedAndThatIsTold) {
  programs::writeText(path("tiles.ply"), tiledMesh());
  const auto built = [&](const std::string& stitch) {
    const std::string scene = path("scene-" + stitch);
    const auto done =
        run("lumigrid", {"build", path("tiles.ply"), "-o", scene, "--methods", "patch", "--stitch", stitch, "--quiet"});
    EXPECT_EQ(done.status, 0) << done.err;
    const auto info = run("lumigrid", {"info", scene, "--json"});
    EXPECT_EQ(info.status, 0) << info.err;
    return json::parse(info.out);
  };
  const json off = built("off"), found = built("auto"), given = built("0.3");
  EXPECT_EQ(off["source_open_edges"], 160);
  EXPECT_EQ(off["open_edges"], 160);
  EXPECT_EQ(off["repairs"]["stitched_vertices"], 0);
  const double still = off["hierarchy"]["position_error"].get<double>();
  for (const json& j : {found, given}) {
    EXPECT_EQ(j["source_open_edges"], 160);
    EXPECT_EQ(j["open_edges"], 80);
    EXPECT_EQ(j["repairs"]["closed_holes"], 0);
    EXPECT_GT(j["repairs"]["stitched_vertices"], 40);
    const double moved = j["scene"]["largest_movement"].get<double>();
    EXPECT_GT(moved, 0.05);
    EXPECT_LT(moved, 0.25);
    EXPECT_NEAR(j["hierarchy"]["position_error"].get<double>(), still + moved, 1e-9);
  }
  programs::expectOneLineError(run("lumigrid", {"build", path("tiles.ply"), "-o", path("x"), "--stitch", "nearly"}), 2,
                               {"--stitch nearly", "auto", "off"});

  // Scenes of programs that did not stitch go on being what they are.
  json old = json::parse(programs::readText(path("scene-off/scene.json")));
  old["parameters"].erase("stitch");
  for (const char* member : {"source_open_edges", "open_edges", "largest_movement"}) old.erase(member);
  programs::writeText(path("scene-off/scene.json"), old.dump());
  const auto again = run("lumigrid", {"build", "-o", path("scene-off"), "--quiet"});
  EXPECT_EQ(again.status, 0) << again.err;
  const auto info = run("lumigrid", {"info", path("scene-off"), "--json"});
  ASSERT_EQ(info.status, 0) << info.err;
  EXPECT_FALSE(json::parse(info.out).contains("open_edges"));
  programs::expectOneLineError(
      run("lumigrid", {"build", path("tiles.ply"), "-o", path("scene-off"), "--methods", "patch", "--quiet"}), 1,
      {"scene-off", "--force"});
}

TEST_F(Build, imagesThatDoNotFitTheMemoryAreRefusedWithWhatTheyNeed) {
  const std::string mesh = smallMesh();
  const auto command = [&](const std::string& scene, const std::string& memory) {
    return std::vector<std::string>{"build",  mesh,   "-o",       scene,  "--grid", "2",
                                    "--face", "1536", "--memory", memory, "--quiet"};
  };
  const auto refused = run("lumigrid", command(path("scene"), "256M"));
  EXPECT_EQ(refused.status, 1);
  const std::string advice = "give --memory ";
  const std::size_t at = refused.err.find(advice);
  ASSERT_NE(at, std::string::npos) << refused.err;
  const std::string rest = refused.err.substr(at + advice.size());

  // The memory that the error asks for suffices, and the images do not depend on it.
  const auto built = run("lumigrid", command(path("scene"), rest.substr(0, rest.find(' '))));
  ASSERT_EQ(built.status, 0) << built.err;
  ASSERT_EQ(run("lumigrid", command(path("free"), "64G")).status, 0);
  EXPECT_EQ(faceValues(path("scene")), faceValues(path("free")));
}

TEST_F(Build, tilesAreWebpAndPlainFacesJpegUnlessAskedOtherwise) {
  const std::string mesh = smallMesh();
  const std::vector<std::pair<std::vector<std::string>, bool>> cases{{{"--tiles", "1"}, true},
                                                                     {{"--tiles", "1", "--codec", "jpeg"}, false},
                                                                     {{"--face", "64"}, false},
                                                                     {{"--face", "64", "--codec", "webp"}, true}};
  for (std::size_t i = 0; i < cases.size(); ++i) {
    const auto& [options, is_webp] = cases[i];
    const std::string scene = path("scene-" + std::to_string(i));
    std::vector<std::string> words{"build", mesh, "-o", scene, "--grid", "2", "--quiet"};
    words.insert(words.end(), options.begin(), options.end());
    const auto built = run("lumigrid", words);
    ASSERT_EQ(built.status, 0) << built.err;
    std::size_t pictures = 0;
    for (const auto& [key, bytes] : faceValues(scene)) {
      const auto value = repository::decodeFaceValue(bytes);
      ASSERT_TRUE(value);
      if (value->empty) continue;
      ++pictures;
      EXPECT_EQ(repository::isWebp(value->picture), is_webp);
    }
    EXPECT_GT(pictures, 0U);
    EXPECT_EQ(run("lumigrid", {"verify", scene}).status, 0);
    const auto missing = run("lumigrid", {"build", "-o", scene, "--missing"});
    EXPECT_EQ(missing.status, 0) << "the scene records its options: " << missing.out << missing.err;
  }
  for (const std::vector<std::string>& wrong :
       {std::vector<std::string>{"--codec", "webp", "--subsampling", "444"}, {"--codec", "webp", "--tune", "36"}}) {
    std::vector<std::string> words{"build", mesh, "-o", path("x")};
    words.insert(words.end(), wrong.begin(), wrong.end());
    programs::expectOneLineError(run("lumigrid", words), 2, {"JPEG"});
  }
}

TEST_F(Build, killedInTheMiddleItGoesOnAndEndsTheSame) {
  const std::string mesh = smallMesh();
  const std::vector<std::string> options{"--grid", "6", "--face", "64", "--batch", "100", "--quiet"};
  auto command = [&](const std::string& scene) {
    std::vector<std::string> words{"build", mesh, "-o", scene};
    words.insert(words.end(), options.begin(), options.end());
    return words;
  };
  ASSERT_EQ(run("lumigrid", command(path("whole"))).status, 0);
  const auto whole = faceValues(path("whole"));

  // Each run is killed as soon as some, but not all, of its images are there, and gets further than the one before.
  int killed = 0;
  for (int round = 0; round < 3; ++round) {
    const std::size_t before =
        std::filesystem::exists(path("killed/images/data.mdb")) ? faceValues(path("killed")).size() : 0;
    const pid_t pid = programs::start("lumigrid", command(path("killed")), path("log"));
    for (int i = 0; i < 3000; ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(5));
      if (std::filesystem::exists(path("killed/scene.json"))) break;
      if (!std::filesystem::exists(path("killed/images/data.mdb"))) continue;
      auto store = repository::openLmdbStore(path("killed/images"), repository::StoreMode::kRead);
      if (!store) continue;
      auto size = (*store)->size();
      if (size && *size >= before + 100) break;
    }
    ::kill(pid, SIGKILL);
    if (programs::wait(pid) == 128 + SIGKILL) ++killed;
    if (std::filesystem::exists(path("killed/scene.json"))) break;
  }
  ASSERT_GT(killed, 0) << "no run was killed in the middle: this test proved nothing";
  const std::size_t committed = faceValues(path("killed")).size();
  ASSERT_GT(committed, 0U);
  ASSERT_LT(committed, whole.size());

  auto words = command(path("killed"));
  words.emplace_back("--json");
  const auto rerun = run("lumigrid", words);
  ASSERT_EQ(rerun.status, 0) << rerun.err;
  const json summary = json::parse(rerun.out);
  EXPECT_EQ(summary["images"]["rendered"].get<std::size_t>(), whole.size() - committed)
      << "what was committed is not rendered again";
  EXPECT_EQ(faceValues(path("killed")), whole);
  EXPECT_EQ(base::readFile(path("killed/patch.lgp")).value(), base::readFile(path("whole/patch.lgp")).value());
  EXPECT_EQ(run("lumigrid", {"verify", path("killed")}).status, 0);
}

TEST_F(Build, interruptedItStopsCleanlyAndGoesOn) {
  const std::string mesh = smallMesh();
  const std::vector<std::string> build{"build",  mesh, "-o",      path("scene"), "--grid", "6",
                                       "--face", "64", "--batch", "20",          "--quiet"};
  const pid_t pid = programs::start("lumigrid", build, path("log"));
  for (int i = 0; i < 3000 && !std::filesystem::exists(path("scene/images/data.mdb")); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  ::kill(pid, SIGINT);
  const int status = programs::wait(pid);
  if (status == 0) GTEST_SKIP() << "the build was faster than the signal";
  EXPECT_EQ(status, 1);
  EXPECT_EQ(run("lumigrid", build).status, 0);
  EXPECT_EQ(run("lumigrid", {"verify", path("scene")}).status, 0);
}

// Another process reads and decodes all that it can see while the build runs.
TEST_F(Build, readersDuringTheBuildSeeOnlyWholeImages) {
  const std::string mesh = smallMesh();
  auto seen = [&] {
    const std::string lines = programs::readText(path("reader.out"));
    return static_cast<std::size_t>(std::count(lines.begin(), lines.end(), '\n'));
  };
  bool beside = false;
  for (int attempt = 0; attempt < 10 && !beside; ++attempt) {
    std::filesystem::remove_all(path("scene"));
    const pid_t reader = programs::start("../tests/store_reader", {path("scene/images")}, path("reader"));
    const pid_t builder = programs::start(
        "lumigrid", {"build", mesh, "-o", path("scene"), "--grid", "6", "--face", "64", "--batch", "20", "--quiet"},
        path("build"));
    // The reader has seen some images, and not all of them.
    while (seen() == 0 && !std::filesystem::exists(path("scene/scene.json")))
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    beside = !std::filesystem::exists(path("scene/scene.json"));
    EXPECT_EQ(programs::wait(builder), 0) << programs::readText(path("build.err"));

    // The reader sees all images in the end, and ends by itself only when one is broken.
    const std::size_t all = faceValues(path("scene")).size();
    while (seen() < all && ::kill(reader, 0) == 0 && programs::readText(path("reader.err")).empty())
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    EXPECT_EQ(seen(), all);
    ::kill(reader, SIGTERM);
    EXPECT_EQ(programs::wait(reader), 0) << programs::readText(path("reader.err"));
    if (HasFailure()) return;
  }
  EXPECT_TRUE(beside) << "every build was over before the reader saw anything";
}

TEST_F(Build, verifyNamesWhatIsDamaged) {
  const std::string scene = smallScene();
  const std::string patches = programs::readText(scene + "/patch.lgp");
  std::string damaged = patches;
  damaged[damaged.size() - 100] = static_cast<char>(damaged[damaged.size() - 100] ^ 0x40);
  programs::writeText(scene + "/patch.lgp", damaged);
  auto verified = run("lumigrid", {"verify", scene});
  EXPECT_EQ(verified.status, 1);
  EXPECT_NE((verified.out + verified.err).find("patch.lgp"), std::string::npos) << verified.out;
  programs::writeText(scene + "/patch.lgp", patches);
  ASSERT_EQ(run("lumigrid", {"verify", scene}).status, 0);

  // One bit of one image is wrong, and one image is gone.
  {
    const auto all = faceValues(scene);
    auto store = repository::openLmdbStore(scene + "/images", repository::StoreMode::kWrite);
    ASSERT_TRUE(store);
    auto largest = std::max_element(all.begin(), all.end(),
                                    [](const auto& a, const auto& b) { return a.second.size() < b.second.size(); });
    base::Bytes value = largest->second;
    value[value.size() / 2] ^= 1;
    ASSERT_TRUE((*store)->putBatch({{*repository::FaceKey::fromCode(largest->first), value}}));
    ASSERT_TRUE((*store)->erase({*repository::FaceKey::fromCode(all.begin()->first)}));
  }
  verified = run("lumigrid", {"verify", scene, "--json"});
  EXPECT_EQ(verified.status, 1);
  EXPECT_EQ(json::parse(verified.out)["faults"].size(), 2U) << verified.out;
}

class TunedBuild : public Build {
 protected:
  void SetUp() override {
    Build::SetUp();
    mesh_ = smallMesh();
  }
  std::vector<std::string> command(const std::string& db) {
    return {"build", mesh_, "-o", path("scene"), "--grid", "4", "--face", "64", "--tune", db, "--quiet", "--json"};
  }
  // The scene is left as if the build had been killed before its first image.
  void takeImagesAway() {
    std::filesystem::remove_all(path("scene/images"));
    std::filesystem::rename(path("scene/scene.json"), path("scene/building.json"));
  }
  void replaceInBuilding(const std::string& what, const std::string& by) {
    std::string text = programs::readText(path("scene/building.json"));
    const std::size_t at = text.find(what);
    ASSERT_NE(at, std::string::npos) << text;
    programs::writeText(path("scene/building.json"), text.replace(at, what.size(), by));
  }
  std::string mesh_;
};

TEST_F(TunedBuild, theChoiceIsToldKeptAndShown) {
  const auto built = run("lumigrid", command("38"));
  ASSERT_EQ(built.status, 0) << built.err;
  const json tuned = json::parse(built.out)["tuned"];
  EXPECT_GE(tuned["psnr_db"].get<double>(), 38.0);
  EXPECT_EQ(tuned["faces"], 64);
  EXPECT_EQ(json::parse(run("lumigrid", {"info", path("scene"), "--json"}).out)["images"]["tuned"], tuned);
  const std::string words =
      "tuned to 38.0 dB: quality " + tuned["quality"].dump() + ", " + tuned["subsampling"].get<std::string>();
  EXPECT_NE(run("lumigrid", {"info", path("scene")}).out.find(words), std::string::npos);

  // A run with another number of threads makes the same choice and the same images.
  const auto first = faceValues(path("scene"));
  auto again = command("38");
  again.insert(again.end(), {"--force", "--threads", "3"});
  EXPECT_EQ(json::parse(run("lumigrid", again).out)["tuned"], tuned);
  EXPECT_TRUE(faceValues(path("scene")) == first);

  std::string subsampling = tuned["subsampling"];
  std::erase(subsampling, ':');
  auto by_hand = command("off");
  by_hand[3] = path("hand");
  by_hand.insert(by_hand.end(), {"--quality", tuned["quality"].dump(), "--subsampling", subsampling});
  ASSERT_EQ(run("lumigrid", by_hand).status, 0);
  EXPECT_TRUE(faceValues(path("hand")) == first);
}

TEST_F(TunedBuild, aResumedBuildTakesTheStoredChoice) {
  const auto built = run("lumigrid", command("38"));
  ASSERT_EQ(built.status, 0) << built.err;
  const std::string quality = json::parse(built.out)["tuned"]["quality"].dump();
  takeImagesAway();
  replaceInBuilding("\"tuned-quality\": \"" + quality, "\"tuned-quality\": \"7");
  const auto resumed = run("lumigrid", command("38"));
  ASSERT_EQ(resumed.status, 0) << resumed.err;
  EXPECT_EQ(json::parse(resumed.out)["tuned"]["quality"], 7);
}

TEST_F(TunedBuild, aStoredChoiceThatIsNoneIsRefused) {
  ASSERT_EQ(run("lumigrid", command("38")).status, 0);
  takeImagesAway();
  replaceInBuilding("\"tuned-faces\": \"64", "\"tuned-faces\": \"0");
  programs::expectOneLineError(run("lumigrid", command("38")), 1, {"building.json", "tuned-faces", "--force"});
}

TEST_F(TunedBuild, reportsUnreachableAccuracyAndAcceptsLessOnRerun) {
  programs::expectOneLineError(run("lumigrid", command("90")), 1, {"--tune", "quality 100", "not 90", "ask for less"});
  const auto lower = run("lumigrid", command("38"));
  ASSERT_EQ(lower.status, 0) << lower.err;
  EXPECT_FALSE(json::parse(lower.out).contains("hierarchy")) << "the hierarchy was built again";

  // Once there are images, all must be of one quality.
  std::filesystem::rename(path("scene/scene.json"), path("scene/building.json"));
  programs::expectOneLineError(run("lumigrid", command("37")), 1, {"other meshes or options"});
}

// A rerun without meshes takes the recorded options, but for those that the given ones overrule.
TEST_F(TunedBuild, whileThereAreNoImagesTheRerunMayEncodeInAnotherWay) {
  ASSERT_EQ(run("lumigrid", command("38")).status, 0);
  takeImagesAway();
  const auto rerun = [&](const std::vector<std::string>& words) {
    std::vector<std::string> all{"build", "-o", path("scene"), "--quiet", "--json"};
    all.insert(all.end(), words.begin(), words.end());
    const auto outcome = run("lumigrid", all);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return outcome.status == 0 ? json::parse(outcome.out) : json();
  };
  EXPECT_FALSE(rerun({"--quality", "70"}).contains("tuned"));
  const auto parameters = json::parse(programs::readText(path("scene/scene.json")))["parameters"];
  EXPECT_EQ(parameters["quality"], "70");
  EXPECT_FALSE(parameters.contains("tuned-quality"));
  takeImagesAway();
  EXPECT_TRUE(rerun({"--tune", "36"}).contains("tuned"));
  EXPECT_TRUE(rerun({}).contains("tuned")) << "what is recorded";
  programs::expectOneLineError(run("lumigrid", {"build", "-o", path("scene"), "--quality", "70"}), 1, {"--force"});
}

TEST_F(TunedBuild, tuningAndChoosingExcludeEachOther) {
  for (const std::vector<std::string>& words :
       {std::vector<std::string>{"--quality", "80"}, {"--subsampling", "444"}, {"--methods", "patch"}}) {
    auto all = command("38");
    all.insert(all.end(), words.begin(), words.end());
    EXPECT_EQ(run("lumigrid", all).status, 2) << words.front();
  }
  for (const char* db : {"0", "-3", "99", "nan", "36dB", ""}) EXPECT_EQ(run("lumigrid", command(db)).status, 2) << db;
  auto off = command("off");
  off.insert(off.end(), {"--quality", "80"});
  EXPECT_EQ(run("lumigrid", off).status, 0);
}

class AutoBuild : public Build {
 protected:
  void SetUp() override {
    Build::SetUp();
    mesh_ = smallMesh();
  }
  std::vector<std::string> command(const std::string& more = "--json") {
    return {"build", mesh_, "-o", path("scene"), "--grid", "3", "--face", "64", "--methods", "auto", "--quiet", more};
  }
  /// Changes what the build measured, so that images pay or not.
  void replaceTrial(double images_db) {
    const std::string file = path("scene/scene.json");
    json scene = json::parse(programs::readText(file));
    json trial = json::parse(scene["parameters"]["auto"].get<std::string>());
    trial["images"]["mean_psnr_db"] = images_db;
    scene["parameters"]["auto"] = trial.dump();
    programs::writeText(file, scene.dump());
  }
  std::string mesh_;
};

TEST_F(AutoBuild, theTrialIsToldKeptShownAndFollowed) {
  const auto open = run("lumigrid", command("--missing"));
  EXPECT_EQ(open.status, 3) << open.err;
  EXPECT_NE(open.out.find("methods: not tried yet"), std::string::npos) << open.out;

  const auto built = run("lumigrid", command());
  ASSERT_EQ(built.status, 0) << built.err;
  const json trial = json::parse(built.out)["auto"];
  EXPECT_EQ(trial["views"], 10);
  const double gain = trial["images"]["mean_psnr_db"].get<double>() - trial["patches"]["mean_psnr_db"].get<double>();
  EXPECT_EQ(std::filesystem::exists(path("scene/images")), gain >= 0.3) << gain;
  EXPECT_EQ(run("lumigrid", command("--missing")).status, 0);
  EXPECT_EQ(run("lumigrid", {"verify", path("scene")}).status, 0);
  EXPECT_EQ(json::parse(run("lumigrid", {"info", path("scene"), "--json"}).out)["auto"], trial);
  EXPECT_NE(run("lumigrid", {"info", path("scene")}).out.find("auto: 10 held-out views: patches alone"),
            std::string::npos);
  EXPECT_EQ(json::parse(run("lumigrid", command()).out)["auto"], trial) << "it is not measured again";
}

TEST_F(AutoBuild, aRerunFollowsTheStoredTrial) {
  ASSERT_EQ(run("lumigrid", command()).status, 0);
  replaceTrial(99.0);
  const int missing = run("lumigrid", command("--missing")).status;
  EXPECT_EQ(missing, std::filesystem::exists(path("scene/images")) ? 0 : 3);
  const auto built = run("lumigrid", command());
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_FALSE(faceValues(path("scene")).empty());
  EXPECT_EQ(json::parse(built.out)["auto"]["images"]["mean_psnr_db"], 99.0);
  EXPECT_EQ(run("lumigrid", command("--missing")).status, 0);
  // Without meshes and methods the command goes on with what was chosen.
  EXPECT_EQ(run("lumigrid", {"build", "-o", path("scene"), "--quiet"}).status, 0);

  replaceTrial(-1.0);
  programs::expectOneLineError(run("lumigrid", command()), 1, {"scene.json", "auto", "--force"});
}

TEST_F(AutoBuild, isAdvisedForASmallModelWhoseImagesNobodyAskedFor) {
  const auto told = [&](std::vector<std::string> more) {
    more.insert(more.begin(), {"build", mesh_, "-o", path("scene"), "--grid", "3", "--face", "64", "--force"});
    const auto built = run("lumigrid", more);
    EXPECT_EQ(built.status, 0) << built.err;
    return built.err.find("--methods auto") != std::string::npos;
  };
  EXPECT_TRUE(told({}));
  EXPECT_FALSE(told({"--methods", "patch,images"}));
  EXPECT_FALSE(told({"--methods", "auto"}));
  EXPECT_FALSE(told({"--quiet"}));
}

TEST_F(AutoBuild, imagesAndAutoExcludeEachOther) {
  auto both = command();
  both[9] = "auto,images";
  programs::expectOneLineError(run("lumigrid", both), 2, {"--methods auto", "leave out"});
}

TEST_F(AutoBuild, aCloudOfPointsGetsSplats) {
  ASSERT_EQ(run("lumigrid", {"sample", "-o", path("points.ply"), "--triangles", "10000", "--points"}).status, 0);
  auto points = command();
  points[1] = path("points.ply");
  const auto built = run("lumigrid", points);
  ASSERT_EQ(built.status, 0) << built.err;
  EXPECT_TRUE(std::filesystem::exists(path("scene/qsplat.lgq")));
  EXPECT_FALSE(std::filesystem::exists(path("scene/patch.lgp")));
  EXPECT_EQ(run("lumigrid", points).status, 0) << "a rerun finds nothing to do";
}

TEST_F(Build, theResultDoesNotDependOnTheThreads) {
  const std::string mesh = smallMesh();
  for (const char* threads : {"1", "4"}) {
    const auto built = run("lumigrid", {"build", mesh, "-o", path(std::string("t") + threads), "--grid", "3", "--face",
                                        "64", "--threads", threads, "--quiet"});
    ASSERT_EQ(built.status, 0) << built.err;
  }
  EXPECT_EQ(base::readFile(path("t1/patch.lgp")).value(), base::readFile(path("t4/patch.lgp")).value());
  EXPECT_EQ(faceValues(path("t1")), faceValues(path("t4")));
}

}  // namespace
