// Servers of published scenes that lie behind a network keep nothing but a cache.
#include <algorithm>
#include <filesystem>
#include <functional>
#include <limits>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

#include "base/json/camera_file.h"
#include "protocol/message.h"
#include "repository/faces/face_value.h"
#include "server/scene/open_scene.h"
#include "tests/programs/published_site.h"
#include "tests/server/net/loopback.h"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using programs::expectOneLineError;
using programs::readText;
using programs::run;
using programs::ServedSite;
using programs::Tour;

// Holds the messages of a server about one view.
struct ViewMessages {
  std::vector<base::Bytes> messages;  // up to the view's completion, in their order
  std::size_t images = 0;             // number of them that are images
};

// The view is the first of its connection, so images ahead of need come after its completion.
ViewMessages askFor(std::uint16_t port, const base::ViewCamera& camera) {
  ViewMessages told;
  const auto client = server::LoopbackClient::connect(port);
  protocol::View view;
  view.sequence = 1;
  view.camera = camera;
  if (!client || !client->send(protocol::Hello{protocol::kVersion, "test"}) || !client->send(view)) {
    ADD_FAILURE() << "no server at port " << port;
    return told;
  }
  while (auto message = client->receive()) {
    if (std::holds_alternative<protocol::Completion>(*message)) return told;
    if (auto* welcome = std::get_if<protocol::Welcome>(&*message)) welcome->scene_name.clear();
    if (const auto* face = std::get_if<protocol::Face>(&*message)) {
      const auto value = repository::decodeFaceValue(face->value);
      told.images += value && !value->empty ? 1 : 0;
    }
    told.messages.push_back(protocol::encode(*message));
  }
  ADD_FAILURE() << "the server closed before the view was complete: " << client->closeReason();
  return told;
}

class RemoteServe : public programs::PublishedSite {
 protected:
  void SetUp() override {
    PublishedSite::SetUp();
    if (IsSkipped()) return;
    makeTour(3, 160, 90);
    nginx_ = std::make_unique<support::Nginx>(path("site"));
    ASSERT_TRUE(nginx_->running());
  }
  std::string place(const std::string& name) const { return nginx_->url() + "/" + name; }
  std::vector<base::ViewCamera> cameras() {
    auto tour = base::readCameraPath(path("tour.json"));
    EXPECT_TRUE(tour && tour->frames.size() == 3);
    return tour ? std::move(tour->frames) : std::vector<base::ViewCamera>();
  }
  std::vector<ViewMessages> answers(const ServedSite& served) {
    std::vector<ViewMessages> all;
    for (const base::ViewCamera& camera : cameras()) all.push_back(askFor(served.port, camera));
    return all;
  }
  std::size_t requests() const {
    const std::string log = nginx_->accessLog();
    return static_cast<std::size_t>(std::count(log.begin(), log.end(), '\n'));
  }

  std::unique_ptr<support::Nginx> nginx_;
};

/// The least number of images that were blended in any picture.
int fewestImages(const Tour& tour) {
  int fewest = std::numeric_limits<int>::max();
  for (const auto& line : tour.lines) fewest = std::min(fewest, line["samples"].get<int>());
  return fewest;
}

// Messages are compared byte by byte but for their order (groups go while far images are on their way). Pictures are
// not: they also show images that happened to come ahead of need, so that even two pictures of one server differ (by
// 0.6 levels in the mean, where leaving all images out is 1.2).
void expectTheSame(const std::vector<ViewMessages>& a, const std::vector<ViewMessages>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t view = 0; view < a.size(); ++view) {
    EXPECT_GE(a[view].images, 8U) << "view " << view;
    const auto inAnyOrder = [](const std::vector<base::Bytes>& messages) {
      std::multiset<std::string> texts;
      for (const base::Bytes& message : messages) texts.emplace(message.begin(), message.end());
      return texts;
    };
    EXPECT_TRUE(inAnyOrder(a[view].messages) == inAnyOrder(b[view].messages)) << "view " << view;
  }
}

TEST_F(RemoteServe, twoServersOfAPlaceShowWhatTheBuiltSceneShows) {
  const auto built = answers(serve(scene_));
  const ServedSite first = serve(place("tower"), {"--cache", path("cache")});
  expectTheSame(answers(first), built);
  EXPECT_GE(fewestImages(tour(first.url, "first")), 8);
  const std::size_t asked = requests();
  EXPECT_GT(asked, 3U);  // scene.json, the hierarchy, the index, images

  // A second server with the same cache asks for little more than scene.json; without a network a viewer notices
  // nothing of what the cache holds.
  const ServedSite second = serve(place("tower"), {"--cache", path("cache")});
  expectTheSame(answers(second), built);
  EXPECT_LE(requests(), asked + 3);
  nginx_->stop();
  expectTheSame(answers(second), built);
  EXPECT_GE(fewestImages(tour(second.url, "offline")), 8);
}

