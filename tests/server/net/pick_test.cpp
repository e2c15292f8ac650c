#include "server/net/pick.h"

#include <gtest/gtest.h>

#include <atomic>
#include <future>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "tests/server/net/loopback.h"
#include "tests/server/net/served_scene.h"

namespace server {
namespace {

std::string target(const std::string& origin_z, const std::string& direction_z) {
  return "/pick?ox=500016.3&oy=4000016.2&oz=" + origin_z + "&dx=0&dy=0&dz=" + direction_z;
}

// Returns the height of the nearest leaf triangle straight below, by the textbook's formula in doubles.
double heightBelow(const SceneDirectory& scene, double x, double y) {
  const auto patches = lod::patch::PatchFile::open(scene.path + "/patch.lgp");
  const lod::patch::Hierarchy& hierarchy = patches->hierarchy();
  double highest = -1e300;
  for (std::uint32_t i = 0; i < hierarchy.patches.size(); ++i) {
    if (hierarchy.patches[i].level != 0) continue;
    const auto geometry = patches->geometry(i);
    const auto at = [&](std::size_t corner) {
      return glm::dvec3(hierarchy.lattice.position(geometry->positions[geometry->indices[corner]]));
    };
    for (std::size_t t = 0; t < geometry->indices.size(); t += 3) {
      const glm::dvec3 a = at(t), b = at(t + 1), c = at(t + 2);
      const double area = (b.x - a.x) * (c.y - a.y) - (c.x - a.x) * (b.y - a.y);
      const double v = ((x - a.x) * (c.y - a.y) - (c.x - a.x) * (y - a.y)) / area;
      const double w = ((b.x - a.x) * (y - a.y) - (x - a.x) * (b.y - a.y)) / area;
      if (v >= 0.0 && w >= 0.0 && v + w <= 1.0) highest = std::max(highest, a.z + v * (b.z - a.z) + w * (c.z - a.z));
    }
  }
  return highest;
}

TEST(Pick, pointBelowIsFoundInWorldCoordinates) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  const double height = heightBelow(scene, 16.3, 16.2);
  ASSERT_GT(height, -1e300);
  for (const auto& [origin, direction, distance] :
       {std::tuple("600", "-2", 500.0 - height), std::tuple("-300", "1e-3", 400.0 + height)}) {
    const HttpAnswer answer = httpRequest(server.port(), target(origin, direction));
    ASSERT_EQ(answer.status, 200) << answer.body;
    EXPECT_EQ(answer.headers.at("content-type"), "application/json");
    EXPECT_EQ(answer.headers.at("cache-control"), "no-store");
    const auto json = nlohmann::json::parse(answer.body);
    ASSERT_TRUE(json["hit"].get<bool>());
    EXPECT_NEAR(json["point"][0].get<double>(), 500016.3, 1e-6);
    EXPECT_NEAR(json["point"][1].get<double>(), 4000016.2, 1e-6);
    EXPECT_NEAR(json["point"][2].get<double>(), 100.0 + height, 1e-6);
    EXPECT_NEAR(json["distance"].get<double>(), distance, 1e-6);
    EXPECT_GT(json["accuracy"].get<double>(), 0.0);
    EXPECT_EQ(json["unit"], "m");
    // The normal points back along the ray, whichever side the ray comes from.
    EXPECT_LT(json["normal"][2].get<double>() * std::stod(direction), 0.0);
  }
}

TEST(Pick, readErrorsAreCountedByScene) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  std::filesystem::resize_file(scene.path + "/patch.lgp", 4096);
  ASSERT_EQ(httpRequest(server.port(), target("600", "-1")).status, 503);
  const std::string figures = httpRequest(server.port(), "/metrics").body;
  const std::string name = std::filesystem::path(scene.path).filename();
  EXPECT_NE(figures.find("lumigrid_read_errors_total{scene=\"" + name + "\"} 1\n"), std::string::npos) << figures;
}

TEST(Pick, rayThatHitsNothingIsNoError) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  const HttpAnswer answer = httpRequest(server.port(), target("600", "1"));
  EXPECT_EQ(answer.status, 200);
  EXPECT_EQ(answer.body, "{\"hit\":false,\"unit\":\"m\"}\n");
}

