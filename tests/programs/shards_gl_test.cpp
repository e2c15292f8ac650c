// Many processes build one scene in shards, say what is missing, and repair it.
#include <signal.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/json/scene_file.h"
#include "repository/faces/face_value.h"
#include "repository/repository.h"
#include "repository/sampling/parameters.h"
#include "tests/programs/run_program.h"
#include "tests/support/sample_points.h"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using programs::expectOneLineError;
using programs::Outcome;
using programs::run;
using repository::FaceKey;
using Words = std::vector<std::string>;

template <class Condition>
bool waitFor(const Condition& condition) {
  for (int i = 0; i < 12000 && !condition(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(5));
  return condition();
}

// Options for sampling by use, with few views so that it is quick.
const Words kSelected{"--views", "60", "--worth", "0.8"};

class Shards : public programs::ProgramTest {
 protected:
  Words build(const std::string& scene, const Words& more = {}, const std::string& grid = "4") {
    Words words{"build", smallMesh(), "-o", path(scene), "--grid", grid, "--face", "64", "--quiet"};
    words.insert(words.end(), more.begin(), more.end());
    return words;
  }
  void mustBuild(const std::string& scene, const Words& more = {}, const std::string& grid = "4") {
    const Outcome built = run("lumigrid", build(scene, more, grid));
    ASSERT_EQ(built.status, 0) << built.err;
  }
  void buildShards(const std::string& scene, int count) {
    for (int i = 0; i < count; ++i) mustBuild(scene, {"--shard", std::to_string(i) + "/" + std::to_string(count)});
  }
  json summary(const Words& words) {
    Words with_json = words;
    with_json.emplace_back("--json");
    const Outcome outcome = run("lumigrid", with_json);
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return outcome.status == 0 ? json::parse(outcome.out) : json();
  }
  json missing(const std::string& scene, int status) {
    const Outcome outcome = run("lumigrid", {"build", "--missing", "--json", "-o", path(scene)});
    EXPECT_EQ(outcome.status, status) << outcome.err;
    return json::parse(outcome.out, nullptr, false);
  }
  // The digest of all values, which is the same for every division of the same scene.
  std::string digest(const std::string& scene) {
    const Outcome outcome = run("lumigrid", {"info", path(scene), "--json", "--digest"});
    EXPECT_EQ(outcome.status, 0) << outcome.err;
    return outcome.status == 0 ? json::parse(outcome.out)["images"]["sha256"].get<std::string>() : "none";
  }
  std::string images(const std::string& scene) { return path(scene) + "/images"; }
  std::unique_ptr<repository::Store> writable(const std::string& directory) {
    auto store = repository::openLmdbStore(directory, repository::StoreMode::kWrite);
    EXPECT_TRUE(store) << store.error().message;
    return store ? std::move(*store) : nullptr;
  }
};

TEST_F(Shards, inAnyOrderTheyMakeTheSceneThatOneProcessMakes) {
  mustBuild("whole");
  for (const int i : {2, 0, 3}) {
    mustBuild("scene", {"--shard", std::to_string(i) + "/4"});
    EXPECT_FALSE(fs::exists(path("scene/scene.json")));
  }
  expectOneLineError(run("lumigrid", {"info", path("scene")}), 1, {"not finished"});
  const json last = summary(build("scene", {"--shard", "1/4"}));
  EXPECT_EQ(last["complete"], true);
  EXPECT_FALSE(fs::exists(path("scene/building.json")));
  EXPECT_FALSE(fs::exists(path("scene/build.lock")));
  EXPECT_EQ(digest("scene"), digest("whole"));
  EXPECT_EQ(programs::readText(path("scene/patch.lgp")), programs::readText(path("whole/patch.lgp")));
  const Outcome verified = run("lumigrid", {"verify", path("scene")});
  EXPECT_EQ(verified.status, 0) << verified.out;
  EXPECT_EQ(base::readScene(path("scene"))->parameters.at("shards"), "4");
}

TEST_F(Shards, allAtOnceFromNothingEndComplete) {
  mustBuild("whole");
  std::vector<pid_t> pids;
  smallMesh();
  for (int i = 0; i < 4; ++i)
    pids.push_back(programs::start("lumigrid", build("scene", {"--shard", std::to_string(i) + "/4"}),
                                   path("log" + std::to_string(i))));
  for (std::size_t i = 0; i < pids.size(); ++i)
    EXPECT_EQ(programs::wait(pids[i]), 0) << programs::readText(path("log" + std::to_string(i) + ".err"));
  EXPECT_EQ(missing("scene", 0)["complete"], true);
  EXPECT_EQ(digest("scene"), digest("whole"));
}

TEST_F(Shards, readersSeeOnlyWholeImagesWhileTheyAreMade) {
  mustBuild("scene", {"--methods", "patch"});
  std::vector<pid_t> pids;
  for (int i = 0; i < 2; ++i)
    pids.push_back(programs::start("lumigrid",
                                   build("scene", {"--shard", std::to_string(i) + "/2", "--batch", "20"}, "7"),
                                   path("log" + std::to_string(i))));
  std::unique_ptr<repository::Store> store;
  ASSERT_TRUE(waitFor([&] {
    auto opened = repository::openRepository(images("scene"));
    if (opened) store = std::move(*opened);
    return store != nullptr;
  }));
  std::size_t seen = 0;
  bool partly = false;
  while (!fs::exists(path("scene/scene.json"))) {
    std::size_t now = 0;
    ASSERT_TRUE(store->forEach([&](const FaceKey& key, base::ByteView value) {
      const auto whole = repository::decodeFaceValue(value);
      EXPECT_TRUE(whole) << key.code() << ": " << whole.error().message;
      ++now;
      return true;
    }));
    EXPECT_GE(now, seen) << "an image that was seen is gone";
    seen = now;
    partly = partly || now > 0;
  }
  for (const pid_t pid : pids) EXPECT_EQ(programs::wait(pid), 0);
  EXPECT_TRUE(partly) << "the build was over before a reader saw any of it";
  EXPECT_GE(*store->size(), seen);
}

TEST_F(Shards, aSecondProcessOnTheSameShardIsRefused) {
  mustBuild("scene", {"--methods", "patch"});
  const Words command = build("scene", {"--shard", "1/2"}, "9");
  const pid_t first = programs::start("lumigrid", command, path("log"));
  const std::string lock = images("scene") + "/shard-0001-of-0002/writer.lock";
  ASSERT_TRUE(waitFor([&] { return !programs::readText(lock).empty(); }));
  ::kill(first, SIGSTOP);
  const Outcome second = run("lumigrid", command);
  const Outcome other = run("lumigrid", build("scene", {"--shard", "0/2"}, "9"));
  const json asked = missing("scene", 3);
  ::kill(first, SIGCONT);
  EXPECT_EQ(asked["missing_shards"], "1");
  EXPECT_EQ(asked["missing"][0]["being_written"], true);
  expectOneLineError(second, 1,
                     {"shard-0001-of-0002", "being written by another process", "pid " + std::to_string(first)});
  EXPECT_EQ(other.status, 0) << other.err;
  EXPECT_EQ(programs::wait(first), 0) << programs::readText(path("log.err"));
  EXPECT_EQ(missing("scene", 0)["complete"], true);
}

TEST_F(Shards, othersWaitForWhoMakesTheHierarchy) {
  const std::string mesh = path("large.ply");
  ASSERT_EQ(run("lumigrid", {"sample", "--triangles", "300000", "-o", mesh}).status, 0);
  const auto command = [&](const std::string& shard) {
    return Words{"build", mesh, "-o", path("scene"), "--grid", "2", "--face", "64", "--shard", shard};
  };
  const pid_t first = programs::start("lumigrid", command("0/2"), path("first"));
  ASSERT_TRUE(waitFor([&] { return fs::exists(path("scene/patch.lgp.work")); }));
  ::kill(first, SIGSTOP);
  const pid_t second = programs::start("lumigrid", command("1/2"), path("second"));
  EXPECT_TRUE(waitFor([&] {
    return programs::readText(path("second.err")).find("waiting for pid " + std::to_string(first)) != std::string::npos;
  }));
  ::kill(first, SIGKILL);  // the lock is gone with it, and the second goes on where it was
  EXPECT_EQ(programs::wait(first), 128 + SIGKILL);
  EXPECT_EQ(programs::wait(second), 0) << programs::readText(path("second.err"));
  const json j = missing("scene", 3);
  EXPECT_EQ(j["hierarchy"], "complete");
  EXPECT_EQ(j["missing_shards"], "0");
}

TEST_F(Shards, aKilledShardIsMissingAndTheRerunEndsTheSame) {
  mustBuild("whole", {}, "6");
  mustBuild("scene", {"--shard", "0/3"}, "6");
  mustBuild("scene", {"--shard", "2/3"}, "6");
  const Words command = build("scene", {"--shard", "1/3", "--batch", "20"}, "6");
  const pid_t pid = programs::start("lumigrid", command, path("log"));
  const std::string store = repository::storeDirectory(images("scene"), 3, 1);
  ASSERT_TRUE(waitFor([&] {
    auto opened = repository::openLmdbStore(store, repository::StoreMode::kRead);
    return opened && *(*opened)->size() > 0;
  }));
  ::kill(pid, SIGKILL);
  ASSERT_EQ(programs::wait(pid), 128 + SIGKILL) << "it was over before the kill: this test proved nothing";
  const json j = missing("scene", 3);
  EXPECT_EQ(j["missing_shards"], "1");
  const auto faces = j["missing_faces"].get<std::uint64_t>();
  EXPECT_EQ(summary(command)["images"]["rendered"].get<std::uint64_t>(), faces);
  EXPECT_EQ(digest("scene"), digest("whole"));
}

TEST_F(Shards, reportsMissingImagesFromTheStart) {
  json j = missing("scene", 3);
  EXPECT_EQ(j["hierarchy"], "missing");
  mustBuild("scene", {"--methods", "patch"});
  EXPECT_EQ(missing("scene", 0)["complete"], true) << "a hierarchy was all that it was asked to be";
  Words question = build("scene", {"--missing", "--shards", "3"});
  Outcome asked = run("lumigrid", question);
  EXPECT_EQ(asked.status, 3) << asked.err;
  EXPECT_NE(asked.out.find("\nshards: 0-2\n"), std::string::npos) << asked.out;
  EXPECT_TRUE(fs::exists(path("scene/scene.json"))) << "a question changes nothing";
  EXPECT_FALSE(fs::exists(path("scene/images")));

  mustBuild("scene", {"--shard", "1/3"});
  j = missing("scene", 3);
  EXPECT_EQ(j["missing_shards"], "0,2");
  EXPECT_EQ(j["missing"][0]["ranges"][0]["first"], (json{0, 0, 0, 0}));
  EXPECT_EQ(run("lumigrid", {"build", "--missing", "--shard", "1/3", "-o", path("scene")}).status, 0);
  EXPECT_EQ(run("lumigrid", {"build", "--missing", "--shard", "2/3", "-o", path("scene")}).status, 3);
  fs::remove(path("scene/patch.lgp"));
  EXPECT_EQ(missing("scene", 3)["hierarchy"], "missing");
  mustBuild("scene", {"--shard", "0/3"});  // makes the same hierarchy again
  EXPECT_EQ(missing("scene", 3)["hierarchy"], "complete");
  expectOneLineError(run("lumigrid", {"build", "--missing", "-o", smallMesh()}), 1, {"is a file"});
}

// The process that rendered the last image was killed before it could declare the scene finished.
TEST_F(Shards, aSceneThatLacksOnlyItsDeclarationGetsIt) {
  buildShards("scene", 2);
  const std::string finished = programs::readText(path("scene/scene.json"));
  fs::rename(path("scene/scene.json"), path("scene/building.json"));
  const Outcome asked = run("lumigrid", {"build", "--missing", "-o", path("scene")});
  EXPECT_EQ(asked.status, 3);
  EXPECT_NE(asked.out.find("scene.json: missing"), std::string::npos) << asked.out;
  EXPECT_EQ(run("lumigrid", {"build", "-o", path("scene"), "--quiet"}).status, 0);
  EXPECT_EQ(programs::readText(path("scene/scene.json")), finished);
  EXPECT_EQ(missing("scene", 0)["scene_json"], "complete");
}

TEST_F(Shards, aSceneGoesOnWithoutItsMeshes) {
  mustBuild("whole");
  mustBuild("scene", {"--shard", "1/3"});
  EXPECT_EQ(run("lumigrid", {"build", "-o", path("scene"), "--shard", "0/3", "--quiet"}).status, 0);
  expectOneLineError(run("lumigrid", {"build", "-o", path("scene"), "--quality", "70", "--quiet"}), 1,
                     {"other meshes or options"});
  EXPECT_EQ(run("lumigrid", {"build", "-o", path("scene"), "--quiet"}).status, 0) << "all that is left";
  EXPECT_EQ(digest("scene"), digest("whole"));
  expectOneLineError(run("lumigrid", {"build", "-o", path("none"), "--quiet"}), 1, {"none", "give the meshes"});
  EXPECT_FALSE(fs::exists(path("none")));
}

TEST_F(Shards, theDivisionOfASceneStays) {
  mustBuild("scene", {"--shard", "1/3"});
  expectOneLineError(run("lumigrid", build("scene", {"--shard", "1/4"})), 1, {"3 shards", "--force"});
  expectOneLineError(run("lumigrid", build("scene", {"--shard", "1/3", "--force"})), 1, {"--force"});
  mustBuild("undivided");
  expectOneLineError(run("lumigrid", build("undivided", {"--shard", "1/4"})), 1, {"undivided"});
  mustBuild("scene", {"--force"});
  EXPECT_FALSE(fs::exists(images("scene") + "/shard-0001-of-0003"));
  for (const char* bad : {"3/3", "x", "1/0", "1/9999"})
    EXPECT_EQ(run("lumigrid", build("scene", {"--shard", bad})).status, 2) << bad;
}

TEST_F(Shards, ranksOfMpiTakeTheirShards) {
  mustBuild("whole");
  for (const char* rank : {"0", "1"}) {
    ::setenv("OMPI_COMM_WORLD_RANK", rank, 1);
    ::setenv("OMPI_COMM_WORLD_SIZE", "2", 1);
    mustBuild("scene");
  }
  ::unsetenv("OMPI_COMM_WORLD_RANK");
  ::unsetenv("OMPI_COMM_WORLD_SIZE");
  EXPECT_TRUE(fs::exists(images("scene") + "/shard-0001-of-0002/data.mdb"));
  EXPECT_EQ(digest("scene"), digest("whole"));
}

// The scene has flipped bytes, erased keys and orphans in a shard, a store of another division, and lacks a shard.
TEST_F(Shards, repairsOnlyTheFaultsOfAFinishedScene) {
  buildShards("scene", 3);
  const std::string before = digest("scene");
  const std::string scene_json = programs::readText(path("scene/scene.json"));
  EXPECT_EQ(summary(build("scene"))["images"]["rendered"], 0);

  {
    auto store = writable(repository::storeDirectory(images("scene"), 3, 1));
    std::vector<std::pair<FaceKey, base::Bytes>> values;
    ASSERT_TRUE(store->forEach([&](const FaceKey& key, base::ByteView value) {
      values.emplace_back(key, base::Bytes(value.begin(), value.end()));
      return true;
    }));
    values[4].second.back() ^= 1;
    ASSERT_TRUE(store->erase({values[1].first}));
    ASSERT_TRUE(store->putBatch({values[4],
                                 {{0, 0, 0, 0}, repository::encodeFaceValue({})},      // belongs to shard 0
                                 {{50, 0, 0, 0}, repository::encodeFaceValue({})}}));  // is at no grid point
  }
  { ASSERT_TRUE(writable(images("scene") + "/shard-0001-of-0005")); }
  fs::remove_all(images("scene") + "/shard-0002-of-0003");

  const Outcome verified = run("lumigrid", {"verify", path("scene"), "--json"});
  EXPECT_EQ(verified.status, 1);
  const std::string faults = verified.out;
  for (const char* piece : {"missing", "checksum", "does not belong to shard 1 of 3", "not a face of this grid",
                            "shard-0001-of-0005: is not of this scene's division", "shard-0002-of-0003"})
    EXPECT_NE(faults.find(piece), std::string::npos) << piece << " in " << faults;
  EXPECT_EQ(json::parse(faults)["faults"].size(), 6U) << faults;
  EXPECT_EQ(missing("scene", 3)["missing_shards"], "1-2");

  const json repaired = summary(build("scene"));
  EXPECT_EQ(repaired["removed"]["damaged"], 1);
  EXPECT_EQ(repaired["removed"]["orphans"], 2);
  EXPECT_EQ(run("lumigrid", {"verify", path("scene")}).status, 0);
  EXPECT_EQ(digest("scene"), before);
  EXPECT_EQ(programs::readText(path("scene/scene.json")), scene_json);
  EXPECT_FALSE(fs::exists(images("scene") + "/shard-0001-of-0005"));
}

TEST_F(Shards, anUndividedSceneIsRepairedToo) {
  mustBuild("scene");
  const std::string before = digest("scene");
  {
    auto store = writable(images("scene"));
    ASSERT_TRUE(store->erase({{1, 1, 1, 2}}));
    ASSERT_TRUE(store->putBatch({{{1, 0, 0, 0}, base::Bytes{'F', 1, 1}}}));
  }
  { ASSERT_TRUE(writable(images("scene") + "/shard-0000-of-0002")); }
  const json repaired = summary(build("scene"));
  EXPECT_EQ(repaired["images"]["rendered"], 2);
  EXPECT_EQ(repaired["removed"]["damaged"], 1);
  EXPECT_EQ(digest("scene"), before);
  EXPECT_FALSE(fs::exists(images("scene") + "/shard-0000-of-0002"));
  const Outcome again = run("lumigrid", build("scene"));
  EXPECT_EQ(again.status, 0);
  EXPECT_NE(again.out.find("nothing was to be done"), std::string::npos) << again.out;
}

// In a finished scene of selected points damaged images are rendered again, others removed, and its points stay.
TEST_F(Shards, aSceneOfSelectedPointsIsVerifiedAndRepairedAsItsTreeSays) {
  mustBuild("scene", kSelected, "9");
  const std::string before = digest("scene");
  const std::string scene_json = programs::readText(path("scene/scene.json"));
  EXPECT_EQ(run("lumigrid", {"verify", path("scene")}).status, 0);
  EXPECT_EQ(missing("scene", 0)["complete"], true);

  std::string meta;
  FaceKey orphan{0, 0, 0, 0};
  {
    auto store = writable(images("scene"));
    meta = store->readMeta()->value_or("");
    const auto points = repository::sampledPointsFromMeta(meta, "images");
    ASSERT_TRUE(points && points->tree);
    const auto sampled = points->tree->points();
    ASSERT_LT(sampled.size(), points->grid.pointCount()) << "all points of the grid are selected";
    for (const glm::uvec3& p : repository::pointsInMortonOrder(points->grid))
      if (!support::hasPoint(*points->tree, points->grid, p)) orphan = {p.x, p.y, p.z, 3};
    const FaceKey flipped{sampled[2].x, sampled[2].y, sampled[2].z, 1};
    auto value = *store->get(flipped);
    ASSERT_TRUE(value);
    value->back() ^= 1;
    ASSERT_TRUE(store->putBatch({{flipped, *value}, {orphan, repository::encodeFaceValue({})}}));
    ASSERT_TRUE(
        store->erase({{sampled[0].x, sampled[0].y, sampled[0].z, 4}, {sampled[1].x, sampled[1].y, sampled[1].z, 0}}));
  }
  const Outcome verified = run("lumigrid", {"verify", path("scene"), "--json"});
  EXPECT_EQ(verified.status, 1);
  EXPECT_EQ(json::parse(verified.out)["faults"].size(), 4U) << verified.out;
  for (const char* piece : {"missing", "checksum", "not at a sampling point"})
    EXPECT_NE(verified.out.find(piece), std::string::npos) << piece << " in " << verified.out;
  EXPECT_EQ(missing("scene", 3)["missing_faces"], 2) << "keys only: what is damaged is there";

  const json repaired = summary({"build", "-o", path("scene"), "--quiet"});
  EXPECT_EQ(repaired["removed"]["damaged"], 1);
  EXPECT_EQ(repaired["removed"]["orphans"], 1);
  EXPECT_EQ(repaired["images"]["rendered"], 3);
  EXPECT_EQ(run("lumigrid", {"verify", path("scene")}).status, 0);
  EXPECT_EQ(digest("scene"), before);
  EXPECT_EQ(*writable(images("scene"))->readMeta(), meta);
  EXPECT_EQ(programs::readText(path("scene/scene.json")), scene_json);
}

TEST_F(Shards, takeOneSelectionOfPoints) {
  mustBuild("whole", kSelected, "9");
  std::vector<pid_t> pids;
  smallMesh();
  for (int i = 0; i < 4; ++i) {
    Words more = kSelected;
    more.insert(more.end(), {"--shard", std::to_string(i) + "/4"});
    pids.push_back(programs::start("lumigrid", build("scene", more, "9"), path("log" + std::to_string(i))));
  }
  for (std::size_t i = 0; i < pids.size(); ++i)
    EXPECT_EQ(programs::wait(pids[i]), 0) << programs::readText(path("log" + std::to_string(i) + ".err"));
  EXPECT_EQ(missing("scene", 0)["complete"], true);
  EXPECT_EQ(digest("scene"), digest("whole"));
  EXPECT_EQ(run("lumigrid", {"verify", path("scene")}).status, 0);
  EXPECT_EQ(summary({"info", path("scene")})["images"]["points"], summary({"info", path("whole")})["images"]["points"]);
  ASSERT_EQ(run("lumigrid", {"publish", path("scene"), path("published"), "--quiet"}).status, 0);
  EXPECT_EQ(digest("published"), digest("whole"));

  // A lost shard is rendered again at the points that were selected.
  fs::remove_all(images("scene") + "/shard-0001-of-0004");
  fs::remove_all(images("scene") + "/shard-0002-of-0004");
  EXPECT_GT(missing("scene", 3)["missing_faces"], 0);
  EXPECT_EQ(summary({"build", "-o", path("scene"), "--quiet"})["complete"], true);
  EXPECT_EQ(digest("scene"), digest("whole"));
}

TEST_F(Shards, killedWhileTheyRenderSelectedPointsEndWithTheSameImages) {
  Words budget = kSelected;
  budget.insert(budget.end(), {"--budget", "60000"});
  mustBuild("whole", budget, "9");
  budget.insert(budget.end(), {"--batch", "6"});
  Words shard = budget;
  shard.insert(shard.end(), {"--shard", "0/2"});
  const std::string selection = images("scene") + "/points.json";
  const pid_t pid = programs::start("lumigrid", build("scene", shard, "9"), path("killed"));
  ASSERT_TRUE(waitFor([&] { return fs::exists(selection); })) << programs::readText(path("killed.err"));
  ::kill(pid, SIGKILL);
  programs::wait(pid);
  const std::string selected = programs::readText(selection);
  EXPECT_EQ(missing("scene", 3)["complete"], false);
  for (const char* index : {"1/2", "0/2"}) {
    Words more = budget;
    more.insert(more.end(), {"--shard", index});
    mustBuild("scene", more, "9");
  }
  EXPECT_EQ(programs::readText(selection), selected);
  EXPECT_EQ(digest("scene"), digest("whole"));
  const json info = summary({"info", path("scene")})["images"];
  EXPECT_LE(info["jpeg_bytes"].get<int>() + info["coverage_bytes"].get<int>(), 60'000);
}

TEST_F(Shards, reportsAllImagesMissingBeforePointsAreSelected) {
  mustBuild("scene", {"--methods", "patch", "--shards", "2"}, "9");
  Words asked{"build", "--missing", "--json", "-o", path("scene"), "--methods", "patch,images", "--grid", "9"};
  asked.insert(asked.end(), kSelected.begin(), kSelected.end());
  const Outcome before = run("lumigrid", asked);
  EXPECT_EQ(before.status, 3) << before.err;
  EXPECT_EQ(json::parse(before.out)["sampling_points"], "missing");
  EXPECT_EQ(json::parse(before.out)["missing_shards"], "0-1");
}

// The first process tunes, and the others use its choice.
TEST_F(Shards, shareOneTunedChoice) {
  mustBuild("whole", {"--tune", "38"});
  std::vector<pid_t> pids;
  smallMesh();
  for (int i = 0; i < 3; ++i)
    pids.push_back(programs::start("lumigrid", build("scene", {"--shard", std::to_string(i) + "/3", "--tune", "38"}),
                                   path("log" + std::to_string(i))));
  for (std::size_t i = 0; i < pids.size(); ++i)
    EXPECT_EQ(programs::wait(pids[i]), 0) << programs::readText(path("log" + std::to_string(i) + ".err"));
  EXPECT_EQ(missing("scene", 0)["complete"], true);
  EXPECT_EQ(digest("scene"), digest("whole"));

  // A lost shard is rendered again by the choice that the scene records, also by a command that does not say it.
  fs::remove_all(images("scene") + "/shard-0001-of-0003");
  const json repaired = summary({"build", "-o", path("scene"), "--quiet"});
  EXPECT_EQ(repaired["tuned"], summary({"info", path("whole")})["images"]["tuned"]);
  EXPECT_EQ(digest("scene"), digest("whole"));
}

TEST_F(Shards, arePublishedAsOne) {
  buildShards("scene", 3);
  ASSERT_EQ(run("lumigrid", {"publish", path("scene"), path("published"), "--quiet"}).status, 0);
  EXPECT_EQ(digest("published"), digest("scene"));
  EXPECT_EQ(run("lumigrid", {"verify", path("published")}).status, 0);
  expectOneLineError(run("lumigrid", {"build", "-o", path("published"), "--quiet"}), 1, {"is a published scene"});
  expectOneLineError(run("lumigrid", build("published")), 1, {"is a published scene"});
  EXPECT_EQ(run("lumigrid", {"verify", path("published")}).status, 0);
}

TEST_F(Shards, aMixOfParametersIsNamed) {
  buildShards("scene", 2);
  Words other = build("other");
  other.insert(other.end(), {"--quality", "60"});
  for (const char* shard : {"0/2", "1/2"}) {
    Words words = other;
    words.insert(words.end(), {"--shard", shard});
    ASSERT_EQ(run("lumigrid", words).status, 0);
  }
  const std::string name = "/shard-0001-of-0002";
  fs::remove_all(images("scene") + name);
  fs::copy(images("other") + name, images("scene") + name);
  expectOneLineError(run("lumigrid", {"info", path("scene")}), 1, {"different parameters", "quality", "60"});
  expectOneLineError(run("lumigrid", build("scene")), 1, {"shard-0001-of-0002", "quality"});
  const Outcome verified = run("lumigrid", {"verify", path("scene")});
  EXPECT_EQ(verified.status, 1);
  EXPECT_NE(verified.out.find("other parameters"), std::string::npos) << verified.out;
}

TEST_F(Shards, aRecordThatIsNoneIsAnErrorAndNeverACrash) {
  buildShards("scene", 2);
  auto scene = *base::readScene(path("scene"));
  for (const auto& [name, value] : std::vector<std::pair<std::string, std::string>>{
           {"shards", "99999"}, {"shards", "-1"}, {"grid", "0"}, {"grid", "x"}, {"face", "1e9"}, {"margin", "nan"}}) {
    base::Scene bad = scene;
    bad.parameters[name] = value;
    ASSERT_TRUE(base::writeSceneFile(bad, path("scene/scene.json")));
    const Outcome outcome = run("lumigrid", {"build", "--missing", "-o", path("scene")});
    expectOneLineError(outcome, 1, {"again"});
  }
}

}  // namespace
