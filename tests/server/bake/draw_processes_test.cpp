#include "server/bake/draw_processes.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <mutex>

#include "server/bake/draw_messages.h"
#include "tests/server/render/two_level_scene.h"
#include "tests/support/temporary_directory.h"

namespace server {
namespace {

using repository::FaceKey;

std::vector<test::Triangle> square() {
  const glm::u8vec4 color(200, 100, 50, 255);
  return {{{-1, -1, 0}, {1, -1, 0}, {1, 1, 0}, color}, {{-1, -1, 0}, {1, 1, 0}, {-1, 1, 0}, color}};
}

class DrawProcessesTest : public testing::Test {
 protected:
  DrawProcessesTest() : scene_(square(), {square()}, 0.1F) {
    work_.grid = repository::makeGrid(base::Aabb{{-1, -1, 0}, {1, 1, 0}}, 4, 0.5F, 32);
  }

  struct ReceivedFaces {
    std::map<std::uint64_t, EncodedFace> faces;  // by sequence number
    std::vector<base::Error> errors;
  };
  FaceMaker::OnFace collectInto(ReceivedFaces& made) {
    return [this, &made](std::uint64_t sequence, const FaceKey& key, EncodedFace face) {
      const std::lock_guard lock(mutex_);
      EXPECT_EQ(key, keyOf(sequence));
      EXPECT_TRUE(made.faces.emplace(sequence, std::move(face)).second) << sequence << " came twice";
    };
  }
  FaceMaker::OnError errorInto(ReceivedFaces& made) {
    return [this, &made](const base::Error& error) {
      const std::lock_guard lock(mutex_);
      made.errors.push_back(error);
    };
  }
  FaceKey keyOf(std::uint64_t sequence) const {
    const glm::uvec3 p = repository::pointsInMortonOrder(work_.grid)[sequence / 6];
    return {p.x, p.y, p.z, static_cast<std::uint32_t>(sequence % 6)};
  }
  void submitAll(FaceMaker& maker) const {
    for (std::uint64_t sequence = 0; sequence < work_.grid.faceCount(); sequence += 6) {
      DrawJob job{sequence, {}};
      for (std::uint64_t d = 0; d < 6; ++d) job.keys.push_back(keyOf(sequence + d));
      maker.submit(std::move(job));
    }
    maker.finish();
  }
  ReceivedFaces makeHere() {
    ReceivedFaces made;
    submitAll(*makeLocalFaceMaker(work_, 2, collectInto(made), errorInto(made)));
    return made;
  }
  ReceivedFaces makeBy(unsigned processes, std::vector<std::string> arguments = {},
                       const std::string& program = DRAW_PROCESS) {
    ReceivedFaces made;
    arguments.insert(arguments.begin(), program);
    submitAll(*makeProcessFaceMaker(work_, arguments, processes, collectInto(made), errorInto(made)));
    return made;
  }
  static void expectSame(const ReceivedFaces& made, const ReceivedFaces& wanted) {
    EXPECT_TRUE(made.errors.empty()) << made.errors.front().message;
    ASSERT_EQ(made.faces.size(), wanted.faces.size());
    for (const auto& [sequence, face] : wanted.faces) {
      const EncodedFace& other = made.faces.at(sequence);
      ASSERT_EQ(other.tiles.size(), face.tiles.size()) << sequence;
      for (std::size_t i = 0; i < face.tiles.size(); ++i) {
        EXPECT_EQ(other.tiles[i].tile, face.tiles[i].tile) << sequence;
        EXPECT_EQ(other.tiles[i].value, face.tiles[i].value) << sequence;
      }
      EXPECT_EQ(other.empty, face.empty) << sequence;
      EXPECT_EQ(other.jpeg_bytes, face.jpeg_bytes) << sequence;
      EXPECT_EQ(other.coverage_bytes, face.coverage_bytes) << sequence;
    }
  }

