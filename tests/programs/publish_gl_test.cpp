// lumigrid publish runs as a user runs it: to its end, killed, again, with --prune, over damage.
#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <map>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/file.h"
#include "base/json/scene_file.h"
#include "repository/faces/face_value.h"
#include "repository/packs/pack_store.h"
#include "tests/programs/run_program.h"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using programs::expectOneLineError;
using programs::readText;
using programs::run;
using repository::FaceKey;
using Values = std::map<std::uint64_t, base::Bytes>;

class PublishProgram : public programs::ProgramTest {
 protected:
  static Values valuesOf(const repository::Store& store) {
    Values all;
    EXPECT_TRUE(store.forEach([&](const FaceKey& key, base::ByteView value) {
      all[key.code()] = base::Bytes(value.begin(), value.end());
      return true;
    }));
    return all;
  }
  static Values builtValues(const std::string& scene) {
    auto store = repository::openLmdbStore(scene + "/images", repository::StoreMode::kRead);
    EXPECT_TRUE(store) << store.error().message;
    return store ? valuesOf(**store) : Values();
  }
  // Returns the objects that scene.json leads to.
  static Values publishedValues(const std::string& place) {
    auto scene = base::readScene(place);
    EXPECT_TRUE(scene) << scene.error().message;
    if (!scene) return {};
    const auto index = base::partFile(*scene, "images/index", ".lgi");
    EXPECT_TRUE(index);
    auto packs = repository::PackStore::open(*repository::openDirectorySource(place), index.value_or(""));
    EXPECT_TRUE(packs) << packs.error().message;
    return packs ? valuesOf(**packs) : Values();
  }
  // Makes all images large, so that publishing takes a while: 162 faces of 200 to 400 kB.
  static void enlargeImages(const std::string& scene, std::uint8_t seed) {
    auto store = repository::openLmdbStore(scene + "/images", repository::StoreMode::kWrite);
    ASSERT_TRUE(store);
    std::vector<std::pair<FaceKey, base::Bytes>> batch;
    for (auto& [code, value] : valuesOf(**store)) {
      const base::Bytes jpeg(200000 + code * 7919U % 200000U, static_cast<std::uint8_t>(code + seed));
      batch.emplace_back(*FaceKey::fromCode(code), repository::encodeFaceValue({false, jpeg, {}}));
    }
    ASSERT_TRUE((*store)->putBatch(batch));
  }
  static std::size_t filesIn(const std::string& place) {
    std::error_code ignored;
    return static_cast<std::size_t>(std::distance(fs::directory_iterator(place, ignored), fs::directory_iterator()));
  }
  // Leaves the status of an ended process to the caller's wait().
  static bool hasEnded(pid_t pid) {
    siginfo_t info{};
    return ::waitid(P_PID, static_cast<id_t>(pid), &info, WEXITED | WNOHANG | WNOWAIT) != 0 || info.si_pid != 0;
  }
  static std::string onePackOf(const std::string& place) {
    for (const auto& entry : fs::directory_iterator(place + "/images"))
      if (entry.path().extension() == ".lgk") return entry.path().string();
    return "";
  }
};

