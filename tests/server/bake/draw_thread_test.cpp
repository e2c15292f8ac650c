#include "server/bake/draw_thread.h"

#include <gtest/gtest.h>

#include <atomic>
#include <map>

#include "base/egl/headless.h"
#include "tests/server/render/two_level_scene.h"

namespace server {
namespace {

using repository::FaceKey;

constexpr std::uint64_t kBudget = 1 << 26;

std::vector<test::Triangle> square() {
  const glm::u8vec4 color(200, 100, 50, 255);
  return {{{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, color}, {{-1, -1, 0}, {1, 1, 0}, {-1, 1, 0}, color}};
}

class DrawThreadTest : public testing::Test {
 protected:
  DrawThreadTest() : scene_(square(), {square()}, 0.1F) {
    grid_ = repository::makeGrid(base::Aabb{{-1, -1, 0}, {1, 1, 0}}, 4, 0.5F, 32);
  }
  FaceWork work() {
    FaceWork all{scene_.scene(), scene_.file(), grid_, {}};
    all.gpu_budget_bytes = kBudget;
    return all;
  }
  std::vector<DrawJob> allJobs() const {
    std::vector<DrawJob> jobs;
    for (const glm::uvec3& point : repository::pointsInMortonOrder(grid_)) {
      DrawJob job{6 * jobs.size(), {}};
      for (std::uint32_t d = 0; d < 6; ++d) job.keys.push_back({point.x, point.y, point.z, d});
      jobs.push_back(std::move(job));
    }
    return jobs;
  }
  // Returns the pictures that came, by sequence number.
  std::map<std::uint64_t, base::Image> drawAll() {
    std::map<std::uint64_t, base::Image> pictures;
    const std::vector<DrawJob> jobs = allJobs();
    DrawThread thread(
        work(),
        [&](std::uint64_t sequence, const FaceKey& key, RenderedPicture rendered) {
          const std::lock_guard lock(mutex_);
          EXPECT_EQ(key, jobs[sequence / 6].keys[sequence % 6]);
          EXPECT_TRUE(pictures.emplace(sequence, std::move(rendered.rgba)).second) << sequence << " came twice";
        },
        [](const base::Error& error) { ADD_FAILURE() << error.message; });
    for (const DrawJob& job : jobs) thread.submit(job);
    thread.finish();
    return pictures;
  }

  test::TwoLevelScene scene_;
  repository::Grid grid_;
  std::mutex mutex_;
};

// One thread draws, since several contexts that draw at a time can crash within llvmpipe (draw_thread.h).
TEST_F(DrawThreadTest, everyFaceComesOnceAndLooksTheSameEveryTime) {
  const auto one = drawAll();
  ASSERT_EQ(one.size(), grid_.faceCount());
  const auto again = drawAll();
  ASSERT_EQ(again.size(), one.size());
  for (const auto& [sequence, picture] : one) EXPECT_EQ(again.at(sequence).pixels, picture.pixels) << sequence;
}

// The next job is held back until all pictures of the one before have come: a thread that kept pictures would hang
// here.
TEST_F(DrawThreadTest, aThreadWithoutAJobDeliversWhatIsOnItsWay) {
  std::uint64_t taken = 0;
  std::condition_variable changed;
  DrawThread thread(
      work(),
      [&](std::uint64_t, const FaceKey&, const RenderedPicture&) {
        const std::lock_guard lock(mutex_);
        ++taken;
        changed.notify_all();
      },
      [](const base::Error& error) { ADD_FAILURE() << error.message; });
  std::uint64_t submitted = 0;
  for (const DrawJob& job : allJobs()) {
    thread.submit(job);
    submitted += job.keys.size();
    std::unique_lock lock(mutex_);
    changed.wait(lock, [&] { return taken == submitted; });
  }
  thread.finish();
  EXPECT_EQ(taken, grid_.faceCount());
}

TEST_F(DrawThreadTest, aFailureIsToldOnceAndNothingIsWaitedForAfterIt) {
  grid_.face_size = 40000;  // more than a picture may have
  std::atomic<int> told{0};
  std::atomic<int> taken{0};
  DrawThread thread(
      work(), [&](std::uint64_t, const FaceKey&, const RenderedPicture&) { ++taken; },
      [&](const base::Error& error) {
        EXPECT_NE(error.message.find("40000"), std::string::npos) << error.message;
        ++told;
      });
  for (const DrawJob& job : allJobs()) thread.submit(job);
  thread.finish();
  EXPECT_EQ(told, 1);
  EXPECT_EQ(taken, 0);
}

}  // namespace
}  // namespace server
