#pragma once
// Puts a published scene into a web server's folder, runs servers of ours beside it, and tours both with lumigrid-view.
#include <signal.h>

#include <chrono>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>
#include <vector>

#include "base/png/png.h"
#include "tests/programs/run_program.h"
#include "tests/support/nginx.h"

namespace programs {

struct ServedSite {
  std::string url;
  std::uint16_t port = 0;
};

struct Tour {
  std::vector<base::Image> pictures;
  std::vector<nlohmann::json> lines;  ///< of frames.jsonl
};

/// path("site/tower") is the published form of scene_.
class PublishedSite : public ProgramTest {
 protected:
  void SetUp() override {
    ProgramTest::SetUp();
    LUMIGRID_SKIP_WITHOUT_NGINX();
    scene_ = smallScene();
    ASSERT_EQ(run("lumigrid", {"publish", scene_, path("site/tower"), "--quiet"}).status, 0);
  }
  void TearDown() override {
    for (const pid_t pid : servers_) {
      ::kill(pid, SIGTERM);
      wait(pid);
    }
    ProgramTest::TearDown();
  }

  /// Runs `lumigrid serve` until the test ends; --no-frames, so that pictures come from the repository alone. The n-th
  /// server logs to path("serve<n>.err").
  ServedSite serve(const std::string& what, const std::vector<std::string>& more = {}) {
    const std::string log = path("serve" + std::to_string(servers_.size()));
    std::vector<std::string> arguments{"serve", what, "--port", "0", "--json", "--no-frames"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    servers_.push_back(start("lumigrid", arguments, log));
    for (int i = 0; i < 2000; ++i) {
      const auto said = nlohmann::json::parse(readText(log + ".out"), nullptr, false);
      if (said.is_object()) return {said["url"], said["port"]};
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    }
    ADD_FAILURE() << readText(log + ".err");
    return {};
  }

  /// Writes path("tour.json") with so many views of the scene.
  void makeTour(int frames, int width, int height) {
    if (std::filesystem::exists(path("tour.json"))) return;
    const auto made = run("lumigrid", {"tour", scene_, "--frames", std::to_string(frames), "--size",
                                       std::to_string(width), std::to_string(height), "-o", path("tour.json")});
    EXPECT_EQ(made.status, 0) << made.err;
  }
  /// Makes that tour, and expects each picture complete and none broken; they stay in path(name). `method`: empty: the
  /// default.
  Tour tour(const std::string& url, const std::string& name, const std::string& method = "lumigraph",
            const std::vector<std::string>& more = {}) {
    std::vector<std::string> arguments{url,      "--headless",      "--settle", "60",
                                       "--path", path("tour.json"), "--out",    path(name)};
    if (!method.empty()) arguments.insert(arguments.end(), {"--method", method});
    arguments.insert(arguments.end(), more.begin(), more.end());
    const auto viewed = run("lumigrid-view", arguments);
    EXPECT_EQ(viewed.status, 0) << viewed.err;
    Tour tour;
    std::istringstream lines(readText(path(name + "/frames.jsonl")));
    for (std::string line; std::getline(lines, line);) {
      tour.lines.push_back(nlohmann::json::parse(line, nullptr, false));
      const nlohmann::json& frame = tour.lines.back();
      EXPECT_TRUE(frame.is_object() && frame["complete"].get<bool>() && frame["broken"] == 0) << line;
      auto picture = base::readPng(path(name + "/frame_000" + std::to_string(tour.pictures.size()) + ".png"));
      EXPECT_TRUE(picture) << picture.error().message;
      tour.pictures.push_back(picture ? std::move(*picture) : base::Image());
    }
    EXPECT_FALSE(tour.pictures.empty());
    return tour;
  }

  /// The picture that `lumigrid render` draws of scene_ on this disk, for a frame of the tour.
  base::Image localPicture(std::size_t frame, const std::string& method, const std::vector<std::string>& more = {}) {
    const nlohmann::json tour = nlohmann::json::parse(readText(path("tour.json")));
    nlohmann::json camera = tour["frames"][frame];
    for (const char* name : {"width", "height", "fov_y_degrees", "ortho_height"})
      if (!camera.contains(name) && tour.contains(name)) camera[name] = tour[name];
    writeText(path("camera.json"), camera.dump());
    std::vector<std::string> arguments{
        "render",          scene_, "--method", method,           "--camera", path("camera.json"),
        "--supersampling", "1",    "-o",       path("local.png")};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const auto drawn = run("lumigrid", arguments);
    EXPECT_EQ(drawn.status, 0) << drawn.err;
    auto picture = base::readPng(path("local.png"));
    EXPECT_TRUE(picture);
    return picture ? std::move(*picture) : base::Image();
  }
  /// Expects these, pixel for pixel.
  void expectLocalPictures(const Tour& streamed, const std::string& method, const std::vector<std::string>& more = {}) {
    const nlohmann::json tour = nlohmann::json::parse(readText(path("tour.json")));
    ASSERT_EQ(streamed.pictures.size(), tour["frames"].size());
    for (std::size_t i = 0; i < streamed.pictures.size(); ++i) {
      const base::Image local = localPicture(i, method, more);
      ASSERT_EQ(streamed.pictures[i].pixels.size(), local.pixels.size());
      std::size_t different = 0;
      std::size_t covered = 0;
      for (std::size_t k = 0; k < local.pixels.size(); ++k) {
        different += local.pixels[k] != streamed.pictures[i].pixels[k] ? 1 : 0;
        covered += k % 4 == 3 && local.pixels[k] > 0 ? 1 : 0;
      }
      EXPECT_EQ(different, 0U) << "frame " << i;
      EXPECT_GT(covered, 1000U) << "frame " << i;
    }
  }

  std::string scene_;
  std::vector<pid_t> servers_;
};

}  // namespace programs