TEST(Pick, badNumbersAreNamedInOneLine) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  for (const std::string bad : {"/pick", "/pick?", "/pick?ox=1", "/pick?ox=1&oy=1&oz=1&dx=0&dy=0&dz=0",
                                "/pick?ox=1&oy=1&oz=nan&dx=0&dy=0&dz=1", "/pick?ox=1e300&oy=1&oz=1&dx=0&dy=0&dz=1",
                                "/pick?ox=1&oy=1&oz=1&dx=0&dy=0&dz=1&more=1", "/pick?ox=&oy=1&oz=1&dx=0&dy=0&dz=1",
                                "/pick?ox=%00&oy=1&oz=1&dx=0&dy=0&dz=1", "/pick?ox=1&ox=1&oz=1&dx=0&dy=0&dz=1"}) {
    const HttpAnswer answer = httpRequest(server.port(), bad);
    EXPECT_EQ(answer.status, 400) << bad;
    EXPECT_EQ(answer.headers.at("content-type"), "text/plain; charset=utf-8");
    EXPECT_EQ(std::count(answer.body.begin(), answer.body.end(), '\n'), 1) << answer.body;
    EXPECT_GT(answer.body.size(), 10U);
  }
  EXPECT_EQ(httpRequest(server.port(), "/pick?" + std::string(5000, 'a') + "=1").status, 400);
  EXPECT_EQ(httpRequest(server.port(), "/pick?a=" + std::string(100'000, 'a')).status, 431);
  EXPECT_EQ(httpRequest(server.port(), target("600", "-1"), {}, "POST").status, 405);
  EXPECT_EQ(httpRequest(server.port(), "/healthz").status, 200);
}

TEST(Pick, headChecksTheQueryWithoutCastingARay) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  const HttpAnswer head = httpRequest(server.port(), target("600", "-1"), {}, "HEAD");
  EXPECT_EQ(head.status, 200);
  EXPECT_EQ(head.body, "");
  EXPECT_EQ(httpRequest(server.port(), "/pick", {}, "HEAD").status, 400);
}

TEST(Pick, manyRequestsAtOnceAreAllAnswered) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  std::atomic<int> good{0};
  std::vector<std::thread> visitors;
  for (int i = 0; i < 16; ++i)
    visitors.emplace_back([&] {
      for (int k = 0; k < 10; ++k) good += httpRequest(server.port(), target("600", "-1")).status == 200 ? 1 : 0;
    });
  for (std::thread& visitor : visitors) visitor.join();
  EXPECT_EQ(good, 160);
}

// Two requests are sent at once; the second waits for the answer to the first.
TEST(Pick, requestsThatComeTogetherAreAnsweredInTurn) {
  const SceneDirectory scene(0);
  RunningServer server(scene.path);
  const std::string first = "GET " + target("600", "-1") + " HTTP/1.1\r\nHost: localhost\r\n\r\n";
  const std::string last = "GET " + target("600", "1") + " HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n";
  const std::string answers = rawExchange(server.port(), first + last);
  const std::size_t hit = answers.find("{\"hit\":true");
  const std::size_t miss = answers.find("{\"hit\":false");
  ASSERT_NE(hit, std::string::npos);
  ASSERT_NE(miss, std::string::npos);
  EXPECT_LT(hit, miss);
}

TEST(Pick, raysBeyondTheQueueAreRefused) {
  const SceneDirectory scene(0);
  const auto patches = lod::patch::PatchFile::open(scene.path + "/patch.lgp");
  const auto document = base::readScene(scene.path);
  std::mutex hold;
  std::unique_lock held(hold);
  std::atomic<std::size_t> answered{0};
  std::size_t taken = 0;
  {
    Picker picker(*document, *patches);
    const lod::patch::Ray ray{{500016.0, 4000016.0, 600.0}, {0.0, 0.0, -1.0}};
    const auto done = [&](const base::Result<std::string>&) {
      const std::lock_guard wait(hold);
      ++answered;
    };
    while (picker.submit(taken, std::to_string(taken), ray, done)) ASSERT_LE(++taken, Picker::kMaxQueued + 1);
    EXPECT_GE(taken, Picker::kMaxQueued);
    held.unlock();
  }
  EXPECT_LE(answered, taken);
}

TEST(Pick, oneAddressHasAQuarterOfTheQueueAndGivesBackWhatItCancels) {
  const SceneDirectory scene(0);
  const auto patches = lod::patch::PatchFile::open(scene.path + "/patch.lgp");
  const auto document = base::readScene(scene.path);
  std::promise<void> begun, go_on;
  std::atomic<std::size_t> answered{0};
  std::atomic<bool> cancelled_was_cast{false};
  const lod::patch::Ray ray{{500016.0, 4000016.0, 600.0}, {0.0, 0.0, -1.0}};
  const auto count = [&](const base::Result<std::string>&) { ++answered; };
  {
    Picker picker(*document, *patches);
    // A ray of another address holds the thread.
    ASSERT_TRUE(picker.submit(1, "first", ray, [&](const base::Result<std::string>&) {
      begun.set_value();
      go_on.get_future().wait();
    }));
    begun.get_future().wait();
    ASSERT_TRUE(picker.submit(2, "greedy", ray, [&](const base::Result<std::string>&) { cancelled_was_cast = true; }));
    for (std::size_t i = 1; i < Picker::kMaxOfOneAddress; ++i)
      ASSERT_TRUE(picker.submit(100 + i, "greedy", ray, count)) << i;
    EXPECT_FALSE(picker.submit(3, "greedy", ray, count));
    EXPECT_TRUE(picker.submit(4, "modest", ray, count));
    picker.cancel(2);
    picker.cancel(2);
    std::promise<void> last;
    EXPECT_TRUE(picker.submit(5, "greedy", ray, [&](const base::Result<std::string>&) { last.set_value(); }));
    EXPECT_FALSE(picker.submit(6, "greedy", ray, count));
    go_on.set_value();
    last.get_future().wait();
  }
  EXPECT_EQ(answered, Picker::kMaxOfOneAddress);
  EXPECT_FALSE(cancelled_was_cast);
}

}  // namespace
}  // namespace server