  test::TwoLevelScene scene_;
  FaceWork work_{scene_.scene(), scene_.file(), {}, {}};
  support::TemporaryDirectory directory_;
  std::mutex mutex_;
};

TEST_F(DrawProcessesTest, anyNumberOfProcessesMakesTheSameBytesAsOneThread) {
  const ReceivedFaces here = makeHere();
  ASSERT_EQ(here.faces.size(), work_.grid.faceCount());
  for (const unsigned processes : {1U, 2U, 3U}) expectSame(makeBy(processes), here);
}

TEST_F(DrawProcessesTest, successorFinishesTheJobsOfADeadProcess) {
  const ReceivedFaces here = makeHere();
  for (const char* face : {"0", "8", "17"}) {
    const std::string mark = directory_ / ("died at " + std::string(face));
    expectSame(makeBy(2, {mark, face}), here);
    EXPECT_TRUE(std::filesystem::exists(mark)) << "no process died";
  }
}

TEST_F(DrawProcessesTest, processesThatDieAgainAndAgainAreGivenUp) {
  const ReceivedFaces made = makeBy(2, {"-", "0"});
  ASSERT_EQ(made.errors.size(), 1U);
  EXPECT_NE(made.errors.front().message.find("signal 9"), std::string::npos) << made.errors.front().message;
  EXPECT_TRUE(made.faces.empty());
}

TEST_F(DrawProcessesTest, aProgramThatIsNotThereIsAnError) {
  const ReceivedFaces made = makeBy(2, {}, "/nowhere/draw");
  ASSERT_EQ(made.errors.size(), 1U);
  EXPECT_EQ(made.errors.front().code, base::ErrorCode::kIo);
  EXPECT_NE(made.errors.front().message.find("/nowhere/draw"), std::string::npos) << made.errors.front().message;
}

TEST_F(DrawProcessesTest, reportsTheReasonOfAFailedDraw) {
  work_.grid.face_size = 40000;  // more than a picture may have
  const ReceivedFaces made = makeBy(2);
  ASSERT_EQ(made.errors.size(), 1U);
  EXPECT_NE(made.errors.front().message.find("40000"), std::string::npos) << made.errors.front().message;
  EXPECT_TRUE(made.faces.empty());
}

// Where software draws, processes draw all images: an option that did not reach them would have no effect.
TEST_F(DrawProcessesTest, ordersCarryAllThatABakeAsksOfTheRenderer) {
  work_.render = {.tolerance_px = 0.75F,
                  .supersampling = 3,
                  .max_target_samples = 5'000'000'000,
                  .measure = base::ErrorMeasure::kBound,
                  .tile_samples = 6'000'000'000,
                  .one_of_many = true};
  const auto order = decodeOrder(encodeOrder(work_));
  ASSERT_TRUE(order);
  EXPECT_EQ(order->render.tolerance_px, 0.75F);
  EXPECT_EQ(order->render.supersampling, 3);
  EXPECT_EQ(order->render.max_target_samples, 5'000'000'000U);
  EXPECT_EQ(order->render.measure, base::ErrorMeasure::kBound);
  EXPECT_EQ(order->render.tile_samples, 6'000'000'000U);
  EXPECT_TRUE(order->render.one_of_many);
}

// Orders, jobs and faces that are cut at any length are errors.
TEST_F(DrawProcessesTest, messagesCutShortAreRefused) {
  const base::Bytes order = encodeOrder(work_);
  const base::Bytes job = encodeJob({7, {{1, 2, 3, 4}}});
  const base::Bytes error = encodeError({base::ErrorCode::kIo, "why"});
  ASSERT_TRUE(decodeOrder(order));
  EXPECT_EQ(decodeOrder(order)->grid, work_.grid);
  ASSERT_TRUE(decodeJob(job));
  EXPECT_EQ(decodeError(error).message, "why");
  for (std::size_t length = 0; length < order.size(); ++length)
    EXPECT_FALSE(decodeOrder(base::ByteView(order).first(length))) << length;
  for (std::size_t length = 0; length < job.size(); ++length)
    EXPECT_FALSE(decodeJob(base::ByteView(job).first(length))) << length;
  for (std::size_t length = 0; length < error.size(); ++length)
    EXPECT_NE(decodeError(base::ByteView(error).first(length)).message, "why") << length;
  EXPECT_FALSE(decodeNumberedFace(base::Bytes(24)));
}

}  // namespace
}  // namespace server
