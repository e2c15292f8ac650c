#include "server/net/drawn_frames.h"

#include <utility>

#include <gtest/gtest.h>

namespace server {
namespace {

constexpr std::size_t kBytes = 4 * 8 * 8;

base::ViewCamera cameraAt(double x) {
  base::ViewCamera camera;
  camera.position.x = x;
  return camera;
}

const int kScene = 0, kOther = 0;  // addresses stand for scenes

DrawnFrames::Picture pictureOf(std::uint8_t value) {
  base::Image picture;
  picture.width = picture.height = 8;
  picture.channels = 4;
  picture.pixels.assign(kBytes, value);
  return std::make_shared<const base::Image>(std::move(picture));
}

TEST(DrawnFrames, aPictureBelongsToItsSceneAndCamera) {
  DrawnFrames frames(10 * kBytes);
  frames.add(&kScene, cameraAt(1.0), pictureOf(7));
  ASSERT_TRUE(frames.find(&kScene, cameraAt(1.0)));
  EXPECT_EQ(frames.find(&kScene, cameraAt(1.0))->pixels[0], 7);
  EXPECT_FALSE(frames.find(&kOther, cameraAt(1.0)));
  EXPECT_FALSE(frames.find(&kScene, cameraAt(1.0000001)));
  base::ViewCamera wider = cameraAt(1.0);
  wider.width += 1;
  EXPECT_FALSE(frames.find(&kScene, wider));
}

TEST(DrawnFrames, thoseThatWereNotAskedForLongestGo) {
  DrawnFrames frames(2 * kBytes);
  frames.add(&kScene, cameraAt(1.0), pictureOf(1));
  frames.add(&kScene, cameraAt(2.0), pictureOf(2));
  ASSERT_TRUE(frames.find(&kScene, cameraAt(1.0)));
  frames.add(&kScene, cameraAt(3.0), pictureOf(3));
  EXPECT_TRUE(frames.find(&kScene, cameraAt(1.0)));
  EXPECT_FALSE(frames.find(&kScene, cameraAt(2.0)));
  EXPECT_TRUE(frames.find(&kScene, cameraAt(3.0)));
  EXPECT_EQ(frames.bytes(), 2 * kBytes);
}

TEST(DrawnFrames, aPictureLargerThanTheLimitIsNotKept) {
  DrawnFrames frames(kBytes - 1);
  frames.add(&kScene, cameraAt(1.0), pictureOf(1));
  EXPECT_FALSE(frames.find(&kScene, cameraAt(1.0)));
  EXPECT_EQ(frames.bytes(), 0U);
}

TEST(DrawnFrames, aSceneIsForgottenByItself) {
  DrawnFrames frames(10 * kBytes);
  frames.add(&kScene, cameraAt(1.0), pictureOf(1));
  frames.add(&kOther, cameraAt(1.0), pictureOf(2));
  frames.forget(&kScene);
  EXPECT_FALSE(frames.find(&kScene, cameraAt(1.0)));
  EXPECT_TRUE(frames.find(&kOther, cameraAt(1.0)));
  EXPECT_EQ(frames.bytes(), kBytes);
}

}  // namespace
}  // namespace server