TEST_F(PublishProgram, aPublishedSceneHoldsTheSameAndIsReadByEveryCommand) {
  const std::string scene = smallScene();
  const auto published = run("lumigrid", {"publish", scene, path("out"), "--viewer", "off", "--json"});
  ASSERT_EQ(published.status, 0) << published.err;
  const json j = json::parse(published.out);
  EXPECT_EQ(j["images"]["packs"], 1);
  EXPECT_EQ(publishedValues(path("out")), builtValues(scene));

  const json built_info = json::parse(run("lumigrid", {"info", scene, "--json"}).out);
  const json info = json::parse(run("lumigrid", {"info", path("out"), "--json"}).out);
  EXPECT_EQ(info["images"], built_info["images"]);
  EXPECT_EQ(info["hierarchy"], built_info["hierarchy"]);
  EXPECT_EQ(info["scene"]["sources"][0]["path"], "small.ply") << "no directories of this machine";
  const auto verified = run("lumigrid", {"verify", path("out")});
  EXPECT_EQ(verified.status, 0) << verified.out << verified.err;

  // A published scene can be published again from where it lies, and comes out the same.
  ASSERT_EQ(run("lumigrid", {"publish", path("out"), "file://" + path("copy")}).status, 0);
  EXPECT_EQ(readText(path("copy/scene.json")), readText(path("out/scene.json")));
  EXPECT_EQ(publishedValues(path("copy")), builtValues(scene));

  // The ranges that a viewer reads first are named; those of the records begin the file.
  const auto listed = base::readScene(path("out"));
  ASSERT_TRUE(listed);
  ASSERT_GE(listed->parts.size(), 2U);
  EXPECT_FALSE(listed->parts[0].opening.empty());
  EXPECT_TRUE(listed->parts[1].file.starts_with("records-")) << listed->parts[1].file;
  ASSERT_EQ(listed->parts[1].opening.size(), 1U);
  EXPECT_EQ(listed->parts[1].opening[0].offset, 0U);

  // A second run writes nothing but scene.json.
  const json again = json::parse(run("lumigrid", {"publish", scene, path("out"), "--viewer", "off", "--json"}).out);
  EXPECT_EQ(again["bytes_written"], 0);
  EXPECT_EQ(filesIn(path("out")), 4U) << "scene.json, the patches, their records, images";
}

TEST_F(PublishProgram, thePageGoesBesideTheSceneAndNeverOverSomebodyElses) {
  const std::string scene = smallScene();
  const std::string kForAnyScene = "<meta name=\"lumigrid-scene\" content=\"\">";
  const std::string kForThisScene = "<meta name=\"lumigrid-scene\" content=\"scene.json\">";
  const std::string page = path("page");
  fs::create_directories(page);
  programs::writeText(page + "/index.html", kForAnyScene + "first page");
  programs::writeText(page + "/index.html.gz", "first page as gzip");
  programs::writeText(page + "/lumigrid-0123abcd.js", "first program");
  programs::writeText(page + "/style.css.gz", "style as gzip");
  programs::writeText(page + "/style.css", "style");
  const auto publish = [&](std::vector<std::string> more) {
    std::vector<std::string> all{"publish", scene, path("out"), "--web", page, "--json"};
    all.insert(all.end(), more.begin(), more.end());
    return run("lumigrid", all);
  };
  const auto first = publish({});
  ASSERT_EQ(first.status, 0) << first.err;
  EXPECT_EQ(json::parse(first.out)["page_files"], 4);
  EXPECT_EQ(readText(path("out/index.html")), kForThisScene + "first page");
  EXPECT_FALSE(fs::exists(path("out/index.html.gz"))) << "its page is another one than ours";
  EXPECT_EQ(readText(path("out/style.css.gz")), "style as gzip");
  EXPECT_EQ(json::parse(publish({}).out)["bytes_written"], 0) << "nothing changed";

  // When a later page is published, the old program stays for those who have the old page open, until --prune.
  programs::writeText(page + "/index.html", kForAnyScene + "second page");
  fs::rename(page + "/lumigrid-0123abcd.js", page + "/lumigrid-89abcdef.js");
  fs::remove(page + "/style.css.gz");
  ASSERT_EQ(publish({"--viewer", "on"}).status, 0);
  EXPECT_FALSE(fs::exists(path("out/style.css.gz"))) << "servers would send it for style.css";
  EXPECT_EQ(readText(path("out/index.html")), kForThisScene + "second page");
  EXPECT_TRUE(fs::exists(path("out/lumigrid-0123abcd.js")));
  ASSERT_EQ(publish({"--prune"}).status, 0);
  EXPECT_FALSE(fs::exists(path("out/lumigrid-0123abcd.js")));
  EXPECT_TRUE(fs::exists(path("out/lumigrid-89abcdef.js")));
  EXPECT_EQ(run("lumigrid", {"verify", path("out")}).status, 0);

  // A page of somebody's own is left, with a line; or an error when ours was asked for.
  programs::writeText(path("out/style.css"), "my own style");
  programs::writeText(page + "/index.html", kForAnyScene + "third page");
  const auto left = publish({});
  EXPECT_EQ(left.status, 0);
  EXPECT_NE(left.err.find("style.css"), std::string::npos);
  expectOneLineError(publish({"--viewer", "on"}), 1, {"style.css", "--viewer off"});
  EXPECT_EQ(readText(path("out/style.css")), "my own style");
  EXPECT_EQ(readText(path("out/index.html")), kForThisScene + "second page") << "all of the page or nothing";

  expectOneLineError(run("lumigrid", {"publish", scene, path("out"), "--web", path("none")}), 1, {path("none")});
  EXPECT_EQ(publish({"--viewer", "perhaps"}).status, 2);
  programs::writeText(page + "/index.html", "not of the preset web");
  expectOneLineError(publish({"--viewer", "on"}), 1, {"lumigrid-scene"});
}