TEST_F(RemoteServe, namesFaultsOfAPlace) {
  const auto serveOnce = [&](const std::string& what) {
    return run("lumigrid", {"serve", what, "--port", "0", "--cache", path("cache")});
  };
  expectOneLineError(serveOnce(place("nothing")), 1, {place("nothing") + "/scene.json"});
  fs::copy(scene_, path("site/built"), fs::copy_options::recursive);
  expectOneLineError(serveOnce(place("built")), 1, {place("built"), "lumigrid publish"});
  fs::create_directories(path("site/broken"));
  programs::writeText(path("site/broken/scene.json"), "{\"version\": 1");
  expectOneLineError(serveOnce(place("broken")), 1, {place("broken") + "/scene.json"});

  // The hierarchy is another than scene.json names.
  for (const auto& entry : fs::directory_iterator(path("site/tower")))
    if (entry.path().extension() == ".lgp") {
      std::string bytes = readText(entry.path());
      bytes[bytes.size() / 2] ^= 1;
      programs::writeText(entry.path(), bytes);
    }
  expectOneLineError(serveOnce(place("tower")), 1, {"SHA-256"});
  nginx_->stop();
  expectOneLineError(serveOnce(place("tower")), 1, {place("tower") + "/scene.json"});
}

TEST_F(RemoteServe, aLostPackIsMissedAndTheRestGoesOn) {
  for (const auto& entry : fs::directory_iterator(path("site/tower/images")))
    if (entry.path().extension() == ".lgk") fs::remove(entry.path());
  const ServedSite served = serve(place("tower"), {"--cache", path("cache")});
  for (const ViewMessages& told : answers(served)) {
    EXPECT_EQ(told.images, 0U);
    EXPECT_GE(told.messages.size(), 2U);  // Welcome, the hierarchy
  }
  // Without images patches are refined for their colours too, but for where both keep to the bound.
  const Tour lost = tour(served.url, "lost", "lumigraph", {"--guarantee"});
  const Tour patches = tour(served.url, "patches", "patches", {"--guarantee"});
  for (std::size_t frame = 0; frame < 3; ++frame)
    EXPECT_TRUE(lost.pictures[frame].pixels == patches.pictures[frame].pixels) << "frame " << frame;
  EXPECT_NE(readText(path("serve0.err")).find(".lgk"), std::string::npos);
}

// The faults that `verify` lists of a place.
class RemoteVerify : public RemoteServe {
 protected:
  static std::string onlyFile(const std::string& directory, const std::string& extension) {
    for (const auto& entry : fs::directory_iterator(directory))
      if (entry.path().extension() == extension) return entry.path().string();
    return "";
  }
  std::vector<std::string> faults() {
    const auto verified = run("lumigrid", {"verify", place("tower"), "--json"});
    const json j = json::parse(verified.out, nullptr, false);
    EXPECT_TRUE(j.is_object()) << verified.out << verified.err;
    if (!j.is_object()) return {};
    EXPECT_EQ(verified.status, j["faults"].empty() ? 0 : 1);
    EXPECT_EQ(j["scene"], place("tower"));
    return j["faults"];
  }
  // Damages a file with `change`, expects a fault that says all of `words`, and puts the file back.
  void expectFault(const std::string& file, const std::function<std::string(std::string)>& change,
                   const std::vector<std::string>& words) {
    const std::string bytes = readText(file);
    programs::writeText(file, change(bytes));
    const auto found = faults();
    const bool said = std::any_of(found.begin(), found.end(), [&](const std::string& fault) {
      return std::all_of(words.begin(), words.end(),
                         [&](const std::string& word) { return fault.find(word) != std::string::npos; });
    });
    EXPECT_TRUE(said) << fs::path(file).filename() << ": " << json(found).dump(2);
    programs::writeText(file, bytes);
  }
  static std::string flipped(std::string bytes, double where) {
    bytes[static_cast<std::size_t>(where * static_cast<double>(bytes.size()))] ^= 0x40;
    return bytes;
  }
};

TEST_F(RemoteVerify, aWholeSceneIsReadByRangesAndHasNoFault) {
  EXPECT_EQ(faults(), std::vector<std::string>());
  const auto verified = run("lumigrid", {"verify", place("tower") + "/", "--quiet"});
  EXPECT_EQ(verified.status, 0) << verified.err;
  EXPECT_NE(verified.out.find("all is well"), std::string::npos) << verified.out;
  EXPECT_NE(nginx_->accessLog().find("\" 206 "), std::string::npos) << "no range was asked for";
}

