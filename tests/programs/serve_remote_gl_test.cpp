// Published scenes served from behind a network: servers that keep nothing but a cache.
#include <signal.h>

#include <algorithm>
#include <chrono>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <sstream>
#include <thread>

#include "base/png/png.h"
#include "tests/programs/run_program.h"
#include "tests/support/nginx.h"

namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using programs::expectOneLineError;
using programs::readText;
using programs::run;

// Images come in another order over a network, so that a blend may differ a little in the last of them.
void expectAlike(const std::vector<base::Image>& a, const std::vector<base::Image>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    ASSERT_EQ(a[i].pixels.size(), b[i].pixels.size());
    double sum = 0.0;
    for (std::size_t k = 0; k < a[i].pixels.size(); ++k) sum += std::abs(int{a[i].pixels[k]} - int{b[i].pixels[k]});
    EXPECT_LT(sum / static_cast<double>(a[i].pixels.size()), 4.0) << "frame " << i;
  }
}

class RemoteServe : public programs::ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    LUMIGRID_SKIP_WITHOUT_NGINX();
    scene_ = smallScene();
    ASSERT_EQ(run("lumigrid", {"publish", scene_, path("site/tower"), "--quiet"}).status, 0);
    nginx_ = std::make_unique<support::Nginx>(path("site"));
    ASSERT_TRUE(nginx_->running());
  }
  void TearDown() override {
    for (const pid_t pid : servers_) {
      ::kill(pid, SIGTERM);
      programs::wait(pid);
    }
    ProgramTest::TearDown();
  }
  std::string place(const std::string& name) const { return nginx_->url() + "/" + name; }
  // Its URL; --no-frames, so that pictures come from the repository alone.
  std::string serve(const std::string& what, const std::vector<std::string>& more = {}) {
    const std::string log = path("serve" + std::to_string(servers_.size()));
    std::vector<std::string> arguments{"serve", what, "--port", "0", "--json", "--no-frames"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    servers_.push_back(programs::start("lumigrid", arguments, log));
    for (int i = 0; i < 2000; ++i) {
      const json j = json::parse(readText(log + ".out"), nullptr, false);
      if (j.is_object()) return j["url"];
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    ADD_FAILURE() << readText(log + ".err");
    return "";
  }
  // The pictures of a tour, each of them complete.
  std::vector<base::Image> tour(const std::string& url, const std::string& name) {
    if (!fs::exists(path("tour.json"))) {
      EXPECT_EQ(
          run("lumigrid", {"tour", scene_, "--frames", "3", "--size", "160", "90", "-o", path("tour.json")}).status, 0);
    }
    const auto viewed = run("lumigrid-view", {url, "--headless", "--path", path("tour.json"), "--out", path(name)});
    EXPECT_EQ(viewed.status, 0) << viewed.err;
    std::istringstream lines(readText(path(name + "/frames.jsonl")));
    for (std::string line; std::getline(lines, line);) {
      const json j = json::parse(line, nullptr, false);
      EXPECT_TRUE(j.is_object() && j["complete"].get<bool>()) << line;
    }
    std::vector<base::Image> pictures;
    for (int frame = 0; frame < 3; ++frame) {
      auto picture = base::readPng(path(name + "/frame_000" + std::to_string(frame) + ".png"));
      EXPECT_TRUE(picture) << picture.error().message;
      pictures.push_back(picture ? std::move(*picture) : base::Image());
    }
    return pictures;
  }
  std::size_t requests() const {
    const std::string log = nginx_->accessLog();
    return static_cast<std::size_t>(std::count(log.begin(), log.end(), '\n'));
  }

  std::string scene_;
  std::unique_ptr<support::Nginx> nginx_;
  std::vector<pid_t> servers_;
};

TEST_F(RemoteServe, twoServersOfAPlaceShowWhatTheBuiltSceneShows) {
  const auto built = tour(serve(scene_), "built");
  const auto first = tour(serve(place("tower"), {"--cache", path("cache")}), "first");
  expectAlike(first, built);
  const std::size_t asked = requests();
  EXPECT_GT(asked, 3U);  // scene.json, the hierarchy, the index, images

  // A second server with the same cache asks for little more than scene.json; without a network a viewer notices
  // nothing of what the cache holds.
  const std::string second = serve(place("tower"), {"--cache", path("cache")});
  expectAlike(tour(second, "second"), built);
  EXPECT_LE(requests(), asked + 3);
  nginx_->stop();
  expectAlike(tour(second, "offline"), built);
}

TEST_F(RemoteServe, whatIsWrongWithAPlaceIsNamed) {
  const auto serveOnce = [&](const std::string& what) {
    return run("lumigrid", {"serve", what, "--port", "0", "--cache", path("cache")});
  };
  expectOneLineError(serveOnce(place("nothing")), 1, {place("nothing") + "/scene.json"});
  fs::copy(scene_, path("site/built"), fs::copy_options::recursive);
  expectOneLineError(serveOnce(place("built")), 1, {place("built"), "lumigrid publish"});
  fs::create_directories(path("site/broken"));
  programs::writeText(path("site/broken/scene.json"), "{\"version\": 1");
  expectOneLineError(serveOnce(place("broken")), 1, {place("broken") + "/scene.json"});

  // Another hierarchy than scene.json names.
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
  const std::string url = serve(place("tower"), {"--cache", path("cache")});
  const auto pictures = tour(url, "lost");  // of the hierarchy alone
  EXPECT_FALSE(pictures.front().empty());
  EXPECT_NE(readText(path("serve0.err")).find(".lgk"), std::string::npos);
}

}  // namespace