TEST_F(PublishProgram, annotationsGoAlongAndBadOnesAreNamed) {
  const std::string scene = smallScene();
  const std::string notes = R"({"version": 1, "annotations": [{"position": [1, 2, 3], "title": "here"}]})";
  programs::writeText(scene + "/annotations.json", notes);
  const auto published = run("lumigrid", {"publish", scene, path("out"), "--json"});
  ASSERT_EQ(published.status, 0) << published.err;
  EXPECT_EQ(json::parse(published.out)["annotations"], 1);
  EXPECT_EQ(readText(path("out/annotations.json")), notes);
  EXPECT_EQ(json::parse(run("lumigrid", {"info", path("out"), "--json"}).out)["annotations"]["count"], 1);
  EXPECT_EQ(run("lumigrid", {"verify", scene}).status, 0);

  programs::writeText(scene + "/annotations.json", R"({"version": 1, "annotations": [{"title": "nowhere"}]})");
  expectOneLineError(run("lumigrid", {"publish", scene, path("out")}), 1, {"annotation 0", "position"});
  EXPECT_EQ(readText(path("out/annotations.json")), notes);
  const auto verified = run("lumigrid", {"verify", scene});
  EXPECT_EQ(verified.status, 1);
  EXPECT_NE(verified.out.find("annotation 0"), std::string::npos);
  const auto info = run("lumigrid", {"info", scene});
  EXPECT_EQ(info.status, 0);
  EXPECT_NE(info.out.find("annotation 0"), std::string::npos);
}

TEST_F(PublishProgram, killedAtAnyMomentTheOldVersionStaysAndTheRerunFinishes) {
  const std::string scene = smallScene();
  const std::string out = path("out");
  ASSERT_EQ(run("lumigrid", {"publish", scene, out}).status, 0);
  const Values old_values = publishedValues(out);
  const std::string old_json = readText(out + "/scene.json");

  enlargeImages(scene, 1);
  const Values new_values = builtValues(scene);
  const std::size_t before = filesIn(out + "/images");
  int killed = 0;
  for (std::size_t more = 1; more <= 21; more += 4) {
    const pid_t pid =
        programs::start("lumigrid", {"publish", scene, out, "--pack-size", "1M", "--jobs", "2"}, path("p"));
    while (filesIn(out + "/images") < before + more && !hasEnded(pid)) std::this_thread::yield();
    ::kill(pid, SIGKILL);
    if (programs::wait(pid) == 128 + SIGKILL && readText(out + "/scene.json") == old_json) {
      ++killed;
      ASSERT_EQ(publishedValues(out), old_values) << "killed with " << more << " new files";
    }
  }
  EXPECT_GT(killed, 0);
  const auto finished = run("lumigrid", {"publish", scene, out, "--pack-size", "1M", "--json"});
  ASSERT_EQ(finished.status, 0) << finished.err;
  const json j = json::parse(finished.out);
  EXPECT_LT(j["images"]["packs_written"].get<int>(), j["images"]["packs"].get<int>()) << "packs that were there stay";
  EXPECT_NE(readText(out + "/scene.json"), old_json);
  EXPECT_EQ(publishedValues(out), new_values);

  // With --prune nothing of killed runs or of the old version stays; files of others do.
  programs::writeText(out + "/index.html", "mine");
  programs::writeText(out + "/images/pack-00000000000000000000000000000000.lgk.part77", "half");
  const json pruned =
      json::parse(run("lumigrid", {"publish", scene, out, "--pack-size", "1M", "--prune", "--json"}).out);
  EXPECT_GE(pruned["pruned"], 3);
  EXPECT_EQ(pruned["bytes_written"], 0);
  EXPECT_EQ(filesIn(out + "/images"), pruned["images"]["packs"].get<std::size_t>() + 1);
  EXPECT_EQ(readText(out + "/index.html"), "mine");
  EXPECT_EQ(publishedValues(out), new_values);
}