TEST_F(RemoteVerify, namesDamagedMissingAndSuperfluousData) {
  const std::string pack = onlyFile(path("site/tower/images"), ".lgk");
  const std::string index = onlyFile(path("site/tower/images"), ".lgi");
  const std::string patches = onlyFile(path("site/tower"), ".lgp");
  const std::string pack_name = fs::path(pack).filename().string();
  const auto third = [](const std::string& bytes) { return flipped(bytes, 0.3); };
  expectFault(pack, third, {place("tower"), pack_name, "SHA-256"});
  expectFault(pack, third, {"face (", "checksum"});
  expectFault(pack, [](const std::string& bytes) { return bytes.substr(0, bytes.size() - 1); },
              {pack_name, "truncated"});
  expectFault(pack, [](const std::string& bytes) { return bytes + "x"; }, {pack_name, "the index says"});
  expectFault(index, [](const std::string& bytes) { return flipped(bytes, 0.6); }, {place("tower"), ".lgi", "SHA-256"});
  expectFault(index, [](const std::string& bytes) { return bytes.substr(0, 20000); }, {".lgi", "scene.json says"});
  expectFault(patches, third, {place("tower"), ".lgp", "SHA-256"});
  programs::writeText(path("site/tower/annotations.json"), "{\"version\": 1}");
  EXPECT_EQ(faults().size(), 1U);
  fs::remove(path("site/tower/annotations.json"));

  fs::rename(pack, pack + ".away");
  const auto lost = faults();
  ASSERT_GE(lost.size(), 2U);
  EXPECT_NE(lost[0].find(pack_name), std::string::npos) << lost[0];
  EXPECT_NE(lost.back().find("missing"), std::string::npos) << lost.back();
  fs::rename(pack + ".away", pack);
  EXPECT_EQ(faults(), std::vector<std::string>());
}

TEST_F(RemoteVerify, aPlaceThatHoldsNoSceneIsAnErrorInOneLine) {
  const auto verify = [&](const std::string& what) { return run("lumigrid", {"verify", what, "--quiet"}); };
  expectOneLineError(verify(place("nothing")), 1, {place("nothing") + "/scene.json", "404"});
  fs::copy(scene_, path("site/built"), fs::copy_options::recursive);
  expectOneLineError(verify(place("built")), 1, {place("built"), "lumigrid publish"});
}

void runAll(const std::vector<std::vector<std::string>>& commands) {
  for (const auto& arguments : commands) {
    const auto outcome = run("lumigrid", arguments);
    ASSERT_EQ(outcome.status, 0) << outcome.err;
  }
}

/// Opens the far scene `name` of the folder `site`: the part lies beside its patches. Where it cannot be had, the scene
/// is served without it and says so. `lacks`: whether an open scene lacks the part.
void expectPartBesidePatches(const std::string& place, const std::string& site, const std::string& cache,
                             const char* stem, const char* extension, bool (*lacks)(const server::OpenScene&),
                             const std::string& warning) {
  server::RemoteOptions options;
  options.cache_directory = cache;
  std::vector<std::string> warnings;
  options.warn = [&](const std::string& said) { warnings.push_back(said); };
  const auto open = server::openScene(place, options);
  ASSERT_TRUE(open) << open.error().message;
  EXPECT_FALSE(lacks(**open));
  const fs::path part =
      fs::path((*open)->patches.path()).parent_path() / *base::partFile((*open)->scene, stem, extension);
  EXPECT_TRUE(fs::exists(part)) << part;

  fs::remove_all(options.cache_directory);
  ASSERT_TRUE(fs::remove(fs::path(site) / part.filename()));
  const auto without = server::openScene(place, options);
  ASSERT_TRUE(without) << without.error().message;
  EXPECT_TRUE(lacks(**without));
  ASSERT_FALSE(warnings.empty());
  EXPECT_NE(warnings.back().find(warning), std::string::npos) << warnings.back();
}

TEST_F(RemoteServe, texturesOfAFarSceneLieBesideItsPatches) {
  runAll({{"sample", "--shape", "facade", "--triangles", "500", "--texels", "50", "-o", path("wall.obj")},
          {"build", path("wall.obj"), "-o", path("wall"), "--methods", "patch", "--quiet"},
          {"publish", path("wall"), path("site/wall"), "--quiet", "--viewer", "off", "--with-textures"}});
  expectPartBesidePatches(place("wall"), path("site/wall"), path("textures-cache"), "texture", ".lgt",
                          server::lacksTextures, "no textures");
}

TEST_F(RemoteServe, nodesThatThrowShadowsLieBesideThePatchesOfAFarScene) {
  runAll({{"sample", "--shape", "relief", "--triangles", "10000", "-o", path("relief.ply")},
          {"build", path("relief.ply"), "-o", path("relief"), "--methods", "patch,hlod", "--light", "soft-shadows",
           "--quiet"},
          {"publish", path("relief"), path("site/relief"), "--quiet", "--viewer", "off"}});
  expectPartBesidePatches(place("relief"), path("site/relief"), path("shadows-cache"), "hlod", ".lgh",
                          server::lacksShadows, "no shadows");
}

}  // namespace