TEST_F(PublishProgram, aReaderOfTheOldVersionGoesOn) {
  const std::string scene = smallScene();
  const std::string out = path("out");
  ASSERT_EQ(run("lumigrid", {"publish", scene, out}).status, 0);
  const auto index = base::partFile(*base::readScene(out), "images/index", ".lgi");
  const auto reader = std::move(*repository::PackStore::open(*repository::openDirectorySource(out), *index));
  const Values old_values = builtValues(scene);
  enlargeImages(scene, 2);
  ASSERT_EQ(run("lumigrid", {"publish", scene, out}).status, 0);
  EXPECT_EQ(valuesOf(*reader), old_values);
}

TEST_F(PublishProgram, placesThatCannotBeAreNamed) {
  const std::string scene = smallScene();
  expectOneLineError(run("lumigrid", {"publish", scene, "https://host/scene"}), 1,
                     {"https://host/scene", "takes no objects"});
  expectOneLineError(run("lumigrid", {"publish", scene, scene}), 1, {scene, "lumigrid build"});
  expectOneLineError(run("lumigrid", {"publish", path("none"), path("out")}), 1, {path("none")});
  EXPECT_FALSE(fs::exists(path("out")));
  EXPECT_EQ(run("lumigrid", {"publish", scene, path("out"), "--pack-size", "100"}).status, 2);
  EXPECT_EQ(run("lumigrid", {"publish", scene, path("out"), "--pack-size", "65M"}).status, 2);
  programs::writeText(path("file"), "x");
  EXPECT_EQ(run("lumigrid", {"publish", scene, path("file")}).status, 1);

  fs::create_directory(path("busy"));
  const int lock = ::open(path("busy").c_str(), O_RDONLY);
  ASSERT_EQ(::flock(lock, LOCK_EX), 0);
  expectOneLineError(run("lumigrid", {"publish", scene, path("busy"), "--quiet"}), 1,
                     {"another program is publishing"});
  ::close(lock);

  std::string patches = readText(scene + "/patch.lgp");
  patches[patches.size() - 20] ^= 1;
  programs::writeText(scene + "/patch.lgp", patches);
  expectOneLineError(run("lumigrid", {"publish", scene, path("out"), "--quiet"}), 1, {"patch.lgp", "SHA-256"});
  EXPECT_FALSE(fs::exists(path("out/scene.json")));
}

TEST_F(PublishProgram, verifyNamesWhatIsDamagedAndRewriteMendsIt) {
  const std::string scene = smallScene();
  const std::string out = path("out");
  ASSERT_EQ(run("lumigrid", {"publish", scene, out}).status, 0);
  const std::string pack = onePackOf(out);
  const std::string bytes = readText(pack);

  std::string flipped = bytes;
  flipped[flipped.size() / 3] ^= 0x40;
  programs::writeText(pack, flipped);
  auto verified = run("lumigrid", {"verify", out});
  EXPECT_EQ(verified.status, 1);
  EXPECT_NE(verified.out.find(fs::path(pack).filename().string() + ": its SHA-256"), std::string::npos) << verified.out;
  EXPECT_NE(verified.out.find("face ("), std::string::npos) << verified.out;
  EXPECT_NE(verified.out.find("--rewrite"), std::string::npos) << verified.out;

  programs::writeText(pack, bytes.substr(0, bytes.size() - 1));
  verified = run("lumigrid", {"verify", out});
  EXPECT_EQ(verified.status, 1);
  EXPECT_NE(verified.out.find("truncated"), std::string::npos) << verified.out;
  fs::remove(pack);
  EXPECT_EQ(run("lumigrid", {"verify", out}).status, 1);

  programs::writeText(pack, flipped);
  ASSERT_EQ(run("lumigrid", {"publish", scene, out, "--rewrite"}).status, 0);
  EXPECT_EQ(readText(pack), bytes);
  EXPECT_EQ(run("lumigrid", {"verify", out}).status, 0);
}

}  // namespace
